/* Chains of hinges with a guide of the tendons at each, one per finger, in steps that are implicit in everything. Fingers
 * act on each other through the other states alone: what each touches is there.
 *
 * Time: the two-stage diagonally implicit method of order 2 that is L-stable (R. Alexander, SIAM J. Numer. Anal. 14
 * (1977), doi:10.1137/0714068). Each stage is solved by Newton's method for bends and other states; tensions are
 * functions of them: within a stage a guide holds its tendon where it was, or lets it slide at the capstan limit.
 */
#include <math.h>
#include <string.h>

#define NF <<fingers>>  /* fingers */
#define N <<hinges>>    /* hinges of each */
#define NB (NF * N)     /* hinges of all */
#define NT <<tendons>>  /* tendons of all */
#define NP <<places>>   /* places of all that bear forces */
#define NX <<others>>   /* other states */
#define NU <<nu>>
#define NW <<nw>>
#define NALL (NB + NX)
#define MOST (N + 1)            /* guides of a tendon at most, with that of a conduit */
#define OWN (7 + N + MOST + 1)  /* numbers that describe a tendon */
#define STATES (2 * NB + NT * MOST + NX)
#define GAMMA 0.29289321881345254  /* 1 - 1/sqrt(2) */
#define NEWTON 60   /* evaluations of a stage, then its step is halved */
#define AGAINST 0.3 /* share of the work along a step that may turn against it at its end */
#define HALVINGS 6
#define FARTHEST 0.2  /* rad of a hinge per iteration */
#define ACCURACY 1e-9 /* rad of a hinge, and per unit of other states */
#define LOOSE 1e-6    /* of a gear's stiffness, by which a drum in its play stays where no tendon pulls */
#define GEAR_STEPS 60 /* that find where the drum of a gear is */
#define SAME 1e-14    /* m of a tendon's sliding: rounding of a path of centimeters */

typedef long long whole;

<<functions>>

static const int TENDONS[NF] = {<<tendons_of>>}, PLACES[NF] = {<<places_of>>};

typedef struct {
  const double *inertia, *stiffness, *rest, *damping, *weight, *length;
  double base[3], first, gravity[2];
} bars;

/* Of places and tendons ``of_place`` and ``of_tendon`` are the fingers. */
typedef struct {
  bars finger[NF];
  const double *tendon[NT];
  double along[NP];
  int bar[NP], of_place[NP], of_tendon[NT];
} chains;

typedef struct {
  double b[NB], v[NB], a[NB], x[NX + 1], rate[NX + 1];
  double tension[NT + 1][MOST + 1], slid[NT + 1][MOST];
  int flag[NT + 1][MOST];
} state;

static void described(const double *given, chains *all)
{
  for (int f = 0, place = 0, cord = 0; f < NF; ++f) {
    bars *c = all->finger + f;
    memcpy(c->base, given, sizeof c->base);
    c->first = given[3];
    memcpy(c->gravity, given + 4, sizeof c->gravity);
    given += 6;
    c->inertia = given, given += N * N;
    c->stiffness = given, given += N;
    c->rest = given, given += N;
    c->damping = given, given += N;
    c->weight = given, given += N;
    c->length = given, given += N;
    for (int k = 0; k < PLACES[f]; ++k, ++place) {
      all->bar[place] = (int)given[k], all->along[place] = given[PLACES[f] + k], all->of_place[place] = f;
    }
    given += 2 * PLACES[f];
    for (int k = 0; k < TENDONS[f]; ++k, ++cord, given += OWN) all->tendon[cord] = given, all->of_tendon[cord] = f;
  }
}

/* ---- tendons -------------------------------------------------------------------------------------------------------
 * Guides count from the drum: that of a conduit, if any, then those of the hinges. Piece q of the tendon ends at guide
 * q, the last at the tendon's end. With E the elongation of all pieces beyond a guide, tensions are differences of E per
 * compliance. A guide holds E where it was, but between the bounds at which the tensions on both sides are at the
 * capstan limit; each bound is a mean of the neighbors' E, so that the system has one solution (an M-matrix with two
 * obstacles), which policy iteration finds. */

typedef struct {
  int count, wound, first;
  double friction, conduit, gear, play;  /* stiffness and half the play of a gear before a pulley, in cable */
  const double *arm, *give;
} tendon;

static tendon tendon_of(const chains *all, int j)
{
  const double *own = all->tendon[j];
  tendon t = {(int)own[0], (int)own[1], (int)own[2], own[3], own[4], own[5], own[6], own + 7, own + 7 + N};
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

/* Tensions of the two tendons of a pulley behind a gear that yields and has a play: its drum, without inertia, falls
 * behind the motor by z of cable, the root of gear (z - clip(z)) = T1(y1 - z) - T2(y2 + z). Slopes are then those at a
 * motor that stays, and ``drum_slopes`` those of what is wound up at the drum by the other states. */
static void pull_geared(const tendon *t, const double *b, const double *drums, double (*memory)[MOST],
                        int (*flag)[MOST], double (*tension)[MOST + 1], double (*by)[MOST + 1][N + 1],
                        double *drum_slopes)
{
  double z = 0.0, low = -HUGE_VAL, high = HUGE_VAL, stiff = 1.0;
  for (int turn = 0; turn < GEAR_STEPS; ++turn) {
    pull(t, b, drums[0] - z, memory[0], flag[0], tension[0], by[0]);
    pull(t + 1, b, drums[1] + z, memory[1], flag[1], tension[1], by[1]);
    const double within = fmin(fmax(z, -t->play), t->play);
    const double missing = t->gear * (z - within) - tension[0][0] + tension[1][0];
    stiff = (z != within ? 1.0 : LOOSE) * t->gear + by[0][0][N] + by[1][0][N];
    if (missing > 0.0) high = z;
    else low = z;
    const double step = missing / stiff;
    if (fabs(step) <= SAME) break;
    z = z - step > low && z - step < high ? z - step : 0.5 * (low + high);
  }
  double moved[N + NX + 1];
  for (int i = 0; i < N; ++i) moved[i] = (by[0][0][i] - by[1][0][i]) / stiff;
  for (int i = 0; i < NX; ++i) {
    const double behind = (by[0][0][N] * drum_slopes[NT * i] - by[1][0][N] * drum_slopes[1 + NT * i]) / stiff;
    drum_slopes[NT * i] -= behind, drum_slopes[1 + NT * i] += behind;
  }
  for (int q = 0; q <= MOST; ++q)
    for (int i = 0; i < N; ++i) by[0][q][i] -= by[0][q][N] * moved[i], by[1][q][i] += by[1][q][N] * moved[i];
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
static int stage(const chains *all, double part, const state *from, state *to, const double *u, const double *w,
                 const double *p)
{
  static double matrix[NALL][NALL], turned[NB][N], by_angle[OUT][NB], slopes[OUT * IN + 1];
  static double by[NT + 1][MOST + 1][N + 1], motion[NP + 1][6][N];
  double right[NALL], values[OUT + 1], drums[NT + 1], drum_slopes[NT * NX + 1], places[6 * NP + 1];
  double angle[NB], spin[NB], turn[NB], cs[NB], sn[NB];
  const double inverse = 1.0 / part;
  double memory[NT + 1][MOST];
  /* Where a step leads from, its direction, work along it and share: what slides one way before and the other way after
   * has passed where it sticks, which is found between. */
  double before[NALL], way[NALL] = {0.0}, work_along = -1.0, share = 1.0;
  memcpy(memory, from->slid, sizeof memory);
  for (int iteration = 0; iteration < NEWTON; ++iteration) {
    double theta = 0.0, omega = 0.0, alpha = 0.0;
    for (int i = 0; i < NB; ++i) {
      if (i % N == 0) theta = all->finger[i / N].base[2], omega = alpha = 0.0;
      to->v[i] = (to->b[i] - from->b[i]) * inverse;
      to->a[i] = (to->v[i] - from->v[i]) * inverse;
      angle[i] = theta += to->b[i], spin[i] = omega += to->v[i], turn[i] = alpha += to->a[i];
      cs[i] = cos(theta), sn[i] = sin(theta);
    }
    /* Places: a point of a bar, its velocity, angle and spin, with their slopes by the angles of the bars. */
    memset(motion, 0, sizeof motion);
    for (int k = 0; k < NP; ++k) {
      const bars *c = all->finger + all->of_place[k];
      const int bar = all->bar[k], at = N * all->of_place[k];
      const double start = bar < 0 ? all->along[k] : c->first;
      double *own = places + 6 * k;
      own[0] = c->base[0] - start * sin(c->base[2]), own[1] = c->base[1] + start * cos(c->base[2]);
      own[2] = own[3] = own[5] = 0.0, own[4] = c->base[2];
      for (int i = 0; i <= bar; ++i) {
        const double l = i < bar ? c->length[i] : all->along[k], x = -l * sn[at + i], y = l * cs[at + i];
        own[0] += x, own[1] += y;
        own[2] += -y * spin[at + i], own[3] += x * spin[at + i];
        motion[k][0][i] = -y, motion[k][1][i] = x;
        motion[k][2][i] = -x * spin[at + i] - y * inverse, motion[k][3][i] = -y * spin[at + i] + x * inverse;
      }
      if (bar >= 0) own[4] = angle[at + bar], own[5] = spin[at + bar], motion[k][4][bar] = 1.0, motion[k][5][bar] = inverse;
    }
    {
      const double *arg[drums_SZ_ARG] = {to->x, u};
      double *res[drums_SZ_RES] = {drums, drum_slopes}, work[drums_SZ_W];
      whole integers[drums_SZ_IW];
      cg_function_drums_of(arg, res, integers, work, 0);
    }
    double tensions[NT + 1];
    for (int j = 0; j < NT; ++j) {
      const tendon t = tendon_of(all, j);
      const double *b = to->b + N * all->of_tendon[j];
      if (t.gear > 0.0) {
        const tendon both[2] = {t, tendon_of(all, j + 1)};
        pull_geared(both, b, drums + j, memory + j, to->flag + j, to->tension + j, by + j, drum_slopes + j);
        tensions[j] = to->tension[j][0];
        ++j;
      } else {
        pull(&t, b, drums[j], memory[j], to->flag[j], to->tension[j], by[j]);
      }
      tensions[j] = to->tension[j][0];
    }
    {
      const double *arg[around_SZ_ARG] = {places, tensions, to->x, u, w, p};
      double *res[around_SZ_RES] = {values, slopes}, work[around_SZ_W];
      whole integers[around_SZ_IW];
      cg_function_around(arg, res, integers, work, 0);
    }
    /* Inertia, weight and forces by the angles of the bars. */
    double force[NB];
    for (int i = 0; i < NB; ++i) {
      const bars *c = all->finger + i / N;
      const int at = i - i % N, own_bar = i % N;
      const double *weights = c->inertia + N * own_bar, away = c->gravity[0] * -cs[i] + c->gravity[1] * -sn[i];
      double sum = -c->weight[own_bar] * away;
      double own = c->weight[own_bar] * (c->gravity[0] * -sn[i] + c->gravity[1] * cs[i]);
      for (int j = 0; j < N; ++j) {
        const int k = at + j;
        const double even = weights[j] * (cs[i] * cs[k] + sn[i] * sn[k]), odd = weights[j] * (sn[i] * cs[k] - cs[i] * sn[k]);
        sum += even * turn[k] + odd * spin[k] * spin[k];
        own += even * spin[k] * spin[k] - odd * turn[k];
        turned[i][j] = odd * turn[k] - even * spin[k] * spin[k] + even * inverse * inverse + 2.0 * odd * spin[k] * inverse;
      }
      turned[i][own_bar] += own;
      force[i] = sum;
    }
    for (int k = 0; k < NP; ++k) {
      const int bar = all->bar[k], at = N * all->of_place[k];
      const double *f = values + 3 * k;
      for (int i = 0; i <= bar; ++i) {
        const double x = motion[k][0][i], y = motion[k][1][i];
        force[at + i] -= f[0] * x + f[1] * y;
        turned[at + i][i] -= f[0] * -y + f[1] * x;
      }
      if (bar >= 0) force[at + bar] -= f[2];
    }
    /* Slopes of forces and rates by the angles: through the motion of the places. */
    for (int r = 0; r < OUT; ++r) {
      memset(by_angle[r], 0, sizeof by_angle[r]);
      for (int k = 0; k < 6 * NP; ++k) {
        const double s = slopes[r + OUT * k];
        if (s == 0.0) continue;
        const double *m = motion[k / 6][k % 6];
        double *row = by_angle[r] + N * all->of_place[k / 6];
        for (int i = 0; i < N; ++i) row[i] += s * m[i];
      }
    }
    memset(matrix, 0, sizeof matrix);
    for (int k = 0; k < NP; ++k) {
      const int bar = all->bar[k], at = N * all->of_place[k];
      for (int i = 0; i <= bar; ++i) {
        for (int r = 0; r < 3; ++r) {
          const double part_of = r < 2 ? motion[k][r][i] : i == bar ? 1.0 : 0.0;
          if (part_of == 0.0) continue;
          /* Forces on a finger are functions of its own places and of the other states. */
          const double *row = by_angle[3 * k + r] + at;
          for (int j = 0; j < N; ++j) turned[at + i][j] -= part_of * row[j];
          for (int j = 0; j < NX; ++j) matrix[at + i][NB + j] -= part_of * slopes[3 * k + r + OUT * (6 * NP + NT + j)];
        }
      }
    }
    /* From angles to bends: a bend turns all bars beyond it. */
    for (int i = 0; i < NB; ++i)
      for (int j = N - 2; j >= 0; --j) turned[i][j] += turned[i][j + 1];
    for (int i = NB - 2; i >= 0; --i) {
      if (i % N == N - 1) continue;  /* the last bar of a finger */
      force[i] += force[i + 1];
      for (int j = 0; j < N; ++j) turned[i][j] += turned[i + 1][j];
      for (int j = 0; j < NX; ++j) matrix[i][NB + j] += matrix[i + 1][NB + j];
    }
    for (int i = 0; i < NB; ++i) {
      const bars *c = all->finger + i / N;
      const int k = i % N;
      right[i] = -(force[i] + c->stiffness[k] * (to->b[i] - c->rest[k]) + c->damping[k] * to->v[i]);
      memcpy(matrix[i] + (i - k), turned[i], sizeof turned[i]);
      matrix[i][i] += c->stiffness[k] + c->damping[k] * inverse;
    }
    for (int r = 0; r < NX; ++r) {
      double *row = matrix[NB + r], *own = by_angle[3 * NP + r];
      for (int j = NB - 2; j >= 0; --j)
        if (j % N != N - 1) own[j] += own[j + 1];
      to->rate[r] = values[3 * NP + r];
      right[NB + r] = -(to->x[r] - from->x[r] - part * to->rate[r]);
      for (int j = 0; j < NB; ++j) row[j] = -part * own[j];
      for (int j = 0; j < NX; ++j) row[NB + j] = -part * slopes[3 * NP + r + OUT * (6 * NP + NT + j)];
      row[NB + r] += 1.0;
    }
    for (int j = 0; j < NT; ++j) {
      const tendon t = tendon_of(all, j);
      const int at = N * all->of_tendon[j];
      for (int k = 0; k < N; ++k) {
        const int q = k + t.first;
        if (q >= t.count) continue;
        /* The mean of both sides does exactly the work that the sliding leaves. */
        const double half = 0.5 * t.arm[k];
        right[at + k] += half * (to->tension[j][q] + to->tension[j][q + 1]);
        for (int i = 0; i < N; ++i) matrix[at + k][at + i] -= half * (by[j][q][i] + by[j][q + 1][i]);
        const double by_drum = half * (by[j][q][N] + by[j][q + 1][N]);
        for (int i = 0; i < NX; ++i) matrix[at + k][NB + i] -= by_drum * drum_slopes[j + NT * i];
      }
      for (int r = 0; r < NX; ++r) {
        const double felt = part * slopes[3 * NP + r + OUT * (6 * NP + j)];
        if (felt == 0.0) continue;
        for (int i = 0; i < N; ++i) matrix[NB + r][at + i] -= felt * by[j][0][i];
        for (int i = 0; i < NX; ++i) matrix[NB + r][NB + i] -= felt * by[j][0][N] * drum_slopes[j + NT * i];
      }
    }
    double along = 0.0;
    for (int i = 0; i < NB; ++i) along += right[i] * way[i];
    if (work_along > 0.0 && along < -AGAINST * work_along) {
      share *= fmin(fmax(work_along / (work_along - along), 0.1), 0.8);
      for (int i = 0; i < NB; ++i) to->b[i] = before[i] + share * way[i];
      for (int r = 0; r < NX; ++r) to->x[r] = before[NB + r] + share * way[NB + r];
      continue;
    }
    memcpy(way, right, sizeof way);
    if (!solve(matrix, way)) return 0;
    double bent = 0.0, moved = 0.0;
    work_along = 0.0;
    for (int i = 0; i < NB; ++i) bent = fmax(bent, fabs(way[i])), work_along += right[i] * way[i];
    for (int r = 0; r < NX; ++r) moved = fmax(moved, fabs(way[NB + r]) / (1.0 + fabs(to->x[r])));
    if (!(bent < 1e6 && moved < 1e12)) return 0;
    if (bent < ACCURACY) work_along = 0.0;  /* rounding, of bends that a motor in its play does not move */
    share = bent > FARTHEST ? FARTHEST / bent : 1.0;
    memcpy(before, to->b, sizeof to->b);
    memcpy(before + NB, to->x, NX * sizeof(double));
    for (int i = 0; i < NB; ++i) to->b[i] += share * way[i];
    for (int r = 0; r < NX; ++r) to->x[r] += share * way[NB + r];
    if (bent < ACCURACY && moved < ACCURACY) {
      for (int i = 0; i < NB; ++i) {
        to->v[i] = (to->b[i] - from->b[i]) * inverse;
        to->a[i] = (to->v[i] - from->v[i]) * inverse;
      }
      for (int r = 0; r < NX; ++r) to->rate[r] = (to->x[r] - from->x[r]) * inverse;
      for (int j = 0; j < NT; ++j) {
        const tendon t = tendon_of(all, j);
        slid_of(&t, to->b + N * all->of_tendon[j], to->tension[j], to->slid[j]);
      }
      return 1;
    }
  }
  return 0;
}

static int advance(const chains *all, double h, state *s, const double *u, const double *w0, const double *w1,
                   const double *p, int depth)
{
  const double part = GAMMA * h, rest = (1.0 - GAMMA) * h;
  double w[NW + 1];
  state first = *s, from = *s, second;
  for (int k = 0; k < NW; ++k) w[k] = w0[k] + GAMMA * (w1[k] - w0[k]);
  for (int i = 0; i < NB; ++i) first.b[i] += part * s->v[i];
  int solved = stage(all, part, s, &first, u, w, p);
  if (solved) {
    second = first;
    memcpy(from.slid, first.slid, sizeof from.slid);
    for (int i = 0; i < NB; ++i) {
      from.b[i] = s->b[i] + rest * first.v[i];
      from.v[i] = s->v[i] + rest * first.a[i];
      second.b[i] = first.b[i] + rest * first.v[i];
    }
    for (int r = 0; r < NX; ++r) {
      from.x[r] = s->x[r] + rest * first.rate[r];
      second.x[r] = first.x[r] + rest * first.rate[r];
    }
    solved = stage(all, part, &from, &second, u, w1, p);
  }
  if (solved) {
    *s = second;
    return 1;
  }
  if (depth == 0) return 0;
  for (int k = 0; k < NW; ++k) w[k] = w0[k] + 0.5 * (w1[k] - w0[k]);
  return advance(all, 0.5 * h, s, u, w0, w, p, depth - 1) && advance(all, 0.5 * h, s, u, w, w1, p, depth - 1);
}

/* Rows of states after each of some steps, from the first on; w has a row per step and one more, or is always the same.
 * Returns the number of steps that were solved. */
whole chain_steps(whole steps, double h, const double *given, const double *u, const double *w, whole stride,
                  const double *p, double *states)
{
  chains all;
  state s;
  described(given, &all);
  memset(&s, 0, sizeof s);
  memcpy(s.b, states, sizeof s.b);
  memcpy(s.v, states + NB, sizeof s.v);
  for (int j = 0; j < NT; ++j) {
    const tendon t = tendon_of(&all, j);
    memcpy(s.tension[j] + 1, states + 2 * NB + j * MOST, MOST * sizeof(double));
    slid_of(&t, s.b + N * all.of_tendon[j], s.tension[j], s.slid[j]);
  }
  memcpy(s.x, states + 2 * NB + NT * MOST, NX * sizeof(double));
  for (whole k = 0; k < steps; ++k) {
    if (!advance(&all, h, &s, u, w + k * stride, w + (k + 1) * stride, p, HALVINGS)) return k;
    double *row = states + (k + 1) * STATES;
    memcpy(row, s.b, sizeof s.b);
    memcpy(row + NB, s.v, sizeof s.v);
    for (int j = 0; j < NT; ++j) memcpy(row + 2 * NB + j * MOST, s.tension[j] + 1, MOST * sizeof(double));
    memcpy(row + 2 * NB + NT * MOST, s.x, NX * sizeof(double));
  }
  return steps;
}
