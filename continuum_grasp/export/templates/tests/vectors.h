/* Test vectors: rows of inputs (parameters, structs, numbers in the order of the arguments), the outputs and the codes
   that belong to them. The outputs were computed without this library, in the same order of operations. */
#ifndef <<P>>_VECTORS_H
#define <<P>>_VECTORS_H

#include "<<p>>.h"

/* A row of good inputs with one entry replaced. */
typedef struct {
  int row, entry;
  uint<<width>>_t bits;
  int code;
} bad_input;

<<tables>>
#endif
