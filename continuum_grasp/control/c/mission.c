/* Phases, limits and setpoints of a mission. See mission.h. */

/* The quintic from 0 to 1 with neither rate nor acceleration at both ends: setpoints that a drive can follow. */
static real mission_smooth(real share)
{
  cg_limit(&share, 0, 1);
  return share * share * share * (10 - 15 * share + 6 * share * share);
}

/* Setpoints at an instant of the plan. */
static void mission_planned(const mission_settings *o, real t, real *row)
{
  for (int j = 0; j < MISSION_NR; ++j) row[j] = o->first[j];
  for (int k = 0; k < MISSION_MOVES; ++k) {
    const real risen = mission_smooth((t - o->moves_at[k]) / o->moves_for[k]);
    for (int j = 0; risen > 0 && j < MISSION_NR; ++j) row[j] += risen * o->moves_by[k][j];
  }
}

/* The instant of the plan that is foreseen at an instant. */
static real mission_foreseen(const mission_state *state, const mission_settings *o, real t)
{
  if (state->opens_at_once) return o->begin[o->release] + o->length[o->release];
  real at = o->begin[state->phase] + (t - state->start);
  if (state->phase <= o->confirm && at > o->begin[o->confirm]) at = o->begin[o->confirm];
  if (o->holds_on && state->phase < o->lower && at > o->begin[o->lower]) at = o->begin[o->lower];
  return at;
}

void mission_setpoints(const mission_state *state, const mission_settings *o, real t, real *row)
{
  const real at = mission_foreseen(state, o, t);
  mission_planned(o, at, row);
  if (state->grip != MISSION_USUAL) {
    const real firm = 1 - mission_smooth((at - o->begin[o->release]) / o->length[o->release]);
    for (int j = 0; j < MISSION_NR; ++j) row[j] += firm * o->firm[j];
  }
  if (state->left_at < 0) return;
  const real left = 1 - mission_smooth((t - state->left_at) / o->length[o->release]);
  for (int j = 0; j < MISSION_NR; ++j) row[j] += left * state->left[j];
}

/* Limits of the command; `fading` is the share of those before that is left. */
static void mission_limit(mission_state *state, const mission_settings *o, int kind, real fading)
{
  state->limits = kind;
  state->changed = 1;
  for (int j = 0; j < MISSION_NU; ++j) {
    state->u_min[j] = o->low[kind][j] + state->moved[j];
    state->u_max[j] = o->high[kind][j] + state->moved[j];
    cg_limit(&state->u_min[j], o->u_min[j], o->u_max[j]);
    cg_limit(&state->u_max[j], o->u_min[j], o->u_max[j]);
    state->u_min[j] += fading * (state->u_min_before[j] - state->u_min[j]);
    state->u_max[j] += fading * (state->u_max_before[j] - state->u_max[j]);
  }
}

void mission_enter(mission_state *state, const mission_settings *o, int phase, real t, const real *u)
{
  if (state->fades && state->sight == CG_BLIND) mission_limit(state, o, MISSION_NOMINAL, 0);
  state->fades = phase == o->release && state->phase == o->lower;
  state->phase = phase;
  state->start = t;
  if (o->follows[phase] < 0) return;
  const int kind = o->limits[phase];
  state->follows = o->follows[phase];
  memcpy(state->u_min_before, state->u_min, sizeof state->u_min);
  memcpy(state->u_max_before, state->u_max, sizeof state->u_max);
  /* Positions hold where they are by now: friction and soft contacts move those of the grasp. */
  for (int j = 0; j < MISSION_NU; ++j)
    state->moved[j] = kind == MISSION_HOLDS && o->follows_command ? u[j] - o->held[j] : 0;
  mission_limit(state, o, kind, 0);
}

/* Blind fingers, whose commands go to the limits, hold as in the grasp, and then open as slowly as those that see. */
static void mission_guard(mission_state *state, const mission_settings *o, real t)
{
  const int blind = state->sight == CG_BLIND;
  if (state->limits == MISSION_HOLDS || (state->limits == MISSION_SQUEEZES && state->phase > o->confirm)) {
    const int kind = blind ? MISSION_SQUEEZES : MISSION_HOLDS;
    if (kind != state->limits) mission_limit(state, o, kind, 0);
  } else if (state->fades) {
    const real left = blind ? 1 - mission_smooth((t - state->start) / o->length[o->release]) : 0;
    mission_limit(state, o, MISSION_NOMINAL, left);
    state->fades = left > 0;
  }
}

void mission_start(mission_state *state, const mission_settings *o, real t, const real *u)
{
  memset(state, 0, sizeof *state);
  state->left_at = -1;
  mission_enter(state, o, 0, t, u);
}

/* Whether the phase is the wait before the lift, or the one before that. */
static int mission_feels(const mission_state *state, const mission_settings *o)
{
  return state->phase == o->confirm || state->phase + 1 == o->confirm;
}

/* Count the calls in a row in which all contacts bear enough: an estimate that jumps is no force. */
static void mission_feel(mission_state *state, const mission_settings *o, const real *forces)
{
  if (state->sight == CG_PREDICTS) return;      /* a prediction is none either */
  int enough = state->sight != CG_BLIND;
  for (int c = 0; c < MISSION_NC; ++c) enough &= forces[c] >= o->needed[c];     /* not those that are no numbers */
  state->borne = enough ? state->borne + 1 : 0;
}

/* Whether the finger lets go before the lift, blind, or because another one does. */
static int mission_gives_up(mission_state *state, const mission_settings *o, int reported)
{
  if (state->phase > o->confirm) return 0;
  if (state->sight == CG_BLIND) state->bears = MISSION_BLIND;
  return state->bears == MISSION_BLIND || reported == (o->leads ? MISSION_BLIND : MISSION_LETS_GO);
}

/* Decide before the lift, or take what was decided; whether there is a decision. */
static int mission_decide(mission_state *state, const mission_settings *o, real since, int reported)
{
  const int enough = state->borne >= o->parts;
  state->bears = !enough ? MISSION_LACKS : state->sight == CG_SEES ? MISSION_BEARS : MISSION_DOUBTS;
  if (!o->leads) state->decision = reported;
  else if (state->bears == MISSION_BEARS && reported == MISSION_BEARS) state->decision = MISSION_LIFTS;
  else if (since > o->patience - (real)1e-3 * o->period && reported != MISSION_UNKNOWN)
    state->decision = enough && reported != MISSION_LACKS ? MISSION_LIFTS : MISSION_LETS_GO;
  return state->decision != MISSION_WAITS;
}

/* ---- an object that slips ---- */

/* Whether it is held off the table. */
static int mission_holds(const mission_state *state, const mission_settings *o)
{
  return state->phase > o->confirm && state->phase < o->lower;
}

void mission_see(mission_state *state, const mission_settings *o, real height)
{
  if (!cg_finite(&height, 1)) return;
  state->height = state->seen ? state->height + o->fresh * (height - state->height) : height;
  state->seen = 1;
  if (state->grip == MISSION_FIRM && state->settled <= o->settles) ++state->settled;
  /* Contacts give way a little under the weight that the lift puts on them, and until they are squeezed. */
  const int usual = state->grip == MISSION_USUAL, lifting = state->phase <= o->confirm + 1;
  if (usual ? lifting : state->settled == o->settles) state->base = state->height;
  const int test = usual ? lifting || !o->answers : state->settled < o->settles ? 2 : 1;
  state->lost = state->base - height;
  real more = o->weight[test] * (state->lost - o->sunk[test]);
  if (more > o->glitch) more = o->glitch;
  state->doubt = mission_holds(state, o) && state->doubt + more > 0 ? state->doubt + more : 0;
}

void mission_squeeze(mission_state *state, const mission_settings *o, int noticed)
{
  if (state->grip != MISSION_USUAL || !mission_holds(state, o)) return;
  state->grip = MISSION_FIRM;
  state->noticed = noticed;
  state->doubt = 0;
}

/* Squeeze where the object slips, and set it down where it goes on slipping. */
static void mission_watch(mission_state *state, const mission_settings *o, real t, const real *forces, const real *u)
{
  const int sinks = state->doubt >= 1;
  int open = 0;
  for (int c = 0; c < MISSION_NC; ++c) open |= state->sight != CG_BLIND && forces[c] < o->lost[c];
  state->open = open ? state->open + 1 : 0;
  if ((state->grip != MISSION_USUAL || !o->answers) && (sinks || state->open >= o->stays)) {
    if (state->grip == MISSION_USUAL) state->noticed = sinks ? MISSION_SINKS : MISSION_PARTS;
    state->grip = MISSION_SETS_DOWN;
    mission_release(state, o, t, u, 0);
  } else if (o->answers && (sinks || state->open >= o->parts))
    mission_squeeze(state, o, sinks ? MISSION_SINKS : MISSION_PARTS);
}

static void mission_let_go(mission_state *state, const mission_settings *o, real t, const real *u)
{
  state->decision = MISSION_LETS_GO;
  mission_release(state, o, t, u, 1);
  /* A blind finger opens as fast as its tensions may change: others that take longer push the object into it. */
  state->opens_at_once = 1;
  state->left_at = -1;
}

int mission_asks(const mission_state *state, const mission_settings *o)
{
  return mission_feels(state, o) || (o->watches && mission_holds(state, o));
}

int mission_advance(mission_state *state, const mission_settings *o, real t, const real *forces, const real *u,
                    int reported)
{
  state->changed = 0;
  if (mission_gives_up(state, o, reported)) mission_let_go(state, o, t, u);
  if (forces && mission_feels(state, o)) mission_feel(state, o, forces);
  if (forces && o->watches && mission_holds(state, o)) mission_watch(state, o, t, forces, u);
  for (;;) {
    const real since = t - state->start;
    const int next = state->phase + 1;
    /* 1e-3 periods: instants are sums of rounded ones */
    int over = since > o->length[state->phase] - (real)1e-3 * o->period;
    if (state->phase == o->confirm) {
      if (over) state->decision = MISSION_LETS_GO;      /* who decides was not heard of */
      else over = forces && mission_decide(state, o, since, reported);
      if (state->decision == MISSION_LETS_GO) {
        mission_let_go(state, o, t, u);
        return 1;
      }
    }
    if (!over || (o->holds_on && next == o->lower)) {
      mission_guard(state, o, t);
      return 1;
    }
    if (next == MISSION_PHASES) return 0;
    mission_enter(state, o, next, t, u);
  }
}

void mission_release(mission_state *state, const mission_settings *o, real t, const real *u, int at_once)
{
  const int next = at_once || state->phase <= o->confirm ? o->release : o->lower;
  real row[MISSION_SIZE(MISSION_NR)];
  if (state->phase >= next) return;
  mission_planned(o, mission_foreseen(state, o, t), row);
  mission_planned(o, o->begin[next], state->left);
  for (int j = 0; j < MISSION_NR; ++j) state->left[j] = row[j] - state->left[j];
  state->left_at = t;
  mission_enter(state, o, next, t, u);
  if (at_once) state->fades = 0;
}
