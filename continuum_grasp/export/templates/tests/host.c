#include <stddef.h>
#include <string.h>
#include "check.h"
<<for f in contents.stateful|\n>><<f.runner>><<end>>
<<for f in contents.stateful>>int host_<<f.name>>(check_memory *memory, const <<p>>_real *row, <<p>>_real *out)
{
  return <<f.name>>_run(memory, row, out, 0, 0, 1);
}
<<end>>
const size_t host_bytes = sizeof(check_memory);

/* Writes the numbers of a member behind each other, or takes them from there. */
#define PASS(type, member) \
  for (k = 0; k < sizeof at->member / sizeof(type); ++k, ++number) { \
    if (taken) ((type *)&at->member)[k] = (type)*number; \
    else *number = (double)((type *)&at->member)[k]; \
  }
#define PASS_STRUCT(type, member) number = pass_##type(&at->member, number, taken);

<<for name, members in passed>>static double *pass_<<name>>(<<name>> *at, double *number, int taken)
{
  size_t k;
<<members>>
  return number;
}

<<end>>/* What all functions retain, as doubles: how many numbers. */
size_t host_retained(check_memory *at, double *numbers, int taken)
{
  double *number = numbers;
<<for type, member in retained>>  PASS_STRUCT(<<type>>, <<member>>)
<<end>>  return (size_t)(number - numbers);
}
