/* Interior point: predictor and corrector of S. Mehrotra, SIAM J. Optim. 2 (1992) 575, doi:10.1137/0802028.
 *
 * A side of a bound is sign y <= bound + s, with slack t = bound + s - sign y >= 0 and its multiplier m, and violation
 * s >= 0 with multiplier n = linear + quadratic s - m. Elimination of t, n, s leaves a Newton step dm = W sign dy + e,
 * ds = V dm + f, with weights W on the bounded quantities of a QP without bounds; V is the compliance of s. Inputs have
 * no s; rows without a linear penalty have s = m / quadratic and no n.
 */

#define RTI_CENTER RTI_R(0.01)        /* first complementarity products, per possible decrease of the cost; 1 takes as many
                                         factorizations, 1e-4 21 instead of 14 (keep_out, as of RTI_ROUNDS) */
#define RTI_SHORTEST_STEP RTI_R(1e-6) /* a shorter step means that the iterate is stuck at the boundary */

/* List the sides; an input that cannot move has none, since it has no interior. */
static void rti_sides(rti_work *o, const rti_settings *s)
{
  o->sides = 0;
  for (int row = 0; row < RTI_ROWS; ++row)
    for (int sign = -1; sign <= 1; sign += 2) {
      const real bound = sign > 0 ? rti_high(s, row) : -rti_low(s, row);
      const int input = row < RTI_NU, i = input ? 0 : row - RTI_NU;
      if (!rti_penalized(s, row) || bound >= RTI_ABSENT || (input && rti_fixed(s, row))) continue;
      rti_side *side = &o->side[o->sides++];
      side->row = row;
      side->sign = (real)sign;
      side->bound = bound;
      side->linear = input ? 0 : s->linear[i];
      side->quadratic = input ? 0 : s->quadratic[i];
      side->soft = side->linear > 0;
      side->compliance = input || side->soft ? 0 : 1 / side->quadratic;
    }
}

/* Move the inputs inside their bounds by a tenth of the range, and integrate the states: Newton steps are long only
 * where slacks and multipliers are both away from zero. */
static void rti_inner_trajectory(rti_work *o, const rti_settings *s)
{
  for (int k = 0; k < RTI_STAGES; ++k) {
    real *z = o->z[rti_node(k)], *next = o->z[rti_node(k) + 1];
    for (int j = 0; j < RTI_NU; ++j) {
      const real low = s->u_min[j], high = s->u_max[j], u = o->u[k][j];
      const real margin = RTI_R(0.1) * (low > -RTI_ABSENT && high < RTI_ABSENT ? high - low : rti_scale(s, j));
      real inner = u + z[RTI_NX + j];
      if (low > -RTI_ABSENT) inner = rti_max(inner, low + margin);
      if (high < RTI_ABSENT) inner = rti_min(inner, high - margin);
      z[RTI_NX + j] = inner - u;
    }
    memset(next, 0, sizeof o->z[0]);
    memcpy(next, o->defect[k], sizeof o->defect[k]);
    rti_following(next, o->M[k], z);
  }
  rti_bounded(o, o->z, o->y, 1);
}

/* Possible decrease of the cost per input on average: along its gradient, up to its bound or the minimum. */
static real rti_first_product(rti_work *o, const rti_settings *s)
{
  real sum = 0;
  memset(o->force, 0, sizeof o->force);
  for (int i = 0; i < o->sides; ++i) {
    const rti_side side = o->side[i];
    for (int k = 0; k < RTI_LENGTH; ++k) {
      const real over = side.sign * o->y[side.row][k] - side.bound;
      if (over > 0) o->force[side.row][k] += side.sign * (side.linear + side.quadratic * over);
    }
  }
  rti_gradient(o);
  for (int k = 0; k < RTI_STAGES; ++k)
    for (int j = 0; j < RTI_NU; ++j) {
      const real r = o->residual[k][j], c = o->stiffness[j][k], y = o->y[j][k];
      const real margin = r > 0 ? y - s->u_min[j] : s->u_max[j] - y;
      if (c > 0) sum += rti_abs(r) * rti_min(margin, rti_abs(r) / c);
    }
  return rti_max(sum / (real)(RTI_STAGES * RTI_NU), RTI_R(1e-20));
}

/* Slacks and multipliers whose products are about `product`; they satisfy all optimality conditions but the gradient's.
 * Of a soft row m + n = linear + quadratic s is shared: within its bounds n takes most, beyond them m. A row with a
 * quadratic penalty alone has s = compliance m, which makes t m = product a quadratic equation of t. */
static void rti_center(rti_work *o, real product)
{
  memset(o->dt, 0, sizeof o->dt);
  memset(o->dm, 0, sizeof o->dm);
  memset(o->ds, 0, sizeof o->ds);
  memset(o->dn, 0, sizeof o->dn);
  for (int i = 0; i < o->sides; ++i) {
    const rti_side side = o->side[i];
    for (int k = 0; k < RTI_LENGTH; ++k) {
      const real gap = side.bound - side.sign * o->y[side.row][k], over = rti_max(0, -gap);
      real t = gap, m, v = 0, n = 1;
      if (side.soft) {
        const real penalty = side.linear + side.quadratic * over;
        const real most = side.quadratic > 0 ? RTI_SQRT(product / side.quadratic) : product / penalty;
        const real inward = rti_min(product / penalty, most);
        const real all = penalty + side.quadratic * inward;
        v = over + inward;
        t = gap + v;
        if (gap < 0) {
          n = rti_min(product / v, all / 2);
          m = all - n;
        } else {
          m = rti_min(product / t, all / 2);
          n = all - m;
        }
      } else if (side.compliance > 0) {
        const real root = RTI_SQRT(gap * gap + 4 * product * side.compliance);
        t = gap > 0 ? (gap + root) / 2 : 2 * product * side.compliance / (root - gap);  /* without cancellation */
        m = product / t;
        v = m * side.compliance;
      } else {
        m = product / t;
      }
      o->t[i][k] = t;
      o->m[i][k] = m;
      o->s[i][k] = v;
      o->n[i][k] = n;
    }
  }
}

/* Forces on the bounded quantities from the multipliers of their sides. */
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

/* Weights of the bounded quantities in a Newton step. */
static void rti_weights(rti_work *o, const rti_settings *settings)
{
  memset(o->weight, 0, sizeof o->weight);
  for (int j = 0; j < RTI_NU; ++j)
    for (int k = 0; rti_fixed(settings, j) && k < RTI_STAGES; ++k) o->weight[j][k] = RTI_FIXED;
  for (int i = 0; i < o->sides; ++i) {
    const rti_side side = o->side[i];
    const real *restrict t = o->t[i], *restrict m = o->m[i], *restrict s = o->s[i], *restrict n = o->n[i];
    real *restrict W = o->W[i], *restrict V = o->V[i], *restrict weight = o->weight[side.row];
    if (side.soft)
      for (int k = 0; k < RTI_LENGTH; ++k) V[k] = s[k] / (side.quadratic * s[k] + n[k]);
    else
      for (int k = 0; k < RTI_LENGTH; ++k) V[k] = side.compliance;
    for (int k = 0; k < RTI_LENGTH; ++k) {
      W[k] = m[k] / (t[k] + V[k] * m[k]);
      weight[k] += W[k];
    }
  }
}

/* Constant parts of the step towards products of `target`, with a share `second` of the predictor's second-order term.
 * */
static void rti_newton_constants(rti_work *o, real target, real second)
{
  memset(o->push, 0, sizeof o->push);
  for (int i = 0; i < o->sides; ++i) {
    const rti_side side = o->side[i];
    const real *restrict y = o->y[side.row], *restrict W = o->W[i], *restrict V = o->V[i];
    const real *restrict m = o->m[i], *restrict s = o->s[i];
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

typedef struct { real ratio, first, second; } rti_direction;

/* Directions of slacks and multipliers along dy: largest relative decrease, and how the mean product changes. */
static rti_direction rti_directions(rti_work *o, real target, real second)
{
  real ratio[RTI_LENGTH] = {0}, first[RTI_LENGTH] = {0}, square[RTI_LENGTH] = {0};
  for (int i = 0; i < o->sides; ++i) {
    const rti_side side = o->side[i];
    const real *restrict y = o->y[side.row], *restrict dy = o->dy[side.row];
    const real *restrict t = o->t[i], *restrict m = o->m[i], *restrict s = o->s[i], *restrict n = o->n[i];
    const real *restrict W = o->W[i], *restrict V = o->V[i], *restrict e = o->e[i], *restrict f = o->f[i];
    real *restrict dt = o->dt[i], *restrict dm = o->dm[i], *restrict ds = o->ds[i], *restrict dn = o->dn[i];
    /* one division for both ratios of a pair: -ds / s = -n ds / (s n), -dn / n = -s dn / (s n) */
    if (side.soft)
      for (int k = 0; k < RTI_LENGTH; ++k) {
        const real violation = V[k] * (W[k] * side.sign * dy[k] + e[k]) + f[k], inverse = 1 / rti_max(s[k] * n[k], RTI_SMALLEST);
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
      ratio[k] = rti_max(ratio[k], -rti_min(m[k] * slack, t[k] * multiplier) / rti_max(t[k] * m[k], RTI_SMALLEST));
      first[k] += t[k] * multiplier + m[k] * slack;
      square[k] += slack * multiplier;
    }
  }
  rti_direction change = {0, 0, 0};
  real pairs = 0;
  for (int i = 0; i < o->sides; ++i) pairs += o->side[i].soft ? (real)(2 * RTI_LENGTH) : (real)RTI_LENGTH;
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
    pairs += (1 + soft) * (real)RTI_LENGTH;
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

/* Iterate until the mean product is small: 1; or 0 if steps become too short or too many, of which `taken` is the count. */
static int rti_interior_point(rti_work *o, const rti_settings *s, real small, int *taken)
{
  for (;;) {
    const real mean = rti_mean(o);
    if (mean <= small) return 1;
    if (*taken >= s->iterations) return 0;
    ++*taken;
    rti_forces(o);
    rti_gradient(o);
    rti_weights(o, s);
    rti_newton_constants(o, 0, 0);      /* predictor: products of zero */
    rti_factor(o, 0);
    rti_resolve(o, 0);
    if (!rti_advance(o)) return 0;
    rti_direction change = rti_directions(o, 0, 0);
    real length = change.ratio > 1 ? 1 / change.ratio : 1;
    const real rest = rti_max(0, 1 + length * (change.first + length * change.second) / mean);
    const real target = rest * rest * rest * mean;      /* Mehrotra: the cube of what the predictor leaves */
    const real second = length;     /* the full second-order term can make the iteration cycle where the predictor was short */
    rti_newton_constants(o, target, second);
    rti_resolve(o, 0);  /* the corrector has the predictor's factors */
    if (!rti_advance(o)) return 0;
    change = rti_directions(o, target, second);
    /* 0.995 of the way to the boundary, as usual: closer, the next products are badly centered. */
    length = change.ratio > RTI_R(0.995) ? RTI_R(0.995) / change.ratio : 1;
    if (length < RTI_SHORTEST_STEP) return 0;
    rti_move(o, length);
    rti_step_sides(o, length);
  }
}

/* Least cost of moving an input by its scale: the unit in which products are small. */
static real rti_unit_cost(const rti_work *o, const rti_settings *s)
{
  real least = 0;
  for (int j = 0; j < RTI_NU; ++j)
    for (int k = 0; k < RTI_STAGES; ++k) {
      const real unit = rti_scale(s, j), cost = o->stiffness[j][k] * unit * unit;
      if (cost > 0 && (cost < least || least == 0)) least = cost;
    }
  return least > 0 ? least : 1;
}
