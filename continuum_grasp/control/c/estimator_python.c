/* An estimator on doubles, for Python. */
#include "doubles.h"

typedef struct { ekf_state state; ekf_settings settings; ekf_work work; ekf_report report; } cg_object;

size_t cg_size(void) { return sizeof(cg_object); }
size_t cg_state_size(void) { return sizeof(ekf_state); }
void cg_settings(cg_object *o, const double *values) { cg_fill(&o->settings, values); }

/* in: z, u */
void cg_start(cg_object *o, const double *in)
{
  real z[EKF_NZ], u[EKF_NU];
  cg_read(u, cg_read(z, in, EKF_NZ), EKF_NU);
  ekf_start(&o->state, &o->settings, z, u);
}

/* in: y, u, p, periods since the last call, age in periods; out: limited, old, z now, parameters with the disturbances, verdicts, innovations, their variances; of the
 * time of the measurement: z and covariance by rows */
int cg_step(cg_object *o, const double *in, double *out)
{
  real y[EKF_NM], u[EKF_NU], p[EKF_SIZE(EKF_NP)], z[EKF_NZ], passed[2];
  cg_read(passed, cg_read(p, cg_read(u, cg_read(y, in, EKF_NM), EKF_NU), EKF_NP), 2);
  int status = ekf_step(&o->state, &o->work, &o->settings, y, u, p, passed[0], passed[1], &o->report);
  if (status < 0) return status;
  if (!ekf_now(&o->state, &o->work, &o->settings, p, z)) {
    ekf_restart(&o->state, &o->settings);
    memcpy(z, o->state.z, sizeof z);
    status = EKF_RESTARTED;
  }
  const real *arg[] = {z, p};
  real full[EKF_SIZE(EKF_NP)], *res[] = {full};
  estimated_parameters(arg, res);
  out = cg_write_ints(out, &o->report.limited, 1);
  out = cg_write_ints(out, &o->report.old, 1);
  out = cg_write(out, z, EKF_NZ);
  out = cg_write(out, full, EKF_NP);
  out = cg_write_ints(out, o->report.verdict, EKF_NM);
  out = cg_write(out, o->report.innovation, EKF_NY);
  out = cg_write(out, o->report.variance, EKF_NY);
  out = cg_write(out, o->state.z, EKF_NZ);
  for (int i = 0; i < EKF_NZ; ++i)
    for (int j = 0; j < EKF_NZ; ++j) {
      double sum = 0;
      for (int k = i > j ? i : j; k < EKF_NZ; ++k)
        sum += (double)o->state.U[i][k] * (double)o->state.U[j][k] * (double)o->state.D[k];
      *out++ = sum;
    }
  return status;
}
