int <<entry>>(const double **from, double **to, long long *iw, double *work, int mem)
{
<<for k, size, least in inputs>>  float i<<k>>[<<least>>];
<<end>><<for k, size, least in outputs|\n>>  float o<<k>>[<<least>>];<<end>>
  const float *arg[<<sz_arg>>] = {<<vi>>};
  float *res[<<sz_res>>] = {<<vo>>};
<<for k, size, least in inputs>><<if size>>  for (int j = 0; j < <<size>>; ++j) i<<k>>[j] = (float)from[<<k>>][j];
<<end>><<end>>  const int failed = <<name>>(arg, res, iw, (float *)work, mem);
<<for k, size, least in outputs>><<if size>>  for (int j = 0; j < <<size>>; ++j) to[<<k>>][j] = (double)o<<k>>[j];
<<end>><<end>>  return failed;
}
