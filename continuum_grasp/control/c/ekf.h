/* Extended Kalman filter of a continuous motion with measurements of known age.
 *
 * The state z = [x, d] has slowly varying disturbances d. The covariance is stored as U diag(D) U', U unit upper
 * triangular, so that it stays symmetric and positive in single precision too. The update takes measurements one by one
 * (Bierman), the prediction orthogonalizes weighted rows (Thornton): G. J. Bierman, Factorization Methods for Discrete
 * Sequential Estimation, 1977, chapters V and VI. The noise of a step of length h is h/6 (F Q F' + 4 G Q G' + Q),
 * Simpson's rule of the integral, with the derivatives F of the step and G of half of it.
 *
 * The gate acts per sensor, which is a device: both axes of a camera are one, since they fail together. All tests use
 * the prediction before any row is taken, so that the order of rows does not matter and a wrong row does not make a
 * right one look wrong. A sensor beyond the gate is rejected (a glitch lasts a frame or two), unless it was beyond too
 * often lately: then the model is wrong, and the sensor is used with bounded influence (P. J. Huber,
 * doi:10.1214/aoms/1177703732). So a wrong model never leaves the loop without measurements: with a gate that rejects
 * by row, a lag of half the model's ended in a limit cycle of 86 mm.
 *
 * A measurement that arrives now was taken EKF_DELAY periods ago, or as long ago as is stated with it. The filter's state
 * is of that time; `ekf_now` predicts the state now with the inputs applied since. The first steps of that are those
 * that the next call's prediction makes, unless its parameters change: they are made once, and the workspace knows what
 * they started from. Where calls were missed, or measurements are of varying age, the inputs of the time that passed move
 * the state, each for as long as it acted. A measurement that is no younger than the one before is not used.
 *
 * Adapted parameters are disturbances that a plant has once and for all. Their noise is in proportion to what is known
 * of them, 1 - variance / initial variance, so that the variance of one that does not show stays that of the start, and
 * returns to it where nothing shows any longer, while the estimate stays: linear forgetting towards what is known before.
 * Their sensitivities, the columns of F, G and H, are shrunk by the share that noise of the estimate may have in their
 * mean over `memory`, to zero where it explains all: at rest, noise passed for motion, and moved the lag to its least
 * value within 3 s.
 *
 * Dimensions are set before this file is read: EKF_NZ, EKF_NX (states without the disturbances), EKF_NU, EKF_NP, EKF_NY
 * (compared quantities), EKF_NS (sensors), EKF_NM (measurements), EKF_DELAY, EKF_AHEAD (steps from the measurement to now),
 * EKF_STEPS (steps that the workspace remembers), EKF_NF (friction states), EKF_NA (adapted parameters); and `real`, with
 * CG_SINGLE defined if that is float. The generated functions estimator_step, estimator_outputs and, where EKF_AHEAD is
 * above EKF_STEPS, estimator_flow stand before ekf.c. Nothing is allocated or static; matrices of generated functions are
 * stored by columns.
 */
#ifndef EKF_H
#define EKF_H
#include "checks.h"

#define EKF_SIZE(n) ((n) > 0 ? (n) : 1)
#define EKF_FROM (EKF_NZ + EKF_NU + EKF_NP + 1)
#define EKF_QUEUE (EKF_DELAY + 9)   /* inputs that are remembered, those of a measurement eight periods older than usual */
#define EKF_LONGEST 256         /* periods over which a prediction goes at most, with 10 ms 2.6 s: whatever moved has come to
                                   rest, and the call that follows a stall ends in time */
#define EKF_MOMENT (real)1e-3   /* periods that make no difference: 1e-3 of 10 ms at 1 m/s are 0.01 mm */

/* The leaky gate, in samples of a sensor. The numbers come from trials with 26 wrong plants and 15 faults. */
#define EKF_PATIENCE 3          /* samples in a row that are rejected: a glitch is one or two frames; with 10, half a
                                   period of the finger's first mode, the loop is lost before the gate opens */
#define EKF_LEAK 0.05           /* forgiven per good sample: up to 5 % of single outliers are rejected for ever */
#define EKF_BUCKET_CAP 20.0     /* a mismatch is forgotten 17 / 0.05 = 340 samples after it ends, so that the gate does not
                                   close again and again while the loop swings */
#define EKF_HUBER 5.0           /* standard deviations by which one row moves the estimate at most; no nominal sample
                                   reaches it, and 3 did as well (geometric mean of errors 5.19 against 5.15 mm) */
#define EKF_NIS_CAP 30.0        /* cap of a row's squared normalized innovation in `nis`: one sample alone must not look
                                   like a wrong sensor */

enum {                        /* result of a step */
  EKF_OK = 0,
  EKF_RESTARTED = 1,          /* the estimate was not finite or beyond its limits: restarted from its last sound prediction, or
                                 within EKF_PATIENCE samples of a restart from its first state */
  EKF_BAD_INPUT = -1          /* input or parameters are not finite: nothing has changed */
};

typedef struct {
  real noise[EKF_NZ];         /* intensity of the white noise that drives each state, variance per second */
  real initial[EKF_NZ];       /* variance of each state at the start */
  real z_min[EKF_NZ], z_max[EKF_NZ];
  int natural[EKF_NZ];        /* whether a state may stay at a limit: no friction at all, a parameter as far as it is adapted */
  real mixing[EKF_NY][EKF_NM];        /* compared quantities as sums of measurements */
  real variance[EKF_NY];      /* of each compared quantity */
  real y_min[EKF_NM], y_max[EKF_NM];  /* of each measurement */
  real period;                /* time from one measurement to the next [s] */
  int substeps;               /* Runge-Kutta steps per period */
  real gate;                  /* standard deviations beyond which a measurement is an outlier */
  int sensor[EKF_NY];         /* of each compared quantity */
#if EKF_NF > 0
  int friction[EKF_NF];       /* indices of friction states: between -1 and 1 at rest, whatever a sensor says */
#endif
#if EKF_NA > 0
  int adapted[EKF_NA];        /* indices of adapted parameters */
  real memory;                /* time over which their sensitivities are averaged [s] */
  real quiet[EKF_NA][EKF_NX][EKF_NX];   /* L of a sensitivity s of a step: |L s| = 1 is the most that noise explains */
#endif
  int drive[EKF_NX];          /* 1: a state is the position, tension or moment of a drive, 2: the rate of one */
  real fade;                  /* share of a period in slow means */
} ekf_settings;

typedef struct {
  real z[EKF_NZ], first[EKF_NZ];
  real sound[EKF_NZ];         /* the last prediction from which a plausible estimate came */
  real U[EKF_NZ][EKF_NZ], D[EKF_NZ];
  /* inputs applied since the time of the state, a ring, and for how many periods each acted since then */
  real queue[EKF_QUEUE][EKF_NU], span[EKF_QUEUE];
  int oldest, queued, started;
  int restarted;              /* samples in which another restart begins from the first state */
  real bucket[EKF_NS];        /* of the leaky gate of each sensor: recent outliers */
  real usual[EKF_NX];         /* slow means of the states of drives */
  real commanded[EKF_NX], settled[EKF_NX];    /* states of drives as commands alone move them, and slow means of those */
  real answer[EKF_NX];        /* motion of the states about slow means, as far as commands of drives cause it */
  real before[EKF_NY], bias[EKF_NY];    /* normalized innovations: of the last call, slow means */
  real moved[EKF_NY];         /* motion of drives at the last call, in deviations */
#if EKF_NA > 0
  real age;                   /* since the start, up to the memory [s] */
  real motion[EKF_NA][EKF_NX];          /* mean sensitivity of the states to each adapted parameter, over a step */
  real excited[EKF_NA];       /* share of the sensitivity to each adapted parameter that noise does not explain */
#endif
} ekf_state;

typedef struct {
  real from[EKF_FROM];        /* z, u, p and h */
  real next[EKF_NZ], F[EKF_NZ * EKF_NZ], G[EKF_NZ * EKF_NZ];
} ekf_transition;             /* a step of the model: from where, to where, and its derivatives */

typedef struct {
  real W[EKF_NZ][4 * EKF_NZ], weight[4 * EKF_NZ];
  real H[EKF_NY * EKF_NZ], y[EKF_NY];
  ekf_transition steps[EKF_STEPS];
} ekf_work;

typedef struct {
  int verdict[EKF_NM];        /* of each measurement, as in checks.h */
  int used, limited;          /* compared quantities that were used; whether a disturbance was clipped to its limits */
  int implausible;            /* whether that limit is none of nature's */
  int old;                    /* whether the measurement was no younger than the one before */
  real innovation[EKF_NY], variance[EKF_NY];    /* of each compared quantity; variance 0: there was none */
  real nis[EKF_NS];           /* mean squared normalized innovation of each sensor, before any row was taken; below zero: the
                                 sensor was not used */
  real echo[EKF_NS];          /* mean product of normalized innovations, about slow means, of two calls in a row: about 0 or
                                 less where the filter knows the motion, above where a delay or a lag is unknown */
  real motion[EKF_NY];        /* of each compared quantity that is the state of a drive alone, about its slow mean */
  real along[EKF_NS], travel[EKF_NS];   /* mean product of the normalized innovations of drives with that motion, and mean square of
                                 the motion, in the same deviations: a drive that is slower than its model falls behind
                                 its motion again and again, by less than any one call shows */
  real ahead[EKF_NS], change[EKF_NS];   /* the same of the change of that motion since the last call: whatever swings, a drive
                                 that is faster than its model is ahead of it */
  real expected[EKF_NM];      /* motion of each measurement about its slow mean, as far as commands of drives cause it */
} ekf_report;

/* Start at a state with its initial variances; u0 was applied before. */
void ekf_start(ekf_state *state, const ekf_settings *settings, const real *z0, const real *u0);
/* Predict, and update with the measurements y, which are `age` periods old; u was applied in the periods that `passed`
 * since the last call (unused in the first). */
int ekf_step(ekf_state *state, ekf_work *work, const ekf_settings *settings, const real *y, const real *u,
             const real *p, real passed, real age, ekf_report *report);
/* Predict the state now with the inputs applied since the measurement; whether it is plausible. */
int ekf_now(const ekf_state *state, ekf_work *work, const ekf_settings *settings, const real *p, real *z);
/* Variance of each state at the time of the measurement. */
void ekf_variance(const ekf_state *state, real *variance);
#endif
