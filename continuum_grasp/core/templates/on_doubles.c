int <<entry>>(const double **from, double **to, long long *iw, double *work, int mem)
{
<<declared>>
  const float *arg[<<sz_arg>>] = {<<vi>>};
  float *res[<<sz_res>>] = {<<vo>>};
<<narrow>>
  const int failed = <<name>>(arg, res, iw, (float *)work, mem);
<<widen>>
  return failed;
}
