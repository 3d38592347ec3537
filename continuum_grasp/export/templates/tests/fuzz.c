/* Any bits as inputs: fuzz [COUNT [SEED]]. Whatever comes in, an error leaves the output alone, and what is written is
   finite. */
#include <stdio.h>
#include <stdlib.h>

#include "check.h"

static check_memory memory;

int main(int count, char **words)
{
  const long rows = count > 1 ? strtol(words[1], NULL, 10) : 20000;
  uint32_t seed = count > 2 ? (uint32_t)strtoul(words[2], NULL, 10) : 1u;
  int function, failed = 0;
  for (function = 0; function < CHECK_FUNCTIONS; ++function) {
    const long share = check_stateful(function) ? rows / 20 : rows;
    const int failures = check_fuzz(function, share, &seed, &memory);
    printf("%-16s %4d of %ld rows failed\n", check_name(function), failures, share);
    failed += failures;
  }
  return failed ? EXIT_FAILURE : EXIT_SUCCESS;
}
