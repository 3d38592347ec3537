/* Estimator, real-time iteration, supervisor and fallback. See controller.h. One call (controller_step):
 *
 * 1. Check what is given; readings that cannot be live are taken as missing.
 * 2. Estimate state and parameters, ahead to the present.
 * 3. The supervisor judges sensors, model and call rate, and may detune the cost.
 * 4. With a state that is known and trusted, iterate on the plan of the call before.
 * 5. Command its first input within the limits; else go on along the last plan while it lasts; else the safe ramp.
 */

void controller_start(controller_state *state, const controller_settings *settings, const real *z0, const real *u0,
                      const real *p)
{
  memset(state, 0, sizeof *state);
  memcpy(state->u, u0, sizeof state->u);
#if RTI_NP > 0
  memcpy(state->p, p, sizeof state->p);
#else
  (void)p;
#endif
  /* limits of what a drive can have, which are wider than those of a command */
  for (int j = 0; j < RTI_NU; ++j) cg_limit(&state->u[j], settings->applied_min[j], settings->applied_max[j]);
#if CONTROLLER_ESTIMATES
  ekf_start(&state->ekf, &settings->ekf, z0, state->u);
#else
  memcpy(state->x, z0, sizeof state->x);
#endif
  state->started = 1;
}

static int controller_valid(const controller_settings *o)
{
  int good = cg_finite(&o->period, 1) && o->period > 0 && o->rti.stage > 0 && o->rti.substeps > 0;
  for (int j = 0; good && j < RTI_NU; ++j)
    good = cg_finite(&o->u_rate[j], 1) && o->u_rate[j] > 0 && cg_finite(&o->safe_rate[j], 1) && o->safe_rate[j] > 0
        && o->rti.u_min[j] <= o->rti.u_max[j];
  return good && cg_finite(o->rti.u_min, RTI_NU) && cg_finite(o->rti.u_max, RTI_NU) && cg_finite(o->u_safe, RTI_NU);
}

/* Length of a plan in calls; rounded, since a ratio of decimal times is not whole in binary. */
static int controller_plan_calls(const controller_settings *o)
{
  return (int)((real)RTI_N * o->rti.stage / o->period + (real)0.5);
}

/* ---- inputs ---- */

#if RTI_NR > 0
/* Whether the finger can meet the setpoints of a node. */
static int controller_reaches(const controller_settings *o, const real *r)
{
  if (!cg_within(r, o->reach_min, o->reach_max, RTI_NR)) return 0;
  for (int j = 0; j + 1 < RTI_NR; ++j) {
    const real radius = o->reach_radius[j];
    if (!(radius > 0)) continue;
    const real dx = r[j] - (o->reach_min[j] + o->reach_max[j]) / 2;
    const real dy = r[j + 1] - (o->reach_min[j + 1] + o->reach_max[j + 1]) / 2;
    if (dx * dx + dy * dy > radius * radius) return 0;
  }
  return 1;
}
#endif

static uint32_t controller_check(controller_state *state, const controller_settings *o, const controller_input *in)
{
  uint32_t anomalies = in->late ? CONTROLLER_LATE : 0;
#if RTI_NP > 0
  if (cg_within(in->p, o->p_min, o->p_max, RTI_NP)) memcpy(state->p, in->p, sizeof state->p);
  else anomalies |= CONTROLLER_BAD_PARAMETERS;
#endif
#if RTI_NR > 0
  for (int k = 0; k <= RTI_N; ++k) {
    const real *r = in->setpoints + k * RTI_NR;
    if (k > 0 && memcmp(r, r - RTI_NR, RTI_NR * sizeof *r) == 0) continue;  /* setpoints that stand: one test for all */
    if (!cg_within(r, o->r_min, o->r_max, RTI_NR)) anomalies |= CONTROLLER_BAD_SETPOINTS;
    else if (!controller_reaches(o, r)) anomalies |= CONTROLLER_OUT_OF_REACH;
  }
#endif
  if (in->applied) {
    if (cg_within(in->applied, o->applied_min, o->applied_max, RTI_NU)) memcpy(state->u, in->applied, sizeof state->u);
    else anomalies |= CONTROLLER_BAD_APPLIED;
  }
  return anomalies;
}

/* Gaps between calls, leaky as the gate of a sensor (ekf.h): what stalls now and then is bridged, and what stalls more often
 * is another call rate. */
#define CONTROLLER_STALLS 3
#define CONTROLLER_FORGIVEN (real)0.05

/* Periods that passed since the last call, by its clock; 1 where it tells nothing else. Up to half a period is jitter. */
static real controller_passed(controller_state *state, const controller_settings *o, const controller_input *in,
                              controller_output *out)
{
  const real passed = in->elapsed / o->period;
  if (!cg_finite(&passed, 1) || passed < 0) return 1;
  const int gap = passed > (real)1.5;
  state->stalls += gap ? (real)1 : -CONTROLLER_FORGIVEN;
  cg_limit(&state->stalls, 0, 2 * CONTROLLER_STALLS);
  /* a whole plan is missed again and again by a clock that counts milliseconds */
  if (!(passed > 0) || (state->stalls > CONTROLLER_STALLS && passed > (real)controller_plan_calls(o)))
    out->anomalies |= CONTROLLER_CLOCK;
  if (gap) out->missed = passed - 1;
  if (out->anomalies & CONTROLLER_CLOCK) return 1;
  if (gap) out->anomalies |= CONTROLLER_MISSED_CALLS;
  return gap || passed < (real)0.5 ? passed : 1;
}

/* Determine state and parameters from which to plan, `passed` periods after the last call; whether they are known. */
#if CONTROLLER_ESTIMATES
static int controller_estimate(controller_state *state, controller_work *work, const controller_settings *o,
                               const real *measurement, real passed, real age, controller_output *out)
{
  real z[EKF_NZ];
  const real old = cg_finite(&age, 1) && age >= 0 ? age / o->period : EKF_DELAY;
  const int result = ekf_step(&state->ekf, &work->ekf, &o->ekf, measurement, state->u, state->p, passed, old, &out->ekf);
  if (out->ekf.old) out->anomalies |= CONTROLLER_OLD;
  for (int j = 0; j < CONTROLLER_NM; ++j) out->verdict[j] = out->ekf.verdict[j];
  if (out->ekf.limited) out->anomalies |= CONTROLLER_ESTIMATE_LIMITED;
  /* A restarted estimate is a guess: it is reported, but no plan starts from it. */
  int known = result == EKF_OK;
  if (known && !ekf_now(&state->ekf, &work->ekf, &o->ekf, state->p, z)) {
    ekf_restart(&state->ekf, &o->ekf);
    known = 0;
  }
  if (!known) {
    out->anomalies |= CONTROLLER_ESTIMATE_RESTARTED;
    memcpy(z, state->ekf.z, sizeof z);
  }
  if (out->ekf.used) state->blind = 0;
  memcpy(out->x, z, CONTROLLER_ND * sizeof *z);
  const real *arg[] = {z, state->p};
  real *res[] = {out->p};
  estimated_parameters(arg, res);
  return known;
}
#else
static int controller_estimate(controller_state *state, controller_work *work, const controller_settings *o,
                               const real *measurement, real passed, real age, controller_output *out)
{
  (void)work; (void)passed; (void)age;
  int known = 1;
  for (int j = 0; j < CONTROLLER_NM; ++j) {
    out->verdict[j] = cg_verdict(measurement[j], o->x_min[j], o->x_max[j]);
    known &= out->verdict[j] == CG_USED;
  }
  if (known) {
    memcpy(state->x, measurement, sizeof state->x);
    state->blind = 0;
  }
  memcpy(out->x, state->x, sizeof state->x);
#if RTI_NP > 0
  memcpy(out->p, state->p, sizeof out->p);
#endif
  return known;
}
#endif

static uint32_t controller_sensor_anomalies(const controller_output *out)
{
  /* by verdict, in the order of checks.h; CG_USED and CG_ALONE are no anomalies */
  static const uint32_t bits[] = {0, CONTROLLER_MISSING, CONTROLLER_ABSURD, CONTROLLER_OUTLIER, CONTROLLER_REOPENED, 0,
                                  CONTROLLER_FROZEN};
  uint32_t seen = 0;
  for (int j = 0; j < CONTROLLER_NM; ++j) seen |= bits[out->verdict[j]];
  return seen;
}

/* ---- a new plan ---- */

/* Settings of a call: the weight of the command's rate is raised fourfold per rung. Each fourfold buys about one period
 * of unmodeled delay (input_rate 5e-5, 5e-4, 2e-3: one, two, three). */
static const rti_settings *controller_problem(const controller_state *state, controller_work *work,
                                              const controller_settings *o)
{
  if (!state->supervisor.rung) return &o->rti;
  memcpy(&work->detuned, &o->rti, sizeof work->detuned);
  for (int j = RTI_NR - RTI_NU; j < RTI_NR; ++j) work->detuned.weights[j] *= (real)(1 << 2 * state->supervisor.rung);
  return &work->detuned;
}

/* Iterate on the plan in the workspace; whether it succeeded. */
static int controller_iterate(controller_work *work, const rti_settings *o, const controller_input *in, int iterations,
                              controller_output *out)
{
  int status = 0;
  rti_begin(&work->rti);
  for (int k = 0; k < iterations && status >= 0 && work->rti.search != RTI_STUCK; ++k) {
    const uint32_t begin = CONTROLLER_TICKS();
    status = rti_prepare(&work->rti, &work->plan, o, out->p, in->setpoints);
    const uint32_t prepared = CONTROLLER_TICKS();
    const int before = out->rti.iterations;       /* reported is the sum, which bounds the time of the call */
    if (status >= 0) {
      status = rti_feedback(&work->rti, &work->plan, o, out->x, &out->rti);
      out->rti.iterations += before;
    }
    if (iterations > 1)
      status = rti_continue(&work->rti, &work->plan, o, out->x, out->p, in->setpoints, status);
    out->ticks[1] += prepared - begin;
    out->ticks[2] += CONTROLLER_TICKS() - prepared;
  }
  if (status < 0 || !cg_finite(work->plan.u[0], RTI_NU)) {
    memset(&work->rti, 0, sizeof work->rti);  /* no trace of non-finite numbers in the next call */
    return 0;
  }
  out->status = status;
  return 1;
}

#ifdef RTI_CHECKS_GAPS
/* Full steps on contacts may repeat themselves: a plan that lets go and comes back is moved on by a stage and found again, call
 * after call, while nothing of it is carried out and the best one costs an eighth. Its gaps never close. Where they cost
 * CONTROLLER_GAPS of the plan's cost at CONTROLLER_CHECKS checks in a row, half a horizon apart, the plan's inputs are
 * integrated, which ends it. Of such a plan they cost 0.6 to 1, of those of configs/mission/mug.yaml 1e-3 in the median and
 * 0.14 at most while the mug is held, more for a few calls where contacts close and open. Where a plan costs nothing any
 * more, all of it is rounding.
 *
 * Full steps may lead away as well, within three calls to costs of 1e20. A plan that costs CONTROLLER_JUMP times as much as
 * any before is checked at once, and is not followed where that is due to gaps: the controller plans from rest. Of 178 masses
 * on stiff walls, whose setpoint of the force jumps, 2 are lost and the mean cost is 3,900 without checks, 75 without this
 * one; with 20, 4, 2 times it is 53, 51, 47. */
#define CONTROLLER_GAPS (real)0.3
#define CONTROLLER_CHECKS 2
#define CONTROLLER_NO_COST (real)1e-9   /* of the greatest cost that a plan had */
#define CONTROLLER_JUMP (real)4

/* Whether the new plan may be followed. */
static int controller_check_gaps(controller_state *state, const controller_work *work, const controller_settings *o,
                                 controller_output *out)
{
  const real most = state->most, cost = out->rti.cost;
  const int jumps = most > 0 && cost > CONTROLLER_JUMP * most;
  if (2 * ++state->unchecked >= controller_plan_calls(o) || jumps) {
    const real gaps = rti_gaps(&work->rti, &work->plan, &o->rti, out->p);
    const int open = !(gaps <= rti_max(CONTROLLER_GAPS * cost, CONTROLLER_NO_COST * rti_max(cost, most)));
    if (open && jumps) {
      out->anomalies |= CONTROLLER_PLAN_GAPS;
      return 0;
    }
    state->unchecked = 0;
    state->gaps = open ? state->gaps + 1 : 0;
  }
  state->most = rti_max(most, cost);
  return 1;
}

/* Integrate the inputs of the plan from the state; where that leaves what is finite, the plan stays. */
static void controller_close_gaps(controller_state *state, controller_work *work, const controller_settings *o,
                                  controller_output *out)
{
  state->gaps = 0;
  memcpy(&work->rti.next, &work->plan, sizeof work->plan);
  if (rti_rollout(&work->plan, &work->rti, &o->rti, out->x, out->p) < 0)
    memcpy(&work->plan, &work->rti.next, sizeof work->plan);
  else
    out->anomalies |= CONTROLLER_PLAN_GAPS;
}
#endif

/* Plan from the last plan; from rest where there is none, or where that fails. */
static int controller_plan(controller_state *state, controller_work *work, const controller_settings *o,
                           const controller_input *in, controller_output *out)
{
  const rti_settings *problem = controller_problem(state, work, o);
  const int calls = o->start_calls > 0 ? o->start_calls : 1, first = o->start_iterations / calls;
  int planned = 0;
  /* On a copy: where the iteration fails, the last plan is the fallback. */
  if (state->planned) {
    memcpy(&work->plan, &state->plan, sizeof work->plan);
    rti_shift(&work->plan, &o->rti, state->age);
#ifdef RTI_CHECKS_GAPS
    if (state->gaps >= CONTROLLER_CHECKS) controller_close_gaps(state, work, o, out);
#endif
    /* a share of what a start has left */
    const int share = calls > 1 ? (o->start_iterations - first + calls - 2) / (calls - 1) : 0;
    const int more = rti_lesser(share, state->pending), count = more > o->sqp_iterations ? more : o->sqp_iterations;
    planned = controller_iterate(work, problem, in, count, out);
    state->pending -= more;
#ifdef RTI_CHECKS_GAPS
    planned = planned && controller_check_gaps(state, work, o, out);
#endif
  }
  if (!planned) {
    /* A motion of the model makes a better first linearization than a state at rest, where it stays finite. */
#ifdef RTI_CHECKS_GAPS
    state->unchecked = state->gaps = 0;
#endif
    rti_start(&work->plan, out->x, state->u);
    if (rti_rollout(&work->plan, &work->rti, &o->rti, out->x, out->p) < 0) rti_start(&work->plan, out->x, state->u);
    planned = controller_iterate(work, problem, in, first > 0 ? first : 1, out);
    state->pending = planned && first < o->start_iterations ? o->start_iterations - first : 0;
  }
  if (!planned) return 0;
  memcpy(&state->plan, &work->plan, sizeof state->plan);
  state->planned = 1;
  state->age = 0;
  return 1;
}

/* ---- supervision ---- */

/* Measured tip minus its setpoint, and whether that moves: from where it stood, or over the horizon, by a fourth of what is an
 * offset. The distance is below 0 where one of both is unknown. */
static void controller_compare(controller_state *state, const controller_settings *o, const controller_input *in,
                               const real *y, supervisor_evidence *seen)
{
  const int tip = o->supervisor.tip, setpoint = o->supervisor.setpoint;
  real squares = 0;
  if (tip < 0 || setpoint < 0 || !cg_finite(in->setpoints + setpoint, 2)) return;
  for (int node = 0; node <= RTI_N; ++node)
    for (int k = 0; k < 2; ++k) {
      const real moved = in->setpoints[node * RTI_NR + setpoint + k] - state->aim[k];
      seen->moves |= !(4 * moved <= o->supervisor.offset && -4 * moved <= o->supervisor.offset);
    }
  if (seen->moves) memcpy(state->aim, in->setpoints + setpoint, sizeof state->aim);
  if (!cg_finite(y + tip, 2)) return;
  for (int k = 0; k < 2; ++k) {
    seen->from[k] = y[tip + k] - in->setpoints[setpoint + k];
    squares += seen->from[k] * seen->from[k];
  }
  seen->distance = CG_SQRT(squares);
}

/* Supervise a call; whether a plan may be followed. */
static int controller_supervise(controller_state *state, const controller_settings *o, const controller_input *in,
                                const real *y, int *moves, controller_output *out)
{
#if CONTROLLER_ESTIMATES
  const ekf_report *ekf = &out->ekf;
  supervisor_evidence seen = {ekf->nis, ekf->echo, ekf->along, ekf->travel, ekf->ahead, ekf->change,
                              y, ekf->expected, out->verdict, ekf->implausible, -1, -1, {0, 0}, 0};
#else
  supervisor_evidence seen = {0, 0, 0, 0, 0, 0, 0, 0, out->verdict, 0, -1, -1, {0, 0}, 0};
#endif
  /* single gaps are bridged, and no evidence; nor is a clock that goes back */
  const int judged = state->stalls > CONTROLLER_STALLS || !(out->anomalies & CONTROLLER_MISSED_CALLS);
  if (cg_finite(&in->elapsed, 1) && in->elapsed > 0 && judged) seen.elapsed = in->elapsed / o->period;
  controller_compare(state, o, in, y, &seen);
  *moves = seen.moves;
  supervisor_judge(&state->supervisor, &o->supervisor, &seen, &out->supervisor);
  return out->supervisor.health != SUPERVISOR_TRIPPED;
}

#if CONTROLLER_CORRECTS
/* Tip at the end of the plan, as sensors would show it. */
static void controller_end(const controller_state *state, controller_work *work, const controller_settings *o, real *end)
{
  real z[EKF_NZ];
  memcpy(z, state->plan.x[RTI_N], EKF_NX * sizeof *z);
  memcpy(z + EKF_NX, state->ekf.z + EKF_NX, (EKF_NZ - EKF_NX) * sizeof *z);
  const real *arg[] = {z, state->plan.u[RTI_N - 1], state->p};
  real *res[] = {work->ekf.y, work->ekf.H};
  estimator_outputs(arg, res);
  for (int row = 0; row < EKF_NY; ++row)
    for (int k = 0; k < 2; ++k)
      if (o->ekf.mixing[row][o->supervisor.tip + k] > 0) end[k] = work->ekf.y[row];
}

/* Why a tip stays away from its setpoint: where the last plan ends, and what holds it there. */
static int controller_cause(const controller_state *state, controller_work *work, const controller_settings *o,
                            const controller_input *in, const controller_output *out)
{
  const int last = RTI_N * RTI_NR + o->supervisor.setpoint;
  real end[2] = {0, 0}, squares = 0;
  controller_end(state, work, o, end);
  for (int k = 0; k < 2; ++k) {
    const real off = end[k] - in->setpoints[last + k];
    squares += off * off;
  }
  /* half of what is measured, or less, does not explain it */
  if (!(4 * squares > out->supervisor.offset * out->supervisor.offset)) return SUPERVISOR_UNEXPECTED;
  int limited = out->rti.violation > 0;
  for (int j = 0; j < RTI_NU; ++j) {
    const real margin = (real)1e-3 * (o->rti.u_max[j] - o->rti.u_min[j]), u = state->plan.u[RTI_N - 1][j];
    /* the greatest: of tendons that pull against each other one rests at its least tension anyway */
    limited |= u > o->rti.u_max[j] - margin || (o->rti.u_min[j] < 0 && u < o->rti.u_min[j] + margin);
  }
  return limited ? SUPERVISOR_LIMITED : SUPERVISOR_UNREACHED;
}

/* A setpoint that stands is to be met in what is measured, while a plan ends where the estimate has the tip. Of constant
 * noise the estimate of a stiffness has a mean error (trunk_2m: 2 %, 20 to 46 mm), and no disturbance stands for friction of
 * tendons. The mean distance between both is taken off the setpoint: it stands for as many unknowns as there are
 * setpoints, and does not wind up where inputs or their path hold the tip, of which the plan knows. */
static void controller_correct(controller_state *state, controller_work *work, const controller_settings *o,
                               controller_input *in)
{
  const int setpoint = o->supervisor.setpoint;
  if (!(state->bias[0] < 0 || state->bias[0] > 0 || state->bias[1] < 0 || state->bias[1] > 0)) return;
  memcpy(work->setpoints, in->setpoints, sizeof work->setpoints);
  for (int node = 0; node <= RTI_N; ++node)
    for (int k = 0; k < 2; ++k) work->setpoints[node * RTI_NR + setpoint + k] -= state->bias[k];
  in->setpoints = work->setpoints;
}

/* Follow that distance while the setpoint stands, and forget it while it moves. */
static void controller_compensate(controller_state *state, controller_work *work, const controller_settings *o,
                                  const real *y, int moves, int contradicts, int planned)
{
  real end[2] = {0, 0}, squares = 0;
  if (!(o->correction > 0)) return;
  /* what swings after a gap, contradicts the model, or may be an old image is no constant distance */
  int doubted = contradicts || state->supervisor.unseen > 2;
  for (int sensor = 0; sensor < CONTROLLER_NS; ++sensor) doubted |= state->supervisor.together[sensor] > (real)SUPERVISOR_SUSPECTED;
  state->stood = moves || doubted ? 0 : state->stood < o->correction_after ? state->stood + 1 : state->stood;
  const int follows = state->stood >= o->correction_after;
  if (follows && (!planned || !cg_finite(y + o->supervisor.tip, 2))) return;
  if (follows) controller_end(state, work, o, end);
  for (int k = 0; k < 2; ++k) {
    const real off = follows ? y[o->supervisor.tip + k] - end[k] : 0;
    if (moves || follows) state->bias[k] += o->correction * (off - state->bias[k]);
    squares += state->bias[k] * state->bias[k];
  }
  const real size = CG_SQRT(squares);
  if (!cg_finite(&size, 1)) memset(state->bias, 0, sizeof state->bias);
  else if (size > o->correction_most)
    for (int k = 0; k < 2; ++k) state->bias[k] *= o->correction_most / size;
}
#endif

/* Worth of the estimate after a call. */
static int controller_sight(const controller_state *state, const controller_settings *o, const supervisor_report *report)
{
  const int patience = controller_plan_calls(o), unseen = state->supervisor.unseen, blind = state->blind;
  const int unplanned = state->age > (real)RTI_N - (real)1e-3;
  if (report->reason || report->entry >= 0 || unseen > patience || blind > patience || unplanned) return CG_BLIND;
  return unseen || blind ? CG_PREDICTS : report->contradicts ? CG_CONTRADICTED : CG_SEES;
}

int controller_rearm(controller_state *state, const controller_settings *settings)
{
  return supervisor_rearm(&state->supervisor, &settings->supervisor);
}

/* ---- the command ---- */

/* Command the allowed input nearest to the wanted one. A plan may change it by its rate over a whole stage, of which a
 * period is a part; only a greater change is an anomaly. The margin of 1e-6 of the range is that of the QP's tolerance.
 * */
static uint32_t controller_command(controller_state *state, const controller_settings *o, const real *wanted,
                                   const real *rate, controller_output *out)
{
  uint32_t anomalies = 0;
  real change[RTI_NU];
  for (int j = 0; j < RTI_NU; ++j) {
    const real step = rate[j] * o->period, stage = rate[j] * o->rti.stage;
    const real margin = (real)1e-6 * (o->rti.u_max[j] - o->rti.u_min[j]);
    real u = wanted[j];
    if (u < o->rti.u_min[j] - margin || u > o->rti.u_max[j] + margin) anomalies |= CONTROLLER_INPUT_LIMITED;
    cg_limit(&u, o->rti.u_min[j], o->rti.u_max[j]);
    if (u < state->u[j] - stage - margin || u > state->u[j] + stage + margin) anomalies |= CONTROLLER_RATE_LIMITED;
    cg_limit(&u, state->u[j] - step, state->u[j] + step);        /* last, so that the rate limit wins */
    change[j] = u - state->u[j];
    if (u < o->rti.u_min[j] - margin || u > o->rti.u_max[j] + margin) anomalies |= CONTROLLER_BEYOND_LIMIT;
    state->u[j] = out->u[j] = u;
  }
  supervisor_note(&state->supervisor, &o->supervisor, change);
  return anomalies;
}

int controller_step(controller_state *state, controller_work *work, const controller_settings *settings,
                    const controller_input *input, controller_output *output)
{
  const uint32_t begin = CONTROLLER_TICKS();
  if (!state->started || !controller_valid(settings)) return output->status = CONTROLLER_INVALID;
  real last[RTI_NU];
  memcpy(last, state->u, sizeof last);
  memset(output, 0, sizeof *output);
  const int patience = controller_plan_calls(settings);
  output->anomalies = controller_check(state, settings, input);
  const uint32_t given = output->anomalies; /* before the clock's, which stop no plan */
  const real passed = controller_passed(state, settings, input, output);
  /* no further: it would overflow in the end */
  state->blind += passed < (real)patience ? (int)(passed + (real)0.5) : patience;
  if (state->blind > patience + 1) state->blind = patience + 1;
  real y[CONTROLLER_NM];
  memcpy(y, input->measurement, sizeof y);
  supervisor_screen(&state->supervisor, &settings->supervisor, y, &output->supervisor);
  const int known = controller_estimate(state, work, settings, y, passed, input->age, output);
  /* What drives exert may be beyond limits, for the estimator alone: no command follows it there. */
  for (int j = 0; j < RTI_NU; ++j)
    cg_limit(&state->u[j], rti_min(last[j], settings->rti.u_min[j]), rti_max(last[j], settings->rti.u_max[j]));
  /* The estimator saw these readings as missing. */
  for (int j = 0; j < CONTROLLER_NM; ++j)
    if (cg_is_nan(y[j]) && !cg_is_nan(input->measurement[j])) output->verdict[j] = CG_FROZEN;
  output->anomalies |= controller_sensor_anomalies(output);
  if (state->blind > patience) output->anomalies |= CONTROLLER_BLIND;
  for (int j = 0; j < RTI_NX - CONTROLLER_ND; ++j) output->x[CONTROLLER_ND + j] = state->u[j];
  state->age += passed * settings->period / settings->rti.stage;
  int moves = 0;
  const int trusted = controller_supervise(state, settings, input, y, &moves, output);
  if (state->age > (real)RTI_N - (real)1e-3 || state->blind > patience || !trusted) state->planned = 0;
  output->ticks[0] = CONTROLLER_TICKS() - begin;

  const uint32_t stops = CONTROLLER_BAD_SETPOINTS | CONTROLLER_BAD_PARAMETERS | CONTROLLER_LATE;
  int planned = 0;
  controller_input corrected = *input;
#if CONTROLLER_CORRECTS
  if (!trusted) memset(state->bias, 0, sizeof state->bias);
  if (!(given & stops)) controller_correct(state, work, settings, &corrected);
#endif
  if (known && trusted && !(given & stops) && state->blind <= patience) {
    planned = controller_plan(state, work, settings, &corrected, output);
    if (!planned) output->anomalies |= CONTROLLER_NOT_SOLVED;
  }
#if CONTROLLER_CORRECTS
  if (planned && output->supervisor.offset > 0)
    output->supervisor.cause = controller_cause(state, work, settings, &corrected, output);
  controller_compensate(state, work, settings, y, moves, output->supervisor.contradicts, planned);
#endif
  output->sight = controller_sight(state, settings, &output->supervisor);
  if (!planned) output->status = state->planned ? CONTROLLER_PREVIOUS_PLAN : CONTROLLER_SAFE_RAMP;
  if (output->status == CONTROLLER_SAFE_RAMP) {
    real rate[RTI_NU];
    for (int j = 0; j < RTI_NU; ++j)
      rate[j] = settings->safe_rate[j] < settings->u_rate[j] ? settings->safe_rate[j] : settings->u_rate[j];
    output->anomalies |= controller_command(state, settings, settings->u_safe, rate, output) & CONTROLLER_BEYOND_LIMIT;
  } else {
    const int stage = rti_lesser((int)(state->age + (real)1e-3), RTI_N - 1);    /* 1e-3 stages: the sum of periods is rounded */
    output->anomalies |= controller_command(state, settings, state->plan.u[stage], settings->u_rate, output);
  }
  return output->status;
}
