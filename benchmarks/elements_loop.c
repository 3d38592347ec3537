/* A simulation's loop around a function of elements, and a program of it whose instructions valgrind counts;
 * bench_elements.py defines the words in capitals above it. */
#include <stdlib.h>
int FUNCTION(const double **, double **, long long *, double *, int);
static double x[NX], u[8], w[8], xd[NX], work[SZ_W];
static long long iw[SZ_IW];

double loop(long long count)
{
  const double *arg[SZ_ARG] = {x, u, w};
  double *res[SZ_RES] = {xd}, sum = 0.0;
  for (long long k = 0; k < count; ++k) {
    FUNCTION(arg, res, iw, work, 0);
    x[0] += 1e-200 * xd[NX - 1]; /* the next evaluation has to wait for this one */
    sum += xd[NX / 2];
  }
  return sum;
}

int main(int count, char **words)
{
  for (int k = 0; k < NX; ++k) x[k] = (k < NX / 2 ? 0.2 : 1.0) * ((k * 37 % 17) / 8.0 - 1.0);
  return loop(count > 1 ? atoll(words[1]) : 0) > 1e300;
}
