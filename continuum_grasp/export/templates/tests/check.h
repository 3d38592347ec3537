/* Runs the vectors. */
#ifndef <<P>>_CHECK_H
#define <<P>>_CHECK_H

#include "<<p>>.h"

#define CHECK_FUNCTIONS <<count>>

enum { CHECK_USUAL, CHECK_START, CHECK_HARD, CHECK_KINDS };

/* What functions keep and work in; to be zero at first. */
typedef struct {<<for f in contents.stateful>><<for name in f.types>>
  <<p>>_<<name>> <<name>>;<<end>><<end>><<if not contents.stateful>>
  int nothing;<<end>>
} check_memory;

/* Name of a function, and how many rows it has; check_run calls it on a row so many times, and returns its code. Rows of a
   function that keeps something (check_stateful) follow on each other; they are of a kind: CHECK_USUAL, CHECK_START without a
   plan before, CHECK_HARD with changed limits and measurements that are far off. */
const char *check_name(int function);
int check_rows(int function);
int check_stateful(int function);
int check_kind(int function, int row);
int check_run(int function, int row, int repeat, check_memory *memory);

/* Cases of a function, and how many of them fail. A tolerance of zero asks for every bit; otherwise outputs may differ by
   so much of the greatest one of their row, those of stateful functions by <<adds_up>> times as much. Codes, and outputs that must be left alone, are never tolerated otherwise. */
int check_cases(int function);
int check_failures(int function, <<p>>_real tolerance, check_memory *memory);

/* So many rows of random bits, or good ones with some of them: how many times an error did not leave the
   output alone, or an output was not finite. */
int check_fuzz(int function, long rows, uint32_t *seed, check_memory *memory);

#endif
