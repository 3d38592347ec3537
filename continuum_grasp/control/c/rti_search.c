/* A search for the step length, for iterations from one state whose full steps do not settle.
 *
 * Full steps are what converges fast near the solution; far from it they may cycle, or end where the model is not finite. A merit
 * of the gaps between the stages cuts good steps too: of 200 states of configs/mpc/keep_out.yaml with curvatures of 20 1/m and
 * rates of 600 1/m/s, full steps settle in 197, backtracking on an exact penalty in 140. So the search goes along integrated
 * trajectories, without gaps: the inputs of the plan, moved along those of the QP's solution, driven from the state. Its cost
 * with all penalties decreases along that direction, by which the iterations converge. Steps beyond one are tried too, since
 * the Hessian without second derivatives may be several times too stiff. Candidates lie side by side in the vector lanes.
 * Where full steps turn out best and shrink, they go on without it: near the solution curved rows make costs rise along good
 * steps.
 */

#define RTI_PATIENCE 5                /* full steps before a search: as many as a start of a controller takes by default */
#define RTI_SHRINKS RTI_R(0.5)        /* of the change of the inputs over RTI_MEMORY iterations, up to which they settle; 0.9
                                         finds the same */
#define RTI_CONVERGES RTI_R(0.2)      /* of the change by a full step, up to which the next one is taken without a search */
#define RTI_CANDIDATES 8
#define RTI_SHORTER 64                /* factor by which all candidates shrink where none decreases the cost */
#define RTI_SHORTEST RTI_R(1e-6)      /* factor at which the search ends */

void rti_begin(rti_work *o)
{
  o->taken = 0;
  o->search = RTI_FULL_STEPS;
}

/* Largest change of an input by the last QP, per scale. */
static real rti_input_change(const rti_work *o, const rti_settings *s)
{
  real most = 0;
  for (int j = 0; j < RTI_NU; ++j) {
    const real unit = rti_scale(s, j);
    for (int k = 0; k < RTI_N; ++k) most = rti_max(most, rti_abs(o->z[k][RTI_NX + j]) / unit);
  }
  return most;
}

#ifdef RTI_CHECKS_GAPS
real rti_gaps(const rti_work *o, const rti_plan *plan, const rti_settings *s, const real *p)
{
  const real step = s->stage / (real)s->substeps;
  real total = 0;
  rti_wide wp[RTI_SIZE(RTI_NP)], h[1];
  rti_broadcast(p, RTI_NP, wp);
  rti_broadcast(&step, 1, h);
  for (int k = 0; k < RTI_STAGES; k += RTI_WIDE) {
    rti_wide x[RTI_NX], u[RTI_NU], M[RTI_NZ][RTI_NX];
    memset(x, 0, sizeof x);
    memset(u, 0, sizeof u);
    for (int l = 0; l < RTI_WIDE; ++l) {
      const int at = rti_lesser(k + l, RTI_STAGES - 1); /* lanes beyond the last stage repeat it */
      for (int j = 0; j < RTI_NX; ++j) RTI_AT(x[j], l) = plan->x[rti_node(at)][j];
      for (int j = 0; j < RTI_NU; ++j) RTI_AT(u[j], l) = plan->u[at][j];
#ifdef RTI_ROBUST
      real own[RTI_SIZE(RTI_NP)];
      rti_parameters(s, rti_scenario(at), p, own);
      for (int j = 0; j < RTI_NP; ++j) RTI_AT(wp[j], l) = own[j];
#endif
    }
    rti_stage(s->substeps, x, u, wp, h, M);
    for (int l = 0; l < rti_lesser(RTI_WIDE, RTI_STAGES - k); ++l) {
      const int next = rti_node(k + l) + 1;
      real gap[RTI_NX];
      for (int i = 0; i < RTI_NX; ++i) gap[i] = RTI_AT(x[i], l) - plan->x[next][i];
      for (int i = 0; i < RTI_NX; ++i)
        for (int j = 0; j < RTI_NX; ++j) total += RTI_R(0.5) * gap[i] * o->H[next][i][j] * gap[j];
    }
  }
  return total;
}
#endif

#ifndef RTI_ROBUST
/* An input of a candidate. */
static inline real rti_candidate(const rti_work *o, const rti_settings *s, int k, int j, real length)
{
  return rti_max(s->u_min[j], rti_min(s->u_max[j], o->u[k][j] + length * o->z[k][RTI_NX + j]));
}

static inline real rti_penalty(const rti_settings *s, int i, real c)
{
  const real over = rti_max(0, rti_max(c - s->c_max[i], s->c_min[i] - c));
  return over * (s->linear[i] + RTI_R(0.5) * s->quadratic[i] * over);
}

/* Costs, penalties included, of the trajectories from x0 of RTI_WIDE step lengths. */
static void rti_candidate_costs(const rti_work *o, const rti_settings *s, const real *x0, const real *p, const real *refs,
    const real length[RTI_WIDE], real total[RTI_WIDE])
{
  const real step = s->stage / (real)s->substeps;
  rti_wide wp[RTI_SIZE(RTI_NP)], ww[RTI_SIZE(RTI_NR)], wr[RTI_SIZE(RTI_NR)], h[1], x[RTI_NX], u[RTI_NU];
  rti_broadcast(p, RTI_NP, wp);
  rti_broadcast(s->weights, RTI_NR, ww);
  rti_broadcast(&step, 1, h);
  rti_broadcast(x0, RTI_NX, x);
  memset(u, 0, sizeof u);
  for (int l = 0; l < RTI_WIDE; ++l) total[l] = 0;
  for (int k = 0; k < RTI_N; ++k) {
    rti_wide M[RTI_NZ][RTI_NX], cost[1], g[RTI_NZ], H[RTI_NZ][RTI_NZ], c[RTI_SIZE(RTI_NC)], C[RTI_NZ][RTI_SIZE(RTI_NC)];
    rti_broadcast(refs + k * RTI_NR, RTI_NR, wr);
    for (int j = 0; j < RTI_NU; ++j)
      for (int l = 0; l < RTI_WIDE; ++l) RTI_AT(u[j], l) = rti_candidate(o, s, k, j, length[l]);
    rti_wide_cost(x, u, wp, wr, ww, cost, g, H[0], c, C[0]);
    for (int l = 0; l < RTI_WIDE; ++l) {
      total[l] += RTI_AT(cost[0], l);
      for (int i = k > 0 ? 0 : RTI_NS; i < RTI_NC; ++i) total[l] += rti_penalty(s, i, RTI_AT(c[i], l));
    }
    rti_stage(s->substeps, x, u, wp, h, M);
  }
  for (int l = 0; l < RTI_WIDE; ++l) {
    real end[RTI_NX], cost = 0, g[RTI_NX], H[RTI_NX * RTI_NX], c[RTI_SIZE(RTI_NS)] = {0}, C[RTI_NX * RTI_SIZE(RTI_NS)] = {0};
    for (int i = 0; i < RTI_NX; ++i) end[i] = RTI_AT(x[i], l);
    const real *in[] = {end, p, refs + RTI_N * RTI_NR, s->terminal_weights};
    real *out[] = {&cost, g, H, c, C};
    terminal_cost(in, out);
    total[l] += cost;
    for (int i = 0; i < RTI_NS; ++i) total[l] += rti_penalty(s, i, c[i]);
  }
}

/* The best of all candidates: its step length, and its cost if that is below the one reached; else 0. */
static real rti_best_length(rti_work *o, const rti_settings *s, const real *x0, const real *p, const real *refs)
{
  static const real lengths[RTI_CANDIDATES] = {1, 2, 4, RTI_R(0.5), RTI_R(0.25), RTI_R(0.125), RTI_R(0.0625), RTI_R(0.015625)};
  real best = 0;
  for (real factor = 1; !(best > 0) && factor > RTI_SHORTEST; factor /= RTI_SHORTER)
    for (int first = 0; first < RTI_CANDIDATES; first += RTI_WIDE) {
      real length[RTI_WIDE], total[RTI_WIDE];
      for (int l = 0; l < RTI_WIDE; ++l) length[l] = factor * lengths[rti_lesser(first + l, RTI_CANDIDATES - 1)];
      rti_candidate_costs(o, s, x0, p, refs, length, total);
      for (int l = 0; l < RTI_WIDE; ++l)
        if (rti_finite(&total[l], 1) && total[l] < o->reached) {
          o->reached = total[l];
          best = length[l];
        }
    }
  return best;
}

/* From now on, along integrated trajectories: that of the plan's inputs, or where those are not usable, of the ones before. */
static int rti_start_search(rti_work *o, rti_plan *plan, const rti_settings *s, const real *x0, const real *p,
    const real *refs, int status)
{
  /* a plan that cannot be linearized is where the last step led */
  const real back = status == RTI_BAD_LINEARIZATION ? -1 : 0;
  real length[RTI_WIDE], total[RTI_WIDE];
  for (int l = 0; l < RTI_WIDE; ++l) length[l] = back;
  memcpy(o->u, plan->u, sizeof o->u);
  for (int k = 0; k < RTI_N; ++k)
    for (int j = 0; j < RTI_NU; ++j) plan->u[k][j] = rti_candidate(o, s, k, j, back);
  const int found = rti_rollout(plan, o, s, x0, p);
  rti_candidate_costs(o, s, x0, p, refs, length, total);
  if (found < 0 || !rti_finite(total, 1)) return status < 0 ? status : RTI_BAD_LINEARIZATION;
  o->search = RTI_SEARCH;
  o->full = 0;
  o->reached = total[0];
  return status < 0 ? RTI_ITERATION_LIMIT : status;
}

int rti_continue(rti_work *o, rti_plan *plan, const rti_settings *s, const real *x0, const real *p, const real *refs,
    int status)
{
  if (status == RTI_BAD_INPUT || status == RTI_NOT_PREPARED) return status;
  if (status < 0) return o->search == RTI_FULL_STEPS && o->taken > 0 ? rti_start_search(o, plan, s, x0, p, refs, status) : status;
  const real now = rti_input_change(o, s), last = o->change[(o->taken + RTI_MEMORY - 1) % RTI_MEMORY];
  real *before = &o->change[o->taken % RTI_MEMORY];
  const int slow = o->taken >= RTI_PATIENCE && now > RTI_SHRINKS * *before && now > s->tolerance;
  *before = now;
  ++o->taken;
  if (o->search == RTI_FULL_STEPS) return slow ? rti_start_search(o, plan, s, x0, p, refs, status) : status;
  if (o->full && now <= RTI_CONVERGES * last) {
    o->search = RTI_FULL_STEPS;
    o->taken = 1;
    return status;
  }
  const real length = rti_best_length(o, s, x0, p, refs);
  for (int k = 0; k < RTI_N; ++k)
    for (int j = 0; j < RTI_NU; ++j) plan->u[k][j] = rti_candidate(o, s, k, j, length);
  if (!(length > 0)) o->search = RTI_STUCK;
  o->full = !(length < 1) && !(length > 1);
  return rti_rollout(plan, o, s, x0, p) < 0 ? RTI_BAD_LINEARIZATION : status;
}
#else
/* Plans of scenarios take full steps. */
int rti_continue(rti_work *o, rti_plan *plan, const rti_settings *s, const real *x0, const real *p, const real *refs,
    int status)
{
  (void)plan, (void)x0, (void)p, (void)refs;
  o->change[o->taken++ % RTI_MEMORY] = rti_input_change(o, s);
  return status;
}
#endif
