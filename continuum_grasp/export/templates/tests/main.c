/* Runs the vectors and says how many failed: test_vectors [TOLERANCE]. */
#include <stdio.h>
#include <stdlib.h>

#include "check.h"

static check_memory memory;

int main(int count, char **words)
{
  const <<p>>_real tolerance = count > 1 ? (<<p>>_real)strtod(words[1], NULL) : 0;
  int function, failed = 0;
  for (function = 0; function < CHECK_FUNCTIONS; ++function) {
    const int failures = check_failures(function, tolerance, &memory);
    printf("%-16s %4d of %4d cases failed\n", check_name(function), failures, check_cases(function));
    failed += failures;
  }
  return failed ? EXIT_FAILURE : EXIT_SUCCESS;
}
