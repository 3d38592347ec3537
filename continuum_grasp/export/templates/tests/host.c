#include <stddef.h>
#include <string.h>
#include "check.h"
<<for f in functions|\n>><<f.runner>><<end>>
<<for f in functions>>int host_<<f.name>>(check_memory *memory, const <<p>>_real *row, <<p>>_real *out)
{
  return run_<<f.name>>(memory, row, out, 0, 0, 1);
}
<<end>>
size_t host_size(int which)
{
  const size_t sizes[] = {<<for name in owners>>sizeof(<<p>>_<<name>>), <<end>>sizeof(check_memory)};
  return sizes[which];
}
