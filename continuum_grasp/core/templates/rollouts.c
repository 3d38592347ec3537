void <<name>>_rollouts(long long count, long long keep, long long sub, double h, const double *x0,
    const double *u, long long us, long long ur, const double *w, long long ws, long long wr, const double *p,
    long long *iw, double *work, double *X, long long *valid)
{
  for (long long r = 0; r < count; ++r)
    valid[r] = <<name>>_rollout(keep, sub, h, x0 + r * <<nx>>, u + r * ur, us, w + r * wr, ws, p, iw, work,
        X + r * (keep + 1) * <<nx>>);
}
