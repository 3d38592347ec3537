/* HPIPM on one QP of a real-time iteration, as control/c/rti.h defines it, timed alone.
 *
 * The state is known, so that stage 0 has none: what follows from it is in the constant parts. Rows are soft with both
 * sides' slacks; bounds that are absent are masked.
 */
#define _POSIX_C_SOURCE 199309L
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include <hpipm_d_ocp_qp.h>
#include <hpipm_d_ocp_qp_dim.h>
#include <hpipm_d_ocp_qp_ipm.h>
#include <hpipm_d_ocp_qp_sol.h>

#define ABSENT 1e30

static struct {
  int N, nx, nu, nc, ns;
  struct d_ocp_qp_dim dim;
  struct d_ocp_qp qp;
  struct d_ocp_qp_sol sol;
  struct d_ocp_qp_ipm_arg arg;
  struct d_ocp_qp_ipm_ws ws;
} o;

static void *memory(hpipm_size_t size)
{
  return aligned_alloc(64, (size / 64 + 1) * 64);
}

static double now(void)
{
  struct timespec t;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* Rows of a node begin at one and end before another: those of the state alone are not at node 0, the others not at N. */
static int first_row(int k) { return k ? 0 : o.ns; }
static int end_row(int k) { return k < o.N ? o.nc : o.ns; }

void hpipm_create(int N, int nx, int nu, int nc, int ns, int mode, double tolerance, int warm)
{
  o.N = N, o.nx = nx, o.nu = nu, o.nc = nc, o.ns = ns;
  d_ocp_qp_dim_create(N, &o.dim, memory(d_ocp_qp_dim_memsize(N)));
  for (int k = 0; k <= N; ++k) {
    const int rows = end_row(k) - first_row(k), inputs = k < N ? nu : 0;
    d_ocp_qp_dim_set_nx(k, k ? nx : 0, &o.dim);
    d_ocp_qp_dim_set_nu(k, inputs, &o.dim);
    d_ocp_qp_dim_set_nbu(k, inputs, &o.dim);
    d_ocp_qp_dim_set_nbx(k, 0, &o.dim);
    d_ocp_qp_dim_set_ng(k, rows, &o.dim);
    d_ocp_qp_dim_set_ns(k, rows, &o.dim);
  }
  d_ocp_qp_create(&o.dim, &o.qp, memory(d_ocp_qp_memsize(&o.dim)));
  d_ocp_qp_sol_create(&o.dim, &o.sol, memory(d_ocp_qp_sol_memsize(&o.dim)));
  d_ocp_qp_ipm_arg_create(&o.dim, &o.arg, memory(d_ocp_qp_ipm_arg_memsize(&o.dim)));
  d_ocp_qp_ipm_arg_set_default((enum hpipm_mode)mode, &o.arg);
  int iterations = 100;
  d_ocp_qp_ipm_arg_set_iter_max(&iterations, &o.arg);
  d_ocp_qp_ipm_arg_set_tol_stat(&tolerance, &o.arg);
  d_ocp_qp_ipm_arg_set_tol_eq(&tolerance, &o.arg);
  d_ocp_qp_ipm_arg_set_tol_ineq(&tolerance, &o.arg);
  d_ocp_qp_ipm_arg_set_tol_comp(&tolerance, &o.arg);
  d_ocp_qp_ipm_arg_set_warm_start(&warm, &o.arg);
  d_ocp_qp_ipm_ws_create(&o.dim, &o.arg, &o.ws, memory(d_ocp_qp_ipm_ws_memsize(&o.dim, &o.arg)));
}

static double column_major[4096];

/* Rows from to end, columns of a row-major matrix with a stride, by columns. */
static double *columns(const double *from, int rows, int count, int stride)
{
  for (int i = 0; i < rows; ++i)
    for (int j = 0; j < count; ++j) column_major[j * rows + i] = from[i * stride + j];
  return column_major;
}

/* Bounds less a value; masked where absent. */
static void bounds(int count, const double *low, const double *high, const double *value, double *least, double *most,
                   double *has_least, double *has_most)
{
  for (int i = 0; i < count; ++i) {
    has_least[i] = low[i] > -ABSENT, has_most[i] = high[i] < ABSENT;
    least[i] = has_least[i] != 0 ? low[i] - value[i] : -1e6;
    most[i] = has_most[i] != 0 ? high[i] - value[i] : 1e6;
  }
}

/* Arguments as RealTimeIteration.qp gives them, by rows; dz (N + 1, nx + nu) is written. Returns HPIPM's status;
 * seconds are of the solution alone. */
int hpipm_solve(const double *x0, const double *x, const double *u, const double *A, const double *B,
                const double *defect, const double *g, const double *H, const double *c, const double *C,
                const double *u_min, const double *u_max, const double *c_min, const double *c_max,
                const double *linear, const double *quadratic, double *dz, double *seconds, int *iterations)
{
  const int N = o.N, nx = o.nx, nu = o.nu, nz = nx + nu, nc = o.nc;
  double dx0[256], b[256], r[256], value[256], least[256], most[256], lower[256], upper[256], zero[256] = {0};
  int index[256];
  for (int i = 0; i < nx; ++i) dx0[i] = x0[i] - x[i];
  for (int k = 0; k <= N; ++k) {
    const double *Hk = H + k * nz * nz, *gk = g + k * nz, *Ck = C + k * nc * nz;
    if (k < N) {
      for (int i = 0; i < nx; ++i) {
        b[i] = defect[k * nx + i];
        for (int j = 0; j < nx && !k; ++j) b[i] += A[i * nx + j] * dx0[j];
      }
      if (k) d_ocp_qp_set_A(k, columns(A + k * nx * nx, nx, nx, nx), &o.qp);
      d_ocp_qp_set_B(k, columns(B + k * nx * nu, nx, nu, nu), &o.qp);
      d_ocp_qp_set_b(k, b, &o.qp);
      for (int i = 0; i < nu; ++i) {
        r[i] = gk[nx + i];
        for (int j = 0; j < nx && !k; ++j) r[i] += Hk[(nx + i) * nz + j] * dx0[j];
      }
      d_ocp_qp_set_R(k, columns(Hk + nx * nz + nx, nu, nu, nz), &o.qp);
      d_ocp_qp_set_r(k, r, &o.qp);
      if (k) d_ocp_qp_set_S(k, columns(Hk + nx * nz, nu, nx, nz), &o.qp);
      for (int i = 0; i < nu; ++i) index[i] = i;
      d_ocp_qp_set_idxbu(k, index, &o.qp);
      bounds(nu, u_min, u_max, u + k * nu, least, most, lower, upper);
      d_ocp_qp_set_lbu(k, least, &o.qp);
      d_ocp_qp_set_ubu(k, most, &o.qp);
      d_ocp_qp_set_lbu_mask(k, lower, &o.qp);
      d_ocp_qp_set_ubu_mask(k, upper, &o.qp);
    }
    if (k) {
      d_ocp_qp_set_Q(k, columns(Hk, nx, nx, nz), &o.qp);
      memcpy(r, gk, sizeof(double) * (size_t)nx);
      d_ocp_qp_set_q(k, r, &o.qp);
    }
    const int from = first_row(k), rows = end_row(k) - from;
    if (!rows) continue;
    for (int i = 0; i < rows; ++i) {
      value[i] = c[k * nc + from + i];
      for (int j = 0; j < nx && !k; ++j) value[i] += Ck[(from + i) * nz + j] * dx0[j];
      index[i] = (k < N ? nu : 0) + i;
    }
    if (k) d_ocp_qp_set_C(k, columns(Ck + from * nz, rows, nx, nz), &o.qp);
    if (k < N) d_ocp_qp_set_D(k, columns(Ck + from * nz + nx, rows, nu, nz), &o.qp);
    bounds(rows, c_min + from, c_max + from, value, least, most, lower, upper);
    d_ocp_qp_set_lg(k, least, &o.qp);
    d_ocp_qp_set_ug(k, most, &o.qp);
    d_ocp_qp_set_lg_mask(k, lower, &o.qp);
    d_ocp_qp_set_ug_mask(k, upper, &o.qp);
    d_ocp_qp_set_idxs(k, index, &o.qp);
    memcpy(r, quadratic + from, sizeof(double) * (size_t)rows);
    d_ocp_qp_set_Zl(k, r, &o.qp);
    d_ocp_qp_set_Zu(k, r, &o.qp);
    memcpy(r, linear + from, sizeof(double) * (size_t)rows);
    d_ocp_qp_set_zl(k, r, &o.qp);
    d_ocp_qp_set_zu(k, r, &o.qp);
    d_ocp_qp_set_lls(k, zero, &o.qp);
    d_ocp_qp_set_lus(k, zero, &o.qp);
  }
  const double begin = now();
  d_ocp_qp_ipm_solve(&o.qp, &o.sol, &o.arg, &o.ws);
  *seconds = now() - begin;
  int status;
  d_ocp_qp_ipm_get_status(&o.ws, &status);
  d_ocp_qp_ipm_get_iter(&o.ws, iterations);
  memset(dz, 0, sizeof(double) * (size_t)((N + 1) * nz));
  memcpy(dz, dx0, sizeof(double) * (size_t)nx);
  for (int k = 0; k <= N; ++k) {
    if (k) d_ocp_qp_sol_get_x(k, &o.sol, dz + k * nz);
    if (k < N) d_ocp_qp_sol_get_u(k, &o.sol, dz + k * nz + nx);
  }
  return status;
}
