/* A chain of hinges with a guide of the tendons at each, in steps that are implicit in everything.
 *
 * Time: the two-stage diagonally implicit method of order 2 that is L-stable (R. Alexander, SIAM J. Numer. Anal. 14
 * (1977), doi:10.1137/0714068). Each stage is solved by Newton's method for bends and other states; tensions are
 * functions of them: within a stage a guide holds its tendon where it was, or lets it slide at the capstan limit.
 */
#include <math.h>
#include <string.h>

#define N <<hinges>>    /* hinges */
#define NT <<tendons>>  /* tendons */
#define NP <<places>>   /* places that bear forces */
#define NX <<others>>   /* other states */
#define NU <<nu>>
#define NW <<nw>>
#define NALL (N + NX)
#define MOST (N + 1)            /* guides of a tendon at most, with that of a conduit */
#define OWN (7 + N + MOST + 1)  /* numbers that describe a tendon */
#define STATES (2 * N + NT * MOST + NX)
#define GAMMA 0.29289321881345254  /* 1 - 1/sqrt(2) */
#define NEWTON 60   /* evaluations of a stage, then its step is halved */
#define AGAINST 0.3 /* share of the work along a step that may turn against it at its end */
#define HALVINGS 6
#define FARTHEST 0.2  /* rad of a hinge per iteration */
#define ACCURACY 1e-9 /* rad of a hinge, and per unit of other states */
#define SAME 1e-14    /* m of a tendon's sliding: rounding of a path of centimeters */

typedef long long whole;

<<functions>>

typedef struct {
  const double *inertia, *stiffness, *rest, *damping, *weight, *length, *bar, *along, *tendon;
  double base[3], first, gravity[2];
} chain;

typedef struct {
  double b[N], v[N], a[N], x[NX + 1], rate[NX + 1];
  double tension[NT + 1][MOST + 1], slid[NT + 1][MOST];
  int flag[NT + 1][MOST];
} state;

static chain described(const double *given)
{
  chain c;
  memcpy(c.base, given, sizeof c.base);
  c.first = given[3];
  memcpy(c.gravity, given + 4, sizeof c.gravity);
  given += 6;
  c.inertia = given, given += N * N;
  c.stiffness = given, given += N;
  c.rest = given, given += N;
  c.damping = given, given += N;
  c.weight = given, given += N;
  c.length = given, given += N;
  c.bar = given, given += NP;
  c.along = given, given += NP;
  c.tendon = given;
  return c;
}

/* ---- tendons -------------------------------------------------------------------------------------------------------
 * Guides count from the drum: that of a conduit, if any, then those of the hinges. Piece q of the tendon ends at guide
 * q, the last at the tendon's end. With E the elongation of all pieces beyond a guide, tensions are differences of E per
 * compliance. A guide holds E where it was, but between the bounds at which the tensions on both sides are at the
 * capstan limit; each bound is a mean of the neighbors' E, so that the system has one solution (an M-matrix with two
 * obstacles), which policy iteration finds. */

typedef struct {
  int count, wound, first;
  double friction, conduit, taut;
  const double *arm, *give;
} tendon;

static tendon tendon_of(const chain *c, int j)
{
  const double *own = c->tendon + j * OWN;
  tendon t = {(int)own[0], (int)own[1], (int)own[2], own[3], own[4], own[5], own + 7, own + 7 + N};
  return t;
}

/* Path beyond each guide that bends draw in [m], and the bend at it; returns the whole path. */
static double paths(const tendon *t, const double *b, double *path, double *bend)
{
  double total = 0.0;
  for (int k = N - 1; k >= 0; --k) {
    const double own = t->arm[k] * b[k];
    const int q = k + t->first;
    if (q < t->count) path[q] = total + 0.5 * own, bend[q] = fabs(b[k]);
    total += own;
  }
  if (t->first) path[0] = total, bend[0] = t->conduit;
  return total;
}

static void slid_of(const tendon *t, const double *b, const double *tension, double *slid)
{
  double path[MOST], bend[MOST], elongated = 0.0;
  paths(t, b, path, bend);
  for (int q = t->count - 1; q >= 0; --q) {
    elongated += t->give[q + 1] * tension[q + 1];
    slid[q] = path[q] + elongated;
  }
}

/* Tensions of the pieces, and their slopes by the bends and by the drum (a tension, or a length wound up). */
static void pull(const tendon *t, const double *b, double drum, const double *memory, int *flag, double *tension,
                 double (*slope)[N + 1])
{
  const int count = t->count;
  double path[MOST], bend[MOST], held[MOST], limit[MOST], e[MOST + 1], ratio[MOST], pivot[MOST], upper[MOST], g[MOST];
  const double *give = t->give, total = paths(t, b, path, bend), begin = t->wound ? drum - total : drum;
  memset(tension, 0, (MOST + 1) * sizeof *tension);
  memset(slope, 0, (MOST + 1) * sizeof *slope);
  if (begin <= 0.0) {
    memset(flag, 0, MOST * sizeof *flag);
    return;
  }
  for (int q = 0; q < count; ++q) {
    held[q] = memory[q] - path[q], limit[q] = t->friction * bend[q];
    if (limit[q] == 0.0) flag[q] = 1;
  }
  e[count] = 0.0;
  for (int turn = 0; turn < 8 * MOST; ++turn) {
    double below = 0.0, above = 0.0;  /* of the elimination: e[q] = below + above e[q + 1] */
    for (int q = 0; q < count; ++q) {
      g[q] = exp(-flag[q] * limit[q]);
      if (flag[q] == 0) {
        pivot[q] = 1.0, ratio[q] = 0.0, upper[q] = 0.0, e[q] = held[q];
      } else if (q == 0 && !t->wound) {
        pivot[q] = 1.0, ratio[q] = 0.0, upper[q] = 1.0, e[q] = give[1] * g[0] * drum;
      } else {
        ratio[q] = g[q] * give[q + 1] / give[q];
        const double by = q ? above : 0.0, from = q ? below : begin;
        pivot[q] = 1.0 / (1.0 + ratio[q] * (1.0 - by));
        upper[q] = pivot[q], e[q] = pivot[q] * ratio[q] * from;
      }
      below = e[q], above = upper[q];
    }
    for (int q = count - 1; q >= 0; --q) e[q] += upper[q] * e[q + 1];
    double worst = 0.0;
    int changes = 0, at = 0;
    int wanted[MOST];
    for (int q = 0; q < count; ++q) {
      wanted[q] = flag[q];
      if (limit[q] == 0.0) continue;
      double miss = 0.0;
      if (flag[q] == 0) {
        double low, high;
        if (q == 0 && !t->wound) {
          low = e[1] + give[1] * exp(-limit[0]) * drum, high = e[1] + give[1] * exp(limit[0]) * drum;
        } else {
          const double before = q ? e[q - 1] : begin, r = give[q + 1] / give[q];
          const double rl = r * exp(-limit[q]), rh = r * exp(limit[q]);
          low = (rl * before + e[q + 1]) / (1.0 + rl), high = (rh * before + e[q + 1]) / (1.0 + rh);
        }
        if (held[q] < low - SAME) wanted[q] = 1, miss = low - held[q];
        else if (held[q] > high + SAME) wanted[q] = -1, miss = held[q] - high;
      } else {
        miss = flag[q] * (held[q] - e[q]);
        if (miss > SAME) wanted[q] = 0;
        else miss = 0.0;
      }
      if (wanted[q] != flag[q]) {
        ++changes;
        if (miss > worst) worst = miss, at = q;
      }
    }
    if (!changes) break;
    if (turn < 2 * MOST) memcpy(flag, wanted, count * sizeof *flag);
    else flag[at] = wanted[at];  /* one at a time, which does not go in circles */
  }
  for (int q = 1; q <= count; ++q) tension[q] = (e[q - 1] - e[q]) / give[q];
  tension[0] = t->wound ? (begin - e[0]) / give[0] : drum;
  /* Slopes: one solution with the same pivots per bend, and one for the drum. */
  for (int k = 0; k <= N; ++k) {
    double d[MOST + 1];
    const double arm = k < N ? t->arm[k] : 0.0, way = k < N ? (b[k] < 0.0 ? -1.0 : 1.0) : 0.0;
    const int own = k + t->first;
    d[count] = 0.0;
    for (int q = 0; q < count; ++q) {
      double right = 0.0;
      if (flag[q] == 0) {
        if (k < N) right = q < own ? -arm : q == own ? -0.5 * arm : 0.0;
        d[q] = right;
        continue;
      }
      if (k < N && q == own && limit[q] > 0.0)
        right = -flag[q] * t->friction * way * g[q] * give[q + 1] * tension[q];
      if (q == 0 && !t->wound) {
        if (k == N) right = give[1] * g[0];
        d[q] = right;
        continue;
      }
      if (q == 0) right += ratio[0] * (k == N ? 1.0 : -arm);
      d[q] = pivot[q] * (right + (q ? ratio[q] * d[q - 1] : 0.0));
    }
    for (int q = count - 1; q >= 0; --q) d[q] += upper[q] * d[q + 1];
    for (int q = 1; q <= count; ++q) slope[q][k] = (d[q - 1] - d[q]) / give[q];
    slope[0][k] = t->wound ? ((k == N ? 1.0 : -arm) - d[0]) / give[0] : k == N ? 1.0 : 0.0;
  }
}

/* ---- a stage ---------------------------------------------------------------------------------------------------- */

static int solve(double (*m)[NALL], double *r)
{
  for (int k = 0; k < NALL; ++k) {
    int at = k;
    for (int i = k + 1; i < NALL; ++i)
      if (fabs(m[i][k]) > fabs(m[at][k])) at = i;
    if (!(fabs(m[at][k]) > 0.0)) return 0;
    if (at != k) {
      for (int j = k; j < NALL; ++j) {
        const double other = m[k][j];
        m[k][j] = m[at][j], m[at][j] = other;
      }
      const double other = r[k];
      r[k] = r[at], r[at] = other;
    }
    const double inverse = 1.0 / m[k][k];
    for (int i = k + 1; i < NALL; ++i) {
      const double factor = m[i][k] * inverse;
      if (factor == 0.0) continue;
      for (int j = k + 1; j < NALL; ++j) m[i][j] -= factor * m[k][j];
      r[i] -= factor * r[k];
    }
  }
  for (int k = NALL - 1; k >= 0; --k) {
    for (int j = k + 1; j < NALL; ++j) r[k] -= m[k][j] * r[j];
    r[k] /= m[k][k];
  }
  return 1;
}

#define IN (6 * NP + NT + NX)  /* arguments of what surrounds the chain: places, tensions, other states */
#define OUT (3 * NP + NX)      /* its results: forces on the places, rates of the other states */

/* One stage: bends and other states such that their rates over ``part`` [s] since ``from`` are what acts. */
static int stage(const chain *c, double part, const state *from, state *to, const double *u, const double *w,
                 const double *p)
{
  static double matrix[NALL][NALL], turned[N][N], by_angle[OUT][N], slopes[OUT * IN + 1];
  static double by[NT + 1][MOST + 1][N + 1], motion[NP + 1][6][N];
  double right[NALL], values[OUT + 1], drums[NT + 1], drum_slopes[NT * NX + 1], places[6 * NP + 1];
  double angle[N + 1], spin[N], turn[N], cs[N + 1], sn[N + 1];
  const double inverse = 1.0 / part;
  double memory[NT + 1][MOST];
  /* Where a step leads from, its direction, work along it and share: what slides one way before and the other way after
   * has passed where it sticks, which is found between. */
  double before[NALL], way[NALL] = {0.0}, work_along = -1.0, share = 1.0;
  memcpy(memory, from->slid, sizeof memory);
  for (int iteration = 0; iteration < NEWTON; ++iteration) {
    double theta = c->base[2], omega = 0.0, alpha = 0.0;
    for (int i = 0; i < N; ++i) {
      to->v[i] = (to->b[i] - from->b[i]) * inverse;
      to->a[i] = (to->v[i] - from->v[i]) * inverse;
      angle[i] = theta += to->b[i], spin[i] = omega += to->v[i], turn[i] = alpha += to->a[i];
      cs[i] = cos(theta), sn[i] = sin(theta);
    }
    /* Places: a point of a bar, its velocity, angle and spin, with their slopes by the angles of the bars. */
    memset(motion, 0, sizeof motion);
    for (int k = 0; k < NP; ++k) {
      const int bar = (int)c->bar[k];
      const double start = bar < 0 ? c->along[k] : c->first;
      double *own = places + 6 * k;
      own[0] = c->base[0] - start * sin(c->base[2]), own[1] = c->base[1] + start * cos(c->base[2]);
      own[2] = own[3] = own[5] = 0.0, own[4] = c->base[2];
      for (int i = 0; i <= bar; ++i) {
        const double l = i < bar ? c->length[i] : c->along[k], x = -l * sn[i], y = l * cs[i];
        own[0] += x, own[1] += y;
        own[2] += -y * spin[i], own[3] += x * spin[i];
        motion[k][0][i] = -y, motion[k][1][i] = x;
        motion[k][2][i] = -x * spin[i] - y * inverse, motion[k][3][i] = -y * spin[i] + x * inverse;
      }
      if (bar >= 0) own[4] = angle[bar], own[5] = spin[bar], motion[k][4][bar] = 1.0, motion[k][5][bar] = inverse;
    }
    {
      const double *arg[drums_SZ_ARG] = {to->x, u};
      double *res[drums_SZ_RES] = {drums, drum_slopes}, work[drums_SZ_W];
      whole integers[drums_SZ_IW];
      drums_of(arg, res, integers, work, 0);
    }
    double tensions[NT + 1];
    for (int j = 0; j < NT; ++j) {
      const tendon t = tendon_of(c, j);
      pull(&t, to->b, drums[j], memory[j], to->flag[j], to->tension[j], by[j]);
      tensions[j] = to->tension[j][0];
    }
    {
      const double *arg[around_SZ_ARG] = {places, tensions, to->x, u, w, p};
      double *res[around_SZ_RES] = {values, slopes}, work[around_SZ_W];
      whole integers[around_SZ_IW];
      around(arg, res, integers, work, 0);
    }
    /* Inertia, weight and forces by the angles of the bars. */
    double force[N];
    for (int i = 0; i < N; ++i) {
      const double *weights = c->inertia + N * i, away = c->gravity[0] * -cs[i] + c->gravity[1] * -sn[i];
      double sum = -c->weight[i] * away, own = c->weight[i] * (c->gravity[0] * -sn[i] + c->gravity[1] * cs[i]);
      for (int k = 0; k < N; ++k) {
        const double even = weights[k] * (cs[i] * cs[k] + sn[i] * sn[k]), odd = weights[k] * (sn[i] * cs[k] - cs[i] * sn[k]);
        sum += even * turn[k] + odd * spin[k] * spin[k];
        own += even * spin[k] * spin[k] - odd * turn[k];
        turned[i][k] = odd * turn[k] - even * spin[k] * spin[k] + even * inverse * inverse + 2.0 * odd * spin[k] * inverse;
      }
      turned[i][i] += own;
      force[i] = sum;
    }
    for (int k = 0; k < NP; ++k) {
      const int bar = (int)c->bar[k];
      const double *f = values + 3 * k;
      for (int i = 0; i <= bar; ++i) {
        const double x = motion[k][0][i], y = motion[k][1][i];
        force[i] -= f[0] * x + f[1] * y;
        turned[i][i] -= f[0] * -y + f[1] * x;
      }
      if (bar >= 0) force[bar] -= f[2];
    }
    /* Slopes of forces and rates by the angles: through the motion of the places. */
    for (int r = 0; r < OUT; ++r) {
      double *row = by_angle[r];
      memset(row, 0, sizeof by_angle[r]);
      for (int k = 0; k < 6 * NP; ++k) {
        const double s = slopes[r + OUT * k];
        if (s == 0.0) continue;
        const double *m = motion[k / 6][k % 6];
        for (int i = 0; i < N; ++i) row[i] += s * m[i];
      }
    }
    memset(matrix, 0, sizeof matrix);
    for (int k = 0; k < NP; ++k) {
      const int bar = (int)c->bar[k];
      for (int i = 0; i <= bar; ++i) {
        for (int r = 0; r < 3; ++r) {
          const double part_of = r < 2 ? motion[k][r][i] : i == bar ? 1.0 : 0.0;
          if (part_of == 0.0) continue;
          const double *row = by_angle[3 * k + r];
          for (int j = 0; j < N; ++j) turned[i][j] -= part_of * row[j];
          for (int j = 0; j < NX; ++j) matrix[i][N + j] -= part_of * slopes[3 * k + r + OUT * (6 * NP + NT + j)];
        }
      }
    }
    /* From angles to bends: a bend turns all bars beyond it. */
    for (int i = 0; i < N; ++i)
      for (int j = N - 2; j >= 0; --j) turned[i][j] += turned[i][j + 1];
    for (int i = N - 2; i >= 0; --i) {
      force[i] += force[i + 1];
      for (int j = 0; j < N; ++j) turned[i][j] += turned[i + 1][j];
      for (int j = 0; j < NX; ++j) matrix[i][N + j] += matrix[i + 1][N + j];
    }
    for (int i = 0; i < N; ++i) {
      right[i] = -(force[i] + c->stiffness[i] * (to->b[i] - c->rest[i]) + c->damping[i] * to->v[i]);
      memcpy(matrix[i], turned[i], sizeof turned[i]);
      matrix[i][i] += c->stiffness[i] + c->damping[i] * inverse;
    }
    for (int r = 0; r < NX; ++r) {
      double *row = matrix[N + r], *own = by_angle[3 * NP + r];
      for (int j = N - 2; j >= 0; --j) own[j] += own[j + 1];
      to->rate[r] = values[3 * NP + r];
      right[N + r] = -(to->x[r] - from->x[r] - part * to->rate[r]);
      for (int j = 0; j < N; ++j) row[j] = -part * own[j];
      for (int j = 0; j < NX; ++j) row[N + j] = -part * slopes[3 * NP + r + OUT * (6 * NP + NT + j)];
      row[N + r] += 1.0;
    }
    for (int j = 0; j < NT; ++j) {
      const tendon t = tendon_of(c, j);
      for (int k = 0; k < N; ++k) {
        const int q = k + t.first;
        if (q >= t.count) continue;
        /* The mean of both sides does exactly the work that the sliding leaves. */
        const double half = 0.5 * t.arm[k];
        right[k] += half * (to->tension[j][q] + to->tension[j][q + 1]);
        for (int i = 0; i < N; ++i) matrix[k][i] -= half * (by[j][q][i] + by[j][q + 1][i]);
        const double by_drum = half * (by[j][q][N] + by[j][q + 1][N]);
        for (int i = 0; i < NX; ++i) matrix[k][N + i] -= by_drum * drum_slopes[j + NT * i];
      }
      for (int r = 0; r < NX; ++r) {
        const double felt = part * slopes[3 * NP + r + OUT * (6 * NP + j)];
        if (felt == 0.0) continue;
        for (int i = 0; i < N; ++i) matrix[N + r][i] -= felt * by[j][0][i];
        for (int i = 0; i < NX; ++i) matrix[N + r][N + i] -= felt * by[j][0][N] * drum_slopes[j + NT * i];
      }
    }
    double along = 0.0;
    for (int i = 0; i < N; ++i) along += right[i] * way[i];
    if (work_along > 0.0 && along < -AGAINST * work_along) {
      share *= fmin(fmax(work_along / (work_along - along), 0.1), 0.8);
      for (int i = 0; i < N; ++i) to->b[i] = before[i] + share * way[i];
      for (int r = 0; r < NX; ++r) to->x[r] = before[N + r] + share * way[N + r];
      continue;
    }
    memcpy(way, right, sizeof way);
    if (!solve(matrix, way)) return 0;
    double bent = 0.0, moved = 0.0;
    work_along = 0.0;
    for (int i = 0; i < N; ++i) bent = fmax(bent, fabs(way[i])), work_along += right[i] * way[i];
    for (int r = 0; r < NX; ++r) moved = fmax(moved, fabs(way[N + r]) / (1.0 + fabs(to->x[r])));
    if (!(bent < 1e6 && moved < 1e12)) return 0;
    share = bent > FARTHEST ? FARTHEST / bent : 1.0;
    memcpy(before, to->b, sizeof to->b);
    memcpy(before + N, to->x, NX * sizeof(double));
    for (int i = 0; i < N; ++i) to->b[i] += share * way[i];
    for (int r = 0; r < NX; ++r) to->x[r] += share * way[N + r];
    if (bent < ACCURACY && moved < ACCURACY) {
      for (int i = 0; i < N; ++i) {
        to->v[i] = (to->b[i] - from->b[i]) * inverse;
        to->a[i] = (to->v[i] - from->v[i]) * inverse;
      }
      for (int r = 0; r < NX; ++r) to->rate[r] = (to->x[r] - from->x[r]) * inverse;
      for (int j = 0; j < NT; ++j) {
        const tendon t = tendon_of(c, j);
        slid_of(&t, to->b, to->tension[j], to->slid[j]);
      }
      return 1;
    }
  }
  return 0;
}

static int advance(const chain *c, double h, state *s, const double *u, const double *w0, const double *w1,
                   const double *p, int depth)
{
  const double part = GAMMA * h, rest = (1.0 - GAMMA) * h;
  double w[NW + 1];
  state first = *s, from = *s, second;
  for (int k = 0; k < NW; ++k) w[k] = w0[k] + GAMMA * (w1[k] - w0[k]);
  for (int i = 0; i < N; ++i) first.b[i] += part * s->v[i];
  int solved = stage(c, part, s, &first, u, w, p);
  if (solved) {
    second = first;
    memcpy(from.slid, first.slid, sizeof from.slid);
    for (int i = 0; i < N; ++i) {
      from.b[i] = s->b[i] + rest * first.v[i];
      from.v[i] = s->v[i] + rest * first.a[i];
      second.b[i] = first.b[i] + rest * first.v[i];
    }
    for (int r = 0; r < NX; ++r) {
      from.x[r] = s->x[r] + rest * first.rate[r];
      second.x[r] = first.x[r] + rest * first.rate[r];
    }
    solved = stage(c, part, &from, &second, u, w1, p);
  }
  if (solved) {
    *s = second;
    return 1;
  }
  if (depth == 0) return 0;
  for (int k = 0; k < NW; ++k) w[k] = w0[k] + 0.5 * (w1[k] - w0[k]);
  return advance(c, 0.5 * h, s, u, w0, w, p, depth - 1) && advance(c, 0.5 * h, s, u, w, w1, p, depth - 1);
}

/* Rows of states after each of some steps, from the first on; w has a row per step and one more, or is always the same.
 * Returns the number of steps that were solved. */
whole chain_steps(whole steps, double h, const double *given, const double *u, const double *w, whole stride,
                  const double *p, double *states)
{
  const chain c = described(given);
  state s;
  memset(&s, 0, sizeof s);
  memcpy(s.b, states, sizeof s.b);
  memcpy(s.v, states + N, sizeof s.v);
  for (int j = 0; j < NT; ++j) {
    const tendon t = tendon_of(&c, j);
    memcpy(s.tension[j] + 1, states + 2 * N + j * MOST, MOST * sizeof(double));
    slid_of(&t, s.b, s.tension[j], s.slid[j]);
  }
  memcpy(s.x, states + 2 * N + NT * MOST, NX * sizeof(double));
  for (whole k = 0; k < steps; ++k) {
    if (!advance(&c, h, &s, u, w + k * stride, w + (k + 1) * stride, p, HALVINGS)) return k;
    double *row = states + (k + 1) * STATES;
    memcpy(row, s.b, sizeof s.b);
    memcpy(row + N, s.v, sizeof s.v);
    for (int j = 0; j < NT; ++j) memcpy(row + 2 * N + j * MOST, s.tension[j] + 1, MOST * sizeof(double));
    memcpy(row + 2 * N + NT * MOST, s.x, NX * sizeof(double));
  }
  return steps;
}
