/* Distances of many points from an object, as `rough_distance` of its outlines. */

#if WIDE == 1 && LANES == 0
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
        const double beyond = along - fmin(fmax(along, 0.0), edge[4]);
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

void distances(int count, const double *object, const double *points, double *out)
{
    for (int k = 0; k < count; ++k)
        out[k] = distance(object, points[2 * k], points[2 * k + 1]);
}
#endif
