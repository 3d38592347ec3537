#include <math.h>
/* A function with loops, branches or calls of its own, which lanes cannot take together: lanes of one. */
#undef CG_LANES
#define CG_LANES 1
#define cg_real double
typedef double cg_one_lane __attribute__((vector_size(sizeof(double))));
#define cg_lanes cg_one_lane
<<gather>>
static void <<lanes>>(const cg_lanes *const in[], cg_lanes *const out[])
{
  const double *from[<<sz_arg>>];
  double *to[<<sz_res>>], work[<<sz_w>>];
  long long iw[<<sz_iw>>];
  static const int sizes[] = {<<sizes>>};
  for (int k = 0; k < <<from>>; ++k) from[k] = (const double *)in[k];
  for (int k = 0; k < <<to>>; ++k) to[k] = (double *)out[k];
  if (<<name>>(from, to, iw, work, 0)) /* a singular matrix: what it gives is not a number */
    for (int k = 0; k < <<to>>; ++k)
      for (int j = 0; j < sizes[k]; ++j) to[k][j] = NAN;
}
