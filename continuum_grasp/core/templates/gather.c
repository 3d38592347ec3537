static void cg_gather(const double *from, long long stride, long long count, int size, cg_lanes *to)
{
  for (int l = 0; l < CG_LANES; ++l) {
    const double *row = from + (l < count ? l : count - 1) * stride; /* the last row fills up the lanes */
    for (int j = 0; j < size; ++j) to[j][l] = (cg_real)row[j];
  }
}
static void cg_scatter(const cg_lanes *from, long long stride, long long count, int size, double *to)
{
  for (long long l = 0; l < count; ++l)
    for (int j = 0; j < size; ++j) to[l * stride + j] = (double)from[j][l];
}
