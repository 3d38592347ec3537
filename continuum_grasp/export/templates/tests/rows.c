#include <stdint.h>

#define C_API
typedef <<real>> c_real;
static int c_is_finite(const c_real *number) { return *number - *number == 0; }

<<source>>
void rows(long count, <<for name, size in arguments|, >>c_real *<<name>><<end>>)
{
  long k;
  for (k = 0; k < count; ++k) c_kernel_<<kernel>>(<<for name, size in arguments|, >><<name>> + <<size>> * k<<end>>);
}
