long long <<name>>_rollout(long long keep, long long sub, double h, const double *x0,
    const double *u, long long us, const double *w, long long ws, const double *p,
    long long *iw, double *work, double *X)
{
  double x[<<nx>>], next[<<nx>>];
  const double *arg[<<sz_arg>>];
  double *res[<<sz_res>>];
  for (int j = 0; j < <<nx>>; ++j) X[j] = x[j] = x0[j];
  for (long long k = 0; k < keep; ++k) {
    for (long long i = 0; i < sub; ++i) {
      arg[0] = x;
      arg[1] = u; arg[2] = u + us; arg[3] = u + 2 * us;
      arg[4] = w; arg[5] = w + ws; arg[6] = w + 2 * ws;
      arg[7] = p; arg[8] = &h;
      res[0] = next;
      if (<<name>>(arg, res, iw, work, 0)) return k;
      for (int j = 0; j < <<nx>>; ++j) x[j] = next[j];
      u += 2 * us;
      w += 2 * ws;
    }
    for (int j = 0; j < <<nx>>; ++j) if (!(x[j] - x[j] == 0)) return k; /* NaN or infinite */
    for (int j = 0; j < <<nx>>; ++j) X[(k + 1) * <<nx>> + j] = x[j];
  }
  return keep;
}
void <<name>>_levels(long long levels, const long long *ratio, long long every, long long keep, long long sub,
    double h, const double *x0, const double *u, long long us, const double *w, long long ws, const double *p,
    long long *iw, double *work, double *const *X, long long *valid)
{
  for (long long l = 0; l < levels; ++l) {
    const long long r = ratio[l], e = r == 1 ? 1 : every; /* the finest level alone is stored at every state */
    valid[l] = <<name>>_rollout(keep / e, sub * e / r, h * (double)r, x0 + l * <<nx>>, u, us * r, w, ws * r, p,
        iw, work, X[l]);
  }
}
