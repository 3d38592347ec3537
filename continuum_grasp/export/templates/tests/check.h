/* Runs the vectors. */
#ifndef <<P>>_CHECK_H
#define <<P>>_CHECK_H

#include "<<p>>.h"

#define CHECK_FUNCTIONS <<count>>

/* Runs a function on row k, so many times. */
const char *check_name(int function);
int check_rows(int function);
int check_run(int function, int row, int repeat);

/* Cases of a function, and how many of them fail. A tolerance of zero asks for every bit; otherwise outputs may differ by
   so much of the greatest one of their row. Codes, and outputs that must be left alone, are never tolerated otherwise. */
int check_cases(int function);
int check_failures(int function, <<p>>_real tolerance);

#endif
