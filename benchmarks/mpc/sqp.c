/* The hooks of loop.c by CasADi's generated `sqpmethod`; peers.py defines the words in capitals above. */
#include <string.h>

int rti(const double **arg, double **res, long long int *iw, double *w, int mem);
static const double fixed_lbx[] = LBX, fixed_ubx[] = UBX, lbg[] = LBG, ubg[] = UBG;
static double w[COUNT], lam_x[COUNT], lam_g[ROWS], next_w[COUNT], next_x[COUNT], next_g[ROWS];
static double lbx[COUNT], ubx[COUNT], parameters[PARAMETERS];
static long long int iw[SZ_IW + 1];
static double work[SZ_W + 1];

/* Whether all numbers are finite, by their bits: compilers may assume that they are. */
static int finite(const double *a, int count)
{
  int bad = 0;
  for (int i = 0; i < count; ++i) {
    unsigned long long bits;
    memcpy(&bits, a + i, sizeof bits);
    bad |= (bits & 0x7ff0000000000000ULL) == 0x7ff0000000000000ULL;
  }
  return !bad;
}

void solver_start(const double *x0, const double *u0)
{
  memset(w, 0, sizeof w);
  memset(lam_x, 0, sizeof lam_x);
  memset(lam_g, 0, sizeof lam_g);
  memcpy(lbx, fixed_lbx, sizeof lbx);
  memcpy(ubx, fixed_ubx, sizeof ubx);
  for (int k = 0; k < N; ++k) {
    memcpy(w + k * NZ, x0, sizeof(double) * NX);
    memcpy(w + k * NZ + NX, u0, sizeof(double) * NU);
  }
  memcpy(w + N * NZ, x0, sizeof(double) * NX);
}

void solver_shift(void)
{
  SHIFT
  memcpy(w + (N - 1) * NZ, w + N * NZ, sizeof(double) * NX);
}

void solver_prepare(const double *p, const double *refs)
{
  memcpy(parameters, p, sizeof(double) * NP);
  memcpy(parameters + NP, refs, sizeof(double) * (PARAMETERS - NP));
}

int solver_feedback(const double *x0)
{
  memcpy(w, x0, sizeof(double) * NX);
  memcpy(lbx, x0, sizeof(double) * NX);
  memcpy(ubx, x0, sizeof(double) * NX);
  const double *arg[SZ_ARG + 1] = {w, parameters, lbx, ubx, lbg, ubg, lam_x, lam_g};
  double *res[SZ_RES + 1] = {next_w, 0, 0, next_x, next_g, 0};
  rti(arg, res, iw, work, 0);
  if (!finite(next_w, COUNT) || !finite(next_x, COUNT) || !finite(next_g, ROWS)) { /* the problem failed */
    double u[NU];
    memcpy(u, w + NX, sizeof u);
    solver_start(x0, u);
    return -1;
  }
  memcpy(w, next_w, sizeof w);
  memcpy(lam_x, next_x, sizeof lam_x);
  memcpy(lam_g, next_g, sizeof lam_g);
  return 0;
}

const double *solver_input(void)
{
  static const double least[] = U_MIN, most[] = U_MAX;
  static double u[NU];
  for (int i = 0; i < NU; ++i) {
    u[i] = w[NX + i];
    u[i] = u[i] < least[i] ? least[i] : u[i] > most[i] ? most[i] : u[i];
  }
  return u;
}

void solver_plan(double *to)
{
  for (int k = 0; k <= N; ++k) memcpy(to + k * NX, w + k * NZ, sizeof(double) * NX);
  for (int k = 0; k < N; ++k) memcpy(to + (N + 1) * NX + k * NU, w + k * NZ + NX, sizeof(double) * NU);
}
