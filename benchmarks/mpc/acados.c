/* The hooks of loop.c by acados's generated solver `loop`; U_MIN and U_MAX, limits of inputs, are defined above. */
#include <string.h>
#include "acados_c/ocp_nlp_interface.h"
#include "acados_solver_loop.h"

static loop_solver_capsule *capsule;
static ocp_nlp_config *config;
static ocp_nlp_dims *dims;
static ocp_nlp_in *in;
static ocp_nlp_out *out;
static const double u_min[] = U_MIN, u_max[] = U_MAX;
static void *options;

static void phase(int which)
{
  ocp_nlp_solver_opts_set(config, options, "rti_phase", &which);
}

static void set(int k, const char *field, const double *values)
{
  ocp_nlp_out_set(config, dims, out, in, k, field, (void *)values);
}

static void get(int k, const char *field, double *values)
{
  ocp_nlp_out_get(config, dims, out, k, field, values);
}

void solver_start(const double *x0, const double *u0)
{
  if (!capsule) {
    capsule = loop_acados_create_capsule();
    loop_acados_create(capsule);
    config = loop_acados_get_nlp_config(capsule);
    dims = loop_acados_get_nlp_dims(capsule);
    in = loop_acados_get_nlp_in(capsule);
    out = loop_acados_get_nlp_out(capsule);
    options = loop_acados_get_nlp_opts(capsule);
  }
  loop_acados_reset(capsule, 1, 1, 0, 1);
  for (int k = 0; k <= LOOP_N; ++k) set(k, "x", x0);
  for (int k = 0; k < LOOP_N; ++k) set(k, "u", u0);
}

void solver_shift(void)
{
  double x[LOOP_NX], u[LOOP_NU];
  for (int k = 0; k < LOOP_N; ++k) {
    get(k + 1, "x", x);
    set(k, "x", x);
    if (k + 1 < LOOP_N) {
      get(k + 1, "u", u);
      set(k, "u", u);
    }
  }
}

void solver_prepare(const double *p, const double *refs)
{
  for (int k = 0; k <= LOOP_N; ++k) {
    loop_acados_update_params(capsule, k, (double *)p, LOOP_NP);
    ocp_nlp_cost_model_set(config, dims, in, k, "yref", (void *)(refs + k * LOOP_NY));
  }
  phase(1);
  loop_acados_solve(capsule);
}

int solver_feedback(const double *x0)
{
  ocp_nlp_constraints_model_set(config, dims, in, out, 0, "lbx", (void *)x0);
  ocp_nlp_constraints_model_set(config, dims, in, out, 0, "ubx", (void *)x0);
  phase(2);
  return loop_acados_solve(capsule) == 0 ? 0 : -1;
}

const double *solver_input(void)
{
  static double u[LOOP_NU];
  get(0, "u", u);
  for (int i = 0; i < LOOP_NU; ++i) u[i] = u[i] < u_min[i] ? u_min[i] : u[i] > u_max[i] ? u_max[i] : u[i];
  return u;
}

void solver_plan(double *to)
{
  for (int k = 0; k <= LOOP_N; ++k) get(k, "x", to + k * LOOP_NX);
  for (int k = 0; k < LOOP_N; ++k) get(k, "u", to + (LOOP_N + 1) * LOOP_NX + k * LOOP_NU);
}
