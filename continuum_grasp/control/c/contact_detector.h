/* Detection of contact by what the drives feel, without sensors at the tip.
 *
 * A model of the finger that touches nothing is wound up as the winches are measured. Its tension is compared with what
 * the motors pull with, by a momentum observer (A. De Luca, R. Mattone, doi:10.1109/ROBOT.2005.1570247; survey: S.
 * Haddadin, A. De Luca, A. Albu-Schaeffer, doi:10.1109/TRO.2017.2723903): the residual is the low-pass filtered tension
 * that no motion without contact explains. Its threshold is not a constant. Members are further such models, one for
 * each end of the range of every uncertain number; the residual of a finger that touches nothing lies within the sum of
 * their deviations from the first member, of the dry friction of the motor, and of noise.
 *
 * The last two members have the friction states of tendons that were pulled and released all along. They start as the
 * first one where the history is known, and a contact sets them apart: what friction did during it is not known. A
 * motion brings them together again.
 *
 * Dimensions are set before this file is read: CONTACT_ND (drives), CONTACT_NS (states of a member), CONTACT_NF (friction
 * states, the last of these), CONTACT_NP (parameters), CONTACT_NM (members), CONTACT_NG (groups of members), CONTACT_NY
 * (measurements), CONTACT_NU (inputs), CONTACT_NL (places); and `real`. The generated functions contact_measured,
 * free_step, free_tension and free_gain stand before contact_detector.c. Nothing is allocated or static.
 */
#ifndef CONTACT_DETECTOR_H
#define CONTACT_DETECTOR_H
#include "checks.h"

#define CONTACT_SIZE(n) ((n) > 0 ? (n) : 1)
#define CONTACT_MOST 1e9          /* a force beyond all [N]: of a place where none is felt, or a residual that excludes none */

enum {                        /* verdict of a step */
  CONTACT_FREE = 0,           /* the residual is that of a finger that touches nothing */
  CONTACT_UNCERTAIN = 1,      /* it is beyond that, and may be a friction history that is not known */
  CONTACT_DETECTED = 2,
  CONTACT_MISSING = 3,        /* a measurement is missing or absurd: nothing has changed */
  CONTACT_LOST = 4            /* winches moved as no finger follows: nothing is known until it starts again */
};

typedef struct {
  real first[CONTACT_NM][CONTACT_NS];         /* state of each member at the start */
  real p[CONTACT_NM][CONTACT_SIZE(CONTACT_NP)];
  int group[CONTACT_NM];      /* of members of which the one that deviates most counts; -1: the first member */
  real period;                /* [s] */
  int substeps;
  real blend;                 /* share of a new residual in the filtered one */
  real fade;                  /* share of a member's deviation that is left after a period: one that swings counts as
                                 much as it swings, also while it passes zero */
  real inertia[CONTACT_ND];   /* tension per acceleration of the cable [kg] */
  real viscous[CONTACT_ND];   /* tension per speed [N s/m] */
  real dry[CONTACT_ND];       /* dry friction of the motor, as a tension [N] */
  real dry_error;             /* greatest relative error of it */
  real slow[CONTACT_ND];      /* speed below which its direction is not known [m/s] */
  real ending[CONTACT_ND];    /* least speed at the end of a period, when a torque is read, per mean speed */
  real jerk[CONTACT_ND];      /* greatest tension that a servo's torque has for it then, per mean speed [N s/m] */
  real held[CONTACT_ND];      /* share of a change of torque by which its mean over a period is not known */
  real model_error;           /* greatest relative error of each tension by what members leave out */
  real noise[CONTACT_ND];     /* of the residual, as much as it reaches [N] */
  int single[CONTACT_ND];     /* whether a drive pulls one tendon */
  int felt[CONTACT_NY];       /* which of the measurements that a step is given it takes */
  real y_min[CONTACT_NY], y_max[CONTACT_NY];    /* beyond which these are absurd */
  int from[CONTACT_NS];       /* where an estimated state has the states of a member */
  int history_known;
} contact_settings;

typedef struct {
  real s[CONTACT_NM][CONTACT_NS];
  real tension[CONTACT_NM][CONTACT_ND], mean[CONTACT_NM][CONTACT_ND];       /* now, and over the period before */
  real deviation[CONTACT_NM][CONTACT_ND];                             /* filtered */
  real least[CONTACT_NM][CONTACT_ND], most[CONTACT_NM][CONTACT_ND];         /* of it, of late */
  real length[CONTACT_ND], speed[3][CONTACT_ND], pull[CONTACT_ND], pull_mean[CONTACT_ND];
  real residual[CONTACT_ND], unknown[CONTACT_ND];     /* filtered; of motors what is not known [N] */
  real size[CONTACT_ND];      /* filtered: all that tendons pull a drive with, which on a pulley differ by less [N] */
  int steps;                  /* so far, up to three */
  int lost;                   /* whether the state of a member is not finite */
} contact_state;

typedef struct {
  int verdict;
  real residual[CONTACT_ND];  /* excess tension [N], on a pulley of the difference */
  real low[CONTACT_ND], high[CONTACT_ND];     /* residuals of a finger that touches nothing [N] */
  real gain[CONTACT_ND * CONTACT_NL];       /* tension per force across the finger at each place, by columns */
  real gain_most[CONTACT_ND * CONTACT_NL];  /* greatest if tendons stick */
  real threshold[CONTACT_NL]; /* least force at each place that is detected, from where the residual is now [N] */
  real force_low[CONTACT_NL], force_high[CONTACT_NL];     /* forces at each place that explain the residual [N]; low above
                                                            high: none does */
} contact_report;

/* Start where the settings say, or at an estimated state. */
void contact_start(contact_state *state, const contact_settings *settings, const real *z);
/* Update with the measurements of which `felt` are taken; u was applied since the last call. Returns the verdict. */
int contact_step(contact_state *state, const contact_settings *settings, const real *measured, const real *u,
                 contact_report *report);
#endif
