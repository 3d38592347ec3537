/* Numbers that come and go as doubles, whatever the C computes in. */
#ifndef CG_DOUBLES_H
#define CG_DOUBLES_H
static inline const double *cg_take(real *to, const double *from, int count)
{
  for (int i = 0; i < count; ++i) to[i] = (real)from[i];
  return from + count;
}
static inline double *cg_give(double *to, const real *from, int count)
{
  for (int i = 0; i < count; ++i) to[i] = (double)from[i];
  return to + count;
}
static inline double *cg_give_whole(double *to, const int *from, int count)
{
  for (int i = 0; i < count; ++i) to[i] = from[i];
  return to + count;
}
#endif
