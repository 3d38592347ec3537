/* Real-time iterations: linearisation, Riccati recursion, primal-dual interior point, active set. See rti.h.
 *
 * Rows of a stage come from three generated functions:
 *   rti_row_values(c, C, z, y)    y = c + C z
 *   rti_row_gradient(C, w, q)     q += C' w
 *   rti_row_hessian(C, W, G)      G += C' diag(W) C
 */
#include <math.h>
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
#ifdef RTI_SINGLE
#define RTI_SQRT sqrtf
#else
#define RTI_SQRT sqrt
#endif
#define RTI_R(a) ((real)(a))
#define RTI_ABSENT RTI_R(1e30)
#ifndef RTI_GUESSES
#define RTI_GUESSES 6
#endif
#ifndef RTI_CENTRE
#define RTI_CENTRE RTI_R(0.01)
#endif
#ifdef RTI_SINGLE
#define RTI_LEAST RTI_R(1e-7)
#else
#define RTI_LEAST RTI_R(1e-14)
#endif
#define RTI_SHORT RTI_R(1e-6)
#ifndef RTI_FRESH
#define RTI_FRESH 0
#endif
#ifndef RTI_MANY
#define RTI_MANY 8
#endif
#ifndef RTI_FIRST
#define RTI_FIRST RTI_R(1e-2)
#define RTI_NEXT RTI_R(1e-3)
#endif
#ifndef RTI_FEW
#define RTI_FEW 4
#endif
#ifndef RTI_POLISH
#define RTI_POLISH 3
#endif
#define RTI_FIXED RTI_R(1e30)        /* weight of an input at its bound: as good as infinite, and harmless */
#ifdef RTI_SINGLE
#define RTI_STIFFER RTI_R(1e3)       /* weight of a row at its bound, per stiffness */
#else
#ifndef RTI_STIFFER
#define RTI_STIFFER RTI_R(1e8)
#endif
#endif

#ifndef RTI_DEBUG
#define RTI_DEBUG(...)
#endif

static inline real rti_abs(real a) { return a < 0 ? -a : a; }
static inline real rti_max(real a, real b) { return a > b ? a : b; }
static inline real rti_min(real a, real b) { return a < b ? a : b; }
static inline int rti_least(int a, int b) { return a < b ? a : b; }

/* Whether all numbers are finite, by their bits: this holds whatever the compiler assumes about arithmetic. */
static int rti_finite(const real *a, size_t count)
{
  unsigned bad = 0;
  for (size_t i = 0; i < count; ++i) {
    rti_bits bits;
    memcpy(&bits, &a[i], sizeof bits);
    bad |= (bits & RTI_EXPONENT) == RTI_EXPONENT;
  }
  return !bad;
}

static int rti_settings_valid(const rti_settings *o)
{
  const real bounds[] = {o->stage, o->tolerance, o->regularisation};
  int good = rti_finite(bounds, 3) && rti_finite(o->u_min, RTI_NU) && rti_finite(o->u_max, RTI_NU)
      && o->stage > 0 && o->substeps > 0 && o->tolerance > 0 && o->regularisation >= 0;
  for (int j = 0; good && j < RTI_NU; ++j) good = o->u_min[j] <= o->u_max[j];
#if RTI_NR > 0
  good = good && rti_finite(o->weights, RTI_NR) && rti_finite(o->terminal_weights, RTI_NR);
#endif
#if RTI_NC > 0
  good = good && rti_finite(o->c_min, RTI_NC) && rti_finite(o->c_max, RTI_NC) && rti_finite(o->linear, RTI_NC)
      && rti_finite(o->quadratic, RTI_NC);
  for (int i = 0; good && i < RTI_NC; ++i)
    good = o->c_min[i] <= o->c_max[i] && o->linear[i] >= 0 && o->quadratic[i] >= 0;
#endif
  return good;
}

/* ---- the plan ---- */

void rti_start(rti_plan *plan, const real *x0, const real *u0)
{
  for (int k = 0; k <= RTI_N; ++k) memcpy(plan->x[k], x0, sizeof plan->x[k]);
  for (int k = 0; k < RTI_N; ++k) memcpy(plan->u[k], u0, sizeof plan->u[k]);
}

void rti_shift(rti_plan *plan, const rti_settings *settings, real stages)
{
  (void)settings;
  if (!rti_finite(&stages, 1) || !(stages > 0)) return;
  const int whole = stages < RTI_N ? (int)stages : RTI_N;
  const real part = stages < RTI_N ? stages - (real)whole : 0;
  for (int k = 0; k <= RTI_N; ++k) {
    const int i = rti_least(k + whole, RTI_N), j = rti_least(i + 1, RTI_N);
    for (int r = 0; r < RTI_NX; ++r) plan->x[k][r] = (1 - part) * plan->x[i][r] + part * plan->x[j][r];
  }
  for (int k = 0; k < RTI_N; ++k) {
    const int i = rti_least(k + whole, RTI_N - 1), j = rti_least(i + 1, RTI_N - 1);
    for (int r = 0; r < RTI_NU; ++r) plan->u[k][r] = (1 - part) * plan->u[i][r] + part * plan->u[j][r];
  }
}

/* ---- linearisation, in vector lanes where RTI_VECTOR is defined: lane l has stage k + l ---- */

#ifdef RTI_VECTOR
typedef cg_lanes rti_wide;
#define RTI_WIDE CG_LANES
#define RTI_AT(a, l) (a)[l]
#else
typedef real rti_wide;
#define RTI_WIDE 1
#define RTI_AT(a, l) (a)
#endif

static inline void rti_wide_step(const rti_wide *x, const rti_wide *u, const rti_wide *p, const rti_wide *h,
    rti_wide *next, rti_wide *A, rti_wide *B)
{
  const rti_wide *in[] = {x, u, p, h};
  rti_wide *out[] = {next, A, B};
#ifdef RTI_VECTOR
  stage_step_lanes(in, out);
#else
  stage_step(in, out, 0, 0, 0);
#endif
}

static inline void rti_wide_cost(const rti_wide *x, const rti_wide *u, const rti_wide *p, const rti_wide *r,
    const rti_wide *w, rti_wide *l, rti_wide *g, rti_wide *H, rti_wide *c, rti_wide *C)
{
  const rti_wide *in[] = {x, u, p, r, w};
  rti_wide *out[] = {l, g, H, c, C};
#ifdef RTI_VECTOR
  stage_cost_lanes(in, out);
#else
  stage_cost(in, out, 0, 0, 0);
#endif
}

static inline void rti_spread(const real *from, int count, rti_wide *to)
{
  for (int j = 0; j < count; ++j)
    for (int l = 0; l < RTI_WIDE; ++l) RTI_AT(to[j], l) = from[j];
}

/* End of a stage and its derivatives by the state and the input, by columns. */
static inline void rti_stage(int substeps, rti_wide *x, const rti_wide *u, const rti_wide *p, const rti_wide *h,
    rti_wide M[RTI_NZ][RTI_NX])
{
  rti_wide next[RTI_NX], A[RTI_NX][RTI_NX], B[RTI_NU][RTI_NX];
  rti_wide_step(x, u, p, h, next, M[0], M[RTI_NX]);
  for (int i = 1; i < substeps; ++i) {
    memcpy(x, next, sizeof next);
    rti_wide_step(x, u, p, h, next, A[0], B[0]);
    for (int j = 0; j < RTI_NZ; ++j) {
      rti_wide column[RTI_NX];
      for (int r = 0; r < RTI_NX; ++r) {
        rti_wide sum = A[0][r] * M[j][0];
        for (int q = 1; q < RTI_NX; ++q) sum += A[q][r] * M[j][q];
        column[r] = j < RTI_NX ? sum : sum + B[j < RTI_NX ? 0 : j - RTI_NX][r];
      }
      memcpy(M[j], column, sizeof column);
    }
  }
  memcpy(x, next, sizeof next);
}

int rti_extend(rti_plan *plan, const rti_settings *settings, int from, const real *p)
{
  if (!rti_settings_valid(settings) || from < 0 || !rti_finite(p, RTI_NP)) return RTI_BAD_INPUT;
  const real h = settings->stage / (real)settings->substeps;
  rti_wide wp[RTI_SIZE(RTI_NP)], wh[1], x[RTI_NX], u[RTI_NU], M[RTI_NZ][RTI_NX];
  rti_spread(p, RTI_NP, wp);
  rti_spread(&h, 1, wh);
  for (int k = from; k < RTI_N; ++k) {
    rti_spread(plan->x[k], RTI_NX, x);
    rti_spread(plan->u[k], RTI_NU, u);
    rti_stage(settings->substeps, x, u, wp, wh, M);
    for (int i = 0; i < RTI_NX; ++i) plan->x[k + 1][i] = RTI_AT(x[i], 0);
    if (!rti_finite(plan->x[k + 1], RTI_NX)) return RTI_BAD_LINEARISATION;
  }
  return RTI_SOLVED;
}

int rti_rollout(rti_plan *plan, rti_work *work, const rti_settings *settings, const real *x0, const real *p)
{
  (void)work;
  if (!rti_finite(x0, RTI_NX)) return RTI_BAD_INPUT;
  memcpy(plan->x[0], x0, sizeof plan->x[0]);
  return rti_extend(plan, settings, 0, p);
}

static void rti_linearise(rti_work *o, const rti_settings *settings, const real *p, const real *refs)
{
  const real step = settings->stage / (real)settings->substeps;
  rti_wide wp[RTI_SIZE(RTI_NP)], ww[RTI_SIZE(RTI_NR)], wr[RTI_SIZE(RTI_NR)], h[1];
  rti_spread(p, RTI_NP, wp);
  rti_spread(settings->weights, RTI_NR, ww);
  rti_spread(&step, 1, h);
  for (int k = 0; k < RTI_N; k += RTI_WIDE) {
    rti_wide x[RTI_NX], u[RTI_NU], M[RTI_NZ][RTI_NX], cost[1], g[RTI_NZ], H[RTI_NZ][RTI_NZ];
    rti_wide c[RTI_SIZE(RTI_NC)], C[RTI_NZ][RTI_SIZE(RTI_NC)];
    for (int l = 0; l < RTI_WIDE; ++l) {
      const int at = rti_least(k + l, RTI_N - 1);
      for (int j = 0; j < RTI_NX; ++j) RTI_AT(x[j], l) = o->x[at][j];
      for (int j = 0; j < RTI_NU; ++j) RTI_AT(u[j], l) = o->u[at][j];
      for (int j = 0; j < RTI_NR; ++j) RTI_AT(wr[j], l) = refs[at * RTI_NR + j];
    }
    rti_wide_cost(x, u, wp, wr, ww, cost, g, H[0], c, C[0]);
    rti_stage(settings->substeps, x, u, wp, h, M);
    for (int l = 0; l < rti_least(RTI_WIDE, RTI_N - k); ++l) {
      const int at = k + l;
      for (int i = 0; i < RTI_NX; ++i) {
        o->defect[at][i] = RTI_AT(x[i], l) - o->x[at + 1][i];
        for (int j = 0; j < RTI_W; ++j) o->M[at][i][j] = j < RTI_NZ ? RTI_AT(M[j < RTI_NZ ? j : 0][i], l) : 0;
      }
      o->l[at] = RTI_AT(cost[0], l);
      for (int i = 0; i < RTI_W; ++i) o->g[at][i] = i < RTI_NZ ? RTI_AT(g[i < RTI_NZ ? i : 0], l) : 0;
      for (int i = 0; i < RTI_NZ; ++i)
        for (int j = 0; j < RTI_W; ++j) o->H[at][i][j] = j < RTI_NZ ? RTI_AT(H[i][j < RTI_NZ ? j : 0], l) : 0;
      for (int j = RTI_NX; j < RTI_NZ; ++j) o->H[at][j][j] += settings->regularisation;
      for (int i = 0; i < RTI_NC; ++i) {
        o->c[at][i] = RTI_AT(c[i], l);
        for (int j = 0; j < RTI_NZ; ++j) o->C[at][i][j] = RTI_AT(C[j][i], l);
      }
    }
  }
  real g[RTI_NX], H[RTI_NX][RTI_NX], c[RTI_SIZE(RTI_NS)], C[RTI_NX][RTI_SIZE(RTI_NS)];
  const real *in[] = {o->x[RTI_N], p, refs + RTI_N * RTI_NR, settings->terminal_weights};
  real *out[] = {&o->l[RTI_N], g, H[0], c, C[0]};
  terminal_cost(in, out, 0, 0, 0);
  memset(o->g[RTI_N], 0, sizeof o->g[RTI_N]);
  memset(o->H[RTI_N], 0, sizeof o->H[RTI_N]);
  memset(o->c[RTI_N], 0, sizeof o->c[RTI_N]);
  memset(o->C[RTI_N], 0, sizeof o->C[RTI_N]);
  for (int i = 0; i < RTI_NX; ++i) {
    o->g[RTI_N][i] = g[i];
    for (int j = 0; j < RTI_NX; ++j) o->H[RTI_N][i][j] = H[i][j];
  }
  for (int i = 0; i < RTI_NS; ++i) {
    o->c[RTI_N][i] = c[i];
    for (int j = 0; j < RTI_NX; ++j) o->C[RTI_N][i][j] = C[j][i];
  }
}

/* ---- Riccati recursion ---- */

/* G += M' P M */
static inline void rti_carry(real G[RTI_NZ][RTI_W], real P[RTI_NZ][RTI_W], real M[RTI_NX][RTI_W])
{
  real PM[RTI_NX][RTI_W];
  for (int i = 0; i < RTI_NX; ++i) {
    real row[RTI_W];
    for (int l = 0; l < RTI_W; ++l) row[l] = P[i][0] * M[0][l];
    for (int q = 1; q < RTI_NX; ++q)
      for (int l = 0; l < RTI_W; ++l) row[l] += P[i][q] * M[q][l];
    memcpy(PM[i], row, sizeof row);
  }
  for (int j = 0; j < RTI_NZ; ++j) {
    real row[RTI_W];
    memcpy(row, G[j], sizeof row);
    for (int i = 0; i < RTI_NX; ++i)
      for (int l = 0; l < RTI_W; ++l) row[l] += M[i][j] * PM[i][l];
    memcpy(G[j], row, sizeof row);
  }
}

/* q += M' p */
static inline void rti_pull(real q[RTI_W], real M[RTI_NX][RTI_W], const real p[RTI_NX])
{
  for (int i = 0; i < RTI_NX; ++i)
    for (int l = 0; l < RTI_W; ++l) q[l] += M[i][l] * p[i];
}

/* Minimise over the inputs, last first: u_j = K_j [x, u_0 .. u_j-1]; what remains is the Hessian of the state. */
static inline void rti_eliminate(real G[RTI_NZ][RTI_W], real K[RTI_NU][RTI_W], real inverse[RTI_NU])
{
  real least[RTI_NU];
  for (int j = 0; j < RTI_NU; ++j) least[j] = 8 * RTI_EPS * G[RTI_NX + j][RTI_NX + j];
  for (int j = RTI_NU - 1; j >= 0; --j) {
    const int v = RTI_NX + j;
    inverse[j] = G[v][v] > least[j] ? 1 / G[v][v] : 0;
    for (int l = 0; l < RTI_W; ++l) K[j][l] = l < v ? -G[v][l] * inverse[j] : 0;
    for (int i = 0; i < v; ++i)
      for (int l = 0; l <= i; ++l) G[i][l] += G[v][i] * K[j][l];
    for (int i = 0; i < v; ++i)
      for (int l = 0; l < i; ++l) G[l][i] = G[i][l];
  }
}

/* The same for the gradient: gives the constant part of the inputs. */
static inline void rti_eliminate_gradient(real q[RTI_W], real K[RTI_NU][RTI_W], const real inverse[RTI_NU],
    real constant[RTI_NU])
{
  for (int j = RTI_NU - 1; j >= 0; --j) {
    const real pull = q[RTI_NX + j];
    constant[j] = -pull * inverse[j];
    for (int l = 0; l < RTI_NX + j; ++l) q[l] += K[j][l] * pull;
  }
}

static inline void rti_inputs(real z[RTI_W], real K[RTI_NU][RTI_W], const real constant[RTI_NU])
{
  for (int j = 0; j < RTI_NU; ++j) {
    real u = constant[j];
    for (int l = 0; l < RTI_NX + j; ++l) u += K[j][l] * z[l];
    z[RTI_NX + j] = u;
  }
}

/* next = M z, to which more is added */
static inline void rti_following(real next[RTI_W], real M[RTI_NX][RTI_W], const real z[RTI_W])
{
  for (int i = 0; i < RTI_NX; ++i) {
    real sum = 0;
    for (int l = 0; l < RTI_NZ; ++l) sum += M[i][l] * z[l];
    next[i] += sum;
  }
}

/* The law that solves the problem without bounds. */
static void rti_solve_free(rti_work *o)
{
  real G[RTI_NZ][RTI_W], P[RTI_NZ][RTI_W], q[RTI_W], p[RTI_NX];
  memcpy(P, o->H[RTI_N], sizeof P);
  memcpy(p, o->g[RTI_N], sizeof p);
  for (int k = RTI_N - 1; k >= 0; --k) {
    memcpy(G, o->H[k], sizeof G);
    memcpy(q, o->g[k], sizeof q);
    rti_carry(G, P, o->M[k]);
    for (int i = 0; i < RTI_NX; ++i)
      for (int l = 0; l < RTI_NX; ++l) p[i] += P[i][l] * o->defect[k][l];
    rti_pull(q, o->M[k], p);
    rti_eliminate(G, o->gain[k], o->ease[k]);
    rti_eliminate_gradient(q, o->gain[k], o->ease[k], o->offset[k]);
    memcpy(P, G, sizeof P);
    memcpy(p, q, sizeof p);
  }
}

int rti_prepare(rti_work *o, const rti_plan *plan, const rti_settings *settings, const real *p, const real *refs)
{
  o->ready = 0;
  if (!rti_settings_valid(settings) || !rti_finite(p, RTI_NP) || !rti_finite(refs, (RTI_N + 1) * RTI_NR)
      || !rti_finite(plan->x[0], (RTI_N + 1) * RTI_NX) || !rti_finite(plan->u[0], RTI_N * RTI_NU))
    return RTI_BAD_INPUT;
  memcpy(o->x, plan->x, sizeof o->x);
  for (int k = 0; k < RTI_N; ++k)
    for (int j = 0; j < RTI_NU; ++j)
      o->u[k][j] = rti_max(settings->u_min[j], rti_min(settings->u_max[j], plan->u[k][j]));
  rti_linearise(o, settings, p, refs);
  rti_solve_free(o);
  const size_t first = offsetof(rti_work, M), count = (offsetof(rti_work, z) - first) / sizeof(real);
  if (!rti_finite((const real *)(const void *)((const char *)o + first), count)) return RTI_BAD_LINEARISATION;
  o->ready = 1;
  return RTI_SOLVED;
}

/* ---- bounded quantities: inputs, then rows; entry k is node k, or node k + 1 for rows of the state alone ---- */

static inline void rti_row_entries(real from[RTI_ROWS][RTI_LENGTH], int node, real to[RTI_SIZE(RTI_NC)])
{
  for (int i = 0; i < RTI_NC; ++i) {
    const int k = i < RTI_NS ? node - 1 : node;
    to[i] = k >= 0 && k < RTI_N ? from[RTI_NU + i][k] : 0;
  }
}

/* Values of all rows on the way z; with_constant adds those of the plan. */
static void rti_bounded(rti_work *o, real z[RTI_N + 1][RTI_W], real y[RTI_ROWS][RTI_LENGTH], int with_constant)
{
  static const real zero[RTI_SIZE(RTI_NC)] = {0};
  for (int k = 0; k <= RTI_N; ++k) {
    real value[RTI_SIZE(RTI_NC)];
    if (k < RTI_N)
      for (int j = 0; j < RTI_NU; ++j) y[j][k] = z[k][RTI_NX + j] + (with_constant ? o->u[k][j] : 0);
    rti_row_values(with_constant ? o->c[k] : zero, o->C[k], z[k], value);
    for (int i = 0; i < RTI_NC; ++i) {
      const int at = i < RTI_NS ? k - 1 : k;
      if (at >= 0 && at < RTI_N) y[RTI_NU + i][at] = value[i];
    }
  }
  for (int i = 0; i < RTI_ROWS; ++i)
    for (int k = RTI_N; k < RTI_LENGTH; ++k) y[i][k] = y[i][RTI_N - 1];
}

static inline real rti_low(const rti_settings *s, int row) { return row < RTI_NU ? s->u_min[row] : s->c_min[row - RTI_NU]; }
static inline real rti_high(const rti_settings *s, int row) { return row < RTI_NU ? s->u_max[row] : s->c_max[row - RTI_NU]; }
static inline int rti_priced(const rti_settings *s, int row)
{
  return row < RTI_NU || s->linear[row - RTI_NU] > 0 || s->quadratic[row - RTI_NU] > 0;
}

/* What a bounded quantity is compared with: its greatest bound; one where that is zero. */
static real rti_scale(const rti_settings *s, int row)
{
  const real low = rti_abs(rti_low(s, row)), high = rti_abs(rti_high(s, row));
  const real scale = rti_max(low < RTI_ABSENT ? low : 0, high < RTI_ABSENT ? high : 0);
  return scale > 0 ? scale : 1;
}

static real rti_excess(const rti_settings *s, int row, const real y[RTI_LENGTH])
{
  real least = y[0], most = y[0];
  for (int k = 1; k < RTI_LENGTH; ++k) {
    least = rti_min(least, y[k]);
    most = rti_max(most, y[k]);
  }
  const real low = rti_low(s, row), high = rti_high(s, row);
  return rti_max(0, rti_max(low > -RTI_ABSENT ? low - least : 0, high < RTI_ABSENT ? most - high : 0));
}

static int rti_inside(const rti_work *o, const rti_settings *s)
{
  for (int i = 0; i < RTI_ROWS; ++i)
    if (rti_priced(s, i) && rti_excess(s, i, o->y[i]) > s->tolerance * rti_scale(s, i)) return 0;
  return 1;
}

/* The way without bounds from the state x0. */
static void rti_free_way(rti_work *o, const real *x0)
{
  memset(o->z[0], 0, sizeof o->z[0]);
  for (int i = 0; i < RTI_NX; ++i) o->z[0][i] = x0[i] - o->x[0][i];
  for (int k = 0; k < RTI_N; ++k) {
    rti_inputs(o->z[k], o->gain[k], o->offset[k]);
    memset(o->z[k + 1], 0, sizeof o->z[k + 1]);
    memcpy(o->z[k + 1], o->defect[k], sizeof o->defect[k]);
    rti_following(o->z[k + 1], o->M[k], o->z[k]);
  }
  rti_bounded(o, o->z, o->y, 1);
}

/* Force per change of each bounded quantity, from the inverse Hessian of the problem without bounds: with S that of the
 * state, that of z is [I; K] S [I; K]' + the inverse Hessian of the inputs. Zero where no input has any influence. */
static void rti_stiffnesses(rti_work *o)
{
  real S[RTI_NX][RTI_NX] = {{0}};
  for (int k = 0; k <= RTI_N; ++k) {
    real Z[RTI_NZ][RTI_NZ] = {{0}};
    for (int i = 0; i < RTI_NX; ++i) memcpy(Z[i], S[i], sizeof S[i]);
    for (int j = 0; j < RTI_NU && k < RTI_N; ++j) {
      const int v = RTI_NX + j;
      for (int i = 0; i < v; ++i) {
        real sum = 0;
        for (int l = 0; l < v; ++l) sum += o->gain[k][j][l] * Z[l][i];
        Z[v][i] = Z[i][v] = sum;
      }
      real own = o->ease[k][j];
      for (int l = 0; l < v; ++l) own += o->gain[k][j][l] * Z[l][v];
      Z[v][v] = own;
      o->stiffness[j][k] = own > 0 ? 1 / own : 0;
    }
    for (int i = 0; i < RTI_NC; ++i) {
      const int at = i < RTI_NS ? k - 1 : k;
      if (at < 0 || at >= RTI_N) continue;
      real sum = 0, size = 0;
      for (int l = 0; l < RTI_NZ; ++l) {
        real product = 0;
        for (int m = 0; m < RTI_NZ; ++m) product += Z[l][m] * o->C[k][i][m];
        sum += o->C[k][i][l] * product;
        size += o->C[k][i][l] * o->C[k][i][l] * Z[l][l];
      }
      o->stiffness[RTI_NU + i][at] = sum > 64 * RTI_EPS * size ? 1 / sum : 0;
    }
    if (k == RTI_N) break;
    real MZ[RTI_NX][RTI_NZ] = {{0}};
    for (int i = 0; i < RTI_NX; ++i)
      for (int m = 0; m < RTI_NZ; ++m)
        for (int l = 0; l < RTI_NZ; ++l) MZ[i][l] += o->M[k][i][m] * Z[m][l];
    for (int i = 0; i < RTI_NX; ++i)
      for (int l = 0; l <= i; ++l) {
        real sum = 0;
        for (int m = 0; m < RTI_NZ; ++m) sum += MZ[i][m] * o->M[k][l][m];
        S[i][l] = S[l][i] = sum;
      }
  }
  for (int i = 0; i < RTI_ROWS; ++i)
    for (int k = RTI_N; k < RTI_LENGTH; ++k) o->stiffness[i][k] = o->stiffness[i][RTI_N - 1];
}

/* ---- Newton steps ---- */

/* Gradient of the Lagrangian by each input, and the largest of them, relative. */
static real rti_gradient(rti_work *o)
{
  real pi[RTI_NX], w[RTI_SIZE(RTI_NC)], most[RTI_NU] = {0}, size[RTI_NU] = {0};
  for (int k = RTI_N; k >= 0; --k) {
    real r[RTI_W], carried[RTI_W] = {0};
    memcpy(r, o->g[k], sizeof r);
    for (int i = 0; i < RTI_NZ; ++i)
      for (int l = 0; l < RTI_W; ++l) r[l] += o->H[k][i][l] * o->z[k][i];
    rti_row_entries(o->force, k, w);
    rti_row_gradient(o->C[k], w, r);
    if (k < RTI_N) {
      rti_pull(carried, o->M[k], pi);
      for (int j = 0; j < RTI_NU; ++j) {
        const real own = r[RTI_NX + j], from = carried[RTI_NX + j], bound = o->force[j][k];
        const real sum = own + from + bound;
        o->residual[k][j] = sum;
        most[j] = rti_max(most[j], rti_abs(sum));
        size[j] = rti_max(size[j], rti_abs(own) + rti_abs(from) + rti_abs(bound));
      }
    }
    for (int l = 0; l < RTI_NX; ++l) pi[l] = r[l] + carried[l];
  }
  real worst = 0;
  for (int j = 0; j < RTI_NU; ++j)
    if (size[j] > 0) worst = rti_max(worst, most[j] / size[j]);
  for (int j = 0; j < RTI_NU; ++j) o->gradient_size[j] = size[j];
  return worst;
}

/* Factors with the present weights; then the step with the present residual and push. */
static void rti_factor(rti_work *o)
{
  real P[RTI_NZ][RTI_W], p[RTI_W] = {0}, w[RTI_SIZE(RTI_NC)];
  memcpy(P, o->H[RTI_N], sizeof P);
  rti_row_entries(o->weight, RTI_N, w);
  rti_row_hessian(o->C[RTI_N], w, P);
  rti_row_entries(o->push, RTI_N, w);
  rti_row_gradient(o->C[RTI_N], w, p);
  for (int k = RTI_N - 1; k >= 0; --k) {
    real G[RTI_NZ][RTI_W], q[RTI_W] = {0};
    memcpy(G, o->H[k], sizeof G);
    rti_row_entries(o->weight, k, w);
    rti_row_hessian(o->C[k], w, G);
    rti_row_entries(o->push, k, w);
    rti_row_gradient(o->C[k], w, q);
    for (int j = 0; j < RTI_NU; ++j) {
      G[RTI_NX + j][RTI_NX + j] += o->weight[j][k];
      q[RTI_NX + j] += o->push[j][k] + o->residual[k][j];
    }
    rti_carry(G, P, o->M[k]);
    rti_pull(q, o->M[k], p);
    rti_eliminate(G, o->K[k], o->inverse[k]);
    rti_eliminate_gradient(q, o->K[k], o->inverse[k], o->constant[k]);
    memcpy(P, G, sizeof P);
    memcpy(p, q, sizeof p);
  }
}

/* The step with the present factors. */
static void rti_resolve(rti_work *o)
{
  real p[RTI_W] = {0}, w[RTI_SIZE(RTI_NC)];
  rti_row_entries(o->push, RTI_N, w);
  rti_row_gradient(o->C[RTI_N], w, p);
  for (int k = RTI_N - 1; k >= 0; --k) {
    real q[RTI_W] = {0};
    rti_row_entries(o->push, k, w);
    rti_row_gradient(o->C[k], w, q);
    for (int j = 0; j < RTI_NU; ++j) q[RTI_NX + j] += o->push[j][k] + o->residual[k][j];
    rti_pull(q, o->M[k], p);
    rti_eliminate_gradient(q, o->K[k], o->inverse[k], o->constant[k]);
    memcpy(p, q, sizeof p);
  }
}

/* The change of the way and of what is bounded; whether it is finite. */
static int rti_advance(rti_work *o)
{
  memset(o->dz[0], 0, sizeof o->dz[0]);
  for (int k = 0; k < RTI_N; ++k) {
    rti_inputs(o->dz[k], o->K[k], o->constant[k]);
    memset(o->dz[k + 1], 0, sizeof o->dz[k + 1]);
    rti_following(o->dz[k + 1], o->M[k], o->dz[k]);
  }
  rti_bounded(o, o->dz, o->dy, 0);
  return rti_finite(o->dz[0], (RTI_N + 1) * RTI_W);
}

static void rti_move(rti_work *o, real length)
{
  for (int k = 0; k <= RTI_N; ++k)
    for (int l = 0; l < RTI_W; ++l) o->z[k][l] += length * o->dz[k][l];
  rti_bounded(o, o->z, o->y, 1);
}

/* ---- active set: which bounds hold; a Newton step for these; anew ----
 *
 * A bound that holds is let go if its multiplier pulls the wrong way, and one that is violated is made to hold. A row
 * whose multiplier exceeds its linear price leaves its bound, and comes back to it if it lies inside. Of the first set,
 * which comes from an estimate, multiplier and distance from the bound say together what holds.
 */

enum { RTI_KEPT, RTI_ESTIMATED, RTI_EXCHANGED };   /* how a set comes about */
enum { RTI_FREE = 0, RTI_AT_HIGH = 1, RTI_AT_LOW = -1, RTI_OVER_HIGH = 2, RTI_UNDER_LOW = -2 };

/* The next state of a bounded quantity; `up` is the multiplier's pull, `price` what it may reach at the bound. */
static inline int rti_next(int at, int how, real y, real up, real low, real high, real stiffness, real price)
{
  if (how == RTI_KEPT) return at;
  if (how == RTI_ESTIMATED) {
    const real above = up + stiffness * (y - high), below = -up + stiffness * (low - y);
    if (high < RTI_ABSENT && above > 0) return above < price ? RTI_AT_HIGH : RTI_OVER_HIGH;
    if (low > -RTI_ABSENT && below > 0) return below < price ? RTI_AT_LOW : RTI_UNDER_LOW;
    return RTI_FREE;
  }
  switch (at) {
    case RTI_AT_HIGH: return up <= 0 ? RTI_FREE : up < price ? RTI_AT_HIGH : RTI_OVER_HIGH;
    case RTI_AT_LOW: return up >= 0 ? RTI_FREE : -up < price ? RTI_AT_LOW : RTI_UNDER_LOW;
    case RTI_OVER_HIGH: return y > high ? RTI_OVER_HIGH : price > 0 ? RTI_AT_HIGH : RTI_FREE;
    case RTI_UNDER_LOW: return y < low ? RTI_UNDER_LOW : price > 0 ? RTI_AT_LOW : RTI_FREE;
    default: break;
  }
  if (high < RTI_ABSENT && y > high) return price > 0 ? RTI_AT_HIGH : RTI_OVER_HIGH;
  if (low > -RTI_ABSENT && y < low) return price > 0 ? RTI_AT_LOW : RTI_UNDER_LOW;
  return RTI_FREE;
}

/* The next set with its weights and pushes, from the present point and multipliers; the number of changes. */
static int rti_choose(rti_work *o, const rti_settings *s, int how, real *gap)
{
  int changes = 0;
  *gap = 0;
  for (int j = 0; j < RTI_NU; ++j) {
    const real low = s->u_min[j], high = s->u_max[j], unit = rti_scale(s, j);
    for (int k = 0; k < RTI_N; ++k) {
      const real y = o->y[j][k], residual = o->residual[k][j];
      int at = RTI_AT_HIGH;
      if (low < high) at = rti_next(o->active[j][k], how, y, -residual, low, high, o->stiffness[j][k], RTI_FIXED);
      const real away = at == RTI_FREE ? 0 : y - (at == RTI_AT_HIGH ? high : low);
      changes += at != o->active[j][k];
      o->active[j][k] = (signed char)at;
      *gap = rti_max(*gap, rti_abs(away) / unit);
      o->weight[j][k] = at == RTI_FREE ? 0 : RTI_FIXED;
      o->push[j][k] = at == RTI_FREE ? 0 : RTI_FIXED * away - residual;
    }
  }
  for (int i = 0; i < RTI_NC; ++i) {
    const int row = RTI_NU + i;
    if (!rti_priced(s, row)) {
      memset(o->weight[row], 0, sizeof o->weight[row]);
      memset(o->push[row], 0, sizeof o->push[row]);
      continue;
    }
    const real low = s->c_min[i], high = s->c_max[i], price = s->linear[i], unit = rti_scale(s, row);
    for (int k = 0; k < RTI_N; ++k) {
      const real y = o->y[row][k], a = o->a[row][k], c = o->stiffness[row][k];
      const int at = rti_next(o->active[row][k], how, y, a, low, high, c, price);
      const real away = at == RTI_FREE ? 0 : y - (at > 0 ? high : low);
      const int holds = at == RTI_AT_HIGH || at == RTI_AT_LOW;
      const real weight = holds ? RTI_STIFFER * c : at == RTI_FREE ? 0 : s->quadratic[i];
      changes += at != o->active[row][k];
      o->active[row][k] = (signed char)at;
      if (holds) *gap = rti_max(*gap, rti_abs(away) / unit);
      o->weight[row][k] = weight;
      o->push[row][k] = weight * away + (holds ? 0 : (at > 0 ? price : at < 0 ? -price : 0) - a);
    }
  }
  return changes;
}

/* Largest gradient by an input that is free, relative. */
static real rti_free_residual(const rti_work *o)
{
  real worst = 0;
  for (int j = 0; j < RTI_NU; ++j)
    for (int k = 0; k < RTI_N; ++k)
      if (o->active[j][k] == RTI_FREE && o->gradient_size[j] > 0)
        worst = rti_max(worst, rti_abs(o->residual[k][j]) / o->gradient_size[j]);
  return worst;
}

/* From the present point and multipliers a; 1 if the optimality conditions are met. */
static int rti_active_set(rti_work *o, const rti_settings *s, int how, int limit, rti_report *report)
{
  int before = RTI_ROWS * RTI_N;
  for (int round = 0;; ++round) {
    real gap;
    memset(o->force, 0, sizeof o->force[0] * RTI_NU);
    for (int i = RTI_NU; i < RTI_ROWS; ++i) memcpy(o->force[i], o->a[i], sizeof o->force[i]);
    rti_gradient(o);
    const int changes = rti_choose(o, s, round == 0 ? how : RTI_EXCHANGED, &gap);
    report->kkt = rti_max(gap, rti_free_residual(o));
    RTI_DEBUG("  set %d changes %d gap %g res %g\n", round, changes, gap, rti_free_residual(o));
    if (round > 0 && changes == 0 && report->kkt <= s->tolerance) return 1;
    if (round == limit || (round > 1 && changes > before && changes > RTI_MANY)) return 0;
    if (round > 0) before = changes;
    ++report->iterations;
    if (round > 0 && changes == 0) rti_resolve(o);
    else rti_factor(o);
    if (!rti_advance(o)) return 0;
    rti_move(o, 1);
    for (int i = RTI_NU; i < RTI_ROWS; ++i)
      for (int k = 0; k < RTI_N; ++k) o->a[i][k] += o->push[i][k] + o->weight[i][k] * o->dy[i][k];
  }
}

/* ---- interior point: S. Mehrotra, SIAM J. Optim. 2 (1992) 575, doi:10.1137/0802028 ----
 *
 * Of a side sign y <= bound + s, with t = bound + s - sign y >= 0 and multiplier m, and s >= 0 with multiplier
 * n = linear + quadratic s - m, a Newton step is dm = W sign dy + e, ds = V dm + f; V is the ease with which s yields.
 */

static void rti_sides(rti_work *o, const rti_settings *s)
{
  o->sides = 0;
  for (int row = 0; row < RTI_ROWS; ++row)
    for (int sign = -1; sign <= 1; sign += 2) {
      const real bound = sign > 0 ? rti_high(s, row) : -rti_low(s, row);
      if (!rti_priced(s, row) || bound >= RTI_ABSENT || (row < RTI_NU && rti_low(s, row) == rti_high(s, row))) continue;
      rti_side *side = &o->side[o->sides++];
      const int input = row < RTI_NU;
      side->row = row;
      side->sign = (real)sign;
      side->bound = bound;
      side->linear = input ? 0 : s->linear[input ? 0 : row - RTI_NU];
      side->quadratic = input ? 0 : s->quadratic[input ? 0 : row - RTI_NU];
      side->soft = side->linear > 0;
      side->yield = input || side->soft ? 0 : 1 / side->quadratic;
    }
}

/* Inputs of the present way moved inside their bounds, and the states that follow from them. */
static void rti_inner_way(rti_work *o, const rti_settings *s)
{
  for (int k = 0; k < RTI_N; ++k) {
    for (int j = 0; j < RTI_NU; ++j) {
      const real low = s->u_min[j], high = s->u_max[j], u = o->u[k][j];
      const real margin = RTI_R(0.1) * (low > -RTI_ABSENT && high < RTI_ABSENT ? high - low : rti_scale(s, j));
      real inner = u + o->z[k][RTI_NX + j];
      if (low > -RTI_ABSENT) inner = rti_max(inner, low + margin);
      if (high < RTI_ABSENT) inner = rti_min(inner, high - margin);
      o->z[k][RTI_NX + j] = inner - u;
    }
    memset(o->z[k + 1], 0, sizeof o->z[k + 1]);
    memcpy(o->z[k + 1], o->defect[k], sizeof o->defect[k]);
    rti_following(o->z[k + 1], o->M[k], o->z[k]);
  }
  rti_bounded(o, o->z, o->y, 1);
}

/* What could be gained at most by an input, on average: of this size are the first products of pairs. */
static real rti_first_product(rti_work *o, const rti_settings *s)
{
  real sum = 0;
  memset(o->force, 0, sizeof o->force);
  for (int i = 0; i < o->sides; ++i) {
    const rti_side side = o->side[i];
    if (side.row < RTI_NU) continue;
    for (int k = 0; k < RTI_LENGTH; ++k) {
      const real over = side.sign * o->y[side.row][k] - side.bound;
      if (over > 0) o->force[side.row][k] += side.sign * (side.linear + side.quadratic * over);
    }
  }
  rti_gradient(o);
  for (int k = 0; k < RTI_N; ++k)
    for (int j = 0; j < RTI_NU; ++j) {
      const real r = o->residual[k][j], c = o->stiffness[j][k], y = o->y[j][k];
      const real room = r > 0 ? y - s->u_min[j] : s->u_max[j] - y;
      sum += rti_abs(r) * rti_min(room, c > 0 ? rti_abs(r) / c : room);
    }
  return rti_max(sum / (RTI_N * RTI_NU), RTI_R(1e-20));
}

/* Slacks and multipliers whose products are about `product`, and which meet all conditions but that on the gradient. */
static void rti_centre(rti_work *o, real product)
{
  memset(o->dt, 0, sizeof o->dt);
  memset(o->dm, 0, sizeof o->dm);
  memset(o->ds, 0, sizeof o->ds);
  memset(o->dn, 0, sizeof o->dn);
  for (int i = 0; i < o->sides; ++i) {
    const rti_side side = o->side[i];
    for (int k = 0; k < RTI_LENGTH; ++k) {
      const real room = side.bound - side.sign * o->y[side.row][k], over = rti_max(0, -room);
      real t = room, m = product / t, v = 0, n = 1;
      if (side.soft) {
        const real price = side.linear + side.quadratic * over;
        const real inward = rti_min(product / price, side.quadratic > 0 ? RTI_SQRT(product / side.quadratic) : product / price);
        const real all = price + side.quadratic * inward;
        v = over + inward;
        t = room + v;
        if (room < 0) {
          n = rti_min(product / v, all / 2);
          m = all - n;
        } else {
          m = rti_min(product / t, all / 2);
          n = all - m;
        }
      } else if (side.yield > 0) {
        const real root = RTI_SQRT(room * room + 4 * product * side.yield);
        t = room > 0 ? (room + root) / 2 : 2 * product * side.yield / (root - room);
        m = product / t;
        v = m * side.yield;
      }
      o->t[i][k] = t;
      o->m[i][k] = m;
      o->s[i][k] = v;
      o->n[i][k] = n;
    }
  }
}

static void rti_forces(rti_work *o)
{
  memset(o->force, 0, sizeof o->force);
  for (int i = 0; i < o->sides; ++i) {
    const real sign = o->side[i].sign;
    real *restrict force = o->force[o->side[i].row];
    const real *restrict m = o->m[i];
    for (int k = 0; k < RTI_LENGTH; ++k) force[k] += sign * m[k];
  }
}

static void rti_weights(rti_work *o, const rti_settings *settings)
{
  memset(o->weight, 0, sizeof o->weight);
  for (int j = 0; j < RTI_NU; ++j)
    for (int k = 0; k < RTI_N && settings->u_min[j] == settings->u_max[j]; ++k) o->weight[j][k] = RTI_FIXED;
  for (int i = 0; i < o->sides; ++i) {
    const rti_side side = o->side[i];
    const real *restrict t = o->t[i], *restrict m = o->m[i], *restrict s = o->s[i], *restrict n = o->n[i];
    real *restrict W = o->W[i], *restrict V = o->V[i], *restrict weight = o->weight[side.row];
    if (side.soft)
      for (int k = 0; k < RTI_LENGTH; ++k) V[k] = s[k] / (side.quadratic * s[k] + n[k]);
    else
      for (int k = 0; k < RTI_LENGTH; ++k) V[k] = side.yield;
    for (int k = 0; k < RTI_LENGTH; ++k) {
      W[k] = m[k] / (t[k] + V[k] * m[k]);
      weight[k] += W[k];
    }
  }
}

/* Constant parts of the step towards products of `target`; `second` of the changes before is taken into account. */
static void rti_aim(rti_work *o, real target, real second)
{
  memset(o->push, 0, sizeof o->push);
  for (int i = 0; i < o->sides; ++i) {
    const rti_side side = o->side[i];
    const real *restrict y = o->y[side.row], *restrict W = o->W[i], *restrict V = o->V[i];
    const real *restrict t = o->t[i], *restrict m = o->m[i], *restrict s = o->s[i], *restrict n = o->n[i];
    const real *restrict dt = o->dt[i], *restrict dm = o->dm[i], *restrict ds = o->ds[i], *restrict dn = o->dn[i];
    real *restrict e = o->e[i], *restrict f = o->f[i], *restrict push = o->push[side.row];
    if (side.soft)
      for (int k = 0; k < RTI_LENGTH; ++k)
        f[k] = V[k] * ((target - second * ds[k] * dn[k]) / s[k] - side.linear - side.quadratic * s[k] + m[k]);
    else
      for (int k = 0; k < RTI_LENGTH; ++k) f[k] = 0;
    for (int k = 0; k < RTI_LENGTH; ++k) {
      const real off = side.sign * y[k] - s[k] - side.bound;
      e[k] = W[k] * ((target - second * dt[k] * dm[k]) / m[k] + off - f[k]);
      push[k] += side.sign * e[k];
    }
  }
}

typedef struct { real ratio, first, second; } rti_change;

/* Changes of slacks and multipliers with dy: largest relative decrease, and how the mean product changes. */
static rti_change rti_changes(rti_work *o, real target, real second)
{
  real ratio[RTI_LENGTH] = {0}, first[RTI_LENGTH] = {0}, square[RTI_LENGTH] = {0};
  for (int i = 0; i < o->sides; ++i) {
    const rti_side side = o->side[i];
    const real *restrict y = o->y[side.row], *restrict dy = o->dy[side.row];
    const real *restrict t = o->t[i], *restrict m = o->m[i], *restrict s = o->s[i], *restrict n = o->n[i];
    const real *restrict W = o->W[i], *restrict V = o->V[i], *restrict e = o->e[i], *restrict f = o->f[i];
    real *restrict dt = o->dt[i], *restrict dm = o->dm[i], *restrict ds = o->ds[i], *restrict dn = o->dn[i];
    if (side.soft)
      for (int k = 0; k < RTI_LENGTH; ++k) {
        const real violation = V[k] * (W[k] * side.sign * dy[k] + e[k]) + f[k], inverse = 1 / (s[k] * n[k]);
        const real pull = (target - second * ds[k] * dn[k] - n[k] * violation) * n[k] * inverse - n[k];
        dn[k] = pull;
        ratio[k] = rti_max(ratio[k], -inverse * rti_min(n[k] * violation, s[k] * pull));
        first[k] += s[k] * pull + n[k] * violation;
        square[k] += violation * pull;
      }
    for (int k = 0; k < RTI_LENGTH; ++k) {
      const real multiplier = W[k] * side.sign * dy[k] + e[k], violation = V[k] * multiplier + f[k];
      const real slack = violation - side.sign * (y[k] + dy[k]) + s[k] + side.bound - t[k];
      dm[k] = multiplier;
      ds[k] = violation;
      dt[k] = slack;
      ratio[k] = rti_max(ratio[k], -rti_min(m[k] * slack, t[k] * multiplier) / (t[k] * m[k]));
      first[k] += t[k] * multiplier + m[k] * slack;
      square[k] += slack * multiplier;
    }
  }
  rti_change change = {0, 0, 0};
  real pairs = 0;
  for (int i = 0; i < o->sides; ++i) pairs += o->side[i].soft ? 2 * RTI_LENGTH : RTI_LENGTH;
  for (int k = 0; k < RTI_LENGTH; ++k) {
    change.ratio = rti_max(change.ratio, ratio[k]);
    change.first += first[k] / pairs;
    change.second += square[k] / pairs;
  }
  return change;
}

/* Mean product of a slack and its multiplier. */
static real rti_mean(const rti_work *o)
{
  real sum = 0, pairs = 0, products[RTI_LENGTH] = {0};
  for (int i = 0; i < o->sides; ++i) {
    const real *t = o->t[i], *m = o->m[i], *s = o->s[i], *n = o->n[i];
    const real soft = o->side[i].soft ? 1 : 0;
    for (int k = 0; k < RTI_LENGTH; ++k) products[k] += t[k] * m[k] + soft * s[k] * n[k];
    pairs += (1 + soft) * RTI_LENGTH;
  }
  for (int k = 0; k < RTI_LENGTH; ++k) sum += products[k];
  return sum / pairs;
}

static void rti_step_sides(rti_work *o, real length)
{
  for (int i = 0; i < o->sides; ++i)
    for (int k = 0; k < RTI_LENGTH; ++k) {
      o->t[i][k] += length * o->dt[i][k];
      o->m[i][k] += length * o->dm[i][k];
      o->s[i][k] += length * o->ds[i][k];
      if (o->side[i].soft) o->n[i][k] += length * o->dn[i][k];
    }
}


/* Until the mean product of pairs is small; 1 if so, 0 if the steps become too short or too many. */
static int rti_interior_point(rti_work *o, const rti_settings *s, real small, int *left)
{
  for (;;) {
    const real mean = rti_mean(o);
    if (mean <= small) return 1;
    if (*left == 0) return 0;
    --*left;
    rti_forces(o);
    const real kkt = rti_gradient(o);
    (void)kkt;
    RTI_DEBUG("%d mean %g kkt %g\n", *left, mean, kkt);
    rti_weights(o, s);
    rti_aim(o, 0, 0);
    rti_factor(o);
    if (!rti_advance(o)) return 0;
    rti_change change = rti_changes(o, 0, 0);
    real length = change.ratio > 1 ? 1 / change.ratio : 1;
    const real rest = rti_max(0, 1 + length * (change.first + length * change.second) / mean);
    const real target = rest * rest * rest * mean;
    rti_aim(o, target, 1);
    rti_resolve(o);
    if (!rti_advance(o)) return 0;
    change = rti_changes(o, target, 1);
    length = change.ratio > RTI_R(0.995) ? RTI_R(0.995) / change.ratio : 1;
    RTI_DEBUG("   sigma %g length %g\n", rest*rest*rest, length);
    if (length < RTI_SHORT) return 0;
    rti_move(o, length);
    rti_step_sides(o, length);
  }
}

/* Cost of moving an input by its scale, the least of all. */
static real rti_unit_cost(const rti_work *o, const rti_settings *s)
{
  real least = RTI_R(1e30);
  for (int j = 0; j < RTI_NU; ++j)
    for (int k = 0; k < RTI_N; ++k) {
      const real unit = rti_scale(s, j);
      least = rti_min(least, o->stiffness[j][k] * unit * unit);
    }
  return least;
}

/* ---- feedback ---- */

static real rti_cost(const rti_work *o, const rti_settings *s, real *violation)
{
  real cost = o->l[RTI_N];
  *violation = 0;
  for (int k = 0; k <= RTI_N; ++k) {
    if (k < RTI_N) cost += o->l[k];
    for (int i = 0; i < RTI_NZ; ++i) {
      real sum = 0;
      for (int l = 0; l < RTI_NZ; ++l) sum += o->H[k][i][l] * o->z[k][l];
      cost += o->z[k][i] * (o->g[k][i] + RTI_R(0.5) * sum);
    }
  }
  for (int i = 0; i < RTI_NC; ++i) {
    const real *y = o->y[RTI_NU + i];
    if (!rti_priced(s, RTI_NU + i)) continue;
    for (int k = 0; k < RTI_N; ++k) {
      const real over = rti_max(0, rti_max(s->c_max[i] < RTI_ABSENT ? y[k] - s->c_max[i] : 0, s->c_min[i] > -RTI_ABSENT ? s->c_min[i] - y[k] : 0));
      cost += over * (s->linear[i] + RTI_R(0.5) * s->quadratic[i] * over);
      *violation = rti_max(*violation, over);
    }
  }
  return cost;
}

/* The set that the plan tells, which is that of the last solution moved on: what is at its bound. Whether any is. */
static int rti_planned(rti_work *o, const rti_settings *s)
{
  int count = 0, violated = 0;
  for (int row = 0; row < RTI_ROWS; ++row) {
    const real low = rti_low(s, row), high = rti_high(s, row);
    const real margin = (row < RTI_NU ? RTI_R(1e-6) : RTI_R(1e-2)) * rti_scale(s, row);
    for (int k = 0; k < RTI_N; ++k) {
      const real y = row < RTI_NU ? o->u[k][row < RTI_NU ? row : 0] : o->c[k + (row - RTI_NU < RTI_NS)][row < RTI_NU ? 0 : row - RTI_NU];
      int at = RTI_FREE;
      if (rti_priced(s, row) && high < RTI_ABSENT && y > high - margin) at = row >= RTI_NU && y > high + margin ? RTI_OVER_HIGH : RTI_AT_HIGH;
      else if (rti_priced(s, row) && low > -RTI_ABSENT && y < low + margin) at = row >= RTI_NU && y < low - margin ? RTI_UNDER_LOW : RTI_AT_LOW;
      o->active[row][k] = (signed char)at;
      count += at != RTI_FREE;
      violated += rti_priced(s, row) && (o->y[row][k] < low || o->y[row][k] > high);
    }
  }
  return count > 0 && violated > RTI_FEW;
}

static void rti_solve_bounded(rti_work *o, const rti_settings *s, const real *x0, rti_report *report)
{
  rti_stiffnesses(o);
  memset(o->a, 0, sizeof o->a);
  if (rti_active_set(o, s, rti_planned(o, s) ? RTI_KEPT : RTI_ESTIMATED, RTI_GUESSES, report)) return;
  rti_sides(o, s);
  rti_free_way(o, x0);
  rti_inner_way(o, s);
  rti_centre(o, RTI_CENTRE * rti_first_product(o, s));
  const real unit = rti_unit_cost(o, s);
  real fall = RTI_FIRST;
  int left = s->iterations;
  for (;;) {
    const int small = rti_interior_point(o, s, fall * unit, &left);
    memcpy(o->saved, o->z, sizeof o->z);
    for (int i = RTI_NU; i < RTI_ROWS; ++i) memset(o->a[i], 0, sizeof o->a[i]);
    for (int i = 0; i < o->sides; ++i)
      for (int k = 0; k < RTI_N; ++k) o->a[o->side[i].row][k] += o->side[i].sign * o->m[i][k];
    const int solved = rti_active_set(o, s, RTI_ESTIMATED, RTI_POLISH, report);
    RTI_DEBUG("polish %d\n", solved);
    if (solved) break;
    memcpy(o->z, o->saved, sizeof o->z);
    rti_bounded(o, o->z, o->y, 1);
    fall *= RTI_NEXT;
    if (!small || fall < RTI_LEAST) {
      rti_forces(o);
      report->kkt = rti_max(rti_gradient(o), RTI_SQRT(rti_mean(o) / unit));
      if (report->kkt > 100 * s->tolerance) report->status = RTI_ITERATION_LIMIT;
      break;
    }
  }
  report->iterations += s->iterations - left;
}

int rti_feedback(rti_work *o, rti_plan *plan, const rti_settings *settings, const real *x0, rti_report *report)
{
  memset(report, 0, sizeof *report);
  if (!o->ready) return report->status = RTI_NOT_PREPARED;
  if (!rti_settings_valid(settings) || !rti_finite(x0, RTI_NX)) return report->status = RTI_BAD_INPUT;
  rti_free_way(o, x0);
  if (!rti_inside(o, settings)) rti_solve_bounded(o, settings, x0, report);
  report->cost = rti_cost(o, settings, &report->violation);
  for (int k = 0; k <= RTI_N; ++k)
    for (int i = 0; i < RTI_NX; ++i) o->next_x[k][i] = o->x[k][i] + o->z[k][i];
  for (int k = 0; k < RTI_N; ++k)
    for (int j = 0; j < RTI_NU; ++j)
      o->next_u[k][j] = rti_max(settings->u_min[j], rti_min(settings->u_max[j], o->u[k][j] + o->z[k][RTI_NX + j]));
  const int finite = rti_finite(o->next_x[0], (RTI_N + 1) * RTI_NX) && rti_finite(&o->z[0][0], (RTI_N + 1) * RTI_W)
      && rti_finite(&report->cost, 1);
  if (!finite) return report->status = RTI_BAD_SOLUTION;
  memcpy(plan->x, o->next_x, sizeof plan->x);
  memcpy(plan->u, o->next_u, sizeof plan->u);
  if (report->status == RTI_SOLVED && report->violation > RTI_R(1e-6)) report->status = RTI_ROW_VIOLATED;
  return report->status;
}
