/* A controller: estimator, real-time iteration, supervisor, and a fallback for when one of them fails.
 *
 * Each call of controller_step takes a measurement and returns the input to apply until the next call:
 *
 *   1. Parameters and setpoints are checked: finite and within their limits. Bad parameters are replaced by the last
 *      good ones.
 *   2. Readings at rest are rejected. The estimator computes from the others the state now and the disturbances, which
 *      go into the parameters over the whole horizon. Without an estimator (CONTROLLER_ESTIMATES 0) the measurement is
 *      the state.
 *   3. One real-time iteration from the last plan, shifted in time; several from a plan at rest where there is none, or
 *      where that fails.
 *   4. The first input of the plan, clipped to the limits of input and rate.
 *
 * The status reports what the command comes from; the health, whether sensors, model and call rate agree
 * (supervisor.h). The supervisor raises the weight of the command's rate, the last RTI_NU weights, and sends the
 * command to the safe input after a trip, until controller_rearm.
 *
 * If one of 1 to 3 fails, or the last command was late, the controller follows the last plan to its end; after that,
 * and where nothing was measured for as long as a plan lasts, the input goes to the safe one at a bounded rate. A
 * command is finite and within the limits of input and rate, with one exception: where the settings move a limit past
 * the last command, or the input before the start is beyond one, the rate limit wins until the command gets there. What
 * was applied since is no such input.
 *
 * status                       what the command comes from
 * ---------------------------- -----------------------------------------------------------------------------------
 *  0 CONTROLLER_SOLVED         a new plan
 *  1 CONTROLLER_ITERATION_LIMIT    a new plan, whose QP was not solved to its tolerance
 *  2 CONTROLLER_ROW_VIOLATED   a new plan that violates a soft constraint
 *  3 CONTROLLER_PREVIOUS_PLAN  the last plan
 *  4 CONTROLLER_SAFE_RAMP      the ramp to the safe input
 * -1 CONTROLLER_INVALID        none: the settings are not valid, or the controller was not started; u is not written
 *
 * anomalies (bits)             of a call
 * ---------------------------- -----------------------------------------------------------------------------------
 *   1 CONTROLLER_MISSING       an entry of the measurement is missing (NaN)
 *   2 CONTROLLER_ABSURD        one is infinite or beyond its limits
 *   4 CONTROLLER_OUTLIER       one is too far from what was expected, and its sensor was rejected
 *   8 CONTROLLER_REOPENED      one is too far too often: used with bounded influence
 *  16 CONTROLLER_BLIND         nothing was measured for as long as a plan lasts
 *  32 CONTROLLER_ESTIMATE_LIMITED      an estimated disturbance was clipped to its limits
 *  64 CONTROLLER_ESTIMATE_RESTARTED    the estimate was not finite or beyond its limits; the estimator restarted
 * 128 CONTROLLER_BAD_SETPOINTS        a setpoint is not finite or beyond its limits
 * 256 CONTROLLER_BAD_PARAMETERS        a parameter is
 * 512 CONTROLLER_BAD_APPLIED   the applied input is; the last command is assumed instead
 * 1024 CONTROLLER_LATE         the last command was late
 * 2048 CONTROLLER_NOT_SOLVED   the real-time iteration failed
 * 4096 CONTROLLER_INPUT_LIMITED        the planned input was outside its limits
 * 8192 CONTROLLER_RATE_LIMITED         the planned input was further from the last one than its rate allows in a stage
 * 16384 CONTROLLER_FROZEN      a reading does not move: it counts as missing until it does
 * 32768 CONTROLLER_BEYOND_LIMIT        a limit is past the last command, which approaches it at its rate
 * 65536 CONTROLLER_PLAN_GAPS   the plan was no motion of the model: replaced, or integrated anew
 * 131072 CONTROLLER_MISSED_CALLS       calls were missed before this one: `missed` tells how many
 * 262144 CONTROLLER_CLOCK      the time of the call is none: it stands still, goes back, or counts another unit
 * 524288 CONTROLLER_OLD        the measurement is no younger than the one before, and is not used
 * 1048576 CONTROLLER_OUT_OF_REACH      a setpoint is one that the finger cannot meet, however it bends
 *
 * Dimensions: those of rti.h, and CONTROLLER_ND (states that are estimated or measured; the others of RTI_NX are the
 * last input), CONTROLLER_ESTIMATES, CONTROLLER_NM (measurements), CONTROLLER_NS (sensors); with an estimator those of
 * ekf.h, and the generated function estimated_parameters. CONTROLLER_TICKS() may be a clock (uint32_t) that times the
 * phases.
 */
#ifndef CONTROLLER_H
#define CONTROLLER_H
#include "checks.h"
#include "supervisor.h"

#define CONTROLLER_PHASES 3
#define CONTROLLER_CORRECTS (CONTROLLER_ESTIMATES && RTI_NR > 0)
#ifndef CONTROLLER_TICKS
#define CONTROLLER_TICKS() 0u
#endif

enum {
  CONTROLLER_SOLVED = 0,
  CONTROLLER_ITERATION_LIMIT = 1,
  CONTROLLER_ROW_VIOLATED = 2,
  CONTROLLER_PREVIOUS_PLAN = 3,
  CONTROLLER_SAFE_RAMP = 4,
  CONTROLLER_INVALID = -1
};

enum {
  CONTROLLER_MISSING = 1,
  CONTROLLER_ABSURD = 2,
  CONTROLLER_OUTLIER = 4,
  CONTROLLER_REOPENED = 8,
  CONTROLLER_BLIND = 16,
  CONTROLLER_ESTIMATE_LIMITED = 32,
  CONTROLLER_ESTIMATE_RESTARTED = 64,
  CONTROLLER_BAD_SETPOINTS = 128,
  CONTROLLER_BAD_PARAMETERS = 256,
  CONTROLLER_BAD_APPLIED = 512,
  CONTROLLER_LATE = 1024,
  CONTROLLER_NOT_SOLVED = 2048,
  CONTROLLER_INPUT_LIMITED = 4096,
  CONTROLLER_RATE_LIMITED = 8192,
  CONTROLLER_FROZEN = 16384,
  CONTROLLER_BEYOND_LIMIT = 32768,
  CONTROLLER_PLAN_GAPS = 65536,
  CONTROLLER_MISSED_CALLS = 131072,
  CONTROLLER_CLOCK = 262144,
  CONTROLLER_OLD = 524288,
  CONTROLLER_OUT_OF_REACH = 1048576
};

typedef struct {
  rti_settings rti;
#if CONTROLLER_ESTIMATES
  ekf_settings ekf;
#endif
  real period;                /* time from one command to the next, a stage at most [s] */
  real u_rate[RTI_NU];        /* greatest change of the input per time; 1e30: none */
  real u_safe[RTI_NU], safe_rate[RTI_NU];       /* end of the safe ramp, as far as limits allow; its rate */
  real applied_min[RTI_NU], applied_max[RTI_NU];        /* of an applied input: slack drives, overshoot */
  real r_min[RTI_SIZE(RTI_NR)], r_max[RTI_SIZE(RTI_NR)];
  /* of setpoints that can be met; at the x of a point the radius of its circle about their middle, else 0 */
  real reach_min[RTI_SIZE(RTI_NR)], reach_max[RTI_SIZE(RTI_NR)], reach_radius[RTI_SIZE(RTI_NR)];
  real p_min[RTI_SIZE(RTI_NP)], p_max[RTI_SIZE(RTI_NP)];
  real x_min[CONTROLLER_ND], x_max[CONTROLLER_ND];      /* of a measured state */
  int sqp_iterations, start_iterations;         /* from the last plan, and from one at rest */
  int start_calls;            /* calls over which the latter are spread, the fewest in the first, which integrates a motion too */
  /* of setpoints of the tip that stand: share of a call in the mean by which they are corrected, 0: they are not; greatest
   * correction [m]; calls until the mean begins */
  real correction, correction_most;
  int correction_after;
  supervisor_settings supervisor;
} controller_settings;

typedef struct {
  int started, planned;       /* whether there is a plan */
  int blind;                  /* calls since something was measured */
  int pending;                /* iterations of its start that are left */
  real aim[2];                /* setpoint of the tip where it stands */
#if CONTROLLER_CORRECTS
  int stood;                  /* calls for which it stands, up to `correction_after` */
  real bias[2];               /* mean distance of the measured tip from where plans end [m] */
#endif
  real stalls;                /* leaky count of gaps between calls */
#ifdef RTI_CHECKS_GAPS
  int unchecked, gaps;        /* calls since its gaps were checked, how often in a row they were too large */
  real most;                  /* cost of a plan so far */
#endif
  real age;                   /* of the plan, in stages */
  real u[RTI_NU], p[RTI_SIZE(RTI_NP)];  /* last input that was applied, last good parameters */
  rti_plan plan;
  supervisor_state supervisor;
#if CONTROLLER_ESTIMATES
  ekf_state ekf;
#else
  real x[CONTROLLER_ND];      /* last known state */
#endif
} controller_state;

typedef struct {
  rti_work rti;
  rti_plan plan;
  rti_settings detuned;       /* settings of a call with a raised weight of the command's rate */
#if CONTROLLER_ESTIMATES
  ekf_work ekf;
#endif
#if CONTROLLER_CORRECTS
  real setpoints[(RTI_N + 1) * RTI_NR];         /* corrected */
#endif
} controller_work;

typedef struct {
  const real *measurement;    /* CONTROLLER_NM */
  const real *setpoints;     /* RTI_N + 1 rows of RTI_NR */
  const real *p;              /* RTI_NP */
  const real *applied;        /* RTI_NU: input applied since the last call; null: the last command */
  int late;                   /* whether the last command was late */
  real elapsed;               /* time since the last call [s]; 0: the clock stood still or went back; below 0: unknown */
  real age;                   /* of the measurement [s]; below 0: as usual */
} controller_input;

typedef struct {
  real u[RTI_NU];
  int status;
  uint32_t anomalies;
  real missed;                /* calls that were missed before this one, by the clock */
  int sight;                  /* worth of the estimate, as in checks.h */
  int verdict[CONTROLLER_NM]; /* on each measurement, as in checks.h */
  real x[RTI_NX], p[RTI_SIZE(RTI_NP)];  /* state and parameters from which the plan starts */
  rti_report rti;
  supervisor_report supervisor;
#if CONTROLLER_ESTIMATES
  ekf_report ekf;
#endif
  uint32_t ticks[CONTROLLER_PHASES];    /* of estimation, preparation, feedback */
} controller_output;

/* Start at a state (EKF_NZ with an estimator, else CONTROLLER_ND), with the input and parameters of before. */
void controller_start(controller_state *state, const controller_settings *settings, const real *z0, const real *u0,
                      const real *p);
/* Leave a trip, with a plan from rest; whether that is allowed (see supervisor_rearm). */
int controller_rearm(controller_state *state, const controller_settings *settings);
int controller_step(controller_state *state, controller_work *work, const controller_settings *settings,
                    const controller_input *input, controller_output *output);
#endif
