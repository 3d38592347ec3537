/* A loop around a function that CasADi generated; `harness.CLoop` defines the words in capitals above it. */
#include <string.h>

int FUNCTION(const double **arg, double **res, long long int *iw, double *w, int mem);
static const double *arg[ARG];
static double *res[RES];
static long long int iw[IW];
static double w[W];
static double out[OUT];
/* too little to change a state, but the next evaluation has to wait for it */
static const double tiny = 1e-200;

double loop(const double *const *in, double *x, long long int count)
{
  double sum = 0.0;
  for (long long int k = 0; k < count; ++k) {
    const long long int j = k & MASK;
    SET_ARGUMENTS
    SET_RESULTS
    FUNCTION(arg, res, iw, w, 0);
    sum += SUM;
  }
  return sum;
}
