/* What is exported: where a finger touches as it should, within its limits. */

/* Lengths [L] that count as much as a force of one, as a moment or a bend of its greatest, as a lean of one; the same of
   friction beyond its cone. */
#define FORCE 0.1
#define BEND 0.1
#define LEAN 0.3
/* Bends that are allowed per the range of the finger's own elements, which bend otherwise; least distance of contacts. */
#define LOOSE 1.25
#define APART 0.06

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
    for (int k = 0; k < rod->coordinates; ++k)
        row[n++] = scaled(LEAN, at->feel[k]);
    if (rod->matched) {
        const dual bend = minus(times(along(rod, TENDON, constant(1.0)), z[3]), times(tip->half, at->friction));
        row[n - 1] = scaled(FORCE, minus(z[numbers_of(rod) - 1], bend));
    }
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
        ((double *)&z[k].d)[k] = 1.0;
#endif
    }
}

static double *write_number(double *to, const dual *a, int lane)
{
    *to++ = AT(a->v, lane);
    for (int k = 0; k < LANES; ++k)
        *to++ = ((const double *)&a->d)[k];
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

#if WIDE > 1
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
#else
static inline dual beyond(double limit, dual a) { return (dual){a.v - limit, a.d}; }

/* Excesses of tension and shape over their limits, not above zero within them. */
static int shape_limits(const Rod *rod, const dual *z, const Finger *at, double entered, dual *row)
{
    int n = 0;
    const dual pull = scaled(BEND / rod->moment, z[3]);
    row[n++] = beyond(BEND * rod->pulls[0], pull), row[n++] = beyond(BEND * rod->pulls[1], scaled(-1.0, pull));
    for (int k = 0; k <= rod->contacts; ++k) {
        row[n++] = beyond(entered, scaled(-1.0, at->clear[k]));
        row[n++] = beyond(BEND * LOOSE, scaled(BEND / rod->bend[k], at->bend[k]));
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
        const dual pressed = normal.v > 0.0 ? normal : constant(0.0);
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

/* Numbers of the contacts and the force at the tip, the conditions, the limits of the shape, those of the forces: out
   (count, 7 (contacts + 1) + 2 + rows, 1 + LANES). */
void trace(const Rod *rod, int count, const double *given, double entered, double *out)
{
    Finger at;
    dual z[NUMBERS], row[ROWS];
    for (; count > 0; --count, given += numbers_of(rod)) {
        read_numbers(rod, 1, given, z);
        integrate(rod, z, 1, &at);
        out = write_touches(out, rod, &at, 0);
        int rows = conditions(rod, z, &at, row);
        rows += shape_limits(rod, z, &at, entered, row + rows);
        rows += force_limits(rod, z, &at, row + rows);
        for (int k = 0; k < rows; ++k)
            out = write_number(out, row + k, 0);
    }
}

/* Steps of the numbers that change an equilibrium alike. */
static void scale_of(const Rod *rod, const double *z, double *step)
{
    step[0] = 0.35, step[3] = 1.5;
    step[1] = step[2] = fmax(0.3, 0.25 * sqrt(z[1] * z[1] + z[2] * z[2]));
    for (int k = 4; k < 4 + 3 * rod->contacts; k += 3)
        step[k] = 0.04, step[k + 1] = step[k + 2] = fmax(0.3, 0.25 * fabs(z[k + 1]));
    for (int k = 4 + 3 * rod->contacts; k < numbers_of(rod); ++k)
        step[k] = 0.35;
}

void scales(const Rod *rod, int count, const double *given, double *step)
{
    const int size = numbers_of(rod);
    for (; count > 0; --count, given += size, step += size)
        scale_of(rod, given, step);
}

#if LANES > 0
/* Solve a symmetric positive definite system in place by the factors of Cholesky; `a` has its lower triangle. */
static void solve(int n, double *a, double *x)
{
    for (int j = 0; j < n; ++j) {
        double *row = a + n * j;
        const double least = 1e-14 * row[j] + 1e-300; /* of a pivot: rounding makes those of free directions negative */
        for (int k = 0; k < j; ++k)
            row[j] -= row[k] * row[k];
        row[j] = sqrt(fmax(row[j], least));
        for (int i = j + 1; i < n; ++i) {
            for (int k = 0; k < j; ++k)
                a[n * i + j] -= a[n * i + k] * row[k];
            a[n * i + j] /= row[j];
        }
    }
    for (int i = 0; i < n; ++i) {
        for (int k = 0; k < i; ++k)
            x[i] -= a[n * i + k] * x[k];
        x[i] /= a[n * i + i];
    }
    for (int i = n - 1; i >= 0; --i) {
        for (int k = i + 1; k < n; ++k)
            x[i] -= a[n * k + i] * x[k];
        x[i] /= a[n * i + i];
    }
}

typedef struct { double off, squares; int sane, equal, rows; dual row[ROWS]; } Residual;

static void residual_of(const Rod *rod, const double *given, double entered, Residual *out)
{
    Finger at;
    dual z[NUMBERS];
    read_numbers(rod, 1, given, z);
    integrate(rod, z, 1, &at);
    out->equal = out->rows = conditions(rod, z, &at, out->row);
    out->rows += shape_limits(rod, z, &at, entered, out->row + out->rows);
    out->rows += force_limits(rod, z, &at, out->row + out->rows);
    out->off = out->squares = 0.0, out->sane = 1;
    for (int k = 0; k < out->rows; ++k) {
        const double *slope = (const double *)&out->row[k].d;
        for (int lane = 0; lane < LANES; ++lane)
            if (!(fabs(slope[lane]) < SANE))
                out->sane = 0;
        const double wrong = k < out->equal ? fabs(out->row[k].v) : fmax(out->row[k].v, 0.0);
        out->off = fmax(out->off, wrong), out->squares += wrong * wrong;
    }
}

/* The damped step of Gauss and Newton in units of `step`, for which all limits count that it breaks to first order. */
static void step_onto(const Residual *at, int size, const double *step, double damping, double *move)
{
    double a[NUMBERS * NUMBERS];
    int active[ROWS];
    for (int k = 0; k < at->rows; ++k)
        active[k] = k < at->equal || at->row[k].v > 0.0;
    for (int round = 0; round < ROUNDS; ++round) {
        for (int i = 0; i < size; ++i) {
            move[i] = 0.0;
            for (int j = 0; j <= i; ++j)
                a[size * i + j] = i == j ? damping : 0.0;
        }
        for (int k = 0; k < at->rows; ++k) {
            if (!active[k])
                continue;
            const double *slope = (const double *)&at->row[k].d;
            for (int i = 0; i < size; ++i) {
                const double scaled_slope = slope[i] * step[i];
                move[i] -= scaled_slope * at->row[k].v;
                for (int j = 0; j <= i; ++j)
                    a[size * i + j] += scaled_slope * slope[j] * step[j];
            }
        }
        solve(size, a, move);
        double most = 1e-12;
        for (int i = 0; i < size; ++i)
            most = fmax(most, fabs(move[i]));
        for (int i = 0; i < size; ++i)
            move[i] *= fmin(1.0, LONGEST / most);
        int same = 1;
        for (int k = at->equal; k < at->rows; ++k) {
            const double *slope = (const double *)&at->row[k].d;
            double value = at->row[k].v;
            for (int i = 0; i < size; ++i)
                value += slope[i] * step[i] * move[i];
            same &= active[k] == (value > 0.0);
            active[k] = value > 0.0;
        }
        if (same)
            return;
    }
}

/* Equilibria (count, n) brought onto the set within the limits by damped steps of Gauss and Newton; whether each
   landed. */
void onto(const Rod *rod, int count, int rounds, double entered, double close, double *z, int *landed)
{
    const int size = numbers_of(rod);
    Residual pair[2], *here = pair, *there = pair + 1;
    for (; count > 0; --count, z += size) {
        double damping = 1e-3, before = INFINITY, step[NUMBERS], trial[NUMBERS], move[NUMBERS];
        residual_of(rod, z, entered, here);
        for (int round = 0; round < rounds && here->sane && here->off >= close; ++round) {
            if (round % OFTEN == 0) {
                if (here->squares > PART * before)
                    break;
                before = here->squares;
            }
            scale_of(rod, z, step);
            step_onto(here, size, step, damping, move);
            for (int i = 0; i < size; ++i)
                trial[i] = z[i] + move[i] * step[i];
            residual_of(rod, trial, entered, there);
            const int nearer = there->sane && there->squares < here->squares;
            if (nearer) {
                for (int i = 0; i < size; ++i)
                    z[i] = trial[i];
                Residual *other = here;
                here = there, there = other;
            }
            damping = fmin(fmax(nearer ? 0.2 * damping : 5.0 * damping, 1e-7), 1e3);
        }
        *landed++ = here->sane && here->off < close;
    }
}
#endif

static double *write_place(double *to, const State *q, dual bent)
{
    *to++ = q->s.v, *to++ = bent.v, *to++ = q->x.v, *to++ = q->y.v;
    return to;
}

/* The curve: rows of place, curvature, x, y of one equilibrium, where each step begins and where it ends. */
int curve(const Rod *rod, const double *given, double *out)
{
    const int contacts = rod->contacts;
    dual z[NUMBERS];
    read_numbers(rod, 1, given, z);
    State q = clamped(rod, z);
    double begin = 0.0;
    const double *first = out;
    for (int segment = 0; segment <= contacts; ++segment) {
        const double end = segment < contacts ? given[4 + 3 * segment] : 1.0;
        const int steps = steps_of(rod);
        for (int k = segment * steps; k < (segment + 1) * steps; ++k) {
            out = write_place(out, &q, bent_from(rod, &q, z, k));
            step_by(rod, &q, (end - begin) / steps, z, k);
            out = write_place(out, &q, q.bent);
        }
        if (segment < contacts) {
            const Touch at = touch_of(rod, &q);
            pass(rod, &q, &at, z + 4 + 3 * segment, z[3]);
        }
        begin = end;
    }
    return (int)(out - first) / 4;
}

/* Moments that bend exact rods (count, 4 + 3 contacts) where the steps of all segments begin. */
void moments(const Rod *elements, int count, const double *given, double *out)
{
    Rod rod = *elements;
    rod.coordinates = 0;
    for (; count > 0; --count, given += numbers_of(&rod)) {
        dual z[NUMBERS];
        read_numbers(&rod, 1, given, z);
        State q = clamped(&rod, z);
        double begin = 0.0;
        for (int segment = 0, steps = steps_of(&rod); segment <= rod.contacts; ++segment) {
            const double end = segment < rod.contacts ? given[4 + 3 * segment] : 1.0;
            for (int k = 0; k < steps; ++k) {
                *out++ = along(&rod, STIFFNESS, q.s).v * (q.bent.v - along(&rod, REST, q.s).v);
                step_by(&rod, &q, (end - begin) / steps, z, 0);
            }
            if (segment < rod.contacts) {
                const Touch at = touch_of(&rod, &q);
                pass(&rod, &q, &at, z + 4 + 3 * segment, z[3]);
            }
            begin = end;
        }
    }
}

/* Places beyond the last contact where the gap is least, the first two: out (count, 4) of place and gap, twice; -1 where
   there is none between the bounds. */
void nearest(const Rod *rod, int count, const double *given, double low, double high, double *out)
{
    const int contacts = rod->contacts, size = numbers_of(rod);
    for (int row = 0; row < count; ++row, given += size, out += 4) {
        dual z[NUMBERS];
        read_numbers(rod, 1, given, z);
        State q = clamped(rod, z);
        const double h = 1.0 / rod->steps;
        double before = 0.0, last = 0.0;
        int found = 0, contact = 0;
        out[0] = out[2] = -1.0, out[1] = out[3] = FAR;
        for (int k = 0; k <= rod->steps && found < 2; ++k) {
            if (k)
                step_by(rod, &q, h, z, 0);
            while (contact < contacts && q.s.v >= given[4 + 3 * contact]) {
                const Touch at = touch_of(rod, &q);
                pass(rod, &q, &at, z + 4 + 3 * contact, z[3]);
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
#endif
