{
  enum { N = <<links>>, LAST = N - 1 };<<if rows>>
  static const casadi_real rows[N][<<row>>] = {<<rows>>};<<end>>
  casadi_real drive[<<drive>>], tip[1], tip_rate[1], lagging[<<lagging>>], base[2];
  casadi_real q[<<full>>], qd[<<full>>], ends[2][<<section_end>>], starts[2][<<start>>], rates[<<full>>];
  casadi_real shape[N][<<shape>>], body[N][<<body>>], gain[N][<<gain>>], spins[N + 1][<<spin>>];<<if implicit>>
  casadi_real r[<<full>>];<<end>><<if loads>>
  static const int loaded[<<loads>>] = {<<loaded>>};
  casadi_real turns[N + 1][2], before[<<loads>>][2], force[N][<<force>>], acting[<<loads>>][<<force>>];<<end>>
  cg_lanes same_drive[<<drive>>], same_p[<<p>>], same_part[1], wide[6][<<widest>>];
  const casadi_real *x = arg[0], *u = arg[1], *w = arg[2], *p = arg[3];
  casadi_int i, k, l;
  {
    const casadi_real *in[] = {x + <<lag>>, u, p};
    casadi_real *out[] = {drive, tip, tip_rate, base, lagging};
    <<head_of>>(in, out, iw, work, mem);
  }
  for (i = 0; i < <<n>>; ++i) q[i] = x[i];
  for (i = 0; i < <<n>>; ++i) qd[i] = x[<<n>> + i];<<if tip>>
  q[<<n>>] = tip[0];
  qd[<<n>>] = tip_rate[0];<<end>><<if implicit>>
  r[<<full>> - 1] = 0;
  for (i = 0; i < <<n>>; ++i) r[i] = arg[5][i];<<end>>
  for (i = 0; i < <<spin>>; ++i) spins[0][i] = 0;
  for (k = 0; k < N; ++k) {
    const casadi_real *in[] = {spins[k], q + k * <<stride>>, qd + k * <<stride>>, <<row_of>>};
    casadi_real *out[] = {spins[k + 1]};
    <<carry_of>>(in, out, iw, work, mem);
  }
  {
    const casadi_real *in[] = {spins[N], x + <<lag>>, u, p};
    casadi_real *out[] = {ends[0]};
    <<tip_of>>(in, out, iw, work, mem);
  }
  for (i = 0; i < <<drives>>; ++i) same_drive[i] = (cg_lanes){0} + drive[i];
  for (i = 0; i < <<ps>>; ++i) same_p[i] = (cg_lanes){0} + p[i];<<if implicit>>
  same_part[0] = (cg_lanes){0} + arg[4][0];<<end>>
  /* Several links at once; the last of them again where their number is not that of whole vectors. */
  for (k = 0; k < N; k += CG_LANES) {
    const cg_lanes *in[] = {wide[0], wide[1], wide[2], wide[3], wide[4], same_drive, same_p, same_part};
    cg_lanes shapes[<<shape>>], bodies[<<body>>], *out[] = {shapes, bodies};
    for (l = 0; l < CG_LANES; ++l) {
      const casadi_int at = k + l < N ? k + l : LAST;
      for (i = 0; i < <<spin>>; ++i) wide[0][i][l] = spins[at][i];
      for (i = 0; i < <<local>>; ++i) wide[1][i][l] = q[at * <<stride>> + i];
      for (i = 0; i < <<local>>; ++i) wide[2][i][l] = qd[at * <<stride>> + i];<<if implicit>>
      for (i = 0; i < <<local>>; ++i) wide[3][i][l] = r[at * <<stride>> + i];<<end>><<if rows>>
      for (i = 0; i < <<row>>; ++i) wide[4][i][l] = rows[at][i];<<end>>
    }
    <<outward>>_lanes(in, out);
    for (l = 0; l < CG_LANES && k + l < N; ++l) {
      for (i = 0; i < <<shape>>; ++i) shape[k + l][i] = shapes[i][l];
      for (i = 0; i < <<body>>; ++i) body[k + l][i] = bodies[i][l];
    }
  }<<if loads>>
  turns[0][0] = 1;
  turns[0][1] = 0;
  for (k = 0; k < LAST; ++k) {
    const casadi_real *in[] = {turns[k], shape[k]};
    casadi_real *out[] = {turns[k + 1]};
    <<turn_of>>(in, out, iw, work, mem);
  }
  for (i = 0; i < <<loads>>; ++i)
    for (k = 0; k < 2; ++k) before[i][k] = turns[loaded[i]][k];
  {
    const casadi_real *in[] = {before[0], x, u, w, p};
    casadi_real *out[] = {acting[0]};
    <<loads_of>>(in, out, iw, work, mem);
  }
  for (k = 0; k < N; ++k)
    for (i = 0; i < <<force>>; ++i) force[k][i] = 0;
  for (k = 0; k < <<loads>>; ++k)
    for (i = 0; i < <<force>>; ++i) force[loaded[k]][i] += acting[k][i];<<end>>
  for (k = LAST; k >= 0; --k) {
    const casadi_real *in[] = {ends[(LAST - k) & 1], shape[k], body[k], <<row_of>>, p, <<force_of>>};
    casadi_real *out[] = {ends[(N - k) & 1], gain[k]};
    <<inward_of>>(in, out, iw, work, mem);
  }
  {
    const casadi_real *in[] = {ends[N & 1], base};
    casadi_real *out[] = {starts[0]};
    <<root_of>>(in, out, iw, work, mem);
  }
  for (i = 0; i < <<shared>>; ++i) rates[i] = starts[0][<<section>> + i];
  for (k = 0; k < N; ++k) {
    const casadi_real *in[] = {starts[k & 1], shape[k], gain[k], <<row_of>>};
    casadi_real *out[] = {starts[(k + 1) & 1], rates + <<shared>> + k * <<stride>>};
    <<onward_of>>(in, out, iw, work, mem);
  }
  if (res[0])
    for (i = 0; i < <<n>>; ++i) res[0][i] = rates[i];<<if lagged>>
  if (res[1])
    for (i = 0; i < <<lagged>>; ++i) res[1][i] = lagging[i];<<end>>
  return 0;
}
