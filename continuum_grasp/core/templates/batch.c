int <<name>>_batch(long long count, const double *const *in, const long long *stride, double *const *out)
{
<<inputs>>
<<results>>
  const cg_lanes *const vi[] = {<<vi>>};
  cg_lanes *const vo[] = {<<vo>>};
  for (long long b = 0; b < count; b += CG_LANES) {
    const long long m = count - b < CG_LANES ? count - b : CG_LANES;
<<gather>>
    <<name>>_lanes(vi, vo);
<<scatter>>
  }
  return 0;
}
