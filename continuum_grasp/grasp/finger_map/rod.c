/* Equilibria of a planar rod by integration from its base, with their derivatives by the numbers that fix them.

   Units: lengths L, forces E I / L^2, moments E I / L of the finger. Numbers z of an equilibrium: curvature at the base,
   internal force there (2), moment of the tendons at the base; per middle contact its place, normal force and friction.
   A dual number has a value, and slopes by each of these numbers; without slopes, values of `WIDE` rods at a time: a step
   waits for the one before, not for as many others beside it. `touching.c` and `balance.c`, which follow this file, export
   the functions that Python calls. */

#include <math.h>
#include <stdlib.h>
#include <string.h>

#ifndef LANES
#define LANES 8
#define WIDE 1
#endif

#if WIDE > 1
typedef double real __attribute__((vector_size(8 * WIDE)));
typedef long long whole __attribute__((vector_size(8 * WIDE)));
#define AT(a, k) (a)[k]
#define WHOLE(a) __builtin_convertvector(a, whole)
#define REAL(a) __builtin_convertvector(a, real)
#define MASK(test) (test)
#define CHOSEN(mask, a, b) ((real)(((whole)(a) & (mask)) | ((whole)(b) & ~(mask))))
#else
typedef double real;
typedef long long whole;
#define AT(a, k) (a)
#define WHOLE(a) ((whole)(a))
#define REAL(a) ((real)(a))
#define MASK(test) (-(whole)(test))
#define CHOSEN(mask, a, b) ((mask) ? (a) : (b))
#endif

/* Slopes: of rods side by side each in a register of its own; of one rod in registers of the machine's size, which compilers
   keep apart where they split longer vectors by memory. */
#ifdef __AVX512F__
#define FEW 8
#else
#define FEW 4
#endif
#if WIDE > 1
typedef real few;
#define PIECES LANES
#define SLOPE(a, k, lane) (((const real *)&(a).d)[k][lane])
#else
typedef double few __attribute__((vector_size(8 * FEW)));
#define PIECES (LANES / FEW)
#define SLOPE(a, k, lane) (((const double *)&(a).d)[k])
#endif
#if PIECES == 12
#define EACH(of) of(0) of(1) of(2) of(3) of(4) of(5) of(6) of(7) of(8) of(9) of(10) of(11)
typedef struct { few d0, d1, d2, d3, d4, d5, d6, d7, d8, d9, d10, d11; } slopes;
#elif PIECES == 8
#define EACH(of) of(0) of(1) of(2) of(3) of(4) of(5) of(6) of(7)
typedef struct { few d0, d1, d2, d3, d4, d5, d6, d7; } slopes;
#elif PIECES == 6
#define EACH(of) of(0) of(1) of(2) of(3) of(4) of(5)
typedef struct { few d0, d1, d2, d3, d4, d5; } slopes;
#elif PIECES == 4
#define EACH(of) of(0) of(1) of(2) of(3)
typedef struct { few d0, d1, d2, d3; } slopes;
#elif PIECES == 3
#define EACH(of) of(0) of(1) of(2)
typedef struct { few d0, d1, d2; } slopes;
#elif PIECES == 2
#define EACH(of) of(0) of(1)
typedef struct { few d0, d1; } slopes;
#elif PIECES == 1
#define EACH(of) of(0)
typedef struct { few d0; } slopes;
#else
#define EACH(of)
typedef struct { char none; } slopes;
#endif
typedef struct { real v; slopes d; } dual;

/* Most middle contacts, numbers, and nodes of a segment; a distance beyond all that matter, in lengths of the finger. */
enum { MOST_CONTACTS = 4, NUMBERS = 4 + 3 * MOST_CONTACTS, STEPS = 64 };
#define FAR 9.0
#define PI 3.14159265358979323846

/* Columns of the table along the rod. */
enum { STIFFNESS, REST, TENDON, HALF, WEIGHT, DEPTH, COLUMNS };

typedef struct {
    int steps, contacts, tip; /* tip: whether it touches */
    int nodes, masses, walls, pegs, width, height;
    double base[3], gravity[2], tip_load[2], tendon_friction;
    double pose[4], corner[2], per_cell; /* of the object: place, cosine and sine of its angle; of the table */
    double pulls[2], moment, strain, places[2], friction, force; /* limits */
    const double *table;    /* (nodes, COLUMNS) */
    const double *mass;     /* (masses, 3): place, weight x, y */
    const double *wall;     /* (walls, 4): normal, point */
    const double *peg;      /* (pegs, 3): center, radius */
    const double *distance; /* (height, width) from the object, in its frame */
} Rod;

typedef struct { dual s, x, y, angle, sine, cosine, moment, fx, fy, turned, bent; } State;
typedef struct { dual gap, nx, ny; } Place;

/* p a + q b */
static inline slopes sum_of(real p, slopes a, real q, slopes b)
{
    slopes sum = {0};
#define OF(k) sum.d##k = p * a.d##k + q * b.d##k;
    EACH(OF)
#undef OF
    return sum;
}

static inline slopes part_of(real p, slopes a)
{
    slopes part = {0};
#define OF(k) part.d##k = p * a.d##k;
    EACH(OF)
#undef OF
    return part;
}

static inline dual constant_of(real value) { return (dual){value}; }
static inline dual constant(double value) { return constant_of(value + (real){0}); }
static inline dual plus(dual a, dual b) { return (dual){a.v + b.v, sum_of((real){0} + 1.0, a.d, (real){0} + 1.0, b.d)}; }
static inline dual minus(dual a, dual b) { return (dual){a.v - b.v, sum_of((real){0} + 1.0, a.d, (real){0} - 1.0, b.d)}; }
static inline dual scaled(double factor, dual a) { return (dual){factor * a.v, part_of(factor + (real){0}, a.d)}; }
static inline dual times(dual a, dual b) { return (dual){a.v * b.v, sum_of(a.v, b.d, b.v, a.d)}; }
static inline dual by(real factor, dual a) { return (dual){factor * a.v, part_of(factor, a.d)}; }
static inline dual with(dual a, real value, real slope) { return (dual){value, part_of(slope, a.d)}; }

static inline dual over(dual a, dual b)
{
    const real inverse = 1.0 / b.v, q = a.v * inverse;
    return (dual){q, sum_of(inverse, a.d, -q * inverse, b.d)};
}

static inline real root(real a)
{
    for (int k = 0; k < WIDE; ++k)
        AT(a, k) = sqrt(AT(a, k));
    return a;
}

static inline dual length_of(dual a, dual b)
{
    const real size = root(a.v * a.v + b.v * b.v + 1e-30), inverse = 1.0 / size;
    return (dual){size, sum_of(a.v * inverse, a.d, b.v * inverse, b.d)};
}

/* The first where a mask is set, else the other. */
static inline dual chosen(whole mask, dual a, dual b)
{
#if WIDE > 1
    dual c = {CHOSEN(mask, a.v, b.v), {0}};
#define OF(k) c.d.d##k = CHOSEN(mask, a.d.d##k, b.d.d##k);
    EACH(OF)
#undef OF
    return c;
#else
    return mask ? a : b;
#endif
}

static inline real least_of(real a, real b) { return CHOSEN(MASK(a < b), a, b); }
static inline real most_of(real a, real b) { return CHOSEN(MASK(a > b), a, b); }
static inline real magnitude(real a) { return most_of(a, -a); }

static inline dual size_of(dual a)
{
    const real one = 1.0 + (real){0}, sign = CHOSEN(MASK(a.v < 0.0), -one, one);
    return with(a, sign * a.v, sign);
}

/* Sine and cosine, to rounding up to a hundred turns: polynomials of fdlibm up to an eighth of a turn. */
static inline void waves(real angle, real *sine, real *cosine)
{
    const whole n = WHOLE(angle * (2.0 / PI) + 1024.5); /* quarters of a turn */
    const real r = angle - (REAL(n) - 1024.0) * (0.5 * PI), q = r * r;
    const real s = r + r * q * (-1.66666666666666324348e-01 + q * (8.33333333332248946124e-03 +
        q * (-1.98412698298579493134e-04 + q * (2.75573137070700676789e-06 +
        q * (-2.50507602534068634195e-08 + q * 1.58969099521155010221e-10)))));
    const real c = 1.0 - 0.5 * q + q * q * (4.16666666666666019037e-02 + q * (-1.38888888888741095749e-03 +
        q * (2.48015872894767294178e-05 + q * (-2.75573143513906633035e-07 +
        q * (2.08757232129817482790e-09 + q * -1.13596475577881948265e-11)))));
    const real odd = REAL(n & 1), change = odd * (c - s);
    *sine = REAL(1 - (n & 2)) * (s + change), *cosine = REAL(1 - ((n + 1) & 2)) * (c - change);
}

/* A column of a table that has many rows at places, and its change per row there. */
static inline real between(const Rod *rod, int column, real s, real *change)
{
    real value = s;
    for (int k = 0; k < WIDE; ++k) {
        const double at = fmin(fmax(AT(s, k), 0.0), 1.0) * (rod->nodes - 1);
        const int cell = at < rod->nodes - 2 ? (int)at : rod->nodes - 2;
        const double *row = rod->table + COLUMNS * cell + column;
        AT(*change, k) = row[COLUMNS] - row[0], AT(value, k) = row[0] + (at - cell) * AT(*change, k);
    }
    return value;
}

/* A column of the table at a place. */
static inline dual along(const Rod *rod, int column, dual s)
{
    if (rod->nodes == 1)
        return constant(rod->table[column]);
    real change = s.v;
    const real value = between(rod, column, s.v, &change);
    return with(s, value, (rod->nodes - 1.0) * change);
}

static inline real slope_along(const Rod *rod, int column, real s)
{
    real change = {0};
    if (rod->nodes > 1)
        between(rod, column, s, &change);
    return (rod->nodes - 1.0) * change;
}

/* Where points are in the table of distances: places, those within the table, parts of the cell, how far beyond; the
   cells. */
typedef struct { real u, v, cu, cv, a, b, away; const double *at[WIDE]; } Cell;

static inline Cell cell_of(const Rod *rod, real x, real y)
{
    const real dx = x - rod->pose[0], dy = y - rod->pose[1];
    const double c = rod->pose[2], s = rod->pose[3];
    Cell to = {(c * dx + s * dy - rod->corner[0]) * rod->per_cell, (c * dy - s * dx - rod->corner[1]) * rod->per_cell};
    const real low = 1.0 + (real){0};
    to.cu = least_of(most_of(to.u, low), rod->width - 2.001 + (real){0});
    to.cv = least_of(most_of(to.v, low), rod->height - 2.001 + (real){0});
    const whole i = WHOLE(to.cu), j = WHOLE(to.cv), first = j * rod->width + i;
    const real du = to.u - to.cu, dv = to.v - to.cv;
    to.a = to.cu - REAL(i), to.b = to.cv - REAL(j), to.away = root(du * du + dv * dv) / rod->per_cell;
    for (int k = 0; k < WIDE; ++k)
        to.at[k] = rod->distance + AT(first, k);
    return to;
}

/* Distances around points, from so many cells before on. */
static inline void patch(const Rod *rod, const Cell *at, int before, int size, real d[4][4])
{
    for (int j = 0; j < size; ++j)
        for (int i = 0; i < size; ++i)
            for (int k = 0; k < WIDE; ++k)
                AT(d[j][i], k) = at->at[k][(j - before) * rod->width + i - before];
}

/* Distance of a point from the object, roughly: beyond the table it only has to be large, and to grow. */
static inline real rough_gap(const Rod *rod, real x, real y)
{
    const Cell at = cell_of(rod, x, y);
    real d[4][4];
    patch(rod, &at, 0, 2, d);
    const real first = d[0][0] + at.a * (d[0][1] - d[0][0]), second = d[1][0] + at.a * (d[1][1] - d[1][0]);
    return first + at.b * (second - first) + 0.7 * at.away;
}

/* Weights of four neighbors of the cubic convolution of R. Keys (1981), doi:10.1109/TASSP.1981.1163711, and their first
   and second derivatives. */
static inline void cubic(real t, real w[3][4])
{
    w[0][0] = t * (-0.5 + t * (1.0 - 0.5 * t)), w[0][1] = 1.0 + t * t * (-2.5 + 1.5 * t);
    w[0][2] = t * (0.5 + t * (2.0 - 1.5 * t)), w[0][3] = t * t * (-0.5 + 0.5 * t);
    w[1][0] = -0.5 + t * (2.0 - 1.5 * t), w[1][1] = t * (-5.0 + 4.5 * t);
    w[1][2] = 0.5 + t * (4.0 - 4.5 * t), w[1][3] = t * (-1.0 + 1.5 * t);
    w[2][0] = 2.0 - 3.0 * t, w[2][1] = -5.0 + 9.0 * t, w[2][2] = 4.0 - 9.0 * t, w[2][3] = -1.0 + 3.0 * t;
}

/* Distance of a point from the object, by values alone. */
static inline real gap_at(const Rod *rod, real x, real y)
{
    const Cell at = cell_of(rod, x, y);
    real wu[3][4], wv[3][4], d[4][4], gap = 0.7 * at.away;
    cubic(at.a, wu), cubic(at.b, wv), patch(rod, &at, 1, 4, d);
    for (int j = 0; j < 4; ++j)
        gap += wv[0][j] * (wu[0][0] * d[j][0] + wu[0][1] * d[j][1] + wu[0][2] * d[j][2] + wu[0][3] * d[j][3]);
    return gap;
}

/* Distance of a point from the object, and the world normal of the object there. */
static Place place(const Rod *rod, dual x, dual y)
{
    const Cell at = cell_of(rod, x.v, y.v);
    real wu[3][4], wv[3][4], d[4][4], f[3][3] = {{{0}}};
    cubic(at.a, wu), cubic(at.b, wv), patch(rod, &at, 1, 4, d);
    for (int j = 0; j < 4; ++j) {
        for (int p = 0; p < 3; ++p) {
            const real line = wu[p][0] * d[j][0] + wu[p][1] * d[j][1] + wu[p][2] * d[j][2] + wu[p][3] * d[j][3];
            for (int q = 0; p + q < 3; ++q)
                f[p][q] += wv[q][j] * line;
        }
    }
    const double c = rod->pose[2], s = rod->pose[3], k = rod->per_cell, k2 = k * k;
    const dual u = plus(scaled(c, x), scaled(s, y)), v = minus(scaled(c, y), scaled(s, x));
    const real gu = f[1][0] * k, gv = f[0][1] * k;
    const dual p = {gu, sum_of(k2 * f[2][0], u.d, k2 * f[1][1], v.d)}, q = {gv, sum_of(k2 * f[1][1], u.d, k2 * f[0][2], v.d)};
    const dual size = length_of(p, q), nu = over(p, size), nv = over(q, size);
    /* Beyond the table the distance only has to be large, and to grow. */
    real fu = gu, fv = gv;
    for (int lane = 0; lane < WIDE; ++lane)
        if (AT(at.away, lane) > 0.0) {
            const double du = AT(at.u, lane) - AT(at.cu, lane), dv = AT(at.v, lane) - AT(at.cv, lane);
            const double more = 0.7 / (AT(at.away, lane) * k);
            AT(fu, lane) = (du == 0.0) * AT(gu, lane) + more * du, AT(fv, lane) = (dv == 0.0) * AT(gv, lane) + more * dv;
        }
    const dual gap = {f[0][0] + 0.7 * at.away, sum_of(fu, u.d, fv, v.d)};
    return (Place){gap, minus(scaled(c, nu), scaled(s, nv)), plus(scaled(s, nu), scaled(c, nv))};
}

static inline int numbers_of(const Rod *rod) { return 4 + 3 * rod->contacts; }

static inline dual bent_by(const Rod *rod, dual moment, dual s)
{
    if (rod->nodes == 1) {
        dual bent = scaled(1.0 / rod->table[STIFFNESS], moment);
        bent.v += rod->table[REST];
        return bent;
    }
    return plus(along(rod, REST, s), over(moment, along(rod, STIFFNESS, s)));
}

/* Curvature: the moments of the loads beyond and of the tendons, of which friction takes part by what the rod turned. */
static inline __attribute__((always_inline)) dual curvature(const Rod *rod, const State *q, dual s, dual base)
{
    dual tendon = times(along(rod, TENDON, s), base);
    if (rod->tendon_friction != 0.0) {
        real factor = -rod->tendon_friction * q->turned.v;
        for (int k = 0; k < WIDE; ++k)
            AT(factor, k) = exp(AT(factor, k));
        tendon = times(tendon, with(q->turned, factor, -rod->tendon_friction * factor));
    }
    return bent_by(rod, plus(q->moment, tendon), s);
}

static inline State clamped(const Rod *rod, const dual *z)
{
    const double angle = rod->base[2];
    const dual none = constant(0.0);
    State q = {none, constant(rod->base[0]), constant(rod->base[1]), constant(angle), constant(sin(angle)),
               constant(cos(angle)), none, z[1], z[2], none, z[0]};
    q.moment = minus(times(along(rod, STIFFNESS, none), minus(z[0], along(rod, REST, none))),
                     times(along(rod, TENDON, none), z[3]));
    return q;
}

/* -(t x F) with the tangent t = (-sin, cos) */
static inline dual bending(const State *q) { return plus(times(q->sine, q->fy), times(q->cosine, q->fx)); }

/* One step of the leapfrog rule; the position by the rule of Euler and Maclaurin. */
static inline void step(const Rod *rod, State *q, dual h, dual half, dual twelfth, dual base)
{
    const dual s0 = q->sine, c0 = q->cosine, k0 = q->bent;
    const real before = q->s.v;
    q->moment = plus(q->moment, times(half, bending(q)));
    const dual k = curvature(rod, q, plus(q->s, half), base);
    const dual turn = times(h, k);
    q->angle = plus(q->angle, turn);
    if (rod->tendon_friction != 0.0)
        q->turned = plus(q->turned, size_of(turn));
    if (rod->gravity[0] != 0.0 || rod->gravity[1] != 0.0) {
        const dual weight = times(h, along(rod, WEIGHT, plus(q->s, half)));
        q->fx = minus(q->fx, scaled(rod->gravity[0], weight)), q->fy = minus(q->fy, scaled(rod->gravity[1], weight));
    }
    q->s = plus(q->s, h);
    for (int m = 0; m < rod->masses; ++m)
        for (int k = 0; k < WIDE; ++k)
            if (AT(before, k) <= rod->mass[3 * m] && rod->mass[3 * m] < AT(q->s.v, k))
                AT(q->fx.v, k) -= rod->mass[3 * m + 1], AT(q->fy.v, k) -= rod->mass[3 * m + 2];
    real sine, cosine;
    waves(q->angle.v, &sine, &cosine);
    q->sine = with(q->angle, sine, cosine), q->cosine = with(q->angle, cosine, -sine);
    q->moment = plus(q->moment, times(half, bending(q)));
    q->bent = curvature(rod, q, q->s, base);
    const dual dx = minus(times(q->bent, q->cosine), times(k0, c0)), dy = minus(times(q->bent, q->sine), times(k0, s0));
    q->x = minus(q->x, minus(times(half, plus(s0, q->sine)), times(twelfth, dx)));
    q->y = plus(q->y, plus(times(half, plus(c0, q->cosine)), times(twelfth, dy)));
}

static inline void step_by(const Rod *rod, State *q, double h, dual base)
{
    step(rod, q, constant(h), constant(0.5 * h), constant(h * h / 12.0), base);
}

/* A segment between contacts as integrated; its extremes are sought by values, and have slopes where they are. */
typedef struct { dual begin, h, x[STEPS], y[STEPS], bent[STEPS]; int steps; } Segment;

static inline dual least(dual a, dual b) { return chosen(MASK(a.v < b.v), a, b); }
static inline dual greatest(dual a, dual b) { return chosen(MASK(a.v > b.v), a, b); }

/* How far a section is clear of the supports; before its first contact a finger may come out of one. */
static inline dual clear_of_supports(const Rod *rod, dual x, dual y, dual half, int emerging)
{
    dual clear = constant(FAR);
    for (int k = 0; k < rod->walls; ++k) {
        const double *w = rod->wall + 4 * k;
        const double start = (rod->base[0] - w[2]) * w[0] + (rod->base[1] - w[3]) * w[1];
        dual height = plus(scaled(w[0], x), scaled(w[1], y));
        height.v -= w[0] * w[2] + w[1] * w[3];
        const dual needed = emerging ? chosen(MASK(start < half.v), constant(fmin(start, 0.0)), half) : half;
        clear = least(clear, minus(height, needed));
    }
    for (int k = 0; k < rod->pegs; ++k) {
        const double *peg = rod->peg + 3 * k;
        const dual off = length_of(minus(x, constant(peg[0])), minus(y, constant(peg[1])));
        clear = least(clear, minus(off, plus(constant(peg[2]), half)));
    }
    return clear;
}

/* By values alone. */
static inline real away_from_supports(const Rod *rod, real x, real y, real half, int emerging)
{
    real clear = FAR + (real){0};
    for (int k = 0; k < rod->walls; ++k) {
        const double *w = rod->wall + 4 * k;
        const double start = (rod->base[0] - w[2]) * w[0] + (rod->base[1] - w[3]) * w[1];
        const real height = w[0] * (x - w[2]) + w[1] * (y - w[3]), out = fmin(start, 0.0) + (real){0};
        clear = least_of(clear, height - (emerging ? CHOSEN(MASK(start < half), out, half) : half));
    }
    for (int k = 0; k < rod->pegs; ++k) {
        const double *peg = rod->peg + 3 * k;
        clear = least_of(clear, root((x - peg[0]) * (x - peg[0]) + (y - peg[1]) * (y - peg[1])) - peg[2] - half);
    }
    return clear;
}

/* Where a step begins, counted in steps. */
static inline dual place_of(const Segment *seg, real k) { return plus(seg->begin, by(k, seg->h)); }

/* One of a row of numbers for each rod. */
static inline dual taken(const dual *row, real at)
{
#if WIDE > 1
    dual one = row[0];
    for (int lane = 0; lane < WIDE; ++lane) {
        const double *from = (const double *)(row + (int)at[lane]) + lane;
        double *to = (double *)&one + lane;
        for (int k = 0; k <= LANES; ++k)
            to[WIDE * k] = from[WIDE * k];
    }
    return one;
#else
    return row[(int)at];
#endif
}

static inline real half_at(const Rod *rod, const Segment *seg, real k)
{
    return along(rod, HALF, constant_of(seg->begin.v + k * seg->h.v)).v;
}

/* Least clearance of the object: at an end, or at the bottom of a parabola through three gaps, so that its place changes
   smoothly with the numbers of the rod. Which three is seen roughly. */
static dual clear_of_object(const Rod *rod, const Segment *seg)
{
    const int last = seg->steps - 1;
    const real none = FAR + (real){0}, one = 1.0 + (real){0};
    real gap[STEPS + 1], least_gap = none, off = {0}, at = one;
    gap[0] = gap[last + 1] = none;
    for (int k = 1; k <= last; ++k)
        gap[k] = rough_gap(rod, seg->x[k].v, seg->y[k].v) - half_at(rod, seg, k + (real){0});
    for (int k = 1; k <= last; ++k) {
        const real before = gap[k - 1], after = gap[k + 1];
        real here = gap[k];
        if (k > 1 && k < last) {
            const real difference = before - after;
            here -= 0.125 * difference * difference / (before - 2.0 * here + after);
        }
        const whole lower = MASK(gap[k] <= before) & MASK(gap[k] < after) & MASK(here < least_gap);
        least_gap = CHOSEN(lower, here, least_gap), at = CHOSEN(lower, k + (real){0}, at);
    }
    /* The first of three gaps around it, and where it is among these. */
    const real first = most_of(one, least_of(at - 1.0, last - 2.0 + (real){0}));
    const whole inner = MASK(at - first == 1.0);
    dual x[3], y[3];
    for (int k = 0; k < 3; ++k) {
        x[k] = taken(seg->x, first + k), y[k] = taken(seg->y, first + k);
        gap[k] = gap_at(rod, x[k].v, y[k].v) - half_at(rod, seg, first + k);
    }
    const real bend = gap[0] - 2.0 * gap[1] + gap[2];
    off = CHOSEN(inner & MASK(bend > 0.0), least_of(one, most_of(-one, 0.5 * (gap[0] - gap[2]) / bend)), off);
    const real t = CHOSEN(inner, off, at - first - 1.0), w0 = 0.5 * t * (t - 1.0), w1 = 1.0 - t * t, w2 = 0.5 * t * (t + 1.0);
    const dual px = plus(plus(by(w0, x[0]), by(w1, x[1])), by(w2, x[2]));
    const dual py = plus(plus(by(w0, y[0]), by(w1, y[1])), by(w2, y[2])), s = place_of(seg, at + off);
    return minus(place(rod, px, py).gap, along(rod, HALF, s));
}

static dual segment_clear_of_supports(const Rod *rod, const Segment *seg, int emerging)
{
    real lowest = FAR + (real){0}, at = {0};
    for (int k = 1; k <= seg->steps; ++k) {
        const real clear = away_from_supports(rod, seg->x[k].v, seg->y[k].v, half_at(rod, seg, k + (real){0}), emerging);
        const whole lower = MASK(clear < lowest);
        lowest = CHOSEN(lower, clear, lowest), at = CHOSEN(lower, k + (real){0}, at);
    }
    return clear_of_supports(rod, taken(seg->x, at), taken(seg->y, at), along(rod, HALF, place_of(seg, at)), emerging);
}

/* Greatest curvature. */
static dual greatest_bend(const Segment *seg)
{
    real most = {0}, at = {0};
    for (int k = 0; k <= seg->steps; ++k) {
        const real bend = magnitude(seg->bent[k].v);
        const whole more = MASK(bend > most);
        most = CHOSEN(more, bend, most), at = CHOSEN(more, k + (real){0}, at);
    }
    return size_of(taken(seg->bent, at));
}

/* Greatest change of curvature from that at rest, times the depth of the section. */
static dual greatest_strain(const Rod *rod, const Segment *seg)
{
    real most = {0}, at = {0};
    for (int k = 0; k <= seg->steps; ++k) {
        const dual s = constant_of(seg->begin.v + k * seg->h.v);
        const real bend = along(rod, DEPTH, s).v * magnitude(seg->bent[k].v - along(rod, REST, s).v);
        const whole more = MASK(bend > most);
        most = CHOSEN(more, bend, most), at = CHOSEN(more, k + (real){0}, at);
    }
    const dual s = place_of(seg, at);
    return times(along(rod, DEPTH, s), size_of(minus(taken(seg->bent, at), along(rod, REST, s))));
}

/* A section that touches, or the tip. */
typedef struct { dual gap, lean, x, y, nx, ny, half; } Touch;

static inline Touch touch_of(const Rod *rod, const State *q)
{
    const Place at = place(rod, q->x, q->y);
    const dual half = along(rod, HALF, q->s);
    dual lean = minus(times(q->cosine, at.ny), times(q->sine, at.nx));
    lean.v -= slope_along(rod, HALF, q->s.v);
    return (Touch){minus(at.gap, half), lean, q->x, q->y, at.nx, at.ny, half};
}

/* The forces of a middle contact act on the rest of the finger no more. */
static inline void pass(const Rod *rod, State *q, const Touch *at, const dual *z, dual base)
{
    const dual normal = z[1], friction = z[2];
    q->fx = minus(q->fx, minus(times(normal, at->nx), times(friction, at->ny)));
    q->fy = minus(q->fy, plus(times(normal, at->ny), times(friction, at->nx)));
    q->moment = plus(q->moment, times(at->half, friction));
    q->bent = curvature(rod, q, q->s, base);
}

/* Steps of a segment, whatever its length: else results would jump where their number changes. */
static inline int steps_of(const Rod *rod)
{
    return rod->contacts ? (3 * rod->steps) / 5 : rod->steps;
}

/* A finger as integrated: its middle contacts and its tip, the force there, the moment missing there; and, where they are
   asked for, its extremes, of which those per segment come with lengths times greatest curvatures. */
typedef struct {
    Touch touch[MOST_CONTACTS + 1];
    dual normal, friction, missing, supports, strain, bend[MOST_CONTACTS + 1], clear[MOST_CONTACTS + 1];
} Finger;

static void integrate(const Rod *rod, const dual *z, int extremes, Finger *out)
{
    State q = clamped(rod, z);
    Segment seg;
    seg.begin = constant(0.0), seg.steps = steps_of(rod);
    out->supports = constant(FAR), out->strain = constant(0.0);
    for (int segment = 0; segment <= rod->contacts; ++segment) {
        const dual end = segment < rod->contacts ? z[4 + 3 * segment] : constant(1.0), span = minus(end, seg.begin);
        seg.h = scaled(1.0 / seg.steps, span);
        const dual half = scaled(0.5, seg.h), twelfth = scaled(1.0 / 12.0, times(seg.h, seg.h));
        seg.x[0] = q.x, seg.y[0] = q.y, seg.bent[0] = q.bent;
        for (int k = 1; k <= seg.steps; ++k) {
            step(rod, &q, seg.h, half, twelfth, z[3]);
            seg.x[k] = q.x, seg.y[k] = q.y, seg.bent[k] = q.bent;
        }
        if (extremes) {
            out->strain = greatest(out->strain, greatest_strain(rod, &seg));
            out->bend[segment] = times(span, greatest_bend(&seg));
            out->clear[segment] = clear_of_object(rod, &seg);
            if (rod->walls + rod->pegs)
                out->supports = least(out->supports, segment_clear_of_supports(rod, &seg, segment == 0));
        }
        out->touch[segment] = touch_of(rod, &q);
        if (segment < rod->contacts)
            pass(rod, &q, out->touch + segment, z + 4 + 3 * segment, z[3]);
        seg.begin = end;
    }
    const Touch *tip = out->touch + rod->contacts;
    q.fx.v -= rod->tip_load[0], q.fy.v -= rod->tip_load[1];
    out->normal = plus(times(q.fx, tip->nx), times(q.fy, tip->ny));
    out->friction = minus(times(q.fy, tip->nx), times(q.fx, tip->ny));
    out->missing = plus(q.moment, times(tip->half, out->friction));
}
