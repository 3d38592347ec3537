/* Extended Kalman filter. See ekf.h. One call, in covariances U diag(D) U':
 *
 * 1. Predict with the input of then, where measurements are late: the step, and its noise by Simpson's rule, go into W;
 *    Gram-Schmidt gives U and D again (ekf_orthogonalize).
 * 2. Compare with the measurements: innovations of all rows, and by sensor a leaky gate that rejects outliers, and opens
 *    where they last (ekf_gate).
 * 3. Update row by row, enlarging the noise of what is far off (ekf_update).
 * 4. A state that is not finite, or beyond its limits, starts anew from the last sound prediction (ekf_restart).
 * 5. ekf_now predicts on to the present, from which a controller plans.
 */

/* Covariance as at the start: errors are independent. */
static void ekf_reset_covariance(ekf_state *state, const ekf_settings *settings)
{
  memset(state->U, 0, sizeof state->U);
  for (int i = 0; i < EKF_NZ; ++i) {
    state->U[i][i] = 1;
    state->D[i] = settings->initial[i];
  }
}

/* Begin anew what drives caused. */
static void ekf_forget_motion(ekf_state *state)
{
  memcpy(state->usual, state->z, sizeof state->usual);
  memset(state->answer, 0, sizeof state->answer);
  memcpy(state->commanded, state->z, sizeof state->commanded);
  memcpy(state->settled, state->z, sizeof state->settled);
}

void ekf_start(ekf_state *state, const ekf_settings *settings, const real *z0, const real *u0)
{
  memset(state, 0, sizeof *state);
  memcpy(state->z, z0, sizeof state->z);
  memcpy(state->first, z0, sizeof state->first);
  memcpy(state->sound, z0, sizeof state->sound);
  ekf_forget_motion(state);
  for (int k = 0; k < EKF_DELAY; ++k) {
    memcpy(state->queue[k], u0, sizeof state->queue[k]);
    state->span[k] = 1;
  }
  state->queued = EKF_DELAY;
  ekf_reset_covariance(state, settings);
}

/* Restart from the last prediction that was plausible, or from the first state where a restart was lately: a
 * finger in contact is far from where it began, and a filter that begins there again restarts for as long as the contact
 * lasts. What is wrong with the estimate is not known, so that the covariance is that of the start. Full buckets open the
 * gate: after a restart, the estimate is far from any measurement. */
static void ekf_restart(ekf_state *state, const ekf_settings *settings)
{
  if (state->restarted) memcpy(state->sound, state->first, sizeof state->sound);
  memcpy(state->z, state->sound, sizeof state->z);
  ekf_forget_motion(state);
  state->restarted = EKF_PATIENCE;
#if EKF_NA > 0
  state->age = 0;
  memset(state->motion, 0, sizeof state->motion);
  memset(state->excited, 0, sizeof state->excited);
#endif
  for (int sensor = 0; sensor < EKF_NS; ++sensor) state->bucket[sensor] = (real)EKF_PATIENCE;
  ekf_reset_covariance(state, settings);
}

/* Whether the estimate is finite and within its limits; disturbances are clipped to theirs. */
static int ekf_plausible(ekf_state *state, const ekf_settings *settings, ekf_report *report)
{
  if (!cg_finite(state->z, EKF_NZ) || !cg_finite(state->D, EKF_NZ) || !cg_finite(&state->U[0][0], EKF_NZ * EKF_NZ))
    return 0;
  for (int i = EKF_NX; i < EKF_NZ; ++i) {
    const int limited = cg_limit(&state->z[i], settings->z_min[i], settings->z_max[i]);
    report->limited |= limited;
    report->implausible |= limited && !settings->natural[i];
  }
  return cg_within(state->z, settings->z_min, settings->z_max, EKF_NX);
}

/* U diag(D) U' = W diag(weight) W', by weighted modified Gram-Schmidt from the last row to the first (Thornton): no
 * subtraction of covariances, so D stays positive under rounding. Row j has entries in its first ends[j] columns alone,
 * and the rows before it in as many at least. */
static void ekf_orthogonalize(ekf_state *state, ekf_work *work, const int *ends)
{
  real scaled[4 * EKF_NZ];
  for (int j = EKF_NZ - 1; j >= 0; --j) {
    const int columns = ends[j];
    real d = 0;
    for (int k = 0; k < columns; ++k) {
      scaled[k] = work->weight[k] * work->W[j][k];
      d += scaled[k] * work->W[j][k];
    }
    state->D[j] = d;
    state->U[j][j] = 1;
    for (int i = 0; i < j; ++i) {
      real dot = 0;
      for (int k = 0; k < columns; ++k) dot += scaled[k] * work->W[i][k];
      const real share = d > 0 ? dot / d : 0;   /* a direction without variance has none to share */
      state->U[i][j] = share;
      for (int k = 0; k < columns; ++k) work->W[i][k] -= share * work->W[j][k];
    }
  }
}

#ifdef EKF_VECTOR
/* One step and its derivatives; half of it, which is a step of its own, is in the second lane. */
static void ekf_lanes(const real *z, const real *u, const real *p, real h, real *next, real *F, real *G)
{
  cg_lanes wz[EKF_NZ], wu[EKF_NU], wp[EKF_SIZE(EKF_NP)], wh[1], end[EKF_NZ], by[EKF_NZ * EKF_NZ];
  for (int j = 0; j < EKF_NZ; ++j) wz[j] = (cg_lanes){0} + z[j];
  for (int j = 0; j < EKF_NU; ++j) wu[j] = (cg_lanes){0} + u[j];
  for (int j = 0; j < EKF_NP; ++j) wp[j] = (cg_lanes){0} + p[j];
  wh[0] = (cg_lanes){0} + h;
  wh[0][1] = h / 2;
  const cg_lanes *in[] = {wz, wu, wp, wh};
  cg_lanes *out[] = {end, by};
  estimator_single_lanes(in, out);
  for (int j = 0; j < EKF_NZ; ++j) next[j] = end[j][0];
  for (int j = 0; F && j < EKF_NZ * EKF_NZ; ++j) {
    F[j] = by[j][0];
    G[j] = by[j][1];
  }
}
#endif

/* A step of a period with its derivatives in the workspace, where it may be already. */
static ekf_transition *ekf_advance(ekf_work *work, int step, const real *z, const real *u, const real *p, real h)
{
  ekf_transition *to = &work->steps[step % EKF_STEPS];
  real from[EKF_FROM];
  memcpy(from, z, EKF_NZ * sizeof *z);
  memcpy(from + EKF_NZ, u, EKF_NU * sizeof *u);
#if EKF_NP > 0
  memcpy(from + EKF_NZ + EKF_NU, p, EKF_NP * sizeof *p);
#endif
  from[EKF_FROM - 1] = h;
  if (memcmp(to->from, from, sizeof from) == 0) return to;
#ifdef EKF_VECTOR
  ekf_lanes(z, u, p, h, to->next, to->F, to->G);
#else
  const real *arg[] = {z, u, p, &h};
  real *res[] = {to->next, to->F, to->G};
  estimator_step(arg, res);
#endif
  memcpy(to->from, from, sizeof from);
  return to;
}

/* Variance of h z before the update. */
static real ekf_prior_variance(const ekf_state *state, const real *h)
{
  real sum = 0;
  for (int j = 0; j < EKF_NZ; ++j) {
    real f = h[j];
    for (int i = 0; i < j; ++i) f += state->U[i][j] * h[i];
    sum += f * f * state->D[j];
  }
  return sum;
}

#if EKF_NA > 0
/* Shrink the columns of a matrix (rows of states or outputs, by z) that are sensitivities to adapted parameters. */
static void ekf_shrink(const ekf_state *state, const ekf_settings *settings, real *matrix, int stride, int rows)
{
  for (int k = 0; k < EKF_NA; ++k)
    for (int i = 0; i < rows; ++i) matrix[i + stride * settings->adapted[k]] *= state->excited[k];
}

/* What of the sensitivities of a step noise does not explain. */
static void ekf_excite(ekf_state *state, const ekf_transition *step, const ekf_settings *settings, real h)
{
  if (state->age < settings->memory) state->age += h;
  for (int k = 0; k < EKF_NA; ++k) {
    const real *column = step->F + EKF_NZ * settings->adapted[k];
    real size = 0;
    if (state->age < settings->memory) continue; /* the error of the start, large and soon gone, passes for motion too */
    for (int i = 0; i < EKF_NX; ++i) state->motion[k][i] += h / (settings->memory + h) * (column[i] - state->motion[k][i]);
    for (int i = 0; i < EKF_NX; ++i) {
      real sum = 0;
      for (int j = 0; j < EKF_NX; ++j) sum += settings->quiet[k][i][j] * state->motion[k][j];
      size += sum * sum;
    }
    state->excited[k] = size > 1 ? 1 - 1 / size : 0;
  }
}

/* Noise of each state over a prediction: of adapted parameters in proportion to what is known of them. */
static void ekf_forget(const ekf_state *state, const ekf_settings *settings, real *noise)
{
  memcpy(noise, settings->noise, sizeof settings->noise);
  for (int k = 0; k < EKF_NA; ++k) {
    const int at = settings->adapted[k];
    real h[EKF_NZ] = {0};
    h[at] = 1;
    const real known = 1 - ekf_prior_variance(state, h) / settings->initial[at];
    noise[at] *= known > 0 ? known : 0;
  }
}
#endif

/* Move what drives cause by a step. Drives follow commands alone: what their sensors add is noise, which would pass for
 * motion that no tip shows (saturation.yaml, at rest at its limit, tripped after 5 s). The other states follow by the
 * step's derivative, contacts and swings included. No sensor corrects them, and no disturbance hides it. */
static void ekf_answer(ekf_state *state, const ekf_transition *step, const ekf_settings *settings)
{
  real from[EKF_NX], off[EKF_NX];
  for (int i = 0; i < EKF_NX; ++i) {
    from[i] = settings->drive[i] == 1 ? state->commanded[i] - state->settled[i] : state->answer[i];
    off[i] = settings->drive[i] ? state->commanded[i] - state->z[i] : 0;
  }
  for (int i = 0; i < EKF_NX; ++i) {
    state->answer[i] = 0;
    state->commanded[i] = step->next[i];
    for (int k = 0; k < EKF_NX; ++k) {
      state->answer[i] += step->F[i + EKF_NZ * k] * from[k];
      state->commanded[i] += step->F[i + EKF_NZ * k] * off[k];
    }
  }
  if (!cg_finite(state->answer, EKF_NX)) memset(state->answer, 0, sizeof state->answer);
}

/* Whether a step moves other states by one: a disturbance that only sensors see stays alone. */
static int ekf_moves(const ekf_transition *step, int j)
{
  int moves = j < EKF_NX;
  for (int i = 0; i < EKF_NX && !moves; ++i) {
    const real whole = step->F[i + EKF_NZ * j], half = step->G[i + EKF_NZ * j];
    moves = whole > 0 || whole < 0 || half > 0 || half < 0;
  }
  return moves;
}

/* Write from a column of W on: column j of F U, and noise of state j over a step. Disturbances are constant but for their
 * noise: those before j have entries in no column from here on. Returns the next column. */
static int ekf_spread(const ekf_state *state, const ekf_transition *step, ekf_work *work, int j, real noise, int column)
{
  for (int i = 0; i < EKF_NX; ++i) {
    real sum = 0;
    for (int k = 0; k <= j; ++k) sum += step->F[i + EKF_NZ * k] * state->U[k][j]; /* F U, U upper triangular */
    work->W[i][column] = sum;
  }
  for (int i = EKF_NX; i < EKF_NZ; ++i) work->W[i][column] = state->U[i][j];
  work->weight[column++] = state->D[j];
  if (!(noise > 0)) return column;
  if (!ekf_moves(step, j)) {
    for (int i = 0; i < EKF_NZ; ++i) work->W[i][column] = (real)(i == j);
    work->weight[column++] = noise;
    return column;
  }
  for (int i = 0; i < EKF_NZ; ++i) {          /* Simpson's rule: F, 4 G and the identity */
    work->W[i][column] = step->F[i + EKF_NZ * j];
    work->W[i][column + 1] = step->G[i + EKF_NZ * j];
    work->W[i][column + 2] = (real)(i == j);
  }
  work->weight[column] = work->weight[column + 2] = noise / 6;
  work->weight[column + 1] = 4 * noise / 6;
  return column + 3;
}

static void ekf_predict(ekf_state *state, ekf_work *work, const ekf_settings *settings, int number, const real *u,
                        const real *p, real h)
{
#if EKF_NA > 0
  real noise[EKF_NZ];
  ekf_forget(state, settings, noise);
#else
  const real *noise = settings->noise;
#endif
  ekf_transition *step = ekf_advance(work, number, state->z, u, p, h);
  ekf_answer(state, step, settings);
  memcpy(state->z, step->next, sizeof state->z);
#if EKF_NA > 0
  ekf_excite(state, step, settings, h);
  ekf_shrink(state, settings, step->F, EKF_NZ, EKF_NX);
  ekf_shrink(state, settings, step->G, EKF_NZ, EKF_NX);
  step->from[EKF_FROM - 1] = 0; /* shrunk: no longer those of the step */
#endif
  int columns = 0, ends[EKF_NZ];
  for (int j = EKF_NZ - 1; j >= 0; --j) columns = ends[j] = ekf_spread(state, step, work, j, noise[j] * h, columns);
  for (int j = 0; j < EKF_NX; ++j) ends[j] = columns;
  ekf_orthogonalize(state, work, ends);
}

/* Update with one scalar measurement, its row h of H and its innovation (Bierman); returns the innovation's expected
 * variance. Beyond EKF_HUBER standard deviations, the noise is enlarged such that the estimate moves by as many. */
static real ekf_update(ekf_state *state, const real *h, real noise, real innovation)
{
  real f[EKF_NZ], v[EKF_NZ], gain[EKF_NZ], expected = noise;
  for (int j = 0; j < EKF_NZ; ++j) {
    f[j] = h[j];
    for (int i = 0; i < j; ++i) f[j] += state->U[i][j] * h[i];
    v[j] = state->D[j] * f[j];
    expected += f[j] * v[j];
  }
  real total = noise;
  const real bound = (real)EKF_HUBER * CG_SQRT(expected), size = innovation < 0 ? -innovation : innovation;
  if (size > bound) total += expected * (size / bound - 1);
  for (int j = 0; j < EKF_NZ; ++j) {
    const real before = total, share = -f[j] / before;
    total += f[j] * v[j];
    state->D[j] *= before / total;
    gain[j] = v[j];
    for (int i = 0; i < j; ++i) {
      const real old = state->U[i][j];
      state->U[i][j] = old + gain[i] * share;
      gain[i] += old * v[j];
    }
  }
  for (int i = 0; i < EKF_NZ; ++i) state->z[i] += gain[i] / total * innovation;
  return expected;
}

#if EKF_NF > 0
/* What is known of friction states without a sensor: their variance is that within -1 and 1 at most. */
static void ekf_bound_friction(ekf_state *state, const ekf_settings *settings)
{
  for (int k = 0; k < EKF_NF; ++k) {
    real h[EKF_NZ] = {0};
    h[settings->friction[k]] = 1;
    const real variance = ekf_prior_variance(state, h);
    if (variance > 1) (void)ekf_update(state, h, variance / (variance - 1), 0);
  }
}

/* A correction takes no friction state where the law does not: beyond one, or beyond where it slides already. */
static void ekf_limit_friction(ekf_state *state, const ekf_settings *settings, const real *prior)
{
  for (int k = 0; k < EKF_NF; ++k) {
    const int at = settings->friction[k];
    cg_limit(&state->z[at], prior[at] < -1 ? prior[at] : -1, prior[at] > 1 ? prior[at] : 1);
  }
}
#endif

/* Give each measurement in a compared quantity its verdict, unless it has one. */
static void ekf_report_row(const ekf_settings *settings, int row, int verdict, ekf_report *report)
{
  for (int j = 0; j < EKF_NM; ++j) {
    const real share = settings->mixing[row][j];
    if ((share > 0 || share < 0) && report->verdict[j] == CG_USED) report->verdict[j] = verdict;
  }
}

/* Innovations and their variances before any update; a row with a missing measurement has variance 0. */
static void ekf_innovations(const ekf_state *state, const ekf_work *work, const ekf_settings *settings, const real *y,
                         ekf_report *report)
{
  for (int row = 0; row < EKF_NY; ++row) {
    real h[EKF_NZ], innovation = -work->y[row];
    int whole = 1;
    for (int j = 0; j < EKF_NM; ++j) {
      const real share = settings->mixing[row][j];
      if (!(share > 0 || share < 0)) continue;
      if (report->verdict[j] == CG_USED) innovation += share * y[j];
      else whole = 0;
    }
    if (!whole) continue;
    for (int j = 0; j < EKF_NZ; ++j) h[j] = work->H[row + EKF_NY * j];
    report->innovation[row] = innovation;
    report->variance[row] = ekf_prior_variance(state, h) + settings->variance[row];
  }
}

/* Motion of measurements as far as drives cause it. Without a sensor, the motion of a finger that topples alone would grow
 * for ever (steady_tip under eight times gravity tripped after 2 s): what is older than two slow means fades. */
static void ekf_expect(ekf_state *state, const ekf_work *work, const ekf_settings *settings, ekf_report *report)
{
  for (int i = 0; i < EKF_NX; ++i)
    if (settings->drive[i] == 1) {
      state->usual[i] += settings->fade * (state->z[i] - state->usual[i]);
      state->settled[i] += settings->fade * (state->commanded[i] - state->settled[i]);
      state->answer[i] = state->commanded[i] - state->settled[i];
    } else state->answer[i] *= 1 - settings->fade / 2;
  for (int row = 0; row < EKF_NY; ++row) {
    real sum = 0, motion = 0;
    int drive = 1;
    for (int i = 0; i < EKF_NX; ++i) {
      const real h = work->H[row + EKF_NY * i];
      sum += h * state->answer[i];
      if (settings->drive[i] == 1) motion += h * (state->z[i] - state->usual[i]);
      else drive &= !(h > 0 || h < 0);
    }
    report->motion[row] = drive ? motion : 0;
    for (int j = 0; j < EKF_NM; ++j) report->expected[j] += settings->mixing[row][j] * sum;
  }
}

/* The leaky gate of a sensor: CG_USED, CG_REOPENED (used although it is beyond the gate), CG_OUTLIER (rejected), or
 * CG_ALONE (nothing to use). A rejected sensor has no nis, else 1 % of outliers would detune the controller. One row
 * beyond the gate counts for the whole device, whose rows fail together. */
static int ekf_gate(ekf_state *state, const ekf_settings *settings, int sensor, ekf_report *report)
{
  const real gate = settings->gate * settings->gate;
  real sum = 0, echo = 0, along = 0, travel = 0, ahead = 0, change = 0;
  int rows = 0, out = 0;
  for (int row = 0; row < EKF_NY; ++row) {
    if (settings->sensor[row] != sensor || !(report->variance[row] > 0)) continue;
    const real deviation = CG_SQRT(report->variance[row]), motion = report->motion[row] / deviation;
    real normal = report->innovation[row] / deviation;
    cg_limit(&normal, -(real)EKF_HUBER, (real)EKF_HUBER);
    along += normal * motion;
    travel += motion * motion;
    const real moved = motion - state->moved[row];
    state->moved[row] = motion;
    ahead += normal * moved;
    change += moved * moved;
    state->bias[row] += settings->fade * (normal - state->bias[row]);
    normal -= state->bias[row];
    echo += normal * state->before[row];
    state->before[row] = normal;
    real ratio = report->innovation[row] * report->innovation[row] / report->variance[row];
    out |= ratio > gate;
    cg_limit(&ratio, 0, (real)EKF_NIS_CAP);
    sum += ratio;
    ++rows;
  }
  report->nis[sensor] = -1;
  if (!rows) return CG_ALONE;
  real *bucket = &state->bucket[sensor];
  *bucket += out ? (real)1 : -(real)EKF_LEAK;
  cg_limit(bucket, 0, (real)EKF_BUCKET_CAP);
  if (out && *bucket <= (real)EKF_PATIENCE) return CG_OUTLIER;
  report->nis[sensor] = sum / (real)rows;
  report->echo[sensor] = echo / (real)rows;
  report->along[sensor] = along / (real)rows;
  report->travel[sensor] = travel / (real)rows;
  report->ahead[sensor] = ahead / (real)rows;
  report->change[sensor] = change / (real)rows;
  return out ? CG_REOPENED : CG_USED;
}

static int ekf_correct(ekf_state *state, ekf_work *work, const ekf_settings *settings, const real *y, const real *u,
                       const real *p, ekf_report *report)
{
  real prior[EKF_NZ];
  int judged[EKF_NS];
  const real *arg[] = {state->z, u, p};
  real *res[] = {work->y, work->H};
  estimator_outputs(arg, res);
  if (!cg_finite(work->y, EKF_NY) || !cg_finite(work->H, EKF_NY * EKF_NZ)) return 0;
  memcpy(prior, state->z, sizeof prior);
#if EKF_NA > 0
  ekf_shrink(state, settings, work->H, EKF_NY, EKF_NY);
#endif
#if EKF_NF > 0
  ekf_bound_friction(state, settings);
#endif
  ekf_innovations(state, work, settings, y, report);
  ekf_expect(state, work, settings, report);
  for (int sensor = 0; sensor < EKF_NS; ++sensor) judged[sensor] = ekf_gate(state, settings, sensor, report);
  const real gate = settings->gate * settings->gate;
  for (int row = 0; row < EKF_NY; ++row) {
    const real square = report->innovation[row] * report->innovation[row];
    const int found = judged[settings->sensor[row]];
    if (!(report->variance[row] > 0)) ekf_report_row(settings, row, CG_ALONE, report);
    else if (square > gate * report->variance[row]) ekf_report_row(settings, row, found, report);
    else if (found == CG_OUTLIER) ekf_report_row(settings, row, CG_ALONE, report);
    if (!(report->variance[row] > 0) || found == CG_OUTLIER) continue;
    real h[EKF_NZ];
    /* Rows one by one, about the prior: what the rows before moved is taken off to first order. */
    for (int j = 0; j < EKF_NZ; ++j) {
      h[j] = work->H[row + EKF_NY * j];
      report->innovation[row] -= h[j] * (state->z[j] - prior[j]);
    }
    report->variance[row] = ekf_update(state, h, settings->variance[row], report->innovation[row]);
    ++report->used;
  }
#if EKF_NF > 0
  ekf_limit_friction(state, settings, prior);
#endif
  return 1;
}

/* Number of steps in a part of a period, or in several. */
static int ekf_steps(const ekf_settings *settings, real part)
{
  const int steps = (int)(part * (real)settings->substeps + 1 - EKF_MOMENT);
  return steps > 0 ? steps : 1;
}

/* Predict with the oldest inputs over as many periods; the last one that acted, from which a sensor may show something. */
static void ekf_move(ekf_state *state, ekf_work *work, const ekf_settings *settings, const real *p, real by, real *acted)
{
  while (by > EKF_MOMENT && state->queued > 0) {
    real *span = &state->span[state->oldest];
    const int whole = *span <= by + EKF_MOMENT;
    const real part = whole ? *span : by;
    const int steps = ekf_steps(settings, part);
    memcpy(acted, state->queue[state->oldest], sizeof state->queue[0]);
    for (int k = 0; k < steps; ++k) ekf_predict(state, work, settings, k, acted, p, part * settings->period / (real)steps);
    by -= part;
    *span -= part;
    if (!whole) continue;
    state->oldest = state->oldest + 1 < EKF_QUEUE ? state->oldest + 1 : 0;
    --state->queued;
  }
}

/* Periods from the time of the state to now. */
static real ekf_lag(const ekf_state *state)
{
  real sum = 0;
  for (int k = 0; k < state->queued; ++k) sum += state->span[(state->oldest + k) % EKF_QUEUE];
  return sum;
}

/* Move the state to the time of a measurement, with what acted until then; whether it is behind that already. */
static int ekf_follow(ekf_state *state, ekf_work *work, const ekf_settings *settings, const real *u, const real *p,
                      real passed, real age, real *acted)
{
  /* Up to the measurement: what a sensor shows of the input itself, as of a torque, is that before it. */
  memcpy(acted, state->queued ? state->queue[state->oldest] : u, EKF_NU * sizeof *u);
  if (state->started) {
    cg_limit(&passed, 0, EKF_LONGEST);
    if (state->queued == EKF_QUEUE) ekf_move(state, work, settings, p, state->span[state->oldest], acted);
    const int at = (state->oldest + state->queued++) % EKF_QUEUE;
    memcpy(state->queue[at], u, sizeof state->queue[at]);
    state->span[at] = passed;
  }
  const real by = ekf_lag(state) - age;
  if (state->started && by <= EKF_MOMENT) return 1;
  ekf_move(state, work, settings, p, by, acted);
  if (by > (real)1.5) {
    /* what drives caused before a gap is over: their means begin anew */
    ekf_forget_motion(state);
    memset(state->before, 0, sizeof state->before);
    memset(state->moved, 0, sizeof state->moved);
  }
  return 0;
}

int ekf_step(ekf_state *state, ekf_work *work, const ekf_settings *settings, const real *y, const real *u,
             const real *p, real passed, real age, ekf_report *report)
{
  real applied[EKF_NU];
  memset(report, 0, sizeof *report);
  if (!cg_finite(u, EKF_NU) || !cg_finite(p, EKF_NP)) return EKF_BAD_INPUT;
  report->old = ekf_follow(state, work, settings, u, p, passed, age, applied);
  for (int j = 0; j < EKF_NM; ++j)
    report->verdict[j] = report->old ? CG_MISSING : cg_verdict(y[j], settings->y_min[j], settings->y_max[j]);
  state->started = 1;
  if (ekf_plausible(state, settings, report)) {
    real predicted[EKF_NZ];
    memcpy(predicted, state->z, sizeof predicted);
    if (ekf_correct(state, work, settings, y, applied, p, report) && ekf_plausible(state, settings, report)) {
      memcpy(state->sound, predicted, sizeof state->sound);
      state->restarted -= state->restarted > 0;
      return EKF_OK;
    }
  }
  report->used = 0;
  /* for the supervisor, a restart contradicts the model as much as anything can */
  for (int sensor = 0; sensor < EKF_NS; ++sensor) report->nis[sensor] = (real)EKF_NIS_CAP;
  ekf_restart(state, settings);
  return EKF_RESTARTED;
}

int ekf_now(const ekf_state *state, ekf_work *work, const ekf_settings *settings, const real *p, real *z)
{
  memcpy(z, state->z, sizeof state->z);
  for (int k = 0; k < state->queued; ++k) {
    const int at = (state->oldest + k) % EKF_QUEUE, steps = ekf_steps(settings, state->span[at]);
    const real *u = state->queue[at], h = state->span[at] * settings->period / (real)steps;
    for (int i = 0; i < steps; ++i) {
#if EKF_AHEAD > EKF_STEPS
      if (k > 0 || i >= EKF_STEPS) {
        real next[EKF_NZ] = {0};
#ifdef EKF_VECTOR
        ekf_lanes(z, u, p, h, next, 0, 0);
#else
        const real *arg[] = {z, u, p, &h};
        real *res[] = {next};
        estimator_flow(arg, res);
#endif
        memcpy(z, next, sizeof next);
        continue;
      }
#endif
      /* from the next call's state, to whose prediction it is left */
      memcpy(z, ekf_advance(work, i, z, u, p, h)->next, EKF_NZ * sizeof *z);
    }
  }
  return cg_within(z, settings->z_min, settings->z_max, EKF_NX);
}

void ekf_variance(const ekf_state *state, real *variance)
{
  for (int i = 0; i < EKF_NZ; ++i) {
    variance[i] = state->D[i];
    for (int j = i + 1; j < EKF_NZ; ++j) variance[i] += state->U[i][j] * state->U[i][j] * state->D[j];
  }
}
