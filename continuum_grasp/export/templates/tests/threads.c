/* All vectors in several threads at once: threads [TOLERANCE]. */
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>

#include "check.h"

#define THREADS 4

static <<p>>_real tolerance;

static void *work(void *failed)
{
  int function;
  for (function = 0; function < CHECK_FUNCTIONS; ++function) *(int *)failed += check_failures(function, tolerance);
  return NULL;
}

int main(int count, char **words)
{
  pthread_t threads[THREADS];
  int failed[THREADS] = {0}, k, sum = 0;
  tolerance = count > 1 ? (<<p>>_real)strtod(words[1], NULL) : 0;
  for (k = 0; k < THREADS; ++k)
    if (pthread_create(&threads[k], NULL, work, &failed[k])) return EXIT_FAILURE;
  for (k = 0; k < THREADS; ++k) {
    pthread_join(threads[k], NULL);
    sum += failed[k];
  }
  printf("%d threads: %d cases failed\n", THREADS, sum);
  return sum ? EXIT_FAILURE : EXIT_SUCCESS;
}
