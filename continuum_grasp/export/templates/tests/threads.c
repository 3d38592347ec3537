/* All vectors in several threads at once: threads [TOLERANCE]. */
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>

#include "check.h"

#define THREADS 4

typedef struct {
  int failed;
  check_memory memory;
} job;

static <<p>>_real tolerance;
static job jobs[THREADS];

static void *work(void *given)
{
  job *own = given;
  int function;
  for (function = 0; function < CHECK_FUNCTIONS; ++function)
    own->failed += check_failures(function, tolerance, &own->memory);
  return NULL;
}

int main(int count, char **words)
{
  pthread_t threads[THREADS];
  int k, sum = 0;
  tolerance = count > 1 ? (<<p>>_real)strtod(words[1], NULL) : 0;
  for (k = 0; k < THREADS; ++k)
    if (pthread_create(&threads[k], NULL, work, &jobs[k])) return EXIT_FAILURE;
  for (k = 0; k < THREADS; ++k) {
    pthread_join(threads[k], NULL);
    sum += jobs[k].failed;
  }
  printf("%d threads: %d cases failed\n", THREADS, sum);
  return sum ? EXIT_FAILURE : EXIT_SUCCESS;
}
