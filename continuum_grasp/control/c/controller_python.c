/* A controller on doubles, for Python. */
#include "doubles.h"

typedef struct {
  controller_state state;
  controller_settings settings;
  controller_work work;
  controller_output output;
  real measurement[CONTROLLER_NM], p[RTI_SIZE(RTI_NP)], applied[RTI_NU];
  real setpoints[RTI_SIZE((RTI_N + 1) * RTI_NR)];
} cg_object;

#if CONTROLLER_ESTIMATES
#define CG_START EKF_NZ
#else
#define CG_START CONTROLLER_ND
#endif

size_t cg_size(void) { return sizeof(cg_object); }
size_t cg_state_size(void) { return sizeof(controller_state); }
void cg_settings(cg_object *o, const double *values) { cg_fill(&o->settings, values); }

/* in: z, u, p */
void cg_start(cg_object *o, const double *in)
{
  real z[CG_START];
  cg_read(o->p, cg_read(o->applied, cg_read(z, in, CG_START), RTI_NU), RTI_NP);
  controller_start(&o->state, &o->settings, z, o->applied, o->p);
}

/* in: states and inputs over the horizon, from which the next step iterates as from a plan of now */
void cg_guess(cg_object *o, const double *in)
{
  cg_read(&o->state.plan.u[0][0], cg_read(&o->state.plan.x[0][0], in, (RTI_N + 1) * RTI_NX), RTI_N * RTI_NU);
  o->state.planned = 1;
  o->state.age = -o->settings.period / o->settings.rti.stage;    /* a step begins by a period */
}

int cg_rearm(cg_object *o) { return controller_rearm(&o->state, &o->settings); }

/* in: measurement, p, applied, setpoints, elapsed, age; flags: 1 late, 2 applied is an argument;
 * out: the numbers of REPORTED in members.py by cg_write_reported, ticks, u, x, p, verdicts, excess of rows, of the time of the measurement z and its covariance U diag(D) U',
 * innovations, their variances, plan */
int cg_controller_step(cg_object *o, const double *in, int flags, double *out)
{
  controller_input given = {o->measurement, o->setpoints, o->p, flags & 2 ? o->applied : 0, flags & 1, -1, -1};
  controller_output *found = &o->output;
  in = cg_read(o->measurement, in, CONTROLLER_NM);
  in = cg_read(o->p, in, RTI_NP);
  in = cg_read(o->applied, in, RTI_NU);
  in = cg_read(o->setpoints, in, (RTI_N + 1) * RTI_NR);
  in = cg_read(&given.elapsed, in, 1);
  cg_read(&given.age, in, 1);
  const int status = controller_step(&o->state, &o->work, &o->settings, &given, found);
  out = cg_write_reported(out, found);
  for (int k = 0; k < CONTROLLER_PHASES; ++k) *out++ = found->ticks[k];
  out = cg_write(out, found->u, RTI_NU);
  out = cg_write(out, found->x, RTI_NX);
  out = cg_write(out, found->p, RTI_NP);
  out = cg_write_ints(out, found->verdict, CONTROLLER_NM);
  out = cg_write(out, found->rti.excess, RTI_NC);
#if CONTROLLER_ESTIMATES
  /* the covariance in factors: whoever wants it multiplies them, the others pay for copies */
  out = cg_write(out, o->state.ekf.z, EKF_NZ);
  out = cg_write(out, &o->state.ekf.U[0][0], EKF_NZ * EKF_NZ);
  out = cg_write(out, o->state.ekf.D, EKF_NZ);
  out = cg_write(out, found->ekf.innovation, EKF_NY);
  out = cg_write(out, found->ekf.variance, EKF_NY);
#endif
  out = cg_write(out, &o->state.plan.x[0][0], (RTI_N + 1) * RTI_NX);
  cg_write(out, &o->state.plan.u[0][0], RTI_N * RTI_NU);
  return status;
}
