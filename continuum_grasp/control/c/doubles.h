/* Arguments and results as doubles, also where the C computes in float. */
#ifndef CG_DOUBLES_H
#define CG_DOUBLES_H
static inline const double *cg_read(real *to, const double *from, int count)
{
  for (int i = 0; i < count; ++i) to[i] = (real)from[i];
  return from + count;
}
static inline double *cg_write(double *to, const real *from, int count)
{
  for (int i = 0; i < count; ++i) to[i] = (double)from[i];
  return to + count;
}
static inline double *cg_write_ints(double *to, const int *from, int count)
{
  for (int i = 0; i < count; ++i) to[i] = from[i];
  return to + count;
}
#endif
