/* Active set: choose the active bounds, take a Newton step for these, repeat (the primal-dual active set method: M.
 * Hintermueller, K. Ito, K. Kunisch, SIAM J. Optim. 13 (2002) 865, doi:10.1137/S1052623401383558).
 *
 * An active bound whose multiplier has the wrong sign is dropped, and a violated one is added; many at once, which
 * takes few rounds but may cycle, so the rounds are limited. A row whose multiplier exceeds its linear penalty leaves
 * its bound, and returns to it if it lies inside. In a first set from an estimate, multiplier and distance from the
 * bound together decide.
 */

enum { RTI_RETAINED, RTI_ESTIMATED, RTI_EXCHANGED };    /* where a set comes from */
enum { RTI_FREE = 0, RTI_AT_HIGH = 1, RTI_AT_LOW = -1, RTI_OVER_HIGH = 2, RTI_UNDER_LOW = -2 };

#define RTI_FIXED RTI_R(1e30)         /* weight of an input at its bound: its pivot's inverse is 0 to rounding, and a sum
                                         of them stays below the largest float, 3.4e38 */
#define RTI_ROUNDING (10000 * RTI_EPS) /* of a gradient, relative to its largest term: it is a sum of RTI_N RTI_NZ terms,
                                          some hundred, through factors of similar condition */
#define RTI_ROUNDED 2                 /* result: the set is found, and only rounding is left */
#define RTI_MORE_ENTRIES 12           /* entries up to which a round may add more than the one before: a small set may grow,
                                         one that grows beyond is cycling (0 and 4: 9 and 4.3 instead of 3.5 factorizations;
                                         as of RTI_ROUNDS) */
#ifdef RTI_SINGLE
#define RTI_COARSE 1                  /* whether rounding may be all that is left; an interior point does no better then */
#define RTI_ROW_WEIGHT RTI_R(1e3)     /* weight of a row at its bound, per stiffness: closes the gap to 1e-3 in a step, and
                                         the update of the multipliers (augmented Lagrangian) closes the rest; more would
                                         leave no digits for the cost */
#else
#define RTI_COARSE 0
#define RTI_ROW_WEIGHT RTI_R(1e9)     /* 1e6 to 1e12 take the same number of factorizations */
#endif

typedef struct {
  real low, high, penalty, stiffness, slack;    /* penalty: least multiplier at which the bound is left */
} rti_bound;

/* The next state of a bounded quantity y, whose multiplier is positive at its upper bound. */
static inline int rti_next(const rti_bound *b, int how, int at, real y, real multiplier)
{
  if (how == RTI_RETAINED) return at;
  if (how == RTI_ESTIMATED) {
    const real above = multiplier + b->stiffness * (y - b->high), below = b->stiffness * (b->low - y) - multiplier;
    if (b->high < RTI_ABSENT && above > 0) return above < b->penalty ? RTI_AT_HIGH : RTI_OVER_HIGH;
    if (b->low > -RTI_ABSENT && below > 0) return below < b->penalty ? RTI_AT_LOW : RTI_UNDER_LOW;
    return RTI_FREE;
  }
  const int to_high = b->penalty > 0 ? RTI_AT_HIGH : RTI_OVER_HIGH, to_low = b->penalty > 0 ? RTI_AT_LOW : RTI_UNDER_LOW;
  switch (at) {
    case RTI_AT_HIGH:
      return multiplier <= 0 ? RTI_FREE : multiplier < b->penalty ? RTI_AT_HIGH : RTI_OVER_HIGH;
    case RTI_AT_LOW:
      return multiplier >= 0 ? RTI_FREE : -multiplier < b->penalty ? RTI_AT_LOW : RTI_UNDER_LOW;
    case RTI_OVER_HIGH:
      return y > b->high - b->slack ? RTI_OVER_HIGH : b->penalty > 0 ? RTI_AT_HIGH : RTI_FREE;
    case RTI_UNDER_LOW:
      return y < b->low + b->slack ? RTI_UNDER_LOW : b->penalty > 0 ? RTI_AT_LOW : RTI_FREE;
    default:
      break;
  }
  if (b->high < RTI_ABSENT && y > b->high + b->slack) return to_high;
  if (b->low > -RTI_ABSENT && y < b->low - b->slack) return to_low;
  return RTI_FREE;
}

/* Whether an active row has a multiplier of the wrong sign. */
static inline int rti_wrong_sign(const rti_work *o, int row, int k)
{
  const int at = o->active[row][k];
  return (at == RTI_AT_HIGH && o->a[row][k] <= 0) || (at == RTI_AT_LOW && o->a[row][k] >= 0);
}

/* The greatest of consecutive wrong multipliers from an entry on. Only its bound is dropped: where a state is at its
 * bound over many nodes, one active bound too many gives all multipliers before it the wrong sign. */
static real rti_greatest_wrong(const rti_work *o, int row, int from)
{
  real worst = 0;
  for (int k = from; k < rti_end(from) && rti_wrong_sign(o, row, k); ++k) worst = rti_max(worst, rti_abs(o->a[row][k]));
  return worst;
}

/* Mark which of a run of inputs at their bound leave it: from each end on while the sum of their multipliers has the wrong
 * sign, up to half of the run. Where changes of an input have a cost, the whole force by which a run is too long acts at its
 * last entry, and the sum tells how many entries are to carry it. In configs/mpc/steady_tip.yaml a QP takes 3.5
 * factorizations, and 4.5 where only the entries of the wrong sign leave, one per end and round. */
static void rti_release(const rti_work *o, int input, int from, int end, signed char *released)
{
  const real sign = (real)o->active[input][from];
  real first = 0, last = 0;
  for (int i = 0; 2 * i < end - from; ++i) {
    first -= sign * o->residual[from + i][input];
    last -= sign * o->residual[end - 1 - i][input];
    if (first <= 0) released[from + i] = 1;
    else first = RTI_ABSENT;
    if (last <= 0) released[end - 1 - i] = 1;
    else last = RTI_ABSENT;
  }
}

/* Choose the next set with its weights and pushes from the current point and multipliers. Returns the number of
 * changes, how many of them are of entries that were free, and the greatest relative distance of an active quantity from its
 * bound. */
static int rti_update_set(rti_work *o, const rti_settings *s, int how, real *gap, int *added)
{
  int changes = 0;
  *added = 0;
  *gap = 0;
  for (int row = 0; row < RTI_ROWS; ++row) {
    const int input = row < RTI_NU, i = input ? 0 : row - RTI_NU;
    const real unit = rti_scale(s, row), linear = input ? 0 : s->linear[i], quadratic = input ? 0 : s->quadratic[i];
    /* slack: a tenth of the violation that counts as none, so that rounding at a bound does not change the set */
    rti_bound bound = {rti_low(s, row), rti_high(s, row), 0, 0, s->tolerance * unit / 10};
    memset(o->weight[row], 0, sizeof o->weight[row]);
    memset(o->push[row], 0, sizeof o->push[row]);
    if (!rti_penalized(s, row)) continue;
    int wrong = 0;
    real worst = 0;
    signed char released[RTI_STAGES] = {0};
    for (int k = 0, end; input && how == RTI_EXCHANGED && k < RTI_STAGES; k = end) {
      for (end = k + 1; end < rti_end(k) && o->active[row][end] == o->active[row][k]; ++end) {}
      if (o->active[row][k] != RTI_FREE) rti_release(o, rti_lesser(row, RTI_NU - 1), k, end, released);
    }
    for (int k = 0; k < RTI_STAGES; ++k) {
      const real y = o->y[row][k], c = o->stiffness[row][k], residual = input ? o->residual[k][rti_lesser(row, RTI_NU - 1)] : 0;
      /* most are free and stay so */
      if (how == RTI_EXCHANGED && o->active[row][k] == RTI_FREE && y <= bound.high + bound.slack
          && y >= bound.low - bound.slack && !(input && rti_fixed(s, row))) {
        wrong = 0;
        continue;
      }
      const real a = input ? -residual : o->a[row][k];  /* an input's gradient is balanced by its bound alone */
      const int first = !wrong || (RTI_SCENARIOS > 1 && k % RTI_N == 0);
      wrong = !input && how == RTI_EXCHANGED && rti_wrong_sign(o, row, k);
      if (wrong && first) worst = rti_greatest_wrong(o, row, k);
      bound.stiffness = c;
      /* Inputs never leave their bounds; a row that no input moves cannot be held at its own. */
      bound.penalty = input ? RTI_FIXED : c > 0 ? linear : 0;
      int at = input && rti_fixed(s, row) ? RTI_AT_HIGH : rti_next(&bound, how, o->active[row][k], y, a);
      if (wrong && rti_abs(a) < worst) at = o->active[row][k];
      if (released[k] && !rti_fixed(s, row)) at = RTI_FREE;
      if (input && rti_copied(k)) at = RTI_FREE;        /* its bound is that of the first scenario's */
      const real away = at == RTI_FREE ? 0 : y - (at > 0 ? bound.high : bound.low);
      const int holds = at == RTI_AT_HIGH || at == RTI_AT_LOW;
      changes += at != o->active[row][k];
      *added += at != RTI_FREE && at != o->active[row][k];
      o->active[row][k] = (signed char)at;
      if (holds) *gap = rti_max(*gap, rti_abs(away) / unit);
      const real weight = at == RTI_FREE ? 0 : input ? RTI_FIXED : holds ? RTI_ROW_WEIGHT * c : quadratic;
      o->weight[row][k] = weight;
      o->push[row][k] = weight * away;
      /* At its bound an input ignores its gradient; beyond its bound a row is pushed by its penalty. */
      if (input) o->push[row][k] -= at == RTI_FREE ? 0 : residual;
      else if (!holds) o->push[row][k] += (at > 0 ? linear : at < 0 ? -linear : 0) - a;
    }
  }
  return changes;
}

/* Largest gradient with respect to a free input, relative to its terms and to the force that moves the input by its
 * scale. */
static real rti_free_residual(const rti_work *o, const rti_settings *s)
{
  real worst = 0;
  for (int j = 0; j < RTI_NU; ++j) {
    const real unit = rti_scale(s, j);
    for (int k = 0; k < RTI_STAGES; ++k) {
      const real size = rti_max(o->gradient_size[j], o->stiffness[j][k] * unit);
      if (o->active[j][k] == RTI_FREE && size > 0) worst = rti_max(worst, rti_abs(o->residual[k][j]) / size);
    }
  }
  return worst;
}

/* Whether a row is at a bound or beyond: where none is, nothing asks for the stiffness of rows. */
static int rti_rows_matter(const rti_work *o, const rti_settings *s)
{
  for (int i = RTI_NU; i < RTI_ROWS; ++i) {
    int active = 0;
    for (int k = 0; k < RTI_STAGES; ++k) active |= o->active[i][k];
    if (active || (rti_penalized(s, i) && rti_excess(s, i, o->y[i]) > 0)) return 1;
  }
  return 0;
}

/* Iterate from the current point and the rows' multipliers a; 1 if the optimality conditions are satisfied,
 * RTI_ROUNDED, or 0 if the set was not found. */
static int rti_active_set(rti_work *o, const rti_settings *s, int how, int limit, rti_report *report)
{
  int before = RTI_ROWS * RTI_STAGES;
  real last = 0; /* residual of the round before, if that did not change the set */
  for (int round = 0;; ++round) {
    real gap;
    int added;
    memset(o->force, 0, sizeof o->force[0] * RTI_NU);
    for (int i = RTI_NU; i < RTI_ROWS; ++i) memcpy(o->force[i], o->a[i], sizeof o->force[i]);
    rti_gradient(o);
    if (!o->has_stiffness && rti_rows_matter(o, s)) rti_stiffnesses_again(o);
    const int changes = rti_update_set(o, s, round == 0 ? how : RTI_EXCHANGED, &gap, &added);
    const real residual = rti_free_residual(o, s);
    report->kkt = rti_max(gap, residual);
    const real enough = (round == limit ? 100 : 1) * s->tolerance;
    if (round > 0 && changes == 0 && 100 * gap <= enough && residual <= enough + RTI_ROUNDING) return 1;
    if (RTI_COARSE && changes == 0 && last > 0 && report->kkt > last / 2) return RTI_ROUNDED;
    if (round == limit || (round > 1 && added > before && added > RTI_MORE_ENTRIES)) return 0;
    if (round > 0) before = added;
    last = round > 0 && changes == 0 ? report->kkt : 0;
    ++report->iterations;
    rti_factor(o, 0);
    rti_resolve(o, 0);
    if (!rti_advance(o)) return 0;
    rti_move(o, 1);
    for (int i = RTI_NU; i < RTI_ROWS; ++i)
      for (int k = 0; k < RTI_STAGES; ++k) o->a[i][k] += o->push[i][k] + o->weight[i][k] * o->dy[i][k];
  }
}

/* The set of the plan, which is the last solution shifted: what is at its bound there, or beyond. Whether to start from
 * it: where the solution without bounds violates few entries (4), the plan is close, and these are the better estimate.
 * */
static int rti_plan_set(rti_work *o, const rti_settings *s)
{
  int count = 0, violated = 0;
  for (int row = 0; row < RTI_ROWS; ++row) {
    const int input = row < RTI_NU, i = input ? 0 : row - RTI_NU, later = !input && i < RTI_NS;
    const real low = rti_low(s, row), high = rti_high(s, row);
    /* Inputs were clipped to their bounds exactly; rows are off by what the linearization left. */
    const real margin = rti_scale(s, row) * (input ? RTI_R(1e-6) : RTI_R(1e-2));
    const int penalized = rti_penalized(s, row), over = input ? RTI_AT_HIGH : RTI_OVER_HIGH;
    for (int k = 0; k < RTI_STAGES; ++k) {
      const real y = input ? o->u[k][rti_lesser(row, RTI_NU - 1)] : o->c[rti_node(k) + later][i];
      int at = RTI_FREE;
      if (penalized && high < RTI_ABSENT && y > high - margin) at = y > high + margin ? over : RTI_AT_HIGH;
      else if (penalized && low > -RTI_ABSENT && y < low + margin) at = y < low - margin ? -over : RTI_AT_LOW;
      o->active[row][k] = (signed char)at;
      count += at != RTI_FREE;
      violated += penalized && (o->y[row][k] < low || o->y[row][k] > high);
    }
  }
  return count > 0 && violated > 4;
}

/* Entry of the previous QP that corresponds to an entry: that of the same node, or of the same instant. */
static inline int rti_previous_entry(const rti_plan *plan, int k, int stays)
{
  return stays ? k : rti_lesser(k + (int)(plan->moved + RTI_R(0.5)), rti_end(k) - 1);
}

/* Take the active set of the previous QP and its multipliers; whether it had one. */
static int rti_previous_set(rti_work *o, const rti_plan *plan)
{
  int count = 0;
  if (!rti_finite(plan->a[0], RTI_NC * RTI_STAGES)) return 0;
  for (int row = 0; row < RTI_ROWS; ++row)
    for (int k = 0; k < RTI_STAGES; ++k) {
      const int from = rti_previous_entry(plan, k, plan->stays);
      o->active[row][k] = plan->active[row][from];
      count += o->active[row][k] != RTI_FREE;
      if (row >= RTI_NU) o->a[row][k] = plan->a[row - RTI_NU][from];
    }
  if (count == 0) memset(o->a, 0, sizeof o->a);
  return count > 0;
}

/* Save the active set for the next QP, and which correspondence of entries predicted this one better: a constraint
 * stays at its instant in a move to a fixed setpoint, but at its node where the reference moves on. */
static void rti_remember_set(const rti_work *o, const rti_plan *before, rti_plan *next)
{
  int changed = 0;
  for (int i = 0; i < RTI_NC; ++i) memcpy(next->a[i], o->a[RTI_NU + i], sizeof next->a[i]);
  for (int row = 0; row < RTI_ROWS; ++row) {
    memcpy(next->active[row], o->active[row], sizeof next->active[row]);
    for (int k = 0; k < RTI_STAGES; ++k) {
      const int is = o->active[row][k], moved = before->active[row][rti_previous_entry(before, k, 0)];
      changed += (is != before->active[row][k]) - (is != moved);
    }
  }
  next->stays = changed < 0 || (changed == 0 && before->stays);
}
