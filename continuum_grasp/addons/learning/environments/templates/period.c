/* One control period of many plants: steps of RK4 under a constant input, in lanes. ``ended`` receives 0; 1 where a number
 * is not finite: then x and the readings of that plant stay as they were; 2 where it left the range of its model. */
void environment_period(long long count, long long sub, double h, double *x, const double *u, const double *held,
    const double *w, const double *p, const double *r, const double *bounds, double *cost, double *readings, signed char *ended)
{
  cg_lanes vx[<<nx1>>], at[<<nx1>>], slope[<<nx1>>], sum[<<nx1>>], vu[<<nu1>>], vheld[<<nu1>>], vw[<<nw1>>], vp[<<np1>>];
  cg_lanes vr[<<nr1>>], vcost[1], vread[<<ny1>>];
  const cg_lanes *const of_cost[] = {vx, vu, vheld, vw, vp, vr}, *const of_slope[] = {at, vu, vw, vp};
  const cg_lanes *const of_readings[] = {vx, vu, vw, vp};
  cg_lanes *const to_cost[] = {vcost}, *const to_slope[] = {slope}, *const to_readings[] = {vread};
  static const double weight[] = {1, 2, 2, 1}, ahead[] = {0.5, 0.5, 1, 0};
  (void)held; (void)w; (void)p; (void)r;
  for (long long b = 0; b < count; b += CG_LANES) {
    const long long m = count - b < CG_LANES ? count - b : CG_LANES;
    cg_gather(x + b * <<nx>>, <<nx>>, m, <<nx>>, vx);
    cg_gather(u + b * <<nu>>, <<nu>>, m, <<nu>>, vu);
    cg_gather(held + b * <<nu>>, <<nu>>, m, <<nu>>, vheld);
    cg_gather(w + b * <<nw>>, <<nw>>, m, <<nw>>, vw);
    cg_gather(p + b * <<np>>, <<np>>, m, <<np>>, vp);
    cg_gather(r + b * <<nr>>, <<nr>>, m, <<nr>>, vr);
    environment_cost_lanes(of_cost, to_cost);
    cg_scatter(vcost, 1, m, 1, cost + b);
    for (long long i = 0; i < sub; ++i) {
      for (int j = 0; j < <<nx>>; ++j) { at[j] = vx[j]; sum[j] = (cg_lanes){0}; }
      for (int k = 0; k < 4; ++k) {
        environment_slope_lanes(of_slope, to_slope);
        for (int j = 0; j < <<nx>>; ++j) {
          sum[j] += weight[k] * slope[j];
          at[j] = vx[j] + (ahead[k] * h) * slope[j];
        }
      }
      for (int j = 0; j < <<nx>>; ++j) vx[j] += (h / 6) * sum[j];
    }
    environment_readings_lanes(of_readings, to_readings);
    for (long long l = 0; l < m; ++l) {
      ended[b + l] = !(vcost[0][l] - vcost[0][l] == 0);
      for (int j = 0; j < <<nx>>; ++j) ended[b + l] |= !(vx[j][l] - vx[j][l] == 0);
      for (int j = 0; j < <<ny>>; ++j) ended[b + l] |= !(vread[j][l] - vread[j][l] == 0);
      if (ended[b + l]) continue;
      if (vread[<<use>>][l] > 1) ended[b + l] = 2;
      for (int j = 0; j < <<nx>>; ++j) {
        if (vx[j][l] < bounds[j] || vx[j][l] > bounds[<<nx>> + j]) ended[b + l] = 2;
        x[(b + l) * <<nx>> + j] = vx[j][l];
      }
      for (int j = 0; j < <<ny>>; ++j) readings[(b + l) * <<ny>> + j] = vread[j][l];
    }
  }
}
