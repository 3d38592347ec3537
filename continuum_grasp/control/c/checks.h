/* Whether numbers can be used. Finiteness is tested by bits, since -ffast-math lets a compiler drop isfinite(), and
 * before any comparison with a limit, which is false for NaN.
 *
 * `real` is set before this file is read, and CG_SINGLE defined if that is float.
 */
#ifndef CG_CHECKS_H
#define CG_CHECKS_H
#include <stdint.h>
#include <string.h>

enum {                        /* verdict on a measurement */
  CG_USED = 0,
  CG_MISSING = 1,             /* NaN: not measured now */
  CG_ABSURD = 2,              /* infinite, or beyond its limits */
  CG_OUTLIER = 3,             /* too far from what was expected: rejected */
  CG_REOPENED = 4,            /* used with bounded influence: too far too often, so the model is wrong */
  CG_ALONE = 5,               /* good, but useless without another reading of its sensor that is not */
  CG_FROZEN = 6               /* repeats the same number: counts as missing until it moves */
};

enum {                        /* worth of an estimate */
  CG_SEES = 0,
  CG_CONTRADICTED = 1,        /* a sensor contradicts the model */
  CG_PREDICTS = 2,            /* nothing shows the shape of the finger in this call */
  CG_BLIND = 3                /* tripped, a reading is frozen, or for as long as a plan lasts nothing showed the shape, or no
                                 plan was found */
};

#ifdef CG_SINGLE
typedef uint32_t cg_bits;
#define CG_EXPONENT ((cg_bits)0x7f800000)
#define CG_FRACTION ((cg_bits)0x007fffff)
#else
typedef uint64_t cg_bits;
#define CG_EXPONENT ((cg_bits)0x7ff0000000000000)
#define CG_FRACTION ((cg_bits)0x000fffffffffffff)
#endif
#ifndef CG_SQRT
#include <math.h>
#ifdef CG_SINGLE
#define CG_SQRT sqrtf
#else
#define CG_SQRT sqrt
#endif
#endif

static inline cg_bits cg_bits_of(real a)
{
  cg_bits bits;
  memcpy(&bits, &a, sizeof bits);
  return bits;
}

static inline int cg_is_nan(real a)
{
  const cg_bits bits = cg_bits_of(a);
  return (bits & CG_EXPONENT) == CG_EXPONENT && (bits & CG_FRACTION) != 0;
}

static inline int cg_finite(const real *a, int count)
{
  int good = 1;
  for (int i = 0; i < count; ++i) good &= (cg_bits_of(a[i]) & CG_EXPONENT) != CG_EXPONENT;
  return good;
}

static inline real cg_nan(void)
{
  const cg_bits bits = CG_EXPONENT | CG_FRACTION; /* quiet; under -ffast-math 0 / 0 may be anything */
  real a;
  memcpy(&a, &bits, sizeof a);
  return a;
}

/* Whether all numbers are finite and within their limits. */
static inline int cg_within(const real *a, const real *least, const real *most, int count)
{
  int good = cg_finite(a, count);
  for (int i = 0; good && i < count; ++i) good = a[i] >= least[i] && a[i] <= most[i];
  return good;
}

/* Verdict on a measurement alone, before the estimator sees it. */
static inline int cg_verdict(real a, real least, real most)
{
  return cg_is_nan(a) ? CG_MISSING : cg_within(&a, &least, &most, 1) ? CG_USED : CG_ABSURD;
}

/* Clip a finite number to its limits; whether it was outside. */
static inline int cg_limit(real *a, real least, real most)
{
  const int outside = *a < least || *a > most;
  *a = *a < least ? least : *a > most ? most : *a;
  return outside;
}
#endif
