/* Detection of contact. See contact_detector.h. */

/* Of the last two members: tendons that were pulled, and released, all along. */
static void contact_forget(contact_state *state)
{
#if CONTACT_NF > 0
  for (int m = CONTACT_NM - 2; m < CONTACT_NM; ++m)
    for (int k = CONTACT_NS - CONTACT_NF; k < CONTACT_NS; ++k) state->s[m][k] = m < CONTACT_NM - 1 ? 1 : -1;
#else
  (void)state;
#endif
}

void contact_start(contact_state *state, const contact_settings *settings, const real *z)
{
  memset(state, 0, sizeof *state);
  memcpy(state->s, settings->first, sizeof state->s);
  if (!z) return;
  for (int m = 0; m < CONTACT_NM; ++m)
    for (int k = 0; k < CONTACT_NS; ++k) state->s[m][k] = z[settings->from[k]];
  if (!settings->history_known) contact_forget(state);
}

static real contact_size(real value) { return value < 0 ? -value : value; }

/* Move a member through the last period; its mean tension over it, and what all tendons of each drive have at its end. */
static void contact_move(contact_state *state, const contact_settings *settings, int member, const real *before,
                         const real *speed, real *mean, real *all)
{
  real wound[2 * CONTACT_ND], next[CONTACT_NS], *s = state->s[member], *tension = state->tension[member];
  const real h = settings->period / (real)settings->substeps, *p = settings->p[member];
  for (int d = 0; d < CONTACT_ND; ++d) mean[d] = 0;
  for (int k = 0; k < settings->substeps; ++k) {
    for (int d = 0; d < CONTACT_ND; ++d) {
      wound[2 * d] = before[d] + (real)k * h * speed[d];
      wound[2 * d + 1] = speed[d];
      mean[d] += tension[d] / 2;
    }
    const real *arg[] = {s, wound, p, &h};
    real *res[] = {next};
    free_step(arg, res);
    memcpy(s, next, sizeof next);
    for (int d = 0; d < CONTACT_ND; ++d) wound[2 * d] += h * speed[d];
    real *pulled[] = {tension, k < settings->substeps - 1 ? 0 : all};
    free_tension(arg, pulled);
    for (int d = 0; d < CONTACT_ND; ++d) mean[d] += tension[d] / 2;
  }
  for (int d = 0; d < CONTACT_ND; ++d) mean[d] /= (real)settings->substeps;
}

/* Share of the dry friction whose direction the last three periods show, with its sign, at a share of their speeds. */
static real contact_direction(const contact_state *state, const contact_settings *settings, int d, real share)
{
  real least = 1, sign = 0;
  for (int k = 0; k < 3; ++k) {
    const real speed = share * state->speed[k][d], slow = settings->slow[d];
    const real way = speed / CG_SQRT(speed * speed + slow * slow);
    if (k > 0 && way * sign <= 0) return 0;
    sign = way;
    if (contact_size(way) < contact_size(least)) least = way;
  }
  return least;
}

/* Greatest and least residual of a finger that touches nothing, by the first groups. */
static void contact_bounds(const contact_state *state, const contact_settings *settings, int groups, int d, real *low,
                           real *high)
{
  const real both = state->unknown[d] + settings->noise[d] + settings->model_error * state->size[d];
  *low = -both;
  *high = both;
  for (int g = 0; g < groups; ++g) {
    real least = 0, most = 0;
    for (int m = 1; m < CONTACT_NM; ++m) {
      if (settings->group[m] != g) continue;
      if (state->least[m][d] < least) least = state->least[m][d];
      if (state->most[m][d] > most) most = state->most[m][d];
    }
    *low += least;
    *high += most;
  }
}

static int contact_beyond(const contact_state *state, const contact_settings *settings, int groups)
{
  int found = 0;
  for (int d = 0; d < CONTACT_ND; ++d) {
    real low, high;
    contact_bounds(state, settings, groups, d, &low, &high);
    found |= state->residual[d] > high || state->residual[d] < low;
  }
  return found;
}

/* Greatest and least of a range of tensions over one of gains, which have the same sign. */
static void contact_divide(real low, real high, real gain, real greatest, real *least, real *most)
{
  const real found[] = {low / gain, low / greatest, high / gain, high / greatest};
  *least = *most = found[0];
  for (int k = 1; k < 4; ++k) {
    if (found[k] < *least) *least = found[k];
    if (found[k] > *most) *most = found[k];
  }
}

/* What one drive says of the force at a place. */
static void contact_explain_by(const contact_state *state, const contact_settings *settings, int d, int place,
                               contact_report *report)
{
  const real gain = report->gain[d + CONTACT_ND * place];
  real greatest = report->gain_most[d + CONTACT_ND * place], least, most;
  const real high = report->high[d], low = report->low[d];
  real now = state->residual[d];
  cg_limit(&now, low, high);
  const real bound = high - now > now - low ? high - now : now - low;   /* whichever way the force acts */
  if (!(contact_size(gain) * (real)CONTACT_MOST > bound)) return;       /* a slack tendon feels nothing */
  if (!(greatest / gain > 1)) greatest = gain;
  if (bound / contact_size(gain) < report->threshold[place]) report->threshold[place] = bound / contact_size(gain);
  contact_divide(state->residual[d] - high, state->residual[d] - low, gain, greatest, &least, &most);
  if (settings->single[d] && state->size[d] + state->residual[d] < high) {
    /* It may be slack, and a greater force would not slacken it further. */
    if (gain > 0) least = -(real)CONTACT_MOST;
    else most = (real)CONTACT_MOST;
  }
  if (least > report->force_low[place]) report->force_low[place] = least;
  if (most < report->force_high[place]) report->force_high[place] = most;
}

/* What a contact may be: where it is, and how strong it is there. */
static void contact_explain(const contact_state *state, const contact_settings *settings, contact_report *report)
{
  real wound[2 * CONTACT_ND];
  for (int d = 0; d < CONTACT_ND; ++d) {
    wound[2 * d] = state->length[d];
    wound[2 * d + 1] = 0;
    report->residual[d] = state->residual[d];
    contact_bounds(state, settings, CONTACT_NG, d, &report->low[d], &report->high[d]);
  }
  const real *arg[] = {state->s[0], wound, settings->p[0]};
  real *res[] = {report->gain, report->gain_most};
  free_gain(arg, res);
  for (int i = 0; i < CONTACT_NL; ++i) {
    report->threshold[i] = report->force_high[i] = (real)CONTACT_MOST;
    report->force_low[i] = -(real)CONTACT_MOST;
    for (int d = 0; d < CONTACT_ND; ++d) contact_explain_by(state, settings, d, i, report);
  }
}

/* Nothing is known: any force agrees with it, and none is detected. */
static int contact_unknown(contact_report *report, int verdict)
{
  for (int i = 0; i < CONTACT_NL; ++i) {
    report->threshold[i] = report->force_high[i] = (real)CONTACT_MOST;
    report->force_low[i] = -(real)CONTACT_MOST;
  }
  return report->verdict = verdict;
}

int contact_step(contact_state *state, const contact_settings *settings, const real *measured, const real *u,
                 contact_report *report)
{
  real y[CONTACT_NY], length[CONTACT_ND], pull[CONTACT_ND], mean[CONTACT_ND], before[CONTACT_ND], free_mean[CONTACT_ND] = {0};
  real all[CONTACT_ND], free_all[CONTACT_ND];
  memset(report, 0, sizeof *report);
  for (int j = 0; j < CONTACT_NY; ++j) y[j] = measured[settings->felt[j]];
  if (state->lost) return contact_unknown(report, CONTACT_LOST);
  if (!cg_within(y, settings->y_min, settings->y_max, CONTACT_NY) || !cg_finite(u, CONTACT_NU))
    return contact_unknown(report, CONTACT_MISSING);
  const real *arg[] = {y, u, state->length, &settings->period};
  real *res[] = {length, pull};
  contact_measured(arg, res);
  const real h = settings->period;
  memcpy(before, state->length, sizeof before);
  if (!state->steps) memcpy(before, length, sizeof before);   /* where it was before is not known: it rested */
  memmove(state->speed[1], state->speed[0], 2 * sizeof state->speed[0]);
  for (int d = 0; d < CONTACT_ND; ++d) state->speed[0][d] = (length[d] - before[d]) / h;
  for (int m = 0; m < CONTACT_NM; ++m) {
    contact_move(state, settings, m, before, state->speed[0], mean, m ? all : free_all);
    for (int d = 0; d < CONTACT_ND; ++d) {
      /* Over two periods, so that the acceleration by differences is that of their middle. */
      const real both = (mean[d] + state->mean[m][d]) / 2;
      state->mean[m][d] = mean[d];
      if (state->steps < 2) continue;
      if (m == 0) free_mean[d] = both;
      else state->deviation[m][d] += settings->blend * (both - free_mean[d] - state->deviation[m][d]);
      const real off = state->deviation[m][d], low = settings->fade * state->least[m][d];
      const real high = settings->fade * state->most[m][d];
      state->least[m][d] = off < low ? off : low;
      state->most[m][d] = off > high ? off : high;
    }
  }
  state->lost = !cg_finite(&state->s[0][0], CONTACT_NM * CONTACT_NS);
  if (state->lost) return contact_unknown(report, CONTACT_LOST);
  for (int d = 0; d < CONTACT_ND; ++d) {
    const real pulled = (pull[d] + (state->steps ? state->pull[d] : pull[d])) / 2;
    const real both = (pulled + state->pull_mean[d]) / 2, way = contact_direction(state, settings, d, 1);
    /* Commands are held over a period: where a servo is fast, its motor nearly stands when the torque is read. */
    const real sure = contact_size(contact_direction(state, settings, d, settings->ending[d]));
    const real speed = (state->speed[0][d] + state->speed[1][d]) / 2;
    const real acceleration = (state->speed[0][d] - state->speed[1][d]) / h;
    const real unknown = settings->dry[d] * (settings->dry_error + 1 - sure)
                         + settings->jerk[d] * contact_size(speed)
                         + settings->held[d] * contact_size(pull[d] - state->pull[d]);
    const real excess = both - settings->inertia[d] * acceleration - settings->viscous[d] * speed
                        - settings->dry[d] * way - free_mean[d];
    state->pull[d] = pull[d];
    state->pull_mean[d] = pulled;
    state->length[d] = length[d];
    if (state->steps < 2) { state->unknown[d] = settings->dry[d] * (settings->dry_error + 1); continue; }
    state->residual[d] += settings->blend * (excess - state->residual[d]);
    state->unknown[d] += settings->blend * (unknown - state->unknown[d]);
    state->size[d] += settings->blend * (free_all[d] - state->size[d]);
  }
  if (state->steps < 2) ++state->steps;
  report->verdict = contact_beyond(state, settings, CONTACT_NG)       ? CONTACT_DETECTED
                    : contact_beyond(state, settings, CONTACT_NG - (CONTACT_NF > 0)) ? CONTACT_UNCERTAIN
                                                                      : CONTACT_FREE;
  if (report->verdict == CONTACT_DETECTED) contact_forget(state);
  contact_explain(state, settings, report);
  return report->verdict;
}
