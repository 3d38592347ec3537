/* Runs the vectors. */
#ifndef <<P>>_CHECK_H
#define <<P>>_CHECK_H

#include "<<p>>.h"

#define CHECK_FUNCTIONS <<count>>

/* Name of a function, and how many rows it has; check_run calls it on a row so many times, and returns its code. */
const char *check_name(int function);
int check_rows(int function);
int check_run(int function, int row, int repeat);

/* Cases of a function, and how many of them fail. A tolerance of zero asks for every bit; otherwise outputs may differ by
   so much of the greatest one of their row. Codes, and outputs that must be left alone, are never tolerated otherwise. */
int check_cases(int function);
int check_failures(int function, <<p>>_real tolerance);

/* So many rows of random bits, every other one a good row with some of them: how many times an error did not leave the
   output alone, or an output was not finite. */
int check_fuzz(int function, long rows, uint32_t *seed);

#endif
