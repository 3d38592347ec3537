/* What is exported: where a finger touches as it should, within its limits. */

/* Lengths [L] that count as much as a force of one, as a moment or a bend of its greatest, as a lean of one; the same of
   friction beyond its cone. */
#define FORCE 0.1
#define BEND 0.1
#define LEAN 0.3
/* Least distance of contacts [L]; two and a half turns [rad], to which a finger may bend in all of its segments together:
   of coils beyond that, maps have many, and searches of grasps lose others for them (`wrap`: 0.37 for 0.31). */
#define APART 0.06
#define COILED 15.7

/* Residuals that vanish where a finger touches as it should. */
static int conditions(const Rod *rod, const dual *z, const Finger *at, dual *row)
{
    const Touch *tip = at->touch + rod->contacts;
    int n = 0;
    row[n++] = scaled(FORCE, at->missing);
    for (int k = 0; k < rod->contacts; ++k)
        row[n++] = at->touch[k].gap, row[n++] = scaled(LEAN, at->touch[k].lean);
    if (rod->tip)
        row[n++] = tip->gap;
    else
        row[n++] = scaled(FORCE, at->normal), row[n++] = scaled(FORCE, at->friction);
    return n;
}

enum { ROWS = 64 };

/* Numbers of rods side by side, of which there may be fewer. */
static void read_numbers(const Rod *rod, int count, const double *given, dual *z)
{
    const int size = numbers_of(rod);
    for (int k = 0; k < size; ++k) {
        z[k] = constant(0.0);
        for (int lane = 0; lane < WIDE; ++lane)
            AT(z[k].v, lane) = given[(lane < count ? lane : 0) * size + k];
#if LANES > 0
        for (int lane = 0; lane < WIDE; ++lane)
            ((double *)&z[k].d)[WIDE * k + lane] = 1.0;
#endif
    }
}

static double *write_number(double *to, const dual *a, int lane)
{
    *to++ = AT(a->v, lane);
    for (int k = 0; k < LANES; ++k)
        *to++ = SLOPE(*a, k, lane);
    return to;
}

/* Numbers of the contacts, and the force at the tip. */
static double *write_touches(double *to, const Rod *rod, const Finger *at, int lane)
{
    for (int k = 0; k <= rod->contacts; ++k)
        for (int field = 0; field < 7; ++field)
            to = write_number(to, &at->touch[k].gap + field, lane);
    return write_number(write_number(to, &at->normal, lane), &at->friction, lane);
}

#if WIDE > 1 && LANES == 0
/* Numbers of the contacts and the force at the tip, the conditions: out (count, 7 (contacts + 1) + 2 + rows). */
void touches(const Rod *rod, int count, const double *given, double *out)
{
    Finger at;
    dual z[NUMBERS], row[ROWS];
    for (; count > 0; count -= WIDE, given += WIDE * numbers_of(rod)) {
        read_numbers(rod, count, given, z);
        integrate(rod, z, 0, &at);
        const int rows = conditions(rod, z, &at, row);
        for (int lane = 0; lane < WIDE && lane < count; ++lane) {
            out = write_touches(out, rod, &at, lane);
            for (int k = 0; k < rows; ++k)
                out = write_number(out, row + k, lane);
        }
    }
}

/* Equilibria (count, n) moved towards the conditions by one inverse of their slopes each (count, n, rows), in units of
   `step` (count, n), in so many rounds. */
void corrected(const Rod *rod, int count, int rounds, const double *back, const double *step, double *z)
{
    const int size = numbers_of(rod);
    Finger at;
    dual numbers[NUMBERS], row[ROWS];
    for (; count > 0; count -= WIDE, z += WIDE * size, step += WIDE * size) {
        int rows = 0;
        for (int round = 0; round < rounds; ++round) {
            read_numbers(rod, count, z, numbers);
            integrate(rod, numbers, 0, &at);
            rows = conditions(rod, numbers, &at, row);
            for (int lane = 0; lane < WIDE && lane < count; ++lane)
                for (int k = lane * size; k < (lane + 1) * size; ++k) {
                    double move = 0.0;
                    for (int j = 0; j < rows; ++j)
                        move += back[rows * k + j] * AT(row[j].v, lane);
                    z[k] -= step[k] * fmin(fmax(move, -1.0), 1.0);
                }
        }
        back += WIDE * rows * size;
    }
}
#endif

static inline dual beyond(double limit, dual a) { return (dual){a.v - limit, a.d}; }

/* Excesses of tension and shape over their limits, not above zero within them. */
static int shape_limits(const Rod *rod, const dual *z, const Finger *at, double entered, dual *row)
{
    int n = 0;
    const dual pull = scaled(BEND / rod->moment, z[3]);
    row[n++] = beyond(BEND * rod->pulls[0], pull), row[n++] = beyond(BEND * rod->pulls[1], scaled(-1.0, pull));
    for (int k = 0; k <= rod->contacts; ++k) {
        row[n++] = beyond(entered, scaled(-1.0, at->clear[k]));
        row[n++] = beyond(BEND, scaled(BEND * (rod->contacts + 1) / COILED, at->bend[k]));
    }
    row[n++] = beyond(entered, scaled(-1.0, at->supports));
    row[n++] = beyond(BEND, scaled(BEND / rod->strain, at->strain));
    for (int k = 0; k < rod->contacts; ++k) {
        const dual place = z[4 + 3 * k];
        const dual after = k ? minus(z[1 + 3 * k], place) : scaled(-1.0, place);
        row[n++] = beyond(k ? -APART : -rod->places[0], after), row[n++] = beyond(rod->places[1], place);
    }
    if (rod->tip)
        row[n++] = scaled(LEAN, at->touch[rod->contacts].lean);
    return n;
}

/* Excesses of the contacts' forces. */
static int force_limits(const Rod *rod, const dual *z, const Finger *at, dual *row)
{
    int n = 0;
    for (int k = 0; k < rod->contacts + rod->tip; ++k) {
        const int tip = k == rod->contacts;
        const dual normal = tip ? at->normal : z[5 + 3 * k], along_it = tip ? at->friction : z[6 + 3 * k];
        const dual pressed = chosen(MASK(normal.v > 0.0), normal, constant(0.0));
        row[n++] = scaled(-FORCE, normal);
        row[n++] = beyond(0.3, scaled(0.3 / rod->force, normal));
        row[n++] = scaled(FORCE, minus(size_of(along_it), scaled(rod->friction, pressed)));
    }
    return n;
}

/* Slopes from which on they say nothing: of a rod that makes a few turns they are below 1e4, of one that coils up without
   end they have no bound. */
#define SANE 1e6
/* Most rounds in which a step finds the limits that it would break; part of the squares that must be left after so many
   steps for a run to go on: seeds that end beside the set make up most of them. */
#define ROUNDS 4
#define PART 0.7
#define OFTEN 5
#define LONGEST 1.5 /* step, in units of the scales */

#if WIDE > 1 || LANES > 0
/* Numbers of the contacts and the force at the tip, the conditions, the limits of the shape, those of the forces: out
   (count, 7 (contacts + 1) + 2 + rows, 1 + LANES). */
void trace(const Rod *rod, int count, const double *given, double entered, double *out)
{
    Finger at;
    dual z[NUMBERS], row[ROWS];
    for (; count > 0; count -= WIDE, given += WIDE * numbers_of(rod)) {
        read_numbers(rod, count, given, z);
        integrate(rod, z, 1, &at);
        int rows = conditions(rod, z, &at, row);
        rows += shape_limits(rod, z, &at, entered, row + rows);
        rows += force_limits(rod, z, &at, row + rows);
        for (int lane = 0; lane < WIDE && lane < count; ++lane) {
            out = write_touches(out, rod, &at, lane);
            for (int k = 0; k < rows; ++k)
                out = write_number(out, row + k, lane);
        }
    }
}
#endif

/* Steps of the numbers that change an equilibrium alike. */
static void scale_of(const Rod *rod, const real *z, real *step)
{
    const real least = 0.3 + (real){0};
    for (int k = 0; k < numbers_of(rod); ++k)
        step[k] = 0.35 + (real){0};
    step[3] = 1.5 + (real){0};
    step[1] = step[2] = most_of(least, 0.25 * root(z[1] * z[1] + z[2] * z[2]));
    for (int k = 4; k < 4 + 3 * rod->contacts; k += 3)
        step[k] = 0.04 + (real){0}, step[k + 1] = step[k + 2] = most_of(least, 0.25 * magnitude(z[k + 1]));
}

#if WIDE == 1 && LANES == 0
void scales(const Rod *rod, int count, const double *given, double *step)
{
    const int size = numbers_of(rod);
    for (; count > 0; --count, given += size, step += size)
        scale_of(rod, given, step);
}
#endif

#if LANES > 0
/* Solve a symmetric positive definite system in place by the factors of Cholesky; `a` has its lower triangle. */
#define SOLVE(name, number, largest, square_root)                                                                          \
    static void name(int n, number *a, number *x)                                                                          \
    {                                                                                                                      \
        for (int j = 0; j < n; ++j) {                                                                                      \
            number *row = a + n * j;                                                                                       \
            const number least = 1e-14 * row[j] + 1e-300; /* rounding makes pivots of free directions negative */          \
            for (int k = 0; k < j; ++k)                                                                                    \
                row[j] -= row[k] * row[k];                                                                                 \
            row[j] = square_root(largest(row[j], least));                                                                  \
            for (int i = j + 1; i < n; ++i) {                                                                              \
                for (int k = 0; k < j; ++k)                                                                                \
                    a[n * i + j] -= a[n * i + k] * row[k];                                                                 \
                a[n * i + j] /= row[j];                                                                                    \
            }                                                                                                              \
        }                                                                                                                  \
        for (int i = 0; i < n; ++i) {                                                                                      \
            for (int k = 0; k < i; ++k)                                                                                    \
                x[i] -= a[n * i + k] * x[k];                                                                               \
            x[i] /= a[n * i + i];                                                                                          \
        }                                                                                                                  \
        for (int i = n - 1; i >= 0; --i) {                                                                                 \
            for (int k = i + 1; k < n; ++k)                                                                                \
                x[i] -= a[n * k + i] * x[k];                                                                               \
            x[i] /= a[n * i + i];                                                                                          \
        }                                                                                                                  \
    }
SOLVE(solve, double, fmax, sqrt)
SOLVE(solve_all, real, most_of, root)

typedef struct { real off, squares; whole sane; int equal, rows; dual row[ROWS]; } Residual;

static void residual_of(const Rod *rod, const real *given, double entered, Residual *out)
{
    Finger at;
    dual z[NUMBERS];
    for (int k = 0; k < numbers_of(rod); ++k) {
        z[k] = constant_of(given[k]);
        for (int lane = 0; lane < WIDE; ++lane)
            ((double *)&z[k].d)[WIDE * k + lane] = 1.0;
    }
    integrate(rod, z, 1, &at);
    out->equal = out->rows = conditions(rod, z, &at, out->row);
    out->rows += shape_limits(rod, z, &at, entered, out->row + out->rows);
    out->rows += force_limits(rod, z, &at, out->row + out->rows);
    out->off = out->squares = (real){0}, out->sane = MASK((real){0} == 0.0);
    for (int k = 0; k < out->rows; ++k) {
        for (int j = 0; j < LANES; ++j)
#if WIDE > 1
            out->sane &= magnitude(((const real *)&out->row[k].d)[j]) < SANE;
#else
            out->sane &= MASK(fabs(SLOPE(out->row[k], j, 0)) < SANE);
#endif
        const real value = out->row[k].v, wrong = k < out->equal ? magnitude(value) : most_of(value, (real){0});
        out->off = most_of(wrong, out->off), out->squares += wrong * wrong;
    }
}

/* Slope of a row by one of the numbers. */
static inline real slope_by(const dual *row, int k)
{
#if WIDE > 1
    return ((const real *)&row->d)[k];
#else
    return SLOPE(*row, k, 0);
#endif
}

/* The damped step of Gauss and Newton in units of `step`, for which all limits count that it breaks to first order. */
static void step_onto(const Residual *at, int size, const real *step, real damping, real *move)
{
    const real one = 1.0 + (real){0}, none = {0};
    real a[NUMBERS * NUMBERS], active[ROWS];
    for (int k = 0; k < at->rows; ++k)
        active[k] = k < at->equal ? one : CHOSEN(MASK(at->row[k].v > 0.0), one, none);
    for (int round = 0; round < ROUNDS; ++round) {
        for (int i = 0; i < size; ++i) {
            move[i] = none;
            for (int j = 0; j <= i; ++j)
                a[size * i + j] = i == j ? damping : none;
        }
        for (int k = 0; k < at->rows; ++k) {
            real slope[NUMBERS];
            int some = 0;
            for (int lane = 0; lane < WIDE; ++lane)
                some |= AT(active[k], lane) > 0.0;
            if (!some)
                continue;
            for (int i = 0; i < size; ++i)
                slope[i] = active[k] * slope_by(at->row + k, i) * step[i];
            for (int i = 0; i < size; ++i) {
                move[i] -= slope[i] * at->row[k].v;
                for (int j = 0; j <= i; ++j)
                    a[size * i + j] += slope[i] * slope[j];
            }
        }
        solve_all(size, a, move);
        real most = 1e-12 + none;
        for (int i = 0; i < size; ++i)
            most = most_of(most, magnitude(move[i]));
        const real part = least_of(one, LONGEST / most);
        for (int i = 0; i < size; ++i)
            move[i] *= part;
        real changed = none;
        for (int k = at->equal; k < at->rows; ++k) {
            real value = at->row[k].v;
            for (int i = 0; i < size; ++i)
                value += slope_by(at->row + k, i) * step[i] * move[i];
            const real now = CHOSEN(MASK(value > 0.0), one, none);
            changed += magnitude(active[k] - now), active[k] = now;
        }
        int same = 1;
        for (int lane = 0; lane < WIDE; ++lane)
            same &= !(AT(changed, lane) > 0.0);
        if (same)
            return;
    }
}

/* Equilibria (count, n) brought onto the set within the limits by damped steps of Gauss and Newton; whether each
   landed. Rods side by side are of different rounds: where one is done, the next one begins. */
void onto(const Rod *rod, int count, int rounds, double entered, double close, double *z, int *landed)
{
    const int size = numbers_of(rod);
    Residual here, there;
    real x[NUMBERS], trial[NUMBERS], step[NUMBERS], move[NUMBERS], damping = {0};
    double before[WIDE];
    int row[WIDE], round[WIDE], next = 0;
    for (int lane = 0; lane < WIDE; ++lane)
        row[lane] = -1, round[lane] = 0, before[lane] = INFINITY;
    for (int k = 0; k < size; ++k)
        x[k] = trial[k] = (real){0};
    while (1) {
        int working = 0;
        for (int lane = 0; lane < WIDE; ++lane) {
            if (row[lane] < 0 && next < count) {
                row[lane] = next++, round[lane] = -1, before[lane] = INFINITY, AT(damping, lane) = 1e-3;
                for (int k = 0; k < size; ++k)
                    AT(trial[k], lane) = z[size * row[lane] + k];
            }
            working |= row[lane] >= 0;
        }
        if (!working)
            return;
        residual_of(rod, trial, entered, &there);
        whole taken_over = {0};
        for (int lane = 0; lane < WIDE; ++lane) {
            const int nearer = AT(there.sane, lane) && AT(there.squares, lane) < AT(here.squares, lane);
            const int first = round[lane]++ < 0;
            if (!first)
                AT(damping, lane) = fmin(fmax((nearer ? 0.2 : 5.0) * AT(damping, lane), 1e-7), 1e3);
            AT(taken_over, lane) = first || nearer ? -1 : 0;
        }
        here.equal = there.equal, here.rows = there.rows;
        here.off = CHOSEN(taken_over, there.off, here.off), here.squares = CHOSEN(taken_over, there.squares, here.squares);
        here.sane = (here.sane & ~taken_over) | (there.sane & taken_over);
        for (int k = 0; k < here.rows; ++k)
            here.row[k] = chosen(taken_over, there.row[k], here.row[k]);
        for (int k = 0; k < size; ++k)
            x[k] = CHOSEN(taken_over, trial[k], x[k]);
        for (int lane = 0; lane < WIDE; ++lane) {
            if (row[lane] < 0)
                continue;
            const int inside = AT(here.off, lane) < close;
            int done = round[lane] >= rounds || !AT(here.sane, lane) || inside;
            if (!done && round[lane] % OFTEN == 0) {
                done = AT(here.squares, lane) > PART * before[lane];
                before[lane] = AT(here.squares, lane);
            }
            if (!done)
                continue;
            for (int k = 0; k < size; ++k)
                z[size * row[lane] + k] = AT(x[k], lane);
            landed[row[lane]] = AT(here.sane, lane) && inside;
            row[lane] = -1;
        }
        scale_of(rod, x, step);
        step_onto(&here, size, step, damping, move);
        for (int k = 0; k < size; ++k)
            trial[k] = x[k] + move[k] * step[k];
    }
}
#endif

#if LANES == 0
/* Places beyond the last contact where the gap is least, the first two: out (count, 4) of place and gap, twice; -1 where
   there is none between the bounds. Rods side by side have no contacts yet. */
void nearest(const Rod *rod, int count, const double *given, double low, double high, double *out)
{
    const int contacts = rod->contacts, size = numbers_of(rod);
    for (; count > 0; count -= WIDE, given += WIDE * size, out += WIDE * 4) {
        dual z[NUMBERS];
        read_numbers(rod, count, given, z);
        State q = clamped(rod, z);
        const double h = 1.0 / rod->steps;
        const int side_by_side = count < WIDE ? count : WIDE;
        real before = {0}, last = {0};
        int found[WIDE] = {0}, contact = 0;
        for (int lane = 0; lane < side_by_side; ++lane)
            out[4 * lane] = out[4 * lane + 2] = -1.0, out[4 * lane + 1] = out[4 * lane + 3] = FAR;
        for (int k = 0; k <= rod->steps; ++k) {
            if (k)
                step_by(rod, &q, h, z[3]);
            while (contact < contacts && AT(q.s.v, 0) >= given[4 + 3 * contact]) {
                const Touch at = touch_of(rod, &q);
                pass(rod, &q, &at, z + 4 + 3 * contact, z[3]);
                ++contact;
            }
            const real gap = rough_gap(rod, q.x.v, q.y.v) - along(rod, HALF, q.s).v;
            for (int lane = 0; k > 1 && lane < side_by_side; ++lane) {
                const double a = AT(before, lane), b = AT(last, lane), c = AT(gap, lane);
                if (found[lane] == 2 || !(b <= a && b < c))
                    continue;
                const double bend = a - 2.0 * b + c, off = bend > 0.0 ? 0.5 * (a - c) / bend : 0.0;
                const double at = (k - 1 + off) * h;
                if (at > low && at < high) {
                    double *to = out + 4 * lane + 2 * found[lane]++;
                    to[0] = at, to[1] = b - 0.25 * (a - c) * off;
                }
            }
            before = last, last = gap;
        }
    }
}
#endif
