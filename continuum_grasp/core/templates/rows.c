int <<name>>_batch(long long count, const double *const *in, const long long *stride, double *const *out)
{
  static const long long size[] = {<<sizes>>};
  const double *from[<<sz_arg>>];
  double *to[<<sz_res>>], work[<<sz_w>>];
  long long iw[<<sz_iw>>];
  for (long long b = 0; b < count; ++b) {
    for (int k = 0; k < <<from>>; ++k) from[k] = in[k] + b * stride[k];
    for (int k = 0; k < <<to>>; ++k) to[k] = out[k] + b * size[k];
    if (<<name>>(from, to, iw, work, 0)) return 1;
  }
  return 0;
}
