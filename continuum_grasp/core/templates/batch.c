void <<name>>_batch(long long count, const double *const *in, const long long *stride, double *const *out)
{
<<for k, size, least in inputs|\n>>  cg_lanes i<<k>>[<<least>>];<<end>>
<<for k, size, least in outputs|\n>>  cg_lanes o<<k>>[<<least>>];<<end>>
  const cg_lanes *const vi[] = {<<vi>>};
  cg_lanes *const vo[] = {<<vo>>};
  for (long long b = 0; b < count; b += CG_LANES) {
    const long long m = count - b < CG_LANES ? count - b : CG_LANES;
<<for k, size, least in inputs>><<if size>>    if (!b || stride[<<k>>]) cg_gather(in[<<k>>] + b * stride[<<k>>], stride[<<k>>], m, <<size>>, i<<k>>);
<<end>><<end>>    <<lanes>>(vi, vo);
<<for k, size, least in outputs>><<if size>>    cg_scatter(o<<k>>, <<size>>, m, <<size>>, out[<<k>>] + b * <<size>>);
<<end>><<end>>  }
}
