static void cg_add(const cg_lanes *from, long long stride, long long count, int size, double *to)
{
  for (long long l = 0; l < count; ++l)
    for (int j = 0; j < size; ++j) to[l * stride + j] += (double)from[j][l];
}
/* A recursion over steps: ``held`` steps share a row of a signal, ``summed`` steps add up to one of a result. */
void <<name>>_scan(long long count, long long steps, int back, const double *const *in, const long long *row,
    const long long *time, const long long *held, double *const *out, const long long *to, const long long *summed)
{
<<for k, size, least in inputs|\n>>  cg_lanes i<<k>>[<<least>>];<<end>>
<<for k, size, least in outputs|\n>>  cg_lanes o<<k>>[<<least>>];<<end>>
  const cg_lanes *const vi[] = {<<vi>>};
  cg_lanes *const vo[] = {<<vo>>};
  (void)time; (void)held; (void)summed;
  for (long long b = 0; b < count; b += CG_LANES) {
    const long long m = count - b < CG_LANES ? count - b : CG_LANES;
    cg_gather(in[0] + b * row[0], row[0], m, <<carry>>, i0);
    cg_scatter(i0, to[0], m, <<carry>>, out[0] + b * to[0] + (back ? steps : 0) * <<carry>>);
    for (long long k = 0; k < steps; ++k) {
      const long long t = back ? steps - 1 - k : k, before = back ? t + 1 : t - 1, next = back ? t : t + 1;
      (void)before;
<<for k, size, least in inputs>><<if k>><<if size>>      if (!k || t / held[<<k>>] != before / held[<<k>>])
        cg_gather(in[<<k>>] + b * row[<<k>>] + t / held[<<k>>] * time[<<k>>], row[<<k>>], m, <<size>>, i<<k>>);
<<end>><<end>><<end>>      <<lanes>>(vi, vo);
      for (int j = 0; j < <<carry>>; ++j) i0[j] = o0[j];
      cg_scatter(i0, to[0], m, <<carry>>, out[0] + b * to[0] + next * <<carry>>);
<<for k, size, least in outputs>><<if k>><<if size>>      cg_add(o<<k>>, to[<<k>>], m, <<size>>, out[<<k>>] + b * to[<<k>>] + t / summed[<<k>>] * <<size>>);
<<end>><<end>><<end>>    }
  }
}
