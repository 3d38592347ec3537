/* What a finger answers when its contacts move and stick to it, its tendons' moments held. */

#if LANES > 0 && WIDE == 1
static inline double *write_constant(double *to, double value)
{
    const dual a = constant(value);
    return write_number(to, &a, 0);
}

/* A value with the slope of one of the unknowns. */
static inline dual unknown(double value, int lane)
{
    dual a = constant(value);
    ((double *)&a.d)[lane] = 1.0;
    return a;
}

/* Curvature of the line through a place that is as far from the object all along. */
void bend_of_object(const Rod *rod, double x, double y, double *out)
{
    const Place at = place(rod, unknown(x, 0), unknown(y, 1));
    *out = ((const double *)&at.nx.d)[0] + ((const double *)&at.ny.d)[1];
}

static void march(const Rod *rod, State *q, double from, double to, const dual *z)
{
    for (int k = 0, steps = steps_of(rod); k < steps; ++k) {
        step_by(rod, q, (to - from) / steps, z, 0);
        q->turned = constant(q->turned.v); /* friction of the tendons stays as it is */
    }
}

/* Equilibria (count, n) with slopes by the curvature at the base, the force there, and the force of each middle contact:
   per middle contact the point that sticks (2), the normal (2) and the force (2), then the tip's place, angle, force,
   moment, normal, half thickness, and the curvature of the object. Out (count, 6 contacts + 10, 1 + LANES). */
void pinned(const Rod *rod, int count, const double *given, double *out)
{
    const int contacts = rod->contacts;
    for (; count > 0; --count, given += 4 + 3 * contacts) {
        const dual z[4] = {unknown(given[0], 0), unknown(given[1], 1), unknown(given[2], 2), constant(given[3])};
        State q = clamped(rod, z);
        double from = 0.0;
        for (int k = 0; k < contacts; ++k) {
            const double *own = given + 4 + 3 * k;
            march(rod, &q, from, own[0], z);
            const Touch at = touch_of(rod, &q);
            const double nx = at.nx.v, ny = at.ny.v, h = at.half.v;
            /* The section's normal, with which the point turns. */
            const dual ux = with(q.angle, nx, -ny), uy = with(q.angle, ny, nx);
            const dual px = unknown(own[1] * nx - own[2] * ny, 3 + 2 * k), py = unknown(own[1] * ny + own[2] * nx, 4 + 2 * k);
            const dual x = minus(q.x, scaled(h, ux)), y = minus(q.y, scaled(h, uy));
            out = write_number(write_number(out, &x, 0), &y, 0);
            out = write_constant(write_constant(out, nx), ny);
            out = write_number(write_number(out, &px, 0), &py, 0);
            q.fx = minus(q.fx, px), q.fy = minus(q.fy, py);
            q.moment = plus(q.moment, scaled(h, minus(times(ux, py), times(uy, px))));
            q.bent = curvature(rod, &q, q.s, z[3]);
            from = own[0];
        }
        march(rod, &q, from, 1.0, z);
        q.fx.v -= rod->tip_load[0], q.fy.v -= rod->tip_load[1];
        const Touch tip = touch_of(rod, &q);
        const dual *numbers[] = {&q.x, &q.y, &q.angle, &q.fx, &q.fy, &q.moment};
        for (int k = 0; k < 6; ++k)
            out = write_number(out, numbers[k], 0);
        out = write_constant(write_constant(out, tip.nx.v), tip.ny.v);
        double bend;
        bend_of_object(rod, q.x.v, q.y.v, &bend);
        out = write_constant(write_constant(out, tip.half.v), bend);
    }
}
#endif
