/* A closed loop around a receding-horizon solver, timed phase by phase in processor time of this thread.
 *
 * The solver is compiled with it or linked to it:
 *   solver_start(x0, u0)         first guess
 *   solver_shift()               the guess one stage on
 *   solver_prepare(p, refs)      what can be done before the state is known
 *   solver_feedback(x0)          the rest; < 0: no plan
 *   solver_input()               the input to apply
 *   solver_plan(to)              states, then inputs
 */
#include <string.h>
#include <time.h>

int plant(const double **arg, double **res, long long int *iw, double *w, int mem);
void solver_start(const double *x0, const double *u0);
void solver_shift(void);
void solver_prepare(const double *p, const double *refs);
int solver_feedback(const double *x0);
const double *solver_input(void);
void solver_plan(double *to);

static double now(void)
{
  struct timespec t;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* Seconds that a measurement of nothing takes. */
double timer_cost(void)
{
  const double start = now();
  for (int k = 0; k < 1000; ++k) (void)now();
  return (now() - start) / 1000.0;
}

/* States (steps + 1, nx), inputs (steps, nu), seconds of shift and preparation, and of feedback (steps, 2), status
 * (steps), and, unless they are null, guesses and plans (steps, plan). The first step is iterated `warm` times before it
 * is timed; its first iteration is the cold one. */
void closed_loop(long long steps, int warm, const double *x0, const double *u0, const double *p, const double *plant_p,
    const double *refs, double *x, double *u, double *seconds, double *cold, int *status, double *guess, double *plan)
{
  static long long int iw[PLANT_IW + 1];
  static double w[PLANT_W + 1];
  memcpy(x, x0, NX * sizeof(double));
  solver_start(x0, u0);
  *cold = now();
  for (int k = 0; k < warm; ++k) {
    solver_prepare(p, refs);
    solver_feedback(x0);
    if (k == 0) *cold = now() - *cold;
  }
  for (long long k = 0; k < steps; ++k) {
    const double start = now();
    if (k) solver_shift();
    if (guess) solver_plan(guess + k * PLAN);
    const double shifted = now();
    solver_prepare(p, refs + k * REFS);
    const double middle = now();
    status[k] = solver_feedback(x);
    const double end = now();
    seconds[2 * k] = middle - (guess ? shifted : start);
    seconds[2 * k + 1] = end - middle;
    if (plan) solver_plan(plan + k * PLAN);
    memcpy(u, solver_input(), NU * sizeof(double));
    const double *arg[PLANT_ARG + 1] = {x, u, plant_p + k * NP};
    double *res[PLANT_RES + 1] = {x + NX};
    plant(arg, res, iw, w, 0);
    x += NX;
    u += NU;
  }
}
