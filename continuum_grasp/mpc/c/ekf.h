/* Extended Kalman filter of a continuous motion with measurements of known age.
 *
 * The state z = [x, d] has slowly varying disturbances d. The covariance is kept as U diag(D) U', U unit upper
 * triangular: it stays symmetric and positive in single precision too. Measurements are taken one by one (Bierman);
 * the prediction orthogonalises weighted rows (Thornton); see G. J. Bierman, Factorization Methods for Discrete
 * Sequential Estimation, 1977, chapters V and VI. The noise of a step of length h is
 * h/6 (F Q F' + 4 G Q G' + Q), with the derivatives F of the step and G of half of it.
 *
 * A measurement that arrives now was taken EKF_DELAY periods ago. The filter lives at that time; `ekf_now` predicts the
 * state from there with the inputs that were applied since.
 *
 * Dimensions are set before this file is read: EKF_NZ, EKF_NX (states without the disturbances), EKF_NU, EKF_NP, EKF_NY (compared quantities), EKF_NM
 * (measurements), EKF_DELAY; and `real`, with CG_SINGLE defined if that is float. The generated functions
 * estimator_step, estimator_flow and estimator_outputs stand before ekf.c. Nothing is allocated or kept between calls
 * beside what the caller owns; matrices of generated functions are stored by columns.
 */
#ifndef EKF_H
#define EKF_H
#include "checks.h"

#define EKF_SIZE(n) ((n) > 0 ? (n) : 1)

enum {                        /* result of a step */
  EKF_OK = 0,
  EKF_RESTARTED = 1,          /* the estimate was not finite or beyond its limits: it starts again from its first state */
  EKF_BAD_INPUT = -1          /* input or parameters are not finite: nothing has changed */
};

typedef struct {
  real noise[EKF_NZ];         /* intensity of the white noise that drives each state, variance per second */
  real initial[EKF_NZ];       /* variance of each state at the start */
  real z_min[EKF_NZ], z_max[EKF_NZ];
  real mixing[EKF_NY][EKF_NM];        /* compared quantities as sums of measurements */
  real variance[EKF_NY];      /* of each compared quantity */
  real y_min[EKF_NM], y_max[EKF_NM];  /* of each measurement */
  real period;                /* time from one measurement to the next [s] */
  int substeps;               /* Runge-Kutta steps per period */
  real gate;                  /* standard deviations beyond which a measurement is an outlier */
  int patience;               /* outliers in a row after which the gate opens */
} ekf_settings;

typedef struct {
  real z[EKF_NZ], first[EKF_NZ];
  real U[EKF_NZ][EKF_NZ], D[EKF_NZ];
  real queue[EKF_SIZE(EKF_DELAY)][EKF_NU];    /* inputs that were applied since the measurement, a ring */
  int oldest, started;
  int closed[EKF_NY];         /* outliers in a row */
} ekf_state;

typedef struct {
  real W[EKF_NZ][4 * EKF_NZ], weight[4 * EKF_NZ];
  real F[EKF_NZ * EKF_NZ], G[EKF_NZ * EKF_NZ], H[EKF_NY * EKF_NZ], y[EKF_NY];
  real next[EKF_NZ];
} ekf_work;

typedef struct {
  int verdict[EKF_NM];        /* of each measurement, as in checks.h */
  int used, limited;          /* compared quantities that were used; whether a disturbance was moved into its limits */
  real innovation[EKF_NY], variance[EKF_NY];    /* of each compared quantity; variance 0: there was none */
} ekf_report;

/* Start at a state with its initial variances; u0 was applied before. */
void ekf_start(ekf_state *state, const ekf_settings *settings, const real *z0, const real *u0);
/* Take the measurements y; u was applied since the last call (not used by the first). */
int ekf_step(ekf_state *state, ekf_work *work, const ekf_settings *settings, const real *y, const real *u,
             const real *p, ekf_report *report);
/* The state now, predicted with the inputs that were applied since the measurement; whether it means something. */
int ekf_now(const ekf_state *state, ekf_work *work, const ekf_settings *settings, const real *p, real *z);
/* Variance of each state at the time of the measurement. */
void ekf_variance(const ekf_state *state, real *variance);
#endif
