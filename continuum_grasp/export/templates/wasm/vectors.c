/* All vectors of a function, for JavaScript. */
#include "check.h"

int vectors_failures(int function);

int vectors_failures(int function)
{
  static check_memory memory;
  return check_failures(function, 0, &memory);
}
