/* Linearization of the stages. With RTI_VECTOR, several stages at a time in vector lanes, lane l at stage k + l: stages
 * are independent (multiple shooting), and 4 lanes took 10 instead of 28 us for 30 stages.
 *
 *   rti_store_step(o, at, l, M)      structural nonzeros of lane l, generated functions: most entries are zero, and copies of
 *   rti_store_cost(o, at, l, H, C)   whole matrices out of the lanes took a quarter of a preparation
 */

static inline void rti_wide_step(const rti_wide *x, const rti_wide *u, const rti_wide *p, const rti_wide *h,
    rti_wide *next, rti_wide *A, rti_wide *B)
{
  const rti_wide *in[] = {x, u, p, h};
  rti_wide *out[] = {next, A, B};
#ifdef RTI_VECTOR
  stage_step_lanes(in, out);
#else
  stage_step(in, out);
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
  stage_cost(in, out);
#endif
}

static inline void rti_broadcast(const real *from, int count, rti_wide *to)
{
  memset(to, 0, sizeof *to);
  for (int j = 0; j < count; ++j)
    for (int l = 0; l < RTI_WIDE; ++l) RTI_AT(to[j], l) = from[j];
}

#ifndef RTI_UNROLLED_CHAIN_RULE /* else written out for the sparsity of the problem */
/* M = A M + [0 B], all by columns: derivatives over one more step */
static inline void rti_chain_rule(rti_wide (*A)[RTI_NX], rti_wide (*B)[RTI_NX], rti_wide (*M)[RTI_NX])
{
  for (int j = 0; j < RTI_NZ; ++j) {
    rti_wide column[RTI_NX];
    for (int r = 0; r < RTI_NX; ++r) {
      rti_wide sum = A[0][r] * M[j][0];
      for (int q = 1; q < RTI_NX; ++q) sum += A[q][r] * M[j][q];
      column[r] = sum;
    }
    memcpy(M[j], column, sizeof column);
  }
  for (int j = 0; j < RTI_NU; ++j)
    for (int r = 0; r < RTI_NX; ++r) M[RTI_NX + j][r] += B[j][r];
}
#endif

/* State at the end of a stage, and its derivatives with respect to state and input, by columns. */
static inline void rti_stage(int substeps, rti_wide *x, const rti_wide *u, const rti_wide *p, const rti_wide *h,
    rti_wide M[RTI_NZ][RTI_NX])
{
  rti_wide next[RTI_NX], A[RTI_NX][RTI_NX], B[RTI_NU][RTI_NX];
  rti_wide_step(x, u, p, h, next, M[0], M[RTI_NX]);
  for (int i = 1; i < substeps; ++i) {
    memcpy(x, next, sizeof next);
    rti_wide_step(x, u, p, h, next, A[0], B[0]);
    rti_chain_rule(A, B, M);
  }
  memcpy(x, next, sizeof next);
}

/* All stages; those of scenarios are side by side as those of one are. `driven`: the plan is the trajectory whose derivatives
 * rti_rollout has stored, without gaps. */
static void rti_linearize(rti_work *o, const rti_settings *settings, const real *p, const real *refs, int driven)
{
  const real step = settings->stage / (real)settings->substeps;
  /* what is structurally zero, or behind the end of a row, is not written below */
  if (!driven) memset(o->M, 0, sizeof o->M);
  else memset(o->defect, 0, sizeof o->defect);
  memset(o->g, 0, sizeof o->g);
  memset(o->H, 0, sizeof o->H);
  memset(o->c, 0, sizeof o->c);
  memset(o->C, 0, sizeof o->C);
  rti_wide wp[RTI_SIZE(RTI_NP)], ww[RTI_SIZE(RTI_NR)], wr[RTI_SIZE(RTI_NR)], h[1];
  rti_broadcast(p, RTI_NP, wp);
  rti_broadcast(settings->weights, RTI_NR, ww);
  rti_broadcast(&step, 1, h);
  memset(wr, 0, sizeof wr);
  for (int k = 0; k < RTI_STAGES; k += RTI_WIDE) {
    rti_wide x[RTI_NX], u[RTI_NU], M[RTI_NZ][RTI_NX], cost[1], g[RTI_NZ], H[RTI_NZ][RTI_NZ];
    rti_wide c[RTI_SIZE(RTI_NC)], C[RTI_NZ][RTI_SIZE(RTI_NC)];
    memset(x, 0, sizeof x);
    memset(u, 0, sizeof u);
    for (int l = 0; l < RTI_WIDE; ++l) {
      const int at = rti_lesser(k + l, RTI_STAGES - 1); /* lanes beyond the last stage repeat it */
      const int node = rti_node(at), row = RTI_SCENARIOS > 1 ? at % RTI_N : at;
      for (int j = 0; j < RTI_NX; ++j) RTI_AT(x[j], l) = o->x[node][j];
      for (int j = 0; j < RTI_NU; ++j) RTI_AT(u[j], l) = o->u[at][j];
      for (int j = 0; j < RTI_NR; ++j) RTI_AT(wr[j], l) = refs[row * RTI_NR + j];
#ifdef RTI_ROBUST
      const int b = rti_scenario(at);
      real own[RTI_SIZE(RTI_NP)];
      rti_parameters(settings, b, p, own);
      for (int j = 0; j < RTI_NP; ++j) RTI_AT(wp[j], l) = own[j];
      for (int j = 0; j < RTI_NR; ++j) RTI_AT(ww[j], l) = settings->share[b] * settings->weights[j];
#endif
    }
    rti_wide_cost(x, u, wp, wr, ww, cost, g, H[0], c, C[0]);
    if (!driven) rti_stage(settings->substeps, x, u, wp, h, M);
    for (int l = 0; l < rti_lesser(RTI_WIDE, RTI_STAGES - k); ++l) {
      const int at = k + l, node = rti_node(at);
      rti_store_cost(o, at, l, H, C);
      if (!driven) rti_store_step(o, at, l, M);
      o->l[node] = RTI_AT(cost[0], l);
      for (int i = 0; !driven && i < RTI_NX; ++i) o->defect[at][i] = RTI_AT(x[i], l) - o->x[node + 1][i];
      for (int i = 0; i < RTI_NZ; ++i) o->g[node][i] = RTI_AT(g[i], l);
      for (int i = 0; i < RTI_NC; ++i) o->c[node][i] = RTI_AT(c[i], l);
      for (int j = RTI_NX; j < RTI_NZ; ++j) o->H[node][j][j] += settings->regularization[j - RTI_NX];
    }
  }
}

/* The last node of a scenario; rows of stages only are zero there. */
static void rti_linearize_end(rti_work *o, const rti_settings *settings, int b, const real *p, const real *refs)
{
  const int end = b * (RTI_N + 1) + RTI_N;
  real g[RTI_NX] = {0}, H[RTI_NX][RTI_NX], c[RTI_SIZE(RTI_NS)] = {0}, C[RTI_NX][RTI_SIZE(RTI_NS)];
  const real *weights = settings->terminal_weights;
#ifdef RTI_ROBUST
  real own[RTI_SIZE(RTI_NP)], weighted[RTI_SIZE(RTI_NR)] = {0};
  rti_parameters(settings, b, p, own);
  for (int j = 0; j < RTI_NR; ++j) weighted[j] = settings->share[b] * weights[j];
  p = own;
  weights = weighted;
#endif
  const real *in[] = {o->x[end], p, refs, weights};
  real *out[] = {&o->l[end], g, H[0], c, C[0]};
  terminal_cost(in, out);
  memset(o->g[end], 0, sizeof o->g[end]);
  memset(o->H[end], 0, sizeof o->H[end]);
  memset(o->c[end], 0, sizeof o->c[end]);
  memset(o->C[end], 0, sizeof o->C[end]);
  for (int i = 0; i < RTI_NX; ++i) {
    o->g[end][i] = g[i];
    for (int j = 0; j < RTI_NX; ++j) o->H[end][i][j] = H[i][j];
  }
  for (int i = 0; i < RTI_NS; ++i) {
    o->c[end][i] = c[i];
    for (int j = 0; j < RTI_NX; ++j) o->C[end][i][j] = C[j][i];
  }
}
