/* Supervision of sensors, model and call rate. See supervisor.h. */

#define SUPERVISOR_NOTICE 2.5   /* mismatch that is reported; a drive four times slower than the model's, which delays the
                                   tip without a swing, has 2.8 */
#define SUPERVISOR_DOUBT 3.0    /* mismatch: of one row the mean is chi-square with 39 degrees of freedom per 39, beyond
                                   3 once in 1e9 steps; greatest of nominal trials 2.3 */
#define SUPERVISOR_SEVERE 10.0  /* mismatch that is acted on at once: a move with half the stiffness stays below 9, a loop
                                   that swings exceeds it within a period of its swing */
#define SUPERVISOR_TRUST 1.5    /* mismatch below which sensors and model agree */
#define SUPERVISOR_WRONG 20.0   /* mismatch that no tuning stabilizes; a camera rotated by 5 degrees, with which the loop
                                   still works, has 10 to 14 */
#define SUPERVISOR_ACTIVE 0.002 /* activity of a loop that swings with a quarter of its noise's amplitude; a knock at
                                   rest stays below */
#define SUPERVISOR_HARD 0.1     /* activity of a command that runs at a third of its rate limit on average */
#define SUPERVISOR_JITTER 0.2   /* standard deviation of the time between two calls, in periods: half the call rate has a
                                   mismatch of 25, scheduling jitter of an ordinary system less than 1 */
#define SUPERVISOR_PATH 0.02    /* travel of the command, in `change`, before a reading at rest is suspicious: without noise
                                   everything rests together; the noise of the other sensors moves a command so far in a
                                   few calls */

#define SUPERVISOR_ECHO 0.15    /* mean product of successive normalized innovations of a drive: -0.2 where it is known, 0.2 to
                                   0.45 of a loop that swings by 9 to 15 mm with an unknown delay of three periods */
#define SUPERVISOR_BEHIND 0.15  /* mean square of a drive's innovations that is in proportion to its motion: 0.05 at most in trials
                                   of 12 shipped loops, beyond the limit in none of all 17; in tip_arc 0.2 of a drive
                                   twice as slow as the model's and 0.6 of thrice, as the tip is 13 and 22 mm off, with a
                                   mismatch of 2 at most */
#define SUPERVISOR_TRAVEL 1.0   /* mean square of that motion below which noise leads it */
#define SUPERVISOR_ANSWER 0.15  /* mean product of successive readings of a live image, per squared motion that drives cause: half
                                   of it where friction of three times the model's holds the finger, 0.3 to 1 else */

/* An offset: each window counts by how far, in `offset`, the tip's mean over five windows is beyond it, at most threefold. Of
 * 8,000 steps each of eight shipped loops with their plants, at setpoints that stand, the evidence stays below 3; a knock of
 * pulse.yaml has 2.2, a stiffness whose estimate wanders under friction (tip_steps.yaml) 2.8. */
#define SUPERVISOR_STAYS 10.0
#define SUPERVISOR_BEYOND 3.0

/* Count the calls in a row for which a condition holds, up to `most`; whether it has held for that many. */
static int supervisor_lasted(int *count, int condition, int most)
{
  *count = condition ? (*count < most ? *count + 1 : most) : 0;
  return *count >= most;
}

/* The same where a condition may fail now and then, up to a third of the time: a call without it takes two back. */
static int supervisor_mostly(int *count, int condition, int most)
{
  if (condition) return supervisor_lasted(count, 1, most);
  *count = *count > 2 ? *count - 2 : 0;
  return 0;
}

/* Exponentially weighted: a window's length without its memory. */
static void supervisor_mean(const supervisor_settings *o, real *mean, real value)
{
  *mean += (value - *mean) / (real)o->window;
}

void supervisor_screen(supervisor_state *state, const supervisor_settings *o, real *y, supervisor_report *report)
{
  memset(report, 0, sizeof *report);
  report->entry = report->sensor = -1;
  if (!o->window) return;
  for (int j = 0; j < CONTROLLER_NM; ++j) {
    if (o->still[j] < 0 || !cg_finite(&y[j], 1)) continue;
    const real moved = y[j] - state->last[j];
    const int same = state->calls > 0 && moved <= o->still[j] && moved >= -o->still[j];
    if (!same) {
      state->last[j] = y[j]; /* from where it rests: many small steps are a motion */
      state->path[j] = 0;
    }
    /* from the command's motion on, to which the reading of a finger at rest answers late */
    const int unmoved = same && state->path[j] > (real)SUPERVISOR_PATH;
    if (!supervisor_lasted(&state->still[j], unmoved, o->window + o->delay)) continue;
    y[j] = cg_nan();
    if (report->entry < 0) report->entry = j;
  }
}

/* Whether all readings of a device are there, within their limits, and move. */
static int supervisor_shows(const supervisor_settings *o, const int *verdict, int sensor)
{
  for (int j = 0; j < CONTROLLER_NM; ++j)
    if (o->sensor[j] == sensor && (verdict[j] == CG_MISSING || verdict[j] == CG_ABSURD || verdict[j] == CG_FROZEN))
      return 0;
  return 1;
}

/* Whether the shape has not been seen for too long: 1.5 windows where a reading is frozen, which took a window to find;
 * five where readings are missing or absurd, through which estimator and plan lead a loop for 2.5. */
static int supervisor_blind(supervisor_state *state, const supervisor_settings *o, const supervisor_evidence *seen)
{
  int any = 0, shown = 0, frozen = 0;
  for (int sensor = 0; sensor < SUPERVISOR_SIZE(CONTROLLER_NS); ++sensor) any |= o->shape[sensor];
  for (int sensor = 0; sensor < SUPERVISOR_SIZE(CONTROLLER_NS); ++sensor)
    shown |= (o->shape[sensor] || !any) && supervisor_shows(o, seen->verdict, sensor);
  for (int j = 0; j < CONTROLLER_NM; ++j)
    frozen |= (o->shape[o->sensor[j]] || !any) && seen->verdict[j] == CG_FROZEN;
  const int lost = supervisor_lasted(&state->unseen, !shown, 5 * o->window);
  return lost || (frozen && state->unseen >= o->window + o->window / 2);
}

/* Gather the evidence that a device shows an old image, in one of its readings or in all together; whether it suffices. By
 * log-likelihood, call by call (CUSUM, E. S. Page, doi:10.2307/2333009): noise alone has no product of successive readings
 * and no mean product with the motion that drives cause, both about slow means; a live image, however late or stiff, has
 * one of them, a share of that motion's square. The weight is that of a known square in white noise; by the greatest lately,
 * since what is left of a great motion is wrong. No call counts more than one, nothing counts below none. */
static int supervisor_silent(supervisor_state *state, const supervisor_settings *o, const supervisor_evidence *seen,
                             int sensor)
{
  const real enough = (real)SUPERVISOR_EVIDENCE;
  real together = 0, most = 0;
  for (int j = 0; j < CONTROLLER_NM; ++j) {
    if (o->sensor[j] != sensor || o->noise[j] < 0 || (seen->verdict[j] != CG_USED && seen->verdict[j] != CG_REOPENED)) continue;
    if (!state->calls) state->usual[j] = seen->y[j];
    /* over half a window, as in ekf_settings.fade */
    state->usual[j] += 2 * (seen->y[j] - state->usual[j]) / (real)o->window;
    const real by_drives = seen->expected[j] / o->noise[j], by_all = (seen->y[j] - state->usual[j]) / o->noise[j];
    const real beyond = by_drives * by_drives - o->hidden[j], lasting = state->before[j] * by_all;
    const real share = beyond > 0 ? (real)SUPERVISOR_ANSWER * beyond : 0;
    state->before[j] = by_all;
    supervisor_mean(o, &state->common[j], by_drives * by_all);
    supervisor_mean(o, &state->caused[j], 0);
    if (state->caused[j] < 2 * share) state->caused[j] = 2 * share;
    const real common = state->common[j] < 0 ? -state->common[j] : state->common[j], scale = 1 + state->caused[j];
    real more = (share - common - lasting) * state->caused[j] / (scale * scale);
    cg_limit(&more, -1, 1);
    state->silent[j] += more;
    cg_limit(&state->silent[j], 0, enough);
    if (most < state->silent[j]) most = state->silent[j];
    together += more;
  }
  state->together[sensor] += together;
  cg_limit(&state->together[sensor], 0, enough);
  return most >= enough || state->together[sensor] >= enough;
}

/* Whether a reading of a device is frozen. */
static int supervisor_stuck(const supervisor_settings *o, const int *verdict, int sensor)
{
  for (int j = 0; j < CONTROLLER_NM; ++j)
    if (o->sensor[j] == sensor && verdict[j] == CG_FROZEN) return 1;
  return 0;
}

/* Begin the means of a device anew. Those of one that is frozen are of numbers that it repeated before that was noticed; no
 * reading would bring them down, so that they would count as a contradiction that lasts. */
static void supervisor_forget(supervisor_state *state, int sensor)
{
  state->mismatch[sensor] = state->echo[sensor] = state->along[sensor] = state->travel[sensor] = 0;
  state->ahead[sensor] = state->change[sensor] = 0;
}

/* Means over a window, and the device that contradicts most. */
static void supervisor_average(supervisor_state *state, const supervisor_settings *o, const supervisor_evidence *seen,
                               supervisor_report *report)
{
  if (state->calls < o->delay) ++state->calls;  /* the first innovations contain the error of the start */
  else {
    for (int sensor = 0; sensor < CONTROLLER_NS; ++sensor) {
      if (!(seen->nis[sensor] >= 0)) {
        if (supervisor_stuck(o, seen->verdict, sensor)) supervisor_forget(state, sensor);
        continue;
      }
      supervisor_mean(o, &state->mismatch[sensor], seen->nis[sensor]);
      state->echo[sensor] += (seen->echo[sensor] - state->echo[sensor]) / (real)(5 * o->window);
      state->along[sensor] += (seen->along[sensor] - state->along[sensor]) / (real)(5 * o->window);
      state->travel[sensor] += (seen->travel[sensor] - state->travel[sensor]) / (real)(5 * o->window);
      state->ahead[sensor] += (seen->ahead[sensor] - state->ahead[sensor]) / (real)(5 * o->window);
      state->change[sensor] += (seen->change[sensor] - state->change[sensor]) / (real)(5 * o->window);
    }
    if (seen->elapsed >= 0) {
      real off = (seen->elapsed - 1) / (real)SUPERVISOR_JITTER;
      off *= off;
      cg_limit(&off, 0, 30); /* like a row of a sensor, EKF_NIS_CAP: one late call alone must not detune */
      supervisor_mean(o, &state->mismatch[CONTROLLER_NS], off);
    }
  }
  for (int sensor = 0; sensor <= CONTROLLER_NS; ++sensor) {
    if (report->sensor >= 0 && state->mismatch[sensor] <= report->mismatch) continue;
    report->mismatch = state->mismatch[sensor];
    report->sensor = sensor;
  }
}

/* The ladder: up where a mismatch lasts 2.5 windows or is severe (that of a knock, or of a move with half the
 * stiffness, is over in 0.4 s, and a calmer command would only prolong the error), one rung down after 5 windows of
 * calm, twice as many after each raise, so that a loop which swings on the lower rung does not go up and down for ever.
 * */
static void supervisor_climb(supervisor_state *state, const supervisor_settings *o, real mismatch)
{
  int echoes = 0;
  for (int sensor = 0; sensor < CONTROLLER_NS; ++sensor)
    echoes |= o->drive[sensor] && state->echo[sensor] > (real)SUPERVISOR_ECHO;
  /* at most 128-fold, 2 min: the shift must not overflow */
  const int doubled = state->raises > 8 ? 7 : state->raises > 0 ? state->raises - 1 : 0;
  const int calm = mismatch < (real)SUPERVISOR_TRUST && state->activity < (real)SUPERVISOR_ACTIVE && !echoes;
  const int settled = supervisor_lasted(&state->calm, calm, (5 * o->window) << doubled);
  const int doubt = mismatch > (real)SUPERVISOR_DOUBT;
  const int lasting = supervisor_lasted(&state->doubted, doubt, 2 * o->window + o->window / 2);
  const int late = supervisor_lasted(&state->late, echoes, 2 * o->window + o->window / 2);
  if (state->since < 5 * o->window) ++state->since;
  const int active = state->activity > (real)SUPERVISOR_ACTIVE && (lasting || mismatch > (real)SUPERVISOR_SEVERE);
  /* the mean over five windows has forgotten the last rung before it is judged again */
  if ((active || (late && (!state->raises || state->since >= 5 * o->window))) && state->rung < o->rungs
      && state->since >= o->window / 2) {
    ++state->rung;
    if (state->raises < 9) ++state->raises;
  } else if (settled && state->rung > 0) --state->rung;
  else return;
  state->since = state->calm = 0;
}

/* The drive whose innovations follow its motion, as of another lag or delay than the model's; -1: none. */
static int supervisor_behind(const supervisor_state *state, const supervisor_settings *o)
{
  for (int sensor = 0; sensor < CONTROLLER_NS; ++sensor) {
    const real along = state->along[sensor], travel = state->travel[sensor] + (real)SUPERVISOR_TRAVEL;
    if (o->drive[sensor] && along * along > (real)SUPERVISOR_BEHIND * travel) return sensor;
  }
  return -1;
}

/* Whether a drive runs ahead of its model (1) or falls behind (-1): its innovations have the sign of its changes, however it
 * swings, while those about its mean have not; 0 where they do not show it. */
static int supervisor_ahead(const supervisor_state *state, const supervisor_settings *o)
{
  for (int sensor = 0; sensor < CONTROLLER_NS; ++sensor) {
    const real ahead = state->ahead[sensor];
    if (o->drive[sensor] && ahead * ahead > (real)SUPERVISOR_BEHIND * state->change[sensor]) return ahead > 0 ? 1 : -1;
  }
  return 0;
}

/* Whether the measured tip stays away from a setpoint that stands, though the loop had the time to reach it. Its mean has a
 * direction, so that a tip which swings about its setpoint, or whose estimate wanders, is not off. */
static void supervisor_stay(supervisor_state *state, const supervisor_settings *o, const supervisor_evidence *seen)
{
  if (seen->moves || state->tripped) state->stood = state->off = 0;
  if (!state->stood) state->offset = state->mean[0] = state->mean[1] = 0;
  if (!(o->offset > 0) || state->tripped || seen->distance < 0) return;
  const int most = o->settling + 5 * o->window, calls = state->stood - o->settling;
  if (state->stood < most) ++state->stood;
  if (calls < 0) return;
  for (int k = 0; k < 2; ++k) state->mean[k] += (seen->from[k] - state->mean[k]) / (real)(calls + 1);
  real beyond = CG_SQRT(state->mean[0] * state->mean[0] + state->mean[1] * state->mean[1]) / o->offset - 1;
  cg_limit(&beyond, -1, (real)SUPERVISOR_BEYOND);
  if (calls >= o->window) state->offset += beyond / (real)o->window;
  cg_limit(&state->offset, 0, (real)SUPERVISOR_STAYS);
  state->off = state->offset >= (real)SUPERVISOR_STAYS || (state->off && 2 * state->offset > (real)SUPERVISOR_STAYS);
}

void supervisor_judge(supervisor_state *state, const supervisor_settings *o, const supervisor_evidence *seen,
                      supervisor_report *report)
{
  if (!o->window) return;
  int silent = -1, eye = CONTROLLER_NS > 0 ? 0 : -1;
  for (int sensor = CONTROLLER_NS - 1; sensor >= 0; --sensor) {
    if (!o->shape[sensor]) continue;
    eye = sensor;
    if (supervisor_silent(state, o, seen, sensor)) silent = sensor;
  }
  supervisor_average(state, o, seen, report);
  const real mismatch = report->mismatch, activity = state->activity;
  const int doubt = mismatch > (real)SUPERVISOR_DOUBT, half = o->window / 2, window = o->window;
  int reason = 0;
  if (!state->tripped) supervisor_climb(state, o, mismatch);
  /* 2.5 windows since the last raise: time to become calm before a loop counts as lost */
  const int top = state->rung == o->rungs && state->since >= 2 * window + half;
  if (supervisor_lasted(&state->swinging, doubt && top && activity > (real)SUPERVISOR_HARD, 2 * window + half))
    reason = SUPERVISOR_SWINGING;
  if (supervisor_lasted(&state->contradicted, mismatch > (real)SUPERVISOR_WRONG, 2 * window + half))
    reason = SUPERVISOR_CONTRADICTED;
  /* a tip that swings from one side to the other passes its setpoint */
  if (supervisor_mostly(&state->away, doubt && seen->distance > o->far, 5 * window)) reason = SUPERVISOR_AWAY;
  if (supervisor_lasted(&state->implausible, seen->implausible, 2 * window + half)) reason = SUPERVISOR_IMPLAUSIBLE;
  if (silent >= 0) reason = SUPERVISOR_UNANSWERED;
  if (supervisor_blind(state, o, seen)) reason = SUPERVISOR_UNSEEN;
  if (!state->tripped && state->since_rearmed < 150 * window) ++state->since_rearmed;
  if (reason && !state->tripped) {
    state->tripped = reason;
    state->suspect = reason == SUPERVISOR_UNSEEN ? eye : reason == SUPERVISOR_UNANSWERED ? silent : report->sensor;
    ++state->trips;
  }
  if (state->tripped) report->sensor = state->suspect;
  report->activity = activity;
  report->rung = state->rung;
  report->reason = state->tripped;
  report->contradicts = mismatch > (real)SUPERVISOR_NOTICE;
  const int behind = report->contradicts ? -1 : supervisor_behind(state, o);
  report->ahead = supervisor_ahead(state, o);
  supervisor_stay(state, o, seen);
  if (state->off) report->offset = CG_SQRT(state->mean[0] * state->mean[0] + state->mean[1] * state->mean[1]);
  report->health = state->tripped ? SUPERVISOR_TRIPPED : report->entry >= 0 ? SUPERVISOR_FROZEN
                 : state->rung ? SUPERVISOR_DETUNED : state->off ? SUPERVISOR_OFFSET : report->contradicts || behind >= 0 ? SUPERVISOR_MISMATCH
                 : SUPERVISOR_OK;
  if (report->health == SUPERVISOR_MISMATCH && behind >= 0) report->sensor = behind;
  if (report->health == SUPERVISOR_OFFSET) report->sensor = o->sensor[o->tip];
}

void supervisor_note(supervisor_state *state, const supervisor_settings *o, const real *change)
{
  real path[RTI_NU], sum = 0, squares = 0;
  if (!o->window) return;
  for (int j = 0; j < RTI_NU; ++j) {
    const real share = change[j] / o->change[j];
    path[j] = share < 0 ? -share : share;
    sum += path[j];
    squares += share * share;
  }
  supervisor_mean(o, &state->activity, squares / RTI_NU);
  for (int j = 0; j < CONTROLLER_NM; ++j)
    if (state->path[j] <= (real)SUPERVISOR_PATH) state->path[j] += o->cause[j] < 0 ? sum : path[o->cause[j]];
}

int supervisor_rearm(supervisor_state *state, const supervisor_settings *o)
{
  int good = state->tripped && state->activity < (real)SUPERVISOR_ACTIVE && !state->unseen;
  for (int sensor = 0; sensor <= CONTROLLER_NS; ++sensor) good &= state->mismatch[sensor] < (real)SUPERVISOR_TRUST;
  if (!good || (state->trips > 1 && state->since_rearmed < 150 * o->window)) return 0;
  state->tripped = state->swinging = state->contradicted = state->away = state->since = state->calm = 0;
  state->implausible = 0;
  memset(state->silent, 0, sizeof state->silent);
  memset(state->together, 0, sizeof state->together);
  state->since_rearmed = 0;
  state->rung = o->rungs;
  return 1;
}
