#include <stddef.h>

#include "<<p>>.h"

const size_t sizes[] = {<<for name in types|, >>sizeof(<<p>>_<<name>>)<<end>>};
