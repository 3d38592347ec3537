#if defined(__AVX512F__)
#define CG_BYTES 64
#elif defined(__AVX__)
#define CG_BYTES 32
#else
#define CG_BYTES 16
#endif
#define CG_LANES (CG_BYTES / (int)sizeof(cg_real))
typedef cg_real cg_lanes __attribute__((vector_size(CG_BYTES)));
typedef __typeof__((cg_lanes){0} < (cg_lanes){0}) cg_mask;      /* all bits of a lane, or none */
#define CG_ONE ((cg_mask)((cg_lanes){0} + (cg_real)1))
/* Whole vectors where C has the operation: of a loop over the lanes compilers make two halves (gcc 12 prefers 256 bits),
 * whose stores the next load of a whole vector waits for. */
#define CG_COMPARE(name, test) \
  static inline cg_lanes name(cg_lanes a, cg_lanes b) { return (cg_lanes)((test) & CG_ONE); }
CG_COMPARE(cg_lt, a < b) CG_COMPARE(cg_le, a <= b) CG_COMPARE(cg_eq, a == b) CG_COMPARE(cg_ne, a != b)
CG_COMPARE(cg_and, (a != 0) & (b != 0)) CG_COMPARE(cg_or, (a != 0) | (b != 0))
static inline cg_lanes cg_select(cg_mask where, cg_lanes a, cg_lanes b) {
  return (cg_lanes)((where & (cg_mask)a) | (~where & (cg_mask)b));
}
static inline cg_lanes cg_if(cg_lanes a, cg_lanes b) { return (cg_lanes)((a != 0) & (cg_mask)b); }
static inline cg_lanes cg_not(cg_lanes a) { return cg_eq(a, (cg_lanes){0}); }
static inline cg_lanes cg_sign(cg_lanes a) { return cg_lt((cg_lanes){0}, a) - cg_lt(a, (cg_lanes){0}); }
static inline cg_lanes cg_fabs(cg_lanes a) { return (cg_lanes)((cg_mask)a & ~(cg_mask)-(cg_lanes){0}); }
/* Selections instead of fmin and fmax, which compilers call lane by lane, since these ignore a NaN. */
static inline cg_lanes cg_fmin(cg_lanes a, cg_lanes b) { return cg_select(a < b, a, b); }
static inline cg_lanes cg_fmax(cg_lanes a, cg_lanes b) { return cg_select(a > b, a, b); }
/* A loop over the lanes of one vector. */
#define CG_EACH(name, call) \
  static inline cg_lanes name(cg_lanes a) { \
    for (int l = 0; l < CG_LANES; ++l) a[l] = call(a[l]); \
    return a; \
  }
#define CG_EACH2(name, call) \
  static inline cg_lanes name(cg_lanes a, cg_lanes b) { \
    for (int l = 0; l < CG_LANES; ++l) a[l] = call(a[l], b[l]); \
    return a; \
  }
#ifdef __AVX512F__
#include <immintrin.h>
static inline cg_lanes cg_sqrt(cg_lanes a) {
  return sizeof(cg_real) == 8 ? (cg_lanes)_mm512_sqrt_pd((__m512d)a) : (cg_lanes)_mm512_sqrt_ps((__m512)a);
}
#else
CG_EACH(cg_sqrt, sqrt)
#endif
/* exp(a) = 2^k exp(r), |r| <= log(2) / 2, by its series: within 2 ulp. */
static inline cg_lanes cg_exp(cg_lanes a) {
  static const double inverse[] = {1., 1., 1. / 2, 1. / 6, 1. / 24, 1. / 120, 1. / 720, 1. / 5040, 1. / 40320,
    1. / 362880, 1. / 3628800, 1. / 39916800, 1. / 479001600, 1. / 6227020800.};
  const int is_double = sizeof(cg_real) == 8, digits = is_double ? 52 : 23;
  /* adding 1.5 2^digits rounds to k, in the last bits; log(2) in two parts, of which k times the first is exact */
  const cg_lanes whole = (cg_lanes){0} + (cg_real)(is_double ? 6755399441055744. : 12582912.);
  const cg_real most = is_double ? 710 : 89, least = is_double ? -746 : -104;     /* beyond: infinite, 0 */
  const cg_real first = (cg_real)(is_double ? 0x1.62e42feep-1 : 0x1.63p-1);
  const cg_real rest = (cg_real)(is_double ? 0x1.a39ef35793c76p-33 : -0x1.bd0106p-13);
  const cg_lanes k = a * (cg_real)1.4426950408889634 + whole, times = k - whole, r = (a - times * first) - times * rest;
  cg_lanes sum = (cg_lanes){0} + (cg_real)inverse[is_double ? 13 : 7];
  for (int j = is_double ? 12 : 6; j >= 0; --j) sum = sum * r + (cg_real)inverse[j];
  /* 2^k in two factors, since one alone does not reach the ends of the range */
  const cg_mask power = (cg_mask)k - (cg_mask)whole, half = power >> 1;
  sum = sum * (cg_lanes)((half << digits) + CG_ONE) * (cg_lanes)(((power - half) << digits) + CG_ONE);
  return cg_select(a > most, (cg_lanes){0} + (cg_real)HUGE_VAL, cg_select(a < least, (cg_lanes){0}, sum));
}
CG_EACH(cg_sin, sin) CG_EACH(cg_cos, cos) CG_EACH(cg_tanh, tanh)
CG_EACH(cg_log, log) CG_EACH2(cg_pow, pow)
