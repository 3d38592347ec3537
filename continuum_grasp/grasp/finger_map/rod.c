/* Equilibria of an exact planar rod by integration from its base, with their derivatives by the numbers that fix them.

   Units: lengths L, forces E I / L^2, moments E I / L of the finger. Numbers z of an equilibrium: curvature at the base,
   internal force there (2), moment of the tendons at the base; per middle contact its place, normal force and friction.
   A dual number has a value, and slopes by each of these numbers. `rod.py` calls these. */

#include <math.h>

#ifndef LANES
#define LANES 8
#endif

typedef double lanes __attribute__((vector_size(8 * LANES)));
typedef struct { double v; lanes d; } dual;

/* Columns of the table along the rod. */
enum { STIFFNESS, REST, TENDON, HALF, WEIGHT, COLUMNS };

typedef struct {
    int steps, contacts, tip; /* tip: whether it touches */
    int nodes, masses, walls, pegs, width, height;
    double base[3], gravity[2], tip_load[2], friction, pose[3], corner[2], per_cell;
    const double *table;    /* (nodes, COLUMNS) */
    const double *mass;     /* (masses, 3): place, weight x, y */
    const double *wall;     /* (walls, 4): normal, point */
    const double *peg;      /* (pegs, 3): center, radius */
    const double *distance; /* (height, width) from the object, in its frame */
} Rod;

typedef struct { dual s, x, y, angle, sine, cosine, moment, fx, fy, turned, bent; } State;
typedef struct { dual gap, nx, ny; } Place;

static inline dual constant(double value) { return (dual){value}; }
static inline dual plus(dual a, dual b) { return (dual){a.v + b.v, a.d + b.d}; }
static inline dual minus(dual a, dual b) { return (dual){a.v - b.v, a.d - b.d}; }
static inline dual scaled(double factor, dual a) { return (dual){factor * a.v, factor * a.d}; }
static inline dual times(dual a, dual b) { return (dual){a.v * b.v, a.v * b.d + b.v * a.d}; }
static inline dual with(dual a, double value, double slope) { return (dual){value, slope * a.d}; }
static inline dual size_of(dual a) { return a.v < 0.0 ? scaled(-1.0, a) : a; }
static inline dual least(dual a, dual b) { return a.v < b.v ? a : b; }
static inline dual greatest(dual a, dual b) { return a.v > b.v ? a : b; }

static inline dual over(dual a, dual b)
{
    const double inverse = 1.0 / b.v, q = a.v * inverse;
    return (dual){q, inverse * (a.d - q * b.d)};
}

static inline dual length_of(dual a, dual b)
{
    const double size = sqrt(a.v * a.v + b.v * b.v + 1e-30);
    return (dual){size, (a.v * a.d + b.v * b.d) / size};
}

/* A column of the table at a place. */
static inline dual along(const Rod *rod, int column, dual s)
{
    if (rod->nodes == 1)
        return constant(rod->table[column]);
    const double at = fmin(fmax(s.v, 0.0), 1.0) * (rod->nodes - 1);
    const int cell = at < rod->nodes - 2 ? (int)at : rod->nodes - 2;
    const double *row = rod->table + COLUMNS * cell + column, change = row[COLUMNS] - row[0];
    return with(s, row[0] + (at - cell) * change, (rod->nodes - 1) * change);
}

static inline double slope_along(const Rod *rod, int column, double s)
{
    if (rod->nodes == 1)
        return 0.0;
    const double at = fmin(fmax(s, 0.0), 1.0) * (rod->nodes - 1);
    const int cell = at < rod->nodes - 2 ? (int)at : rod->nodes - 2;
    const double *row = rod->table + COLUMNS * cell + column;
    return (rod->nodes - 1) * (row[COLUMNS] - row[0]);
}

typedef struct { double u, v, cu, cv, a, b, away; const double *at; } Cell;

static inline Cell cell_of(const Rod *rod, double x, double y)
{
    const double c = cos(rod->pose[2]), s = sin(rod->pose[2]), dx = x - rod->pose[0], dy = y - rod->pose[1];
    const double u = (c * dx + s * dy - rod->corner[0]) * rod->per_cell;
    const double v = (c * dy - s * dx - rod->corner[1]) * rod->per_cell;
    const double cu = fmin(fmax(u, 1.0), rod->width - 2.001), cv = fmin(fmax(v, 1.0), rod->height - 2.001);
    const int i = (int)cu, j = (int)cv;
    return (Cell){u, v, cu, cv, cu - i, cv - j, hypot(u - cu, v - cv) / rod->per_cell, rod->distance + j * rod->width + i};
}

/* Distance of a point from the object, roughly: beyond the table it only has to be large, and to grow. */
static inline double rough_gap(const Rod *rod, double x, double y)
{
    const Cell at = cell_of(rod, x, y);
    const double *d = at.at, *below = d + rod->width;
    const double first = d[0] + at.a * (d[1] - d[0]), second = below[0] + at.a * (below[1] - below[0]);
    return first + at.b * (second - first) + 0.7 * at.away;
}

/* Weights of four neighbors of the cubic convolution of R. Keys (1981), doi:10.1109/TASSP.1981.1163711, and their first
   and second derivatives. */
static inline void cubic(double t, double w[3][4])
{
    w[0][0] = t * (-0.5 + t * (1.0 - 0.5 * t)), w[0][1] = 1.0 + t * t * (-2.5 + 1.5 * t);
    w[0][2] = t * (0.5 + t * (2.0 - 1.5 * t)), w[0][3] = t * t * (-0.5 + 0.5 * t);
    w[1][0] = -0.5 + t * (2.0 - 1.5 * t), w[1][1] = t * (-5.0 + 4.5 * t);
    w[1][2] = 0.5 + t * (4.0 - 4.5 * t), w[1][3] = t * (-1.0 + 1.5 * t);
    w[2][0] = 2.0 - 3.0 * t, w[2][1] = -5.0 + 9.0 * t, w[2][2] = 4.0 - 9.0 * t, w[2][3] = -1.0 + 3.0 * t;
}

/* Distance of a point from the object, and the world normal of the object there. */
static Place place(const Rod *rod, dual x, dual y)
{
    const Cell at = cell_of(rod, x.v, y.v);
    double wu[3][4], wv[3][4], f[3][3] = {{0}};
    cubic(at.a, wu), cubic(at.b, wv);
    for (int j = 0; j < 4; ++j) {
        const double *row = at.at + (j - 1) * rod->width - 1;
        for (int p = 0; p < 3; ++p) {
            const double line = wu[p][0] * row[0] + wu[p][1] * row[1] + wu[p][2] * row[2] + wu[p][3] * row[3];
            for (int q = 0; p + q < 3; ++q)
                f[p][q] += wv[q][j] * line;
        }
    }
    const double c = cos(rod->pose[2]), s = sin(rod->pose[2]), k = rod->per_cell, k2 = k * k;
    const dual u = plus(scaled(c, x), scaled(s, y)), v = minus(scaled(c, y), scaled(s, x));
    const double gu = f[1][0] * k, gv = f[0][1] * k;
    const dual p = {gu, k2 * (f[2][0] * u.d + f[1][1] * v.d)}, q = {gv, k2 * (f[1][1] * u.d + f[0][2] * v.d)};
    const dual size = length_of(p, q), nu = over(p, size), nv = over(q, size);
    /* Beyond the table the distance only has to be large, and to grow. */
    const double beyond = at.away > 0.0 ? 0.7 / (at.away * k) : 0.0;
    const double fu = gu * (at.u == at.cu) + beyond * (at.u - at.cu), fv = gv * (at.v == at.cv) + beyond * (at.v - at.cv);
    const dual gap = {f[0][0] + 0.7 * at.away, fu * u.d + fv * v.d};
    return (Place){gap, minus(scaled(c, nu), scaled(s, nv)), plus(scaled(s, nu), scaled(c, nv))};
}

/* Curvature: the moments of the loads beyond and of the tendons, of which friction takes part by what the rod turned. */
static inline dual curvature(const Rod *rod, const State *q, dual s, dual base)
{
    dual tendon = times(along(rod, TENDON, s), base);
    if (rod->friction != 0.0) {
        const double factor = exp(-rod->friction * q->turned.v);
        tendon = times(tendon, with(q->turned, factor, -rod->friction * factor));
    }
    const dual moment = plus(q->moment, tendon);
    if (rod->nodes == 1) {
        dual bent = scaled(1.0 / rod->table[STIFFNESS], moment);
        bent.v += rod->table[REST];
        return bent;
    }
    return plus(along(rod, REST, s), over(moment, along(rod, STIFFNESS, s)));
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
static inline void step(const Rod *rod, State *q, dual h, dual base)
{
    const dual half = scaled(0.5, h), k0 = q->bent, s0 = q->sine, c0 = q->cosine;
    const double before = q->s.v;
    q->moment = plus(q->moment, times(half, bending(q)));
    const dual k = curvature(rod, q, plus(q->s, half), base), turn = times(h, k);
    q->angle = plus(q->angle, turn);
    q->turned = plus(q->turned, size_of(turn));
    if (rod->gravity[0] != 0.0 || rod->gravity[1] != 0.0) {
        const dual weight = times(h, along(rod, WEIGHT, plus(q->s, half)));
        q->fx = minus(q->fx, scaled(rod->gravity[0], weight)), q->fy = minus(q->fy, scaled(rod->gravity[1], weight));
    }
    q->s = plus(q->s, h);
    for (int m = 0; m < rod->masses; ++m)
        if (before <= rod->mass[3 * m] && rod->mass[3 * m] < q->s.v)
            q->fx.v -= rod->mass[3 * m + 1], q->fy.v -= rod->mass[3 * m + 2];
    const double sine = sin(q->angle.v), cosine = cos(q->angle.v);
    q->sine = with(q->angle, sine, cosine), q->cosine = with(q->angle, cosine, -sine);
    q->moment = plus(q->moment, times(half, bending(q)));
    q->bent = curvature(rod, q, q->s, base);
    const dual twelfth = scaled(1.0 / 12.0, times(h, h));
    const dual dx = minus(times(q->bent, q->cosine), times(k0, c0)), dy = minus(times(q->bent, q->sine), times(k0, s0));
    q->x = minus(q->x, plus(times(half, plus(s0, q->sine)), times(twelfth, dx)));
    q->y = plus(q->y, minus(times(half, plus(c0, q->cosine)), times(twelfth, scaled(-1.0, dy))));
}

/* How far a section is clear of the supports; before its first contact a finger may come out of one. */
static inline dual clear_of_supports(const Rod *rod, const State *q, dual half, int emerging)
{
    dual clear = constant(9.0);
    for (int k = 0; k < rod->walls; ++k) {
        const double *w = rod->wall + 4 * k;
        const double start = (rod->base[0] - w[2]) * w[0] + (rod->base[1] - w[3]) * w[1];
        dual height = plus(scaled(w[0], q->x), scaled(w[1], q->y));
        height.v -= w[0] * w[2] + w[1] * w[3];
        const dual needed = emerging && start < half.v ? constant(fmin(start, 0.0)) : half;
        clear = least(clear, minus(height, needed));
    }
    for (int k = 0; k < rod->pegs; ++k) {
        const double *peg = rod->peg + 3 * k;
        const dual off = length_of(minus(q->x, constant(peg[0])), minus(q->y, constant(peg[1])));
        clear = least(clear, minus(off, plus(constant(peg[2]), half)));
    }
    return clear;
}

/* Where a segment is nearest to the object: of samples and of the parabolas through three of their gaps, so that the
   place changes smoothly with the numbers of the rod. */
typedef struct { dual x, y, half; double gap; } Sample;
typedef struct { double least; Sample at, last[2]; int count; } Lowest;
static inline void found(Lowest *low, Sample at)
{
    if (at.gap < low->least)
        low->least = at.gap, low->at = at;
}

static inline dual blend(const double *w, dual a, dual b, dual c)
{
    return plus(plus(scaled(w[0], a), scaled(w[1], b)), scaled(w[2], c));
}

static inline void watch(const Rod *rod, Lowest *low, const State *q)
{
    const dual half = along(rod, HALF, q->s);
    const double distance = LANES >= 8 ? place(rod, q->x, q->y).gap.v : rough_gap(rod, q->x.v, q->y.v);
    const Sample now = {q->x, q->y, half, distance - half.v};
    const Sample *a = low->last, *b = low->last + 1;
    if (low->count > 1 && b->gap <= a->gap && b->gap < now.gap) {
        const double at = 0.5 * (a->gap - now.gap) / (a->gap - 2.0 * b->gap + now.gap);
        const double w[3] = {0.5 * at * (at - 1.0), 1.0 - at * at, 0.5 * at * (at + 1.0)};
        found(low, (Sample){blend(w, a->x, b->x, now.x), blend(w, a->y, b->y, now.y), blend(w, a->half, b->half, now.half),
                            b->gap - 0.25 * (a->gap - now.gap) * at});
    }
    else if (low->count == 1 && b->gap < now.gap)
        found(low, *b);
    low->last[0] = *b, low->last[1] = now;
    ++low->count;
}

static inline dual clearance(const Rod *rod, Lowest *low)
{
    if (low->count < 2 || low->last[1].gap < low->last[0].gap)
        found(low, low->last[1]);
    return minus(place(rod, low->at.x, low->at.y).gap, low->at.half);
}

enum { CONTACT = 7, ENDS = 5 };

/* Numbers per contact: gap, lean, x, y, normal, half thickness; at the end: normal force and friction of the tip, moment
   missing there, clearance of the supports, greatest change of curvature; then per segment its length times its greatest
   curvature; then per segment its clearance of the object. */

static inline Place touched(const Rod *rod, const State *q, dual *out)
{
    const Place at = place(rod, q->x, q->y);
    const dual half = along(rod, HALF, q->s);
    out[0] = minus(at.gap, half);
    out[1] = minus(times(q->cosine, at.ny), times(q->sine, at.nx));
    out[1].v -= slope_along(rod, HALF, q->s.v);
    out[2] = q->x, out[3] = q->y, out[4] = at.nx, out[5] = at.ny, out[6] = half;
    return at;
}

/* The forces of a middle contact act on the rest of the finger no more. */
static inline void pass(const Rod *rod, State *q, Place at, dual half, const dual *z, dual base)
{
    const dual normal = z[1], friction = z[2];
    q->fx = minus(q->fx, minus(times(normal, at.nx), times(friction, at.ny)));
    q->fy = minus(q->fy, plus(times(normal, at.ny), times(friction, at.nx)));
    q->moment = plus(q->moment, times(half, friction));
    q->bent = curvature(rod, q, q->s, base);
}

/* Steps of a segment, whatever its length: else results would jump where their number changes. */
static inline int steps_of(const Rod *rod)
{
    return rod->contacts ? (3 * rod->steps) / 5 : rod->steps;
}

/* z (count, 4 + 3 contacts); out (count, 9 contacts + 14, 1 + LANES) or, of values alone, (count, 9 contacts + 14). */
void trace(const Rod *rod, int count, const double *given, double *result)
{
    const int contacts = rod->contacts, size = 4 + 3 * contacts, wide = (CONTACT + 2) * (contacts + 1) + ENDS;
    for (int row = 0; row < count; ++row, given += size) {
        dual z[16], values[64], *out = values;
        dual *bends = values + CONTACT * (contacts + 1) + ENDS, *clear = bends + contacts + 1;
        for (int k = 0; k < size; ++k) {
            z[k] = constant(given[k]);
            if (LANES >= 8)
                z[k].d[k] = 1.0;
        }
        State q = clamped(rod, z);
        dual supports = constant(9.0), strain = constant(0.0), begin = constant(0.0);
        Place at;
        for (int segment = 0; segment <= contacts; ++segment) {
            const dual end = segment < contacts ? z[4 + 3 * segment] : constant(1.0), span = minus(end, begin);
            const int steps = steps_of(rod);
            const dual h = scaled(1.0 / steps, span);
            dual most = size_of(q.bent);
            Lowest lowest = {9.0};
            strain = greatest(strain, size_of(minus(q.bent, along(rod, REST, q.s))));
            for (int k = 1; k <= steps; ++k) {
                step(rod, &q, h, z[3]);
                most = greatest(most, size_of(q.bent));
                strain = greatest(strain, size_of(minus(q.bent, along(rod, REST, q.s))));
                if (rod->walls + rod->pegs)
                    supports = least(supports, clear_of_supports(rod, &q, along(rod, HALF, q.s), segment == 0));
                if (k < steps)
                    watch(rod, &lowest, &q);
            }
            clear[segment] = clearance(rod, &lowest);
            bends[segment] = times(span, most);
            at = touched(rod, &q, out);
            out += CONTACT;
            if (segment < contacts)
                pass(rod, &q, at, out[-1], z + 4 + 3 * segment, z[3]);
            begin = end;
        }
        q.fx.v -= rod->tip_load[0], q.fy.v -= rod->tip_load[1];
        const dual friction = minus(times(q.fy, at.nx), times(q.fx, at.ny));
        out[0] = plus(times(q.fx, at.nx), times(q.fy, at.ny)), out[1] = friction;
        out[2] = plus(q.moment, times(out[-1], friction));
        out[3] = supports, out[4] = strain;
        for (int k = 0; k < wide; ++k) {
            *result++ = values[k].v;
            for (int lane = 0; lane < (LANES >= 8 ? LANES : 0); ++lane)
                *result++ = values[k].d[lane];
        }
    }
}

/* The curve: rows of place, curvature, x, y of one equilibrium, per segment from its start to its end. */
int curve(const Rod *rod, const double *given, double *out)
{
    const int contacts = rod->contacts;
    dual z[16], scratch[CONTACT];
    for (int k = 0; k < 4 + 3 * contacts; ++k)
        z[k] = constant(given[k]);
    State q = clamped(rod, z);
    double begin = 0.0;
    const double *first = out;
    for (int segment = 0; segment <= contacts; ++segment) {
        const double end = segment < contacts ? given[4 + 3 * segment] : 1.0;
        const int steps = steps_of(rod);
        for (int k = 0; k <= steps; ++k, out += 4) {
            out[0] = q.s.v, out[1] = q.bent.v, out[2] = q.x.v, out[3] = q.y.v;
            if (k < steps)
                step(rod, &q, constant((end - begin) / steps), z[3]);
        }
        if (segment < contacts) {
            const Place at = touched(rod, &q, scratch);
            pass(rod, &q, at, scratch[6], z + 4 + 3 * segment, z[3]);
        }
        begin = end;
    }
    return (int)(out - first) / 4;
}

/* Places beyond the last contact where the gap is least, the first two: out (count, 4) of place and gap, twice; -1 where
   there is none between the bounds. */
void nearest(const Rod *rod, int count, const double *given, double low, double high, double *out)
{
    const int contacts = rod->contacts, size = 4 + 3 * contacts;
    for (int row = 0; row < count; ++row, given += size, out += 4) {
        dual z[16], scratch[CONTACT];
        for (int k = 0; k < size; ++k)
            z[k] = constant(given[k]);
        State q = clamped(rod, z);
        const double h = 1.0 / rod->steps;
        double before = 0.0, last = 0.0;
        int found = 0, contact = 0;
        out[0] = out[2] = -1.0, out[1] = out[3] = 9.0;
        for (int k = 0; k <= rod->steps && found < 2; ++k) {
            if (k)
                step(rod, &q, constant(h), z[3]);
            while (contact < contacts && q.s.v >= given[4 + 3 * contact]) {
                const Place at = touched(rod, &q, scratch);
                pass(rod, &q, at, scratch[6], z + 4 + 3 * contact, z[3]);
                ++contact;
            }
            const double gap = rough_gap(rod, q.x.v, q.y.v) - along(rod, HALF, q.s).v;
            if (k > 1 && last <= before && last < gap) {
                const double bend = before - 2.0 * last + gap, off = bend > 0.0 ? 0.5 * (before - gap) / bend : 0.0;
                const double at = (k - 1 + off) * h;
                if (at > low && at < high) {
                    out[2 * found] = at, out[2 * found + 1] = last - 0.25 * (before - gap) * off;
                    ++found;
                }
            }
            before = last, last = gap;
        }
    }
}
