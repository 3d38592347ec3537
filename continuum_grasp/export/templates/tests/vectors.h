/* Test vectors: rows of inputs (parameters, structs, numbers in the order of the arguments), the outputs and the codes
   that belong to them. The outputs were computed without this library, in the same order of operations. */
#ifndef <<P>>_VECTORS_H
#define <<P>>_VECTORS_H

#include "<<p>>.h"

/* One entry of a row replaced: of a good row, and the code that belongs to it; or where it is not finite, for which C has
   no literal. */
typedef struct {
  int row, entry;
  uint<<width>>_t bits;
  int code;
} spoilt_value;

<<for table in tables|\n>>static const <<p>>_real <<table.name>>_inputs[] = {
<<for row in table.inputs|,\n>>  <<row>><<end>>
};
static const <<p>>_real <<table.name>>_outputs[] = {
<<for row in table.outputs|,\n>>  <<row>><<end>>
};
static const signed char <<table.name>>_codes[] = {<<for code in table.codes|, >><<code>><<end>>};
static const spoilt_value <<table.name>>_bad[] = {
<<for row in table.bad|,\n>>  {<<for value in row|, >><<value>><<end>>}<<end>>
};
static const spoilt_value <<table.name>>_spoilt[] = {
<<for row in table.spoilt|,\n>>  {<<for value in row|, >><<value>><<end>>}<<end>>
};
<<end>>
#endif
