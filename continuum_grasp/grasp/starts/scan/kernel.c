/* The inner loops of the scan: distances of many postures from an object, and forces that come closest to balance.

   Arrays are C-contiguous. `kernel.py` calls these; each has its like in numpy, which says what it computes. */

#if defined __GNUC__ && !defined __clang__
#pragma GCC optimize("O2", "tree-vectorize")  /* as fast as -O3, for which gcc 12 needs 0.9 s instead of 0.4 s */
#endif

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { LANES = 4 };  /* systems that are solved side by side: a vector of 256 bits */

static inline double less(double a, double b)
{
    return a < b ? a : b;
}

static inline double more(double a, double b)
{
    return a > b ? a : b;
}

/* Sines and cosines of angles below 1e5, to rounding. Unlike those of the library, the compiler makes vectors of it:
   reduction by multiples of pi / 2 in three parts, polynomials of W. J. Cody and W. Waite as in Cephes. */
static void turns(int count, const double *restrict angle, double *restrict sines, double *restrict cosines)
{
    const double whole = 0x1.8p52;  /* added and taken away: rounds to whole numbers */
    for (int k = 0; k < count; ++k) {
        const double n = (angle[k] * 0.63661977236758134308 + whole) - whole;
        const double x = ((angle[k] - n * 0x1.921fb544p0) - n * 0x1.0b4611a6p-34) - n * 0x1.3198a2e037073p-69;
        const double z = x * x;
        const double s = x + x * z * (-1.66666666666666307295e-1 + z * (8.33333333332211858878e-3 + z *
            (-1.98412698295895385996e-4 + z * (2.75573136213857245213e-6 + z * (-2.50507477628578072866e-8 + z *
            1.58962301576546568060e-10)))));
        const double c = 1.0 - 0.5 * z + z * z * (4.16666666666665929218e-2 + z * (-1.38888888888730564116e-3 + z *
            (2.48015872888517045348e-5 + z * (-2.75573141792967388112e-7 + z * (2.08757008419747316778e-9 - z *
            1.13585365213876817300e-11)))));
        const double quarter = n - 4.0 * ((0.25 * n + whole) - whole);  /* -2 to 2 */
        const double odd = quarter * quarter;
        const double a = odd == 1.0 ? c : s, b = odd == 1.0 ? s : c;
        sines[k] = ((quarter < 0.0) | (quarter > 1.5)) ? -a : a;
        cosines[k] = ((quarter > 0.5) | (quarter < -1.5)) ? -b : b;
    }
}

enum { POLYGON, SUPERELLIPSE };

/* Signed distance from one part, as of `rough_distance` of its outline. A polygon of one corner is a disc. */
static double from_polygon(int count, const double *shape, double x, double y)
{
    const double radius = shape[0], slot = shape[1], *edge = shape + 2;
    if (count == 1)
        return hypot(x - edge[0], y - edge[1]) - radius;
    double least = HUGE_VAL, height = 0.0, over = 0.0;
    int best = 0;
    for (int k = 0; k < count; ++k, edge += 5) {  /* corner, direction, length */
        const double dx = x - edge[0], dy = y - edge[1];
        const double along = dx * edge[2] + dy * edge[3], out = dx * edge[3] - dy * edge[2];
        const double beyond = along - less(more(along, 0.0), edge[4]);
        const double square = beyond * beyond + out * out + (count == 2 && out < 0.0 ? slot : 0.0);
        if (square < least) {
            least = square;
            best = k;
            height = out;
            over = beyond;
        }
    }
    const double core = sqrt(over * over + height * height);
    if (count > 2 && over != 0.0) {
        /* At a corner both faces say together on which side a point lies: one alone does not, where it is acute. */
        edge = shape + 2 + 5 * ((best + (over > 0.0 ? 1 : count - 1)) % count);
        height += (x - edge[0]) * edge[3] - (y - edge[1]) * edge[2];
    }
    return (count > 2 && height < 0.0 ? -core : core) - radius;
}

static double from_superellipse(int count, const double *shape, double x, double y)
{
    const double dx = x - shape[0], dy = y - shape[1];
    const double u = fabs(dx * shape[2] + dy * shape[3]), v = fabs(dy * shape[2] - dx * shape[3]);
    /* Tangents, one property after the other: normals, distances from the center, points, radii. */
    const double *nx = shape + 4, *ny = nx + count, *reach = ny + count, *px = reach + count, *py = px + count;
    const double *radius = py + count;
    double gap = -HUGE_VAL;
    int best = 0;
    for (int k = 0; k < count; ++k) {
        const double height = u * nx[k] + v * ny[k] - reach[k];
        if (height > gap) {
            gap = height;
            best = k;
        }
    }
    const double slide = (v - py[best]) * nx[best] - (u - px[best]) * ny[best];
    return gap + 0.5 * slide * slide / more(gap + radius[best], 4.0 * fabs(slide) + 1e-12);
}

/* The least of the distances from all parts; `object` has for each its kind, count, length of its numbers, numbers. */
static double distance(const double *object, double x, double y)
{
    double least = HUGE_VAL;
    for (int left = (int)*object++; left > 0; --left) {
        const int kind = (int)object[0], count = (int)object[1], size = (int)object[2];
        const double *shape = object + 3;
        const double found = kind == POLYGON ? from_polygon(count, shape, x, y) : from_superellipse(count, shape, x, y);
        least = less(least, found);
        object = shape + size;
    }
    return least;
}

int distances(int count, const double *object, const double *points, double *out)
{
    for (int k = 0; k < count; ++k)
        out[k] = distance(object, points[2 * k], points[2 * k + 1]);
    return 0;
}

/* As `curves.sample`: points at increasing places, the first of which is 0. 0 unless there is no memory. */
int sample(int count, int knots, int places, const double *knot, const double *bent, const double *at, double *out)
{
    const double node[2] = {0.5 - 0.5 / sqrt(3.0), 0.5 + 0.5 / sqrt(3.0)};
    const int size = 2 * (places - 1);
    double *angle = malloc((3 * size + 1) * sizeof *angle), *sines = angle + size, *cosines = sines + size;
    if (!angle)
        return 1;
    for (int b = 0; b < count; ++b, knot += knots, bent += knots, at += places) {
        double turned = 0.0, x = 0.0, y = 0.0;
        int piece = 0;
        for (int s = 0; s < size; ++s) {
            const double here = at[s / 2] + node[s % 2] * (at[s / 2 + 1] - at[s / 2]);
            /* What whole intervals before turn is known once they are passed; before and beyond all, it is none. */
            while (piece < knots - 1 && here >= knot[piece + 1]) {
                turned += 0.5 * (knot[piece + 1] - knot[piece]) * (bent[piece] + bent[piece + 1]);
                ++piece;
            }
            angle[s] = turned;
            if (piece < knots - 1 && here > knot[piece]) {
                const double u = here - knot[piece];
                const double slope = (bent[piece + 1] - bent[piece]) / (knot[piece + 1] - knot[piece]);
                angle[s] += u * (bent[piece] + 0.5 * slope * u);
            }
        }
        turns(size, angle, sines, cosines);
        *out++ = x;
        *out++ = y;
        for (int s = 0; s < size; s += 2) {
            const double half = 0.5 * (at[s / 2 + 1] - at[s / 2]);
            *out++ = x -= half * (sines[s] + sines[s + 1]);
            *out++ = y += half * (cosines[s] + cosines[s + 1]);
        }
    }
    free(angle);
    return 0;
}

/* Distance from the object of the end of a curve from a point (x, y, turn, length) with linear curvature, by a Gauss
   rule of `size` nodes, at most 16. */
static double tip_gap(int size, const double *object, const double *node, const double *weight, const double *from,
                      double first, double last)
{
    double angle[16] = {0.0}, sines[16], cosines[16], x = 0.0, y = 0.0;
    for (int g = 0; g < size; ++g) {
        const double late = 0.5 * node[g] * node[g];
        angle[g] = from[2] + from[3] * (first * (node[g] - late) + last * late);
    }
    turns(size, angle, sines, cosines);
    for (int g = 0; g < size; ++g) {
        x -= weight[g] * sines[g];
        y += weight[g] * cosines[g];
    }
    return distance(object, from[0] + from[3] * x, from[1] + from[3] * y);
}

/* Such distances for lines of `lines` last curvatures each; where `arc`, the first is the last. */
int tip_gaps(int count, int lines, int size, int arc, const double *object, const double *node, const double *weight,
             const double *from, const double *first, const double *last, double *out)
{
    for (int b = 0; b < count; ++b, from += 4)
        for (int k = 0; k < lines; ++k, ++last)
            *out++ = tip_gap(size, object, node, weight, from, arc ? *last : first[b], *last);
    return 0;
}

/* As `touching.bracketed_root` for `count` brackets (low, high, gap at low, gap at high), property after property: the
   last curvatures with which such distances are `half`. */
int tip_roots(int count, int size, int arc, int steps, double half, double rounded, const double *object,
              const double *node, const double *weight, const double *from, const double *first, const double *ends,
              double *out)
{
    for (int k = 0; k < count; ++k, from += 4) {
        double a = ends[k], b = ends[count + k], fa = ends[2 * count + k], fb = ends[3 * count + k];
        for (int step = 0; step < steps; ++step) {
            const double x = b - fb * (b - a) / (fb == fa ? 1.0 : fb - fa);
            const double fx = tip_gap(size, object, node, weight, from, arc ? x : first[k], x) - half;
            const int crossed = fb * fx < 0.0;
            a = crossed ? b : a;
            fa = crossed ? fb : 0.5 * fa;
            b = x;
            fb = fx;
            if (fabs(fx) < rounded)
                break;
        }
        out[k] = b;
    }
    return 0;
}

/* As `curves.exact_bends`, with a Gauss rule (node, weight): first curvatures next to guesses, lengths, and whether they
   were found, property after property. The aims are unit vectors. */
int exact_bends(int count, int size, const double *node, const double *weight, const double *aim, const double *turn,
                const double *guess, double *out)
{
    double angle[16], sines[16], cosines[16];
    for (int b = 0; b < count; ++b) {
        const double c = aim[2 * b], s = -aim[2 * b + 1];
        double bend = guess[b], along = 0.0, off = 0.0;
        for (int step = 0; step < 5; ++step) {
            double x = 0.0, y = 0.0, dx = 0.0, dy = 0.0;
            for (int g = 0; g < size; ++g)
                angle[g] = bend * (node[g] - node[g] * node[g]) + turn[b] * node[g] * node[g];
            turns(size, angle, sines, cosines);
            for (int g = 0; g < size; ++g) {
                const double early = weight[g] * (node[g] - node[g] * node[g]);
                x -= weight[g] * sines[g];
                y += weight[g] * cosines[g];
                dx -= early * cosines[g];
                dy -= early * sines[g];
            }
            along = x * c - y * s;
            off = x * s + y * c;
            if (step == 4)
                break;
            const double fall = dx * s + dy * c;
            bend -= off / (fabs(fall) < 1e-9 ? 1e-9 : fall);
        }
        out[b] = bend;
        out[count + b] = along;
        out[2 * count + b] = off;
    }
    return 0;
}

/* As `curves.bends_to` finds brackets: from tables (2, rows, columns) of chords by their parts, linear between rows at
   `at`; the row and the column, with the share of the way to the next, of each change of sign across the direction of
   an aim, a unit vector. The first number is how many there are. */
int crossings(int count, int rows, int columns, int first, int last, const double *table, const double *aim,
              const double *at, double *out)
{
    int found = 0;
    for (int b = 0; b < count; ++b) {
        const int row = (int)less(more(at[b], 0.0), rows - 2.0);
        const double share = at[b] - row, c = aim[2 * b], s = -aim[2 * b + 1];
        const double *x = table + row * columns, *y = x + rows * columns;
        double old_x = 0.0, old_y = 0.0, old = 0.0;
        for (int k = first; k < last; ++k) {
            const double here_x = x[k] + share * (x[k + columns] - x[k]), here_y = y[k] + share * (y[k + columns] - y[k]);
            const double off = here_x * s + here_y * c;
            if (k > first && (off < 0.0) != (old < 0.0) && (here_x + old_x) * c > (here_y + old_y) * s) {
                out[1 + 2 * found] = b;
                out[2 + 2 * found] = k - 1 + old / (old - off);
                ++found;
            }
            old_x = here_x;
            old_y = here_y;
            old = off;
        }
    }
    out[0] = found;
    return 0;
}

/* -- least squares within bounds: LANES systems side by side, the lane last in all arrays ------------------------- */

#define EACH_LANE for (int l = 0; l < LANES; ++l)

/* Symmetric positive definite matrices (m, m) as L D L': L in the lower part, the reciprocals of D on the diagonal. */
static void factor(int m, double *restrict a)
{
    for (int j = 0; j < m; ++j) {
        double *pivot = a + (j * m + j) * LANES;
        EACH_LANE pivot[l] = 1.0 / pivot[l];
        for (int i = j + 1; i < m; ++i) {
            double share[LANES];
            EACH_LANE share[l] = a[(i * m + j) * LANES + l] * pivot[l];
            /* Below, the column is still that of L D. */
            for (int k = i; k < m; ++k)
                EACH_LANE a[(k * m + i) * LANES + l] -= share[l] * a[(k * m + j) * LANES + l];
            EACH_LANE a[(i * m + j) * LANES + l] = share[l];
        }
    }
}

static void solve(int m, const double *restrict a, double *restrict b)
{
    for (int i = 1; i < m; ++i)
        for (int k = 0; k < i; ++k)
            EACH_LANE b[i * LANES + l] -= a[(i * m + k) * LANES + l] * b[k * LANES + l];
    for (int i = 0; i < m; ++i)
        EACH_LANE b[i * LANES + l] *= a[(i * m + i) * LANES + l];
    for (int i = m - 1; i > 0; --i)
        for (int k = 0; k < i; ++k)
            EACH_LANE b[k * LANES + l] -= a[(i * m + k) * LANES + l] * b[i * LANES + l];
}

/* (K' K + D) step = -slope with D = 1 / soft, from factors of I + K soft K'. */
static void newton(int m, int n, const double *restrict across, const double *restrict soft,
                   const double *restrict factors, const double *restrict slope, double *restrict inner,
                   double *restrict step)
{
    memset(inner, 0, m * LANES * sizeof *inner);
    for (int j = 0; j < n; ++j) {
        double scaled[LANES];
        EACH_LANE scaled[l] = soft[j * LANES + l] * slope[j * LANES + l];
        for (int i = 0; i < m; ++i)
            EACH_LANE inner[i * LANES + l] += across[(j * m + i) * LANES + l] * scaled[l];
    }
    solve(m, factors, inner);
    for (int j = 0; j < n; ++j) {
        double sum[LANES] = {0.0};
        for (int i = 0; i < m; ++i)
            EACH_LANE sum[l] += across[(j * m + i) * LANES + l] * inner[i * LANES + l];
        EACH_LANE step[j * LANES + l] = soft[j * LANES + l] * (sum[l] - slope[j * LANES + l]);
    }
}

/* Changes of the multipliers with a step, for the products of these and the distances to become `pull`, which is taken
   per distance; the longest step, at most one, that no distance and no multiplier cuts. Those of upper bounds change the
   other way. The reciprocals of distances and multipliers are given: divisions take most of the time. */
static void changes(int size, const double *restrict step, const double *restrict pull, const double *restrict press,
                    const double *restrict per_away, const double *restrict per_press, double *restrict change,
                    double *restrict length)
{
    EACH_LANE length[l] = -1.0;
    for (int j = 0; j < size; j += LANES)
        EACH_LANE {
            const int at = j + l, to = size + at;
            const double share = step[at] * per_away[at], other = -step[at] * per_away[to];
            change[at] = pull[at] - press[at] - press[at] * share;
            change[to] = pull[to] - press[to] - press[to] * other;
            const double first = less(share, change[at] * per_press[at]);
            length[l] = less(length[l], less(first, less(other, change[to] * per_press[to])));
        }
    EACH_LANE length[l] = -1.0 / length[l];
}

/* As `kernel.within_bounds`: `count` systems of `m` rows and `n` unknowns in (0, 1), transposed (count, n, m). 0 unless
   there is no memory. */
int within_bounds(int count, int m, int n, int steps, double rigid, double enough, const double *given,
                  const double *target, const double *weight, double *out)
{
    const int size = n * LANES;
    double *work = calloc(18 * size + 3 * m * LANES + m * size + m * m * LANES, sizeof *work);
    if (!work)
        return 1;
    double *away = work, *press = away + 2 * size, *change = press + 2 * size, *pull = change + 2 * size;
    double *soft = pull + 2 * size, *slope = soft + size, *step = slope + size, *down = step + size;
    double *found = down + size, *left = found + size, *inner = left + m * LANES, *goal = inner + m * LANES;
    double *across = goal + m * LANES, *matrix = across + m * size, *per_away = matrix + m * m * LANES;
    double *per_press = per_away + 2 * size;
    for (int b = 0; b < count; b += LANES) {
        EACH_LANE {  /* what is left of the last lanes solves the last system */
            const int from = b + l < count ? b + l : count - 1;
            for (int j = 0; j < n * m; ++j)
                across[j * LANES + l] = given[from * n * m + j];
            for (int i = 0; i < m; ++i)
                goal[i * LANES + l] = target[from * m + i];
        }
        for (int j = 0; j < size; ++j) {
            away[j] = 0.1;
            away[size + j] = 0.9;
            press[j] = press[size + j] = 0.05;
        }
        double least[LANES], value[LANES], gap[LANES], length[LANES], going[LANES], barrier[LANES];
        EACH_LANE least[l] = HUGE_VAL;
        for (int round = 0;; ++round) {
            EACH_LANE value[l] = gap[l] = 0.0;
            for (int i = 0; i < m * LANES; ++i)
                left[i] = -goal[i];
            for (int j = 0; j < n; ++j) {
                const double *x = away + j * LANES, *y = x + size, *p = press + j * LANES, *q = p + size;
                EACH_LANE value[l] += weight[j] * x[l];
                EACH_LANE gap[l] += x[l] * p[l] + y[l] * q[l];
                for (int i = 0; i < m; ++i)
                    EACH_LANE left[i * LANES + l] += across[(j * m + i) * LANES + l] * x[l];
            }
            for (int i = 0; i < m; ++i)
                EACH_LANE value[l] += 0.5 * left[i * LANES + l] * left[i * LANES + l];
            double on = 0.0;
            EACH_LANE {
                gap[l] /= 2 * n;
                on += going[l] = gap[l] > enough;
                if (value[l] <= least[l]) {
                    least[l] = value[l];
                    for (int j = 0; j < n; ++j)
                        found[j * LANES + l] = away[j * LANES + l];
                }
            }
            if (on == 0.0 || round == steps)
                break;
            for (int j = 0; j < 2 * size; ++j) {
                per_away[j] = 1.0 / away[j];
                per_press[j] = 1.0 / press[j];
            }
            memset(matrix, 0, m * m * LANES * sizeof *matrix);
            for (int j = 0; j < n; ++j) {
                const double *column = across + j * m * LANES;
                double sum[LANES], scaled[LANES];
                EACH_LANE sum[l] = weight[j];
                for (int i = 0; i < m; ++i)
                    EACH_LANE sum[l] += column[i * LANES + l] * left[i * LANES + l];
                EACH_LANE {
                    const int at = j * LANES + l;
                    slope[at] = sum[l];
                    soft[at] = 1.0 / (press[at] * per_away[at] + press[size + at] * per_away[size + at] + rigid);
                }
                for (int i = 0; i < m; ++i) {
                    EACH_LANE scaled[l] = column[i * LANES + l] * soft[j * LANES + l];
                    for (int k = 0; k <= i; ++k)
                        EACH_LANE matrix[(i * m + k) * LANES + l] += scaled[l] * column[k * LANES + l];
                }
            }
            for (int i = 0; i < m; ++i)
                EACH_LANE matrix[(i * m + i) * LANES + l] += 1.0;
            factor(m, matrix);
            newton(m, n, across, soft, matrix, slope, inner, step);
            memset(pull, 0, 2 * size * sizeof *pull);
            changes(size, step, pull, press, per_away, per_press, change, length);
            double both[LANES] = {0.0};
            for (int j = 0; j < size; j += LANES)
                EACH_LANE both[l] += step[j + l] * (change[j + l] - change[size + j + l]);
            EACH_LANE {
                /* To first order the products of both fall by the step's part. */
                const double after = (1.0 - length[l]) * gap[l] + length[l] * length[l] * both[l] / (2 * n);
                const double share = after / gap[l];
                barrier[l] = more(gap[l] * less(share * share * share, 1.0), 0.1 * enough);
            }
            for (int j = 0; j < size; j += LANES)
                EACH_LANE {
                    const int at = j + l, to = size + at;
                    pull[at] = (barrier[l] - step[at] * change[at]) * per_away[at];
                    pull[to] = (barrier[l] + step[at] * change[to]) * per_away[to];
                    down[at] = slope[at] - pull[at] + pull[to];
                }
            newton(m, n, across, soft, matrix, down, inner, step);
            changes(size, step, pull, press, per_away, per_press, change, length);
            /* Those that have converged stay: with multipliers of zero the system is singular. */
            EACH_LANE length[l] = going[l] == 0.0 ? 0.0 : 0.99 * length[l];
            for (int j = 0; j < size; j += LANES)
                EACH_LANE {
                    const int at = j + l, to = size + at;
                    away[at] += length[l] * step[at];
                    away[to] -= length[l] * step[at];
                    press[at] += length[l] * change[at];
                    press[to] += length[l] * change[to];
                }
        }
        for (int l = 0; l < LANES && b + l < count; ++l, out += n)
            for (int j = 0; j < n; ++j)
                out[j] = found[j * LANES + l];
    }
    free(work);
    return 0;
}
