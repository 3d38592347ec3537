#include <stddef.h>
#include <string.h>
#include "check.h"
<<runners>>
<<exported>>
size_t host_size(int which)
{
  const size_t sizes[] = {<<sizes>>, sizeof(check_memory)};
  return sizes[which];
}
