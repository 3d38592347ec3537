void <<name>>_rollouts(long long count, long long keep, long long sub, double h, const double *x0,
    const double *u, long long us, long long ur, const double *w, long long ws, long long wr, const double *p,
    long long *iw, double *work, double *X, long long *valid)
{
  cg_lanes x[<<nx>>], next[<<nx>>], vp[<<np1>>], vh[1], vu[3][<<nu1>>], vw[3][<<nw1>>];
  const cg_lanes *const in[] = {x, vu[0], vu[1], vu[2], vw[0], vw[1], vw[2], vp, vh};
  cg_lanes *const out[] = {next};
  const long long row = (keep + 1) * <<nx>>;
  (void)iw; (void)work; (void)u; (void)us; (void)ur; (void)w; (void)ws; (void)wr; (void)p;
  cg_gather(p, 0, 1, <<np>>, vp);
  cg_gather(&h, 0, 1, 1, vh);
  for (long long b = 0; b < count; b += CG_LANES) {
    const long long m = count - b < CG_LANES ? count - b : CG_LANES;
    cg_gather(x0 + b * <<nx>>, <<nx>>, m, <<nx>>, x);
    cg_scatter(x, row, m, <<nx>>, X + b * row);
    for (long long l = 0; l < m; ++l) valid[b + l] = keep;
    for (long long k = 0, t = 0; k < keep; ++k) {
      for (long long i = 0; i < sub; ++i, t += 2) {
        for (int a = 0; a < 3; ++a) {
          if (us || !t) cg_gather(u + b * ur + (t + a) * us, ur, m, <<nu>>, vu[a]);
          if (ws || !t) cg_gather(w + b * wr + (t + a) * ws, wr, m, <<nw>>, vw[a]);
        }
        <<lanes>>(in, out);
        for (int j = 0; j < <<nx>>; ++j) x[j] = next[j];
      }
      cg_scatter(x, row, m, <<nx>>, X + b * row + (k + 1) * <<nx>>);
      for (long long l = 0; l < m; ++l)
        for (int j = 0; j < <<nx>>; ++j)
          if (valid[b + l] == keep && !(x[j][l] - x[j][l] == 0)) valid[b + l] = k;
    }
  }
}
