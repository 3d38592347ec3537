/* The inner loops of the scan: distances of many postures from an object, and forces that come closest to balance.

   Arrays are C-contiguous. `kernel.py` calls these; each has its like in numpy, which says what it computes. */

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { POLYGON, SUPERELLIPSE };

/* Signed distance from one part, as of `rough_distance` of its outline. A polygon of one corner is a disc. */
static double from_polygon(int count, const double *shape, double x, double y)
{
    const double radius = shape[0], slot = shape[1], *edge = shape + 2;
    if (count == 1)
        return hypot(x - edge[0], y - edge[1]) - radius;
    double least = HUGE_VAL, core = 0.0, deepest = -HUGE_VAL;
    for (int k = 0; k < count; ++k, edge += 5) {  /* corner, direction, length */
        const double dx = x - edge[0], dy = y - edge[1];
        const double along = dx * edge[2] + dy * edge[3], out = dx * edge[3] - dy * edge[2];
        const double beyond = along - fmin(fmax(along, 0.0), edge[4]);
        const double off = beyond * beyond + out * out, square = off + (count == 2 && out < 0.0 ? slot : 0.0);
        if (square < least) {
            least = square;
            core = off;
        }
        deepest = fmax(deepest, out);
    }
    return (count > 2 && deepest < 0.0 ? deepest : sqrt(core)) - radius;
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
    return gap + 0.5 * slide * slide / fmax(gap + radius[best], 4.0 * fabs(slide) + 1e-12);
}

/* The least of the distances from all parts; `object` has for each its kind, count, length of its numbers, numbers. */
static double distance(const double *object, double x, double y)
{
    double least = HUGE_VAL;
    for (int left = (int)*object++; left > 0; --left) {
        const int kind = (int)object[0], count = (int)object[1], size = (int)object[2];
        const double *shape = object + 3;
        const double found = kind == POLYGON ? from_polygon(count, shape, x, y) : from_superellipse(count, shape, x, y);
        least = fmin(least, found);
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

/* As `curves.sample`: points at increasing places, the first of which is 0. */
int sample(int count, int knots, int places, const double *knot, const double *bent, const double *at, double *out)
{
    const double node[2] = {0.5 - 0.5 / sqrt(3.0), 0.5 + 0.5 / sqrt(3.0)};
    for (int b = 0; b < count; ++b, knot += knots, bent += knots, at += places, out += 2 * places) {
        double x = 0.0, y = 0.0, turned = 0.0;
        int piece = 0;
        out[0] = out[1] = 0.0;
        for (int s = 1; s < places; ++s) {
            const double step = at[s] - at[s - 1];
            for (int g = 0; g < 2; ++g) {
                const double here = at[s - 1] + node[g] * step;
                /* What whole intervals before turn is known once they are passed; before and beyond all, it is none. */
                while (piece < knots - 1 && here >= knot[piece + 1]) {
                    turned += 0.5 * (knot[piece + 1] - knot[piece]) * (bent[piece] + bent[piece + 1]);
                    ++piece;
                }
                double angle = turned;
                if (piece < knots - 1 && here > knot[piece]) {
                    const double u = here - knot[piece];
                    const double slope = (bent[piece + 1] - bent[piece]) / (knot[piece + 1] - knot[piece]);
                    angle += u * (bent[piece] + 0.5 * slope * u);
                }
                x -= 0.5 * step * sin(angle);
                y += 0.5 * step * cos(angle);
            }
            out[2 * s] = x;
            out[2 * s + 1] = y;
        }
    }
    return 0;
}

/* Distances from the object of the ends of curves from points (x, y, turn, length), with linear curvature from first to
   last; lines of `lines` end curvatures each, by a Gauss rule of `size` nodes. Where `arc`, the first is the last. */
int tip_gaps(int count, int lines, int size, int arc, const double *object, const double *node, const double *weight,
              const double *from, const double *first, const double *last, double *out)
{
    for (int b = 0; b < count; ++b, from += 4)
        for (int k = 0; k < lines; ++k, ++last, ++out) {
            const double start = arc ? *last : first[b], ell = from[3];
            double x = 0.0, y = 0.0;
            for (int g = 0; g < size; ++g) {
                const double late = 0.5 * node[g] * node[g];
                const double angle = from[2] + ell * (start * (node[g] - late) + *last * late);
                x -= weight[g] * sin(angle);
                y += weight[g] * cos(angle);
            }
            *out = distance(object, from[0] + ell * x, from[1] + ell * y);
        }
    return 0;
}

/* -- least squares within bounds --------------------------------------------------------------------------------- */

/* Factor a symmetric positive definite matrix (m, m), lower part. */
static void factor(int m, double *a)
{
    for (int j = 0; j < m; ++j) {
        const double pivot = 1.0 / sqrt(a[j * m + j]);
        for (int i = j; i < m; ++i)
            a[i * m + j] *= pivot;
        for (int i = j + 1; i < m; ++i)
            for (int k = j + 1; k <= i; ++k)
                a[i * m + k] -= a[i * m + j] * a[k * m + j];
    }
}

static void solve(int m, const double *a, double *b)
{
    for (int i = 0; i < m; ++i) {
        for (int k = 0; k < i; ++k)
            b[i] -= a[i * m + k] * b[k];
        b[i] /= a[i * m + i];
    }
    for (int i = m - 1; i >= 0; --i) {
        b[i] /= a[i * m + i];
        for (int k = 0; k < i; ++k)
            b[k] -= a[i * m + k] * b[i];
    }
}

/* (K' K + D) step = -slope with D = 1 / soft, from factors of I + K soft K'. */
static void newton(int m, int n, const double *across, const double *soft, const double *factors, const double *slope,
                   double *inner, double *step)
{
    memset(inner, 0, m * sizeof *inner);
    for (int j = 0; j < n; ++j)
        for (int i = 0; i < m; ++i)
            inner[i] += across[j * m + i] * (soft[j] * slope[j]);
    solve(m, factors, inner);
    for (int j = 0; j < n; ++j) {
        double sum = 0.0;
        for (int i = 0; i < m; ++i)
            sum += across[j * m + i] * inner[i];
        step[j] = soft[j] * (sum - slope[j]);
    }
}

/* Longest step, at most one, that no distance and no multiplier cuts; those of upper bounds change the other way. */
static double longest(int n, const double *step, const double *change, const double *away, const double *press)
{
    double least = -1.0;
    for (int j = 0; j < n; ++j) {
        least = fmin(least, fmin(step[j] / away[j], -step[j] / away[n + j]));
        least = fmin(least, fmin(change[j] / press[j], change[n + j] / press[n + j]));
    }
    return -1.0 / least;
}

/* As `force.within_bounds`: `count` systems of `m` rows and `n` unknowns in (0, 1), transposed (count, n, m). 0 unless
   there is no memory. */
int within_bounds(int count, int m, int n, int steps, double rigid, double enough, const double *across,
                  const double *goal, const double *weight, double *found)
{
    double *work = malloc((13 * n + 2 * m + m * m) * sizeof *work);
    if (!work)
        return 1;
    double *away = work, *press = away + 2 * n, *change = press + 2 * n, *pull = change + 2 * n;
    double *soft = pull + 2 * n, *slope = soft + n, *step = slope + n, *down = step + n;
    double *left = down + 2 * n, *inner = left + m, *matrix = inner + m;
    for (int b = 0; b < count; ++b, across += n * m, goal += m, found += n) {
        double least = HUGE_VAL;
        for (int j = 0; j < n; ++j) {
            away[j] = 0.1;
            away[n + j] = 0.9;
            press[j] = press[n + j] = 0.05;
        }
        for (int round = 0; round <= steps; ++round) {
            double value = 0.0, gap = 0.0;
            for (int i = 0; i < m; ++i)
                left[i] = -goal[i];
            for (int j = 0; j < n; ++j) {
                value += weight[j] * away[j];
                gap += away[j] * press[j] + away[n + j] * press[n + j];
                for (int i = 0; i < m; ++i)
                    left[i] += across[j * m + i] * away[j];
            }
            for (int i = 0; i < m; ++i)
                value += 0.5 * left[i] * left[i];
            if (value <= least) {
                least = value;
                memcpy(found, away, n * sizeof *found);
            }
            gap /= 2 * n;
            if (!(gap > enough) || round == steps)
                break;
            memset(matrix, 0, m * m * sizeof *matrix);
            for (int j = 0; j < n; ++j) {
                const double *column = across + j * m;
                double sum = 0.0;
                for (int i = 0; i < m; ++i)
                    sum += column[i] * left[i];
                slope[j] = sum + weight[j];
                soft[j] = 1.0 / (press[j] / away[j] + press[n + j] / away[n + j] + rigid);
                for (int i = 0; i < m; ++i) {
                    const double scaled = column[i] * soft[j];
                    for (int k = 0; k <= i; ++k)
                        matrix[i * m + k] += scaled * column[k];
                }
            }
            for (int i = 0; i < m; ++i)
                matrix[i * m + i] += 1.0;
            factor(m, matrix);
            newton(m, n, across, soft, matrix, slope, inner, step);
            double both = 0.0;
            for (int j = 0; j < n; ++j) {
                change[j] = -press[j] - press[j] / away[j] * step[j];
                change[n + j] = -press[n + j] + press[n + j] / away[n + j] * step[j];
                both += step[j] * (change[j] - change[n + j]);
            }
            double length = longest(n, step, change, away, press);
            /* To first order the products of both fall by the step's part. */
            const double after = (1.0 - length) * gap + length * length * both / (2 * n), share = after / gap;
            const double barrier = fmax(gap * fmin(share * share * share, 1.0), 0.1 * enough);
            for (int j = 0; j < n; ++j) {
                pull[j] = (barrier - step[j] * change[j]) / away[j];
                pull[n + j] = (barrier + step[j] * change[n + j]) / away[n + j];
                down[j] = slope[j] - pull[j] + pull[n + j];
            }
            newton(m, n, across, soft, matrix, down, inner, step);
            for (int j = 0; j < n; ++j) {
                change[j] = pull[j] - press[j] - press[j] / away[j] * step[j];
                change[n + j] = pull[n + j] - press[n + j] + press[n + j] / away[n + j] * step[j];
            }
            length = 0.99 * longest(n, step, change, away, press);
            for (int j = 0; j < n; ++j) {
                away[j] += length * step[j];
                away[n + j] -= length * step[j];
                press[j] += length * change[j];
                press[n + j] += length * change[n + j];
            }
        }
    }
    free(work);
    return 0;
}
