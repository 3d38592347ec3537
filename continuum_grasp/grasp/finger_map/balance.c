/* Fingers and supports in one balance of the object: constraints and tension of combinations, and steps to their optimum.

   Unknowns x of a combination are the numbers of each finger, normal force and friction of each support, and the lift of
   each contact, where the object is lifted; forces are in units of `force`. */

/* 0.3: a force of the object's weight counts as much as so many lengths */
#define WEIGHED 0.3
/* Rounding of a finger's moment per its greatest, else straight fingers stall, and of friction per force. */
#define STRAIGHT 1e-3
#define SLIGHT 1e-8

typedef struct {
    int fingers, supports, contacts, lifted, tilts, numbers, equal, rows;
    double center[2], size, weight[2], lift, force;
    const Rod *const *rod;
    const double *finger;  /* (fingers, 3): length, unit of force, greatest tension per that of all */
    const double *support; /* (supports, 4): point, normal */
    const double *cone;    /* (contacts, 2): friction coefficient, greatest normal force */
    const double *step;    /* (numbers,): what changes a combination alike */
} Balance;

#if LANES > 0
/* What a finger or a support has at a contact, by the `count` unknowns from `at` on. */
typedef struct { dual x, y, nx, ny, normal, along; int at, count; } Contact;

/* A combination: constraints that vanish, then those that are not above zero, and the tension per the greatest; slopes by
   steps of the unknowns. */
typedef struct { double tension, *x, *value, *pull, *slope; } Held;

static double *slopes_of(const Balance *b, Held *to, int row) { return to->slope + row * b->numbers; }

/* Add a number of all combinations side by side, `to` (WIDE). */
static void add(const Balance *b, real factor, dual a, int at, int count, int lane, double *value, double *slope)
{
    *value += AT(factor, lane) * AT(a.v, lane);
    for (int k = 0; k < count; ++k)
        slope[at + k] += AT(factor, lane) * SLOPE(a, k, lane) * b->step[at + k];
}

static void add_row(const Balance *b, real factor, dual a, const Contact *by, Held *to, int row)
{
    for (int lane = 0; lane < WIDE; ++lane)
        add(b, factor, a, by->at, by->count, lane, to[lane].value + row, slopes_of(b, to + lane, row));
}

static inline real number(double value) { return value + (real){0}; }

/* One of the unknowns of all combinations. */
static real unknown_of(const Held *at, int k)
{
    real value = number(0.0);
    for (int lane = 0; lane < WIDE; ++lane)
        AT(value, lane) = at[lane].x[k];
    return value;
}

static Contact finger_contact(const Rod *rod, const double *unit, const Finger *at, const dual *z, int k, int first)
{
    const Touch *touch = at->touch + k;
    const int tip = k == rod->contacts;
    return (Contact){
        scaled(unit[0], minus(touch->x, times(touch->half, touch->nx))),
        scaled(unit[0], minus(touch->y, times(touch->half, touch->ny))), touch->nx, touch->ny,
        scaled(unit[1], tip ? at->normal : z[5 + 3 * k]), scaled(unit[1], tip ? at->friction : z[6 + 3 * k]),
        first, numbers_of(rod)};
}

static Contact support_contact(const Balance *b, int k, const Held *at, int first)
{
    const double *s = b->support + 4 * k;
    dual force[2];
    for (int j = 0; j < 2; ++j) {
        force[j] = constant_of(b->force * unknown_of(at, first + j));
        for (int lane = 0; lane < WIDE; ++lane)
            ((double *)&force[j].d)[WIDE * j + lane] = b->force;
    }
    return (Contact){constant(s[0]), constant(s[1]), constant(s[2]), constant(s[3]), force[0], force[1], first, 2};
}

/* The fingers' own constraints and tension; their contacts. */
static void add_fingers(const Balance *b, Held *to, Contact *contact, int *equal, int *below)
{
    const real one = number(1.0);
    int first = 0;
    for (int f = 0; f < b->fingers; ++f) {
        const Rod *rod = b->rod[f];
        const int size = numbers_of(rod);
        Finger at;
        dual z[NUMBERS], row[ROWS];
        for (int k = 0; k < size; ++k) {
            z[k] = constant_of(unknown_of(to, first + k));
            for (int lane = 0; lane < WIDE; ++lane)
                ((double *)&z[k].d)[WIDE * k + lane] = 1.0;
        }
        integrate(rod, z, 1, &at);
        for (int k = 0; k < rod->contacts + rod->tip; ++k)
            *contact++ = finger_contact(rod, b->finger + 3 * f, &at, z, k, first);
        const Contact of_finger = {.at = first, .count = size};
        for (int n = conditions(rod, z, &at, row), k = 0; k < n; ++k)
            add_row(b, one, row[k], &of_finger, to, (*equal)++);
        for (int n = shape_limits(rod, z, &at, 0.0, row), k = 0; k < n; ++k)
            add_row(b, one, row[k], &of_finger, to, (*below)++);
        const dual pull = scaled(1.0 / rod->moment, z[3]);
        const real size_of_pull = root(pull.v * pull.v + STRAIGHT * STRAIGHT);
        const dual rounded = with(pull, size_of_pull, pull.v / size_of_pull);
        for (int lane = 0; lane < WIDE; ++lane)
            add(b, number(b->finger[3 * f + 2]), rounded, first, size, lane, &to[lane].tension, to[lane].pull);
        first += size;
    }
    for (int k = 0; k < b->supports; ++k, first += 2)
        *contact++ = support_contact(b, k, to, first);
}

/* Balance of the object: forces and moment, lift and tilt. */
static void add_balance(const Balance *b, Held *to, const Contact *contact, int row)
{
    const double unit = WEIGHED / b->force, arm = unit / b->size;
    const int lifts = b->numbers - b->contacts;
    for (int lane = 0; lane < WIDE; ++lane) {
        to[lane].value[row] = unit * b->weight[0], to[lane].value[row + 1] = unit * b->weight[1];
        if (b->lifted)
            to[lane].value[row + 3] = -unit * b->lift;
    }
    for (int k = 0; k < b->contacts; ++k) {
        const Contact *c = contact + k;
        const dual fx = minus(times(c->normal, c->nx), times(c->along, c->ny));
        const dual fy = plus(times(c->normal, c->ny), times(c->along, c->nx));
        const dual rx = minus(c->x, constant(b->center[0])), ry = minus(c->y, constant(b->center[1]));
        add_row(b, number(-unit), fx, c, to, row), add_row(b, number(-unit), fy, c, to, row + 1);
        add_row(b, number(arm), minus(times(ry, fx), times(rx, fy)), c, to, row + 2);
        if (!b->lifted)
            continue;
        const int at = lifts + k;
        const real up = b->force * unknown_of(to, at);
        for (int lane = 0; lane < WIDE; ++lane) {
            to[lane].value[row + 3] += unit * AT(up, lane);
            slopes_of(b, to + lane, row + 3)[at] += unit * b->force * b->step[at];
        }
        for (int j = 0; b->tilts && j < 2; ++j) {
            const dual r = j ? ry : rx;
            add_row(b, arm * up, r, c, to, row + 4 + j);
            for (int lane = 0; lane < WIDE; ++lane)
                slopes_of(b, to + lane, row + 4 + j)[at] += arm * AT(r.v, lane) * b->force * b->step[at];
        }
    }
}

/* Friction within its cone, normal forces between zero and their greatest. */
static void add_cones(const Balance *b, Held *to, const Contact *contact, int row)
{
    const double unit = WEIGHED / b->force, rounded = SLIGHT * b->force;
    const int lifts = b->numbers - b->contacts;
    for (int k = 0; k < b->contacts; ++k, row += 3) {
        const Contact *c = contact + k;
        const real up = b->lifted ? b->force * unknown_of(to, lifts + k) : number(0.0);
        const real shear = root(c->along.v * c->along.v + up * up + rounded * rounded);
        add_row(b, number(unit), with(c->along, shear, c->along.v / shear), c, to, row);
        for (int lane = 0; b->lifted && lane < WIDE; ++lane)
            slopes_of(b, to + lane, row)[lifts + k] +=
                unit * AT(up, lane) / AT(shear, lane) * b->force * b->step[lifts + k];
        add_row(b, number(-unit * b->cone[2 * k]), c->normal, c, to, row);
        add_row(b, number(-unit), c->normal, c, to, row + 1);
        add_row(b, number(1.0 / b->cone[2 * k + 1]), c->normal, c, to, row + 2);
        for (int lane = 0; lane < WIDE; ++lane)
            to[lane].value[row + 2] -= 1.0;
    }
}

/* Constraints and tension of combinations side by side (WIDE); what coils up without end is as wrong as can be. */
static void reach(const Balance *b, Held *to)
{
    Contact contact[b->contacts];
    int equal = 0, below = b->equal;
    const int entries = b->rows * b->numbers;
    for (int lane = 0; lane < WIDE; ++lane) {
        Held *one = to + lane;
        one->tension = 0.0;
        memset(one->value, 0, b->rows * sizeof(double)), memset(one->slope, 0, entries * sizeof(double));
        memset(one->pull, 0, b->numbers * sizeof(double));
    }
    add_fingers(b, to, contact, &equal, &below);
    add_balance(b, to, contact, equal);
    add_cones(b, to, contact, below);
    for (int lane = 0; lane < WIDE; ++lane) {
        Held *one = to + lane;
        int sane = 1;
        for (int k = 0; k < entries; ++k)
            sane &= fabs(one->slope[k]) < SANE;
        if (sane)
            continue;
        memset(one->slope, 0, entries * sizeof(double));
        for (int k = 0; k < b->rows; ++k)
            one->value[k] = 1e3;
    }
}

static double wrong_by(const Balance *b, const double *value, int row)
{
    return row < b->equal ? value[row] : fmax(value[row], 0.0);
}

static double merit(const Balance *b, const Held *at, double stiff)
{
    double squares = 0.0;
    for (int k = 0; k < b->rows; ++k)
        squares += wrong_by(b, at->value, k) * wrong_by(b, at->value, k);
    return at->tension + 0.5 * stiff * squares;
}

/* Normal equations of a penalty of what is wrong with `value`, and of a gradient; the lower triangle. */
static void normal_equations(const Balance *b, const double *slope, const double *value, double stiff, double *matrix,
                             double *gradient)
{
    const int n = b->numbers;
    memset(matrix, 0, n * n * sizeof(double));
    for (int k = 0; k < b->rows; ++k, slope += n) {
        if (k >= b->equal && !(value[k] > 0.0))
            continue;
        for (int i = 0; i < n; ++i) {
            const double part = stiff * slope[i];
            gradient[i] += part * value[k];
            for (int j = 0; j <= i && part != 0.0; ++j)
                matrix[n * i + j] += part * slope[j];
        }
    }
}

static double longest(int n, const double *move)
{
    double most = 1e-12;
    for (int k = 0; k < n; ++k)
        most = fmax(most, fabs(move[k]));
    return most;
}

/* The move against a gradient, which may have `more` on the diagonal of its matrix. */
static void newton(int n, const double *matrix, double more, const double *gradient, double *factors, double *move)
{
    memcpy(factors, matrix, n * n * sizeof(double));
    for (int k = 0; k < n; ++k)
        factors[(n + 1) * k] += more, move[k] = -gradient[k];
    solve(n, factors, move);
}

static void moved(const Balance *b, const Held *from, double part, const double *move, Held *to)
{
    for (int k = 0; k < b->numbers; ++k)
        to->x[k] = from->x[k] + part * move[k] * b->step[k];
}

static void exchange(Held *a, Held *b) { const Held other = *a; *a = *b, *b = other; }

/* Residual of the constraint that is violated most. */
static double most_wrong(const Balance *b, const Held *at)
{
    double most = 0.0;
    for (int k = 0; k < b->rows; ++k)
        most = fmax(most, fabs(wrong_by(b, at->value, k)));
    return most;
}

static double *held_in(const Balance *b, Held *at, double *memory)
{
    at->x = memory, at->pull = at->x + b->numbers, at->value = at->pull + b->numbers, at->slope = at->value + b->rows;
    return at->slope + b->rows * b->numbers;
}

/* A combination that moves towards the least tension: a penalty that grows, and damped steps of Gauss and Newton. */
typedef struct { int row, round, attempt; double damping, before, stiff, *matrix, *factors, *gradient, *move; } Settling;

#define DAMPINGS 4 /* that are tried */
#define GROWN 0.6  /* part of the rounds after which the penalty grows no more */

static void next_step(const Balance *b, const Held *here, Settling *at, Held *there)
{
    newton(b->numbers, at->matrix, at->damping, at->gradient, at->factors, at->move);
    moved(b, here, fmin(1.0, 0.5 / longest(b->numbers, at->move)), at->move, there);
}

static void next_round(const Balance *b, int rounds, const Held *here, Settling *at, Held *there)
{
    at->stiff = 30.0 * pow(1000.0, fmin(1.0, at->round / (GROWN * rounds)));
    at->attempt = 0, at->before = merit(b, here, at->stiff);
    memcpy(at->gradient, here->pull, b->numbers * sizeof(double));
    normal_equations(b, here->slope, here->value, at->stiff, at->matrix, at->gradient);
    next_step(b, here, at, there);
}

/* Take in what a step has reached, and step on; whether the last round is over. */
static int settled(const Balance *b, int rounds, Held *here, Settling *at, Held *there)
{
    if (at->round < 0) {
        exchange(here, there);
    } else {
        const int better = merit(b, there, at->stiff) < at->before;
        at->damping = fmin(fmax((better ? 0.3 : 5.0) * at->damping, 1e-7), 1e6);
        if (better)
            exchange(here, there);
        else if (++at->attempt < DAMPINGS) {
            next_step(b, here, at, there);
            return 0;
        }
        if (at->round >= GROWN * rounds && longest(b->numbers, at->move) < 1e-9)
            return 1;
    }
    if (++at->round >= rounds)
        return 1;
    next_round(b, rounds, here, at, there);
    return 0;
}

/* Bring combinations (count, numbers) to the least tension, from afar; what is wrong with each at most. Those side by side
   are of different rounds: where one is done, the next one begins. 0: there is no memory. */
int settle(const Balance *b, int count, int rounds, double *x, double *off)
{
    const int n = b->numbers, of_held = (b->rows + 2) * (n + 1), of_one = 2 * of_held + 2 * n * (n + 1);
    double *memory = calloc(WIDE * of_one, sizeof(double)), *rest = memory;
    Held here[WIDE], there[WIDE];
    Settling at[WIDE];
    int next = 0;
    if (!memory)
        return 0;
    for (int lane = 0; lane < WIDE; ++lane) {
        Settling *one = at + lane;
        rest = held_in(b, there + lane, held_in(b, here + lane, rest));
        one->row = -1, one->matrix = rest, one->factors = rest + n * n, one->gradient = one->factors + n * n;
        one->move = one->gradient + n, rest = one->move + n;
    }
    while (1) {
        int working = 0;
        for (int lane = 0; lane < WIDE; ++lane) {
            if (at[lane].row < 0 && next < count) {
                at[lane].row = next++, at[lane].round = -1, at[lane].damping = 1e-2;
                memcpy(there[lane].x, x + n * at[lane].row, n * sizeof(double));
            }
            working |= at[lane].row >= 0;
        }
        if (!working)
            break;
        reach(b, there);
        for (int lane = 0; lane < WIDE; ++lane) {
            if (at[lane].row < 0 || !settled(b, rounds, here + lane, at + lane, there + lane))
                continue;
            memcpy(x + n * at[lane].row, here[lane].x, n * sizeof(double));
            off[at[lane].row] = most_wrong(b, here + lane);
            at[lane].row = -1;
        }
    }
    free(memory);
    return 1;
}

#endif

#if WIDE == 1 && LANES == 0
typedef struct { double at; int row; } Placed;

static int by_place(const void *a, const void *b)
{
    const double first = ((const Placed *)a)->at, other = ((const Placed *)b)->at;
    return (first > other) - (first < other);
}

/* Rows (count, most) of the points (size, 3) that are nearest to places (count, 3), the nearest first: on both sides of a
   place along the first axis, until all others are farther along it. 0: there is no memory. */
int closest(int size, int count, int most, const double *point, const double *place, int *out)
{
    Placed *order = malloc(size * sizeof(Placed));
    double *sorted = malloc(3 * size * sizeof(double)), *best = malloc(most * sizeof(double));
    const int ready = order && sorted && best;
    for (int k = 0; ready && k < size; ++k)
        order[k] = (Placed){point[3 * k], k};
    if (ready)
        qsort(order, size, sizeof(Placed), by_place);
    for (int k = 0; ready && k < size; ++k)
        memcpy(sorted + 3 * k, point + 3 * order[k].row, 3 * sizeof(double));
    for (; ready && count > 0; --count, place += 3, out += most) {
        int low = 0, high = size;
        while (low < high) {
            const int middle = (low + high) / 2;
            if (order[middle].at < place[0])
                low = middle + 1;
            else
                high = middle;
        }
        for (int k = 0; k < most; ++k)
            best[k] = INFINITY, out[k] = 0;
        for (int before = low - 1, after = low; before >= 0 || after < size;) {
            const double left = before >= 0 ? place[0] - order[before].at : INFINITY;
            const double right = after < size ? order[after].at - place[0] : INFINITY;
            const double along = fmin(left, right);
            if (!(along * along < best[most - 1]))
                break;
            const int at = left < right ? before-- : after++;
            const double *p = sorted + 3 * at, y = p[1] - place[1], z = p[2] - place[2];
            const double squares = along * along + y * y + z * z;
            int k = most;
            for (; k > 0 && squares < best[k - 1]; --k)
                if (k < most)
                    best[k] = best[k - 1], out[k] = out[k - 1];
            if (k < most)
                best[k] = squares, out[k] = order[at].row;
        }
    }
    free(order), free(sorted), free(best);
    return ready;
}

/* The first `most` of rows (count, size) that are farther than `apart` from all those before them that are chosen; their
   number. */
int differing(int count, int size, int most, double apart, const double *place, int *chosen)
{
    int found = 0;
    for (int row = 0; row < count && found < most; ++row) {
        int differs = 1;
        for (int k = 0; k < found && differs; ++k) {
            const double *a = place + row * size, *b = place + chosen[k] * size;
            double squares = 0.0;
            for (int i = 0; i < size; ++i)
                squares += (a[i] - b[i]) * (a[i] - b[i]);
            differs = squares > apart * apart;
        }
        if (differs)
            chosen[found++] = row;
    }
    return found;
}
#endif
