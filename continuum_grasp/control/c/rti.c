/* The functions of rti.h.
 *
 * 1. rti_prepare linearizes all stages at the plan, and factorizes the QP without bounds.
 * 2. rti_feedback solves that from the measured state; where no bound is violated, this is the answer.
 * 3. Else the active set, from that of the QP before or from an estimate (rti_active_set.c).
 * 4. Where it cycles, the interior point (rti_interior_point.c), whose estimate of the set is tried in between.
 * 5. The plan moves by the solution; what is still wrong is reported, relative to the cost of moving an input.
 */

/* Rounds of the active set from a warm start, and from the interior point's estimate. In the closed loop of
 * configs/mpc/steady_tip.yaml a QP takes 3.5 factorizations on average and 10 at most, and needs no interior point; with 6
 * rounds of the first up to 27. In that of configs/mpc/keep_out.yaml, whose bounds are curved, it takes 15; with 1 and 6
 * rounds of the second 13 and 16. */
#define RTI_ROUNDS 12
#define RTI_FINAL_ROUNDS 3
/* Mean complementarity products, per cost of moving an input by its scale, at which the interior point's estimate of the
 * active set is tried: first at 1e-2 (in keep_out 1e-1: 15.6 factorizations, 1e-4: 14.0), then each time they have fallen by
 * 1e-3 (1e-1: 21, 1e-6: 13.9). Below the last, rounding hides any further progress. */
#define RTI_FIRST_PRODUCT RTI_R(1e-2)
#define RTI_PRODUCT_FACTOR RTI_R(1e-3)
#ifdef RTI_SINGLE
#define RTI_LAST_PRODUCT RTI_R(1e-6)
#else
#define RTI_LAST_PRODUCT RTI_R(1e-13)
#endif

void rti_start(rti_plan *plan, const real *x0, const real *u0)
{
  memset(plan, 0, sizeof *plan);
  for (int k = 0; k < RTI_NODES; ++k) memcpy(plan->x[k], x0, sizeof plan->x[k]);
  for (int k = 0; k < RTI_STAGES; ++k) memcpy(plan->u[k], u0, sizeof plan->u[k]);
}

void rti_shift(rti_plan *plan, const rti_settings *settings, real stages)
{
  (void)settings;
  if (!rti_finite(&stages, 1) || !(stages > 0)) return;
  const int whole = stages < RTI_N ? (int)stages : RTI_N;
  const real part = stages < RTI_N ? stages - (real)whole : 0;
  plan->moved = rti_min(plan->moved + stages, RTI_N);
  /* in place: an entry is read from its own index or a later one */
  for (int b = 0; b < RTI_SCENARIOS; ++b) {
    real (*x)[RTI_NX] = plan->x + b * (RTI_N + 1), (*u)[RTI_NU] = plan->u + b * RTI_N;
    for (int k = 0; k <= RTI_N; ++k) {
      const int i = rti_lesser(k + whole, RTI_N), j = rti_lesser(i + 1, RTI_N);
      for (int r = 0; r < RTI_NX; ++r) x[k][r] = (1 - part) * x[i][r] + part * x[j][r];
    }
    for (int k = 0; k < RTI_N; ++k) {
      const int i = rti_lesser(k + whole, RTI_N - 1), j = rti_lesser(i + 1, RTI_N - 1);
      for (int r = 0; r < RTI_NU; ++r) u[k][r] = (1 - part) * u[i][r] + part * u[j][r];
    }
  }
}

int rti_rollout(rti_plan *plan, rti_work *o, const rti_settings *settings, const real *x0, const real *p)
{
  o->driven = 0;
  if (!rti_settings_valid(settings) || !rti_finite(x0, RTI_NX) || !rti_finite(p, RTI_NP)) return RTI_BAD_INPUT;
  memset(o->M, 0, sizeof o->M);
  const real h = settings->stage / (real)settings->substeps;
  rti_wide wp[RTI_SIZE(RTI_NP)], wh[1], x[RTI_NX], u[RTI_NU], M[RTI_NZ][RTI_NX];
  rti_broadcast(p, RTI_NP, wp);
  rti_broadcast(&h, 1, wh);
  for (int b = 0; b < RTI_SCENARIOS; ++b) {
    real (*nodes)[RTI_NX] = plan->x + b * (RTI_N + 1);
#ifdef RTI_ROBUST
    real own[RTI_SIZE(RTI_NP)];
    rti_parameters(settings, b, p, own);
    rti_broadcast(own, RTI_NP, wp);
#endif
    memcpy(nodes[0], x0, sizeof nodes[0]);
    for (int k = 0; k < RTI_N; ++k) {
      rti_broadcast(nodes[k], RTI_NX, x);
      rti_broadcast(plan->u[b * RTI_N + k], RTI_NU, u);
      rti_stage(settings->substeps, x, u, wp, wh, M);
      for (int i = 0; i < RTI_NX; ++i) nodes[k + 1][i] = RTI_AT(x[i], 0);
      if (!rti_finite(nodes[k + 1], RTI_NX)) return RTI_BAD_LINEARIZATION;
      rti_store_step(o, b * RTI_N + k, 0, M);
    }
  }
  /* what the derivatives are of: a preparation at the same plan takes them */
  memcpy(o->x, plan->x, sizeof o->x);
  memcpy(o->u, plan->u, sizeof o->u);
#if RTI_NP > 0
  memcpy(o->p, p, sizeof o->p);
#endif
  o->stage = settings->stage;
  o->driven = settings->substeps;
  return RTI_SOLVED;
}

static int rti_equal(const real *a, const real *b, size_t count)
{
  int same = 1;
  for (size_t i = 0; i < count; ++i) same &= a[i] == b[i];
  return same;
}

/* Whether the stages are those of the last rollout, whose derivatives are at hand; its inputs are compared by the caller. */
static int rti_is_driven(const rti_work *o, const rti_plan *plan, const rti_settings *settings, const real *p)
{
  return o->driven == settings->substeps && rti_equal(&o->stage, &settings->stage, 1)
      && rti_equal(o->x[0], plan->x[0], RTI_NODES * RTI_NX) && rti_equal(o->p, p, RTI_NP);
}

int rti_prepare(rti_work *o, const rti_plan *plan, const rti_settings *settings, const real *p, const real *refs)
{
  o->ready = 0;
  if (!rti_settings_valid(settings) || !rti_finite(p, RTI_NP) || !rti_finite(refs, (RTI_N + 1) * RTI_NR)
      || !rti_finite(plan->x[0], RTI_NODES * RTI_NX) || !rti_finite(plan->u[0], RTI_STAGES * RTI_NU)
      || !rti_between(plan->moved, 0, RTI_N))
    return RTI_BAD_INPUT;
  int driven = o->driven && rti_is_driven(o, plan, settings, p);
  o->driven = 0;
  memcpy(o->x, plan->x, sizeof o->x);
  for (int k = 0; k < RTI_STAGES; ++k) /* the limits may have moved since the plan was made */
    for (int j = 0; j < RTI_NU; ++j) {
      const real u = rti_max(settings->u_min[j], rti_min(settings->u_max[j], plan->u[k][j]));
      driven &= o->u[k][j] == u;
      o->u[k][j] = u;
    }
#ifdef RTI_ROBUST
  driven = 0; /* scenarios come to share their first input */
  rti_share(o, settings);
#endif
  rti_linearize(o, settings, p, refs, driven);
  for (int b = 0; b < RTI_SCENARIOS; ++b) rti_linearize_end(o, settings, b, p, refs + RTI_N * RTI_NR);
  rti_solve_free(o);
  /* the QP and its feedback in one pass: these members are all real, one after the other */
  const size_t first = offsetof(rti_work, M), count = (offsetof(rti_work, z) - first) / sizeof(real);
  if (!rti_finite((const real *)(const void *)((const char *)o + first), count)) return RTI_BAD_LINEARIZATION;
  o->ready = 1;
  return RTI_SOLVED;
}

/* Whether the trajectory satisfies all bounds: then the solution without bounds is that of the QP. */
static int rti_feasible(const rti_work *o, const rti_settings *s)
{
  for (int i = 0; i < RTI_ROWS; ++i)
    if (rti_penalized(s, i) && rti_excess(s, i, o->y[i]) > s->tolerance * rti_scale(s, i)) return 0;
  return 1;
}

/* Cost of the QP and largest violation of a row; whether one is to be reported, which takes 100 times the tolerance so
 * that rounding at an active bound does not count. */
static int rti_evaluate(rti_work *o, const rti_settings *s, rti_report *report)
{
  real cost = o->l[RTI_NODES - 1];
  int violated = 0;
  for (int k = 0; k < RTI_NODES; ++k) {
    if (k < RTI_NODES - 1) cost += o->l[k];
    real sum[RTI_W] = {0};
    rti_add_hessian(sum, o->H[k], o->z[k]);
    for (int i = 0; i < RTI_NZ; ++i) cost += o->z[k][i] * (o->g[k][i] + RTI_R(0.5) * sum[i]);
  }
  for (int i = 0; i < RTI_NC; ++i) {
    const int row = RTI_NU + i;
    const real low = s->c_min[i], high = s->c_max[i], reported = 100 * s->tolerance * rti_scale(s, row);
    for (int k = 0; rti_penalized(s, row) && k < RTI_STAGES; ++k) {
      const real y = o->y[row][k];
      const real over = rti_max(high < RTI_ABSENT ? y - high : 0, low > -RTI_ABSENT ? low - y : 0);
      if (!(over > 0)) continue;
      cost += over * (s->linear[i] + RTI_R(0.5) * s->quadratic[i] * over);
      report->violation = rti_max(report->violation, over);
      if (over > reported) {
        violated = 1;
        report->excess[i] = rti_max(report->excess[i], over);
      }
    }
  }
  report->cost = cost / RTI_SCENARIOS;
  return violated;
}

/* Multipliers of bounded quantities from those of their sides. */
static void rti_gather_multipliers(rti_work *o)
{
  memset(o->a, 0, sizeof o->a);
  for (int i = 0; i < o->sides; ++i) {
    const rti_side side = o->side[i];
    for (int k = 0; k < RTI_STAGES; ++k) o->a[side.row][k] += side.sign * o->m[i][k];
  }
}

/* Relative residual of the optimality conditions at the interior point: the gradient, and the complementarity products,
 * as a share of the inputs' scales or of what the multipliers cost per scale of their bounds. */
static real rti_optimality(rti_work *o, const rti_settings *s, real unit)
{
  const real mean = rti_mean(o);
  real cost = 0, pairs = 0;
  for (int i = 0; i < o->sides; ++i) {
    const real scale = rti_scale(s, o->side[i].row);
    for (int k = 0; k < RTI_LENGTH; ++k) cost += scale * o->m[i][k];
    pairs += o->side[i].soft ? (real)(2 * RTI_LENGTH) : (real)RTI_LENGTH;
  }
  rti_forces(o);
  rti_gradient(o);
  memset(o->active, RTI_FREE, sizeof o->active);
  for (int j = 0; j < RTI_NU; ++j)
    for (int k = 0; rti_fixed(s, j) && k < RTI_STAGES; ++k) o->active[j][k] = RTI_AT_HIGH;
  const real share = RTI_SQRT(mean / unit);
  return rti_max(rti_free_residual(o, s), mean * pairs < share * cost ? mean * pairs / cost : share);
}

/* Solve the QP with bounds. The active set from a warm start needs a median of 0 to 5 factorizations in the shipped closed
 * loops, but may cycle from a bad start; the interior point converges from anywhere, but slowly near the solution. So the
 * interior point takes over where the active set fails, and hands back its estimate as soon as that suffices. All of
 * them together take s->iterations factorizations at most. */
static int rti_solve(rti_work *o, const rti_plan *plan, const rti_settings *s, rti_report *report)
{
  memcpy(o->saved, o->z, sizeof o->z);
  o->is_free = 0;
  memset(o->a, 0, sizeof o->a);
  const int how = rti_previous_set(o, plan) || rti_plan_set(o, s) ? RTI_RETAINED : RTI_ESTIMATED;
  /* rows far from their bounds need none, which takes as long as two and a half factorizations */
  o->has_stiffness = how != RTI_RETAINED || rti_rows_matter(o, s);
  if (o->has_stiffness) rti_stiffnesses(o);
  else rti_pivots(o);
  const int found = rti_active_set(o, s, how, rti_lesser(RTI_ROUNDS, s->iterations), report);
  if (found) return found == RTI_ROUNDED ? RTI_ITERATION_LIMIT : RTI_SOLVED;
  /* the last of its points is closer than a first one of the interior point */
  if (report->iterations >= s->iterations) return RTI_ITERATION_LIMIT;
  if (!o->has_stiffness) rti_stiffnesses_again(o);
  rti_sides(o, s);
  memcpy(o->z, o->saved, sizeof o->z);  /* the trajectory without bounds */
  rti_inner_trajectory(o, s);
  if (o->sides == 0) return RTI_ITERATION_LIMIT;
  rti_center(o, RTI_CENTER * rti_first_product(o, s));
  const real unit = rti_unit_cost(o, s);
  for (real products = RTI_FIRST_PRODUCT;; products *= RTI_PRODUCT_FACTOR) {
    const int small = rti_interior_point(o, s, products * unit, &report->iterations);
    memcpy(o->saved, o->z, sizeof o->z);        /* where the interior point goes on if the active set fails */
    rti_gather_multipliers(o);
    const int left = s->iterations - report->iterations;
    const int again = rti_active_set(o, s, RTI_ESTIMATED, rti_lesser(RTI_FINAL_ROUNDS, left), report);
    if (again) return again == RTI_ROUNDED ? RTI_ITERATION_LIMIT : RTI_SOLVED;
    memcpy(o->z, o->saved, sizeof o->z);
    rti_bounded(o, o->z, o->y, 1);
    if (small && products > RTI_LAST_PRODUCT) continue;
    report->kkt = rti_optimality(o, s, unit);
    return report->kkt <= 100 * s->tolerance + RTI_ROUNDING ? RTI_SOLVED : RTI_ITERATION_LIMIT;
  }
}

int rti_feedback(rti_work *o, rti_plan *plan, const rti_settings *settings, const real *x0, rti_report *report)
{
  memset(report, 0, sizeof *report);
  if (!o->ready) return report->status = RTI_NOT_PREPARED;
  if (!rti_settings_valid(settings) || !rti_finite(x0, RTI_NX)) return report->status = RTI_BAD_INPUT;
  if (!o->is_free) rti_solve_free(o);   /* bounds were active for another state */
  rti_free_trajectory(o, x0);
  memset(&o->next, 0, sizeof o->next);
  const int status = rti_feasible(o, settings) ? RTI_SOLVED : rti_solve(o, plan, settings, report);
  const int violated = rti_evaluate(o, settings, report);
  for (int k = 0; k < RTI_NODES; ++k)
    for (int i = 0; i < RTI_NX; ++i) o->next.x[k][i] = o->x[k][i] + o->z[k][i];
  for (int k = 0; k < RTI_STAGES; ++k)
    for (int j = 0; j < RTI_NU; ++j) {
      const real u = o->u[k][j] + o->z[rti_node(k)][RTI_NX + j];
      o->next.u[k][j] = rti_max(settings->u_min[j], rti_min(settings->u_max[j], u));
    }
  if (!rti_finite(o->next.x[0], RTI_NODES * RTI_NX) || !rti_finite(o->z[0], RTI_NODES * RTI_W)
      || !rti_finite(&report->cost, 1))
    return report->status = RTI_BAD_SOLUTION;
  /* Without a factorization no bound is active, and the set of `next` is empty. */
  if (report->iterations > 0) rti_remember_set(o, plan, &o->next);
  *plan = o->next;
  return report->status = status == RTI_SOLVED && violated ? RTI_ROW_VIOLATED : status;
}
