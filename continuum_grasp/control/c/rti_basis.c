/* Basis of all parts of the real-time iteration; see rti.h. The parts form one translation unit. */
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#ifdef RTI_SINGLE
#define RTI_EPS ((real)1.1920929e-7)
typedef uint32_t rti_bits;
#define RTI_EXPONENT ((rti_bits)0x7f800000)
#else
#define RTI_EPS ((real)2.220446049250313e-16)
typedef uint64_t rti_bits;
#define RTI_EXPONENT ((rti_bits)0x7ff0000000000000)
#endif
#ifndef RTI_SQRT
#include <math.h>
#ifdef RTI_SINGLE
#define RTI_SQRT sqrtf
#else
#define RTI_SQRT sqrt
#endif
#endif
#define RTI_R(a) ((real)(a))
#define RTI_ABSENT RTI_R(1e30)
#define RTI_SMALLEST RTI_R(2e-38)             /* least divisor, just above the smallest normal float (1.2e-38): a product of
                                                 slack and multiplier that underflows must not give 0 / 0 */

#ifdef RTI_VECTOR
typedef cg_lanes rti_wide;
#define RTI_WIDE CG_LANES
#define RTI_AT(a, l) (a)[l]
#else
typedef real rti_wide;
#define RTI_WIDE 1
#define RTI_AT(a, l) (a)
#endif

static inline real rti_abs(real a) { return a < 0 ? -a : a; }
static inline real rti_max(real a, real b) { return a > b ? a : b; }
static inline real rti_min(real a, real b) { return a < b ? a : b; }
static inline int rti_lesser(int a, int b) { return a < b ? a : b; }

/* Whether all numbers are finite, by their bits: -ffast-math lets a compiler drop isfinite(). */
static int rti_finite(const real *a, size_t count)
{
  rti_bits bad = 0; /* as wide as the numbers, for vector instructions */
  for (size_t i = 0; i < count; ++i) {
    rti_bits bits;
    memcpy(&bits, &a[i], sizeof bits);
    bad |= (bits & RTI_EXPONENT) == RTI_EXPONENT;
  }
  return !bad;
}

/* Whether a number is between finite limits, which NaN is not. */
static inline int rti_between(real a, real least, real most)
{
  return rti_finite(&a, 1) && a >= least && a <= most;
}

/* to += a from, over the first `count` numbers of a row at least: vectors take whole rows. In blocks, as RTI_W is padded with lanes: of a loop over 16 numbers gcc 12 makes scalar code,
 * since it unrolls such loops before it vectorizes. */
static inline void rti_add_row(real to[RTI_W], real a, const real from[RTI_W], int count)
{
#ifdef RTI_VECTOR
  typedef real block __attribute__((vector_size(4 * sizeof(real)), aligned(sizeof(real)), may_alias));
  for (int l = 0; l < count; l += 4) *(block *)(to + l) += a * *(const block *)(from + l);
#else
  for (int l = 0; l < count; ++l) to[l] += a * from[l];
#endif
}

/* Bounds of a bounded quantity: of an input, or of a row of c. */
static inline real rti_low(const rti_settings *s, int row)
{
  return row < RTI_NU ? s->u_min[row] : s->c_min[row - RTI_NU];
}

static inline real rti_high(const rti_settings *s, int row)
{
  return row < RTI_NU ? s->u_max[row] : s->c_max[row - RTI_NU];
}

/* Whether a violation of the bounds has a penalty; inputs have hard bounds. */
static inline int rti_penalized(const rti_settings *s, int row)
{
  return row < RTI_NU || s->linear[row - RTI_NU] > 0 || s->quadratic[row - RTI_NU] > 0;
}

static inline int rti_fixed(const rti_settings *s, int input) { return s->u_min[input] == s->u_max[input]; }

/* Scale of a bounded quantity for relative tolerances: its greatest bound; 1 where that is zero. */
static real rti_scale(const rti_settings *s, int row)
{
  const real low = rti_abs(rti_low(s, row)), high = rti_abs(rti_high(s, row));
  const real scale = rti_max(low < RTI_ABSENT ? low : 0, high < RTI_ABSENT ? high : 0);
  return scale > 0 ? scale : 1;
}

/* Node and scenario of a stage, and the end of its scenario; whether its inputs are those of the first scenario. */
static inline int rti_node(int stage) { return RTI_SCENARIOS > 1 ? stage + stage / RTI_N : stage; }
static inline int rti_scenario(int stage) { return RTI_SCENARIOS > 1 ? stage / RTI_N : 0; }
static inline int rti_end(int stage) { return RTI_N + RTI_N * rti_scenario(stage); }
static inline int rti_copied(int stage) { return RTI_SCENARIOS > 1 && stage >= RTI_N && stage % RTI_N == 0; }

#ifdef RTI_ROBUST
/* Parameters of a scenario. */
static inline void rti_parameters(const rti_settings *s, int b, const real *p, real own[RTI_SIZE(RTI_NP)])
{
  for (int i = 0; i < RTI_NP; ++i) own[i] = s->scale[b][i] * p[i] + s->shift[b][i];
}
#endif

static int rti_settings_valid(const rti_settings *s)
{
  const real limit = RTI_R(1e38); /* just below the largest float, 3.4e38 */
  int good = rti_between(s->stage, RTI_R(1e-30), limit) && s->substeps > 0 && s->iterations >= 0
      && rti_between(s->tolerance, RTI_R(1e-30), 1)
      && rti_finite(s->u_min, RTI_NU) && rti_finite(s->u_max, RTI_NU);
  for (int j = 0; good && j < RTI_NU; ++j) good = s->u_min[j] <= s->u_max[j] && rti_between(s->regularization[j], 0, limit);
  for (int i = 0; good && i < RTI_NR; ++i)
    good = rti_finite(&s->weights[i], 1) && rti_finite(&s->terminal_weights[i], 1);
  for (int i = 0; good && i < RTI_NC; ++i)
    good = rti_finite(&s->c_min[i], 1) && rti_finite(&s->c_max[i], 1) && s->c_min[i] <= s->c_max[i]
        && rti_between(s->linear[i], 0, limit) && rti_between(s->quadratic[i], 0, limit);
#ifdef RTI_ROBUST
  good = good && rti_finite(s->share, RTI_SCENARIOS) && rti_finite(s->scale[0], RTI_SCENARIOS * RTI_SIZE(RTI_NP))
      && rti_finite(s->shift[0], RTI_SCENARIOS * RTI_SIZE(RTI_NP));
  for (int b = 0; good && b < RTI_SCENARIOS; ++b) good = s->share[b] > 0;
#endif
  return good;
}
