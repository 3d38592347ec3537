/* Distances of many points from an object, and points along curves.

   Arrays are C-contiguous. `curves.py` calls these; each has its like in numpy, which says what it computes. */

#if defined __GNUC__ && !defined __clang__
#pragma GCC optimize("O2", "tree-vectorize")  /* as fast as -O3, for which gcc 12 needs 0.9 s instead of 0.4 s */
#endif

#include <math.h>
#include <stdlib.h>

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
