/* A supervisor: whether sensors, model and call rate agree, which the solver's status does not show.
 *
 * A loop can swing at its rate limit while every QP is solved (86 mm, status "solved", with a lag of half the model's).
 * Exponentially weighted means over `window` calls show it: the mean squared normalized innovation of each sensor
 * ("mismatch", about 1 where the filter's covariances are right), and the mean squared change of the command relative
 * to its rate limit ("activity", 1: the command runs at the limit). The supervisor reports a mismatch, then raises the
 * weight of the command's rate (which gives delay margin), then sends the command to the safe input, latched.
 *
 * health                       when
 * ---------------------------- -----------------------------------------------------------------------------------
 *  0 SUPERVISOR_OK
 *  1 SUPERVISOR_MISMATCH       a sensor contradicts the model: mismatch > 2.5, or a drive falls behind its motion, or runs ahead
 *  2 SUPERVISOR_DETUNED        the weight of the command's rate is raised, for a lasting mismatch with an active command
 *                              or for a drive that follows its command late
 *  3 SUPERVISOR_FROZEN         a reading has not moved for a window and the delay while the command did: missing until it moves
 *  4 SUPERVISOR_TRIPPED        the command goes to the safe input and stays there
 *  5 SUPERVISOR_OFFSET         the measured tip stays away from a setpoint that stands, for longer than the loop needs
 *
 * reason of a trip             when
 * ---------------------------- -----------------------------------------------------------------------------------
 *  1 SUPERVISOR_SWINGING       mismatch and an active command, although the weight is raised to its maximum
 *  2 SUPERVISOR_CONTRADICTED   mismatch > 20: a sensor contradicts the model by many standard deviations, moving or not
 *  3 SUPERVISOR_AWAY           mismatch, and the measured tip stays far from its setpoint
 *  4 SUPERVISOR_UNSEEN         no sensor that shows the shape has readings that move, or that are there and within limits
 *  5 SUPERVISOR_UNANSWERED     the drives move, and a sensor that should show it shows noise, so that the estimator takes
 *                              their motion for a disturbance
 *  6 SUPERVISOR_IMPLAUSIBLE    an estimated disturbance stays at a limit of what it can be
 *
 * cause of an offset           when (found by the controller, which has the plan)
 * ---------------------------- -----------------------------------------------------------------------------------
 *  1 SUPERVISOR_UNEXPECTED     the plan ends at the setpoint: what the sensor shows is not what the model moves
 *  2 SUPERVISOR_UNREACHED      the plan ends away from it too, and no limit is why
 *  3 SUPERVISOR_LIMITED        the same, with an input at its limit or a constraint that is left
 *
 * The thresholds come from trials with 26 wrong plants and 16 faults: in 240,000 nominal and mildly mismatched steps
 * the mismatch stayed below 2.3. Activity alone triggers nothing.
 *
 * Dimensions are set before this file is read: CONTROLLER_NM, CONTROLLER_NS (sensors; the one behind them is the call
 * rate), RTI_NU; and `real`.
 */
#ifndef SUPERVISOR_H
#define SUPERVISOR_H
#include "checks.h"

#define SUPERVISOR_SIZE(n) ((n) > 0 ? (n) : 1)

#define SUPERVISOR_EVIDENCE 20.0        /* log-likelihood ratio that an image is old: of three million calls of loops whose
                                   fingers are stiffer or softer by a fifth none reaches it, and 16 every 180,000th of a
                                   nitinol rod's. A tip that friction of 0.3 holds, of which the model has none, may */
#define SUPERVISOR_SUSPECTED (SUPERVISOR_EVIDENCE / 4)  /* from which on corrections of setpoints wait */

enum { SUPERVISOR_OK = 0, SUPERVISOR_MISMATCH = 1, SUPERVISOR_DETUNED = 2, SUPERVISOR_FROZEN = 3, SUPERVISOR_TRIPPED = 4,
       SUPERVISOR_OFFSET = 5 };
enum { SUPERVISOR_UNEXPECTED = 1, SUPERVISOR_UNREACHED = 2, SUPERVISOR_LIMITED = 3 };
enum {
  SUPERVISOR_SWINGING = 1,
  SUPERVISOR_CONTRADICTED = 2,
  SUPERVISOR_AWAY = 3,
  SUPERVISOR_UNSEEN = 4,
  SUPERVISOR_UNANSWERED = 5,
  SUPERVISOR_IMPLAUSIBLE = 6
};

typedef struct {
  int window;                 /* calls over which means are taken; 0: no supervision */
  int delay;                  /* calls before innovations are meaningful: the filter's delay and three more */
  int rungs;                  /* how often the weight of the command's rate may be raised fourfold */
  int sensor[SUPERVISOR_SIZE(CONTROLLER_NM)];   /* device of each measurement */
  int shape[SUPERVISOR_SIZE(CONTROLLER_NS)];    /* whether a device shows the shape of the finger */
  int drive[SUPERVISOR_SIZE(CONTROLLER_NS)];    /* whether it shows what drives do */
  int cause[SUPERVISOR_SIZE(CONTROLLER_NM)];    /* entry of the command that moves a measurement; -1: all */
  real still[SUPERVISOR_SIZE(CONTROLLER_NM)];   /* a reading that moves by no more is at rest; below 0: not tested */
  real noise[SUPERVISOR_SIZE(CONTROLLER_NM)];   /* standard deviation of a reading; below 0: not compared with drives */
  real hidden[SUPERVISOR_SIZE(CONTROLLER_NM)];  /* squared motion by drives that friction may hold, in variances of a reading */
  real change[RTI_NU];        /* of the command per call at activity 1 */
  int tip, setpoint;          /* first of two measurements and of two setpoints of the tip; -1: none */
  real far;                   /* distance from the setpoint beyond which a tip is away [m] */
  int settling;               /* calls that a loop needs for a setpoint that stands */
  real offset;                /* mean distance from it beyond which a tip is off [m]; 0: not tested */
} supervisor_settings;

typedef struct {
  real last[SUPERVISOR_SIZE(CONTROLLER_NM)];    /* readings that rest, or of the last call */
  int still[SUPERVISOR_SIZE(CONTROLLER_NM)];    /* calls for which a reading has not moved although the command has */
  real path[SUPERVISOR_SIZE(CONTROLLER_NM)];    /* of the command in the meantime, in `change` */
  real mismatch[CONTROLLER_NS + 1], activity;
  real echo[SUPERVISOR_SIZE(CONTROLLER_NS)];    /* of drives, over five windows */
  real along[SUPERVISOR_SIZE(CONTROLLER_NS)], travel[SUPERVISOR_SIZE(CONTROLLER_NS)];    /* the same */
  real ahead[SUPERVISOR_SIZE(CONTROLLER_NS)], change[SUPERVISOR_SIZE(CONTROLLER_NS)];
  real usual[SUPERVISOR_SIZE(CONTROLLER_NM)];   /* slow means of readings */
  real before[SUPERVISOR_SIZE(CONTROLLER_NM)];  /* last readings about them, in standard deviations */
  /* of devices that show the shape: mean product with the motion that drives cause, greatest square of it lately as far as a
   * live image shows it, evidence of an old image [log-likelihood] in each reading and in all of a device */
  real common[SUPERVISOR_SIZE(CONTROLLER_NM)], caused[SUPERVISOR_SIZE(CONTROLLER_NM)];
  real silent[SUPERVISOR_SIZE(CONTROLLER_NM)], together[SUPERVISOR_SIZE(CONTROLLER_NS)];
  int calls;                  /* since the start, up to `delay` */
  int rung, raises;           /* fourfold raises of the weight now, and ever */
  int since;                  /* calls since the last change of the rung */
  int calm, doubted, late;    /* calls in a row that are calm, with a mismatch, with an echo */
  int swinging, contradicted, away, unseen, implausible;    /* calls in a row */
  int tripped, trips, since_rearmed;    /* reason of the latched trip, or 0 */
  int suspect;                /* device of the trip */
  int stood, off;             /* calls since the setpoint moved; whether the tip stays away from it */
  real mean[2], offset;       /* of the tip about it [m]; evidence that it stays away, in windows */
} supervisor_state;

typedef struct {
  const real *nis, *echo, *along, *travel, *ahead, *change;   /* of each sensor, as in ekf.h; nis below 0: not used */
  const real *y, *expected;   /* measurement, and its motion as far as drives cause it; null without an estimator */
  const int *verdict;         /* on each measurement, as in checks.h */
  int implausible;            /* whether a disturbance was clipped to a limit beyond which it means nothing */
  real elapsed;               /* time since the last call in periods; below 0: unknown */
  real distance;              /* of the measured tip from its setpoint; below 0: unknown */
  real from[2];               /* measured tip minus setpoint [m], where the distance is known */
  int moves;                  /* whether that setpoint moves, now or over the horizon */
} supervisor_evidence;

typedef struct {
  int health;
  int sensor;                 /* the device that contradicts most, CONTROLLER_NS: the call rate; -1: none */
  int entry;                  /* a measurement that is frozen; -1: none */
  int reason;                 /* of a trip, or 0 */
  int rung;
  int contradicts;            /* whether that device contradicts the model now, whatever the health */
  int ahead;                  /* 1: a drive runs ahead of the model's, -1: it falls behind, 0: nothing shows either */
  int cause;                  /* of an offset, or 0 */
  real mismatch, activity;
  real offset;                /* distance at which the tip stays from its setpoint [m], or 0 */
} supervisor_report;

/* Replace readings at rest in y by NaN. */
void supervisor_screen(supervisor_state *state, const supervisor_settings *settings, real *y, supervisor_report *report);
/* Evaluate a call. */
void supervisor_judge(supervisor_state *state, const supervisor_settings *settings, const supervisor_evidence *seen,
                      supervisor_report *report);
/* Record the change of the command. */
void supervisor_note(supervisor_state *state, const supervisor_settings *settings, const real *change);
/* Leave a trip: only at rest, without mismatch, and not after a second trip within 150 windows (30 s); returns whether
 * it was left. The weight of the command's rate starts fully raised. */
int supervisor_rearm(supervisor_state *state, const supervisor_settings *settings);
#endif
