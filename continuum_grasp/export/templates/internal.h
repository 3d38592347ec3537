/* What the kernels and the checked layer share; no part of the interface. */
#ifndef <<P>>_INTERNAL_H
#define <<P>>_INTERNAL_H

#include "<<p>>.h"

/* Whether a number is finite, by the bits of its exponent: compilers that may assume that there is no NaN (-ffast-math)
   would drop a comparison. They are read through a volatile, so that they are looked at. */
<<P>>_API static inline int <<p>>_is_finite(const <<p>>_real *number)
{
  union { <<p>>_real value; uint<<width>>_t bits; } seen;
  const volatile uint<<width>>_t *bits = &seen.bits;
  seen.value = *number;
  return (*bits & <<exponent>>) != <<exponent>>;
}

<<kernels>>

#endif
