{
  enum { N = <<links>>, LAST = N - 1 };<<if rows>>
  static const casadi_real rows[N][<<row>>] = {<<rows>>};<<end>>
  casadi_real drive[<<drive>>], tip[1], tip_rate[1], lagging[2], base[2];
  casadi_real q[<<full>>], qd[<<full>>], ends[2][<<end>>], starts[2][<<start>>], rates[<<full>>];
  casadi_real spins[N + 1][<<spin>>], shape[N][<<shape>>], body[N][<<body>>], gain[N][<<gain>>];<<if implicit>>
  casadi_real r[N][<<r>>];<<end>><<if loads>>
  static const int loaded[<<loads>>] = {<<loaded>>};
  casadi_real force[N][<<force>>], before[<<loads>>][<<spin>>], acting[<<loads>>][<<force>>];<<end>>
  const casadi_real *x = arg[0], *u = arg[1], *w = arg[2], *p = arg[3];
  const casadi_real *part = <<if implicit>>arg[4]<<end>><<if explicit>>0<<end>>;
  casadi_int i, k;
  {
    const casadi_real *in[] = {x + <<lag>>, u, p};
    casadi_real *out[] = {drive, tip, tip_rate, ends[0], base, lagging};
    <<head>>(in, out, iw, work, mem);
  }
  for (i = 0; i < <<n>>; ++i) q[i] = x[i];
  for (i = 0; i < <<n>>; ++i) qd[i] = x[<<n>> + i];<<if tip>>
  q[<<n>>] = tip[0];
  qd[<<n>>] = tip_rate[0];<<end>><<if implicit>>
  for (k = 0; k < N; ++k)
    for (i = 0; i < <<r>>; ++i) {
      const casadi_int at = k * <<stride>> + i % <<local>>;
      r[k][i] = at < <<n>> ? arg[5 + i / <<local>>][at] : 0;
    }<<end>><<if spun>>
  for (i = 0; i < <<spin>>; ++i) spins[0][i] = i == 1;<<end>>
  for (k = 0; k < N; ++k) {
    const casadi_real *in[] = {spins[k], q + k * <<stride>>, qd + k * <<stride>>, <<r_of>>, <<row_of>>, drive, p, part};
    casadi_real *out[] = {spins[k + 1], shape[k], body[k]};
    <<outward>>(in, out, iw, work, mem);
  }<<if loads>>
  for (i = 0; i < <<loads>>; ++i)
    for (k = 0; k < <<spin>>; ++k) before[i][k] = spins[loaded[i]][k];
  {
    const casadi_real *in[] = {before[0], x, u, w, p};
    casadi_real *out[] = {acting[0]};
    <<load>>(in, out, iw, work, mem);
  }
  for (k = 0; k < N; ++k)
    for (i = 0; i < <<force>>; ++i) force[k][i] = 0;
  for (k = 0; k < <<loads>>; ++k)
    for (i = 0; i < <<force>>; ++i) force[loaded[k]][i] += acting[k][i];<<end>>
  for (k = LAST; k >= 0; --k) {
    const casadi_real *in[] = {ends[(LAST - k) & 1], shape[k], body[k], <<row_of>>, p, <<force_of>>};
    casadi_real *out[] = {ends[(N - k) & 1], gain[k]};
    <<inward>>(in, out, iw, work, mem);
  }
  {
    const casadi_real *in[] = {ends[N & 1], base};
    casadi_real *out[] = {starts[0]};
    <<root>>(in, out, iw, work, mem);
  }
  for (i = 0; i < <<shared>>; ++i) rates[i] = starts[0][<<section>> + i];
  for (k = 0; k < N; ++k) {
    const casadi_real *in[] = {starts[k & 1], shape[k], gain[k], <<row_of>>};
    casadi_real *out[] = {starts[(k + 1) & 1], rates + <<shared>> + k * <<stride>>};
    <<onward>>(in, out, iw, work, mem);
  }
  if (res[0])
    for (i = 0; i < <<n>>; ++i) res[0][i] = rates[i];<<if lagged>>
  if (res[1])
    for (i = 0; i < 2; ++i) res[1][i] = lagging[i];<<end>>
  return 0;
}
