/* A mission: the phases in which a finger closes on an object, holds it and lets it go. Once per period, before the
 * controller's step:
 *
 *   1. mission_advance begins the next phase where the present one is over. Before the lift the normal forces that are
 *      estimated are compared with those that are needed: while a contact bears too little, the fingers squeeze on, for
 *      `patience` at most, and then let go. While sensors contradict the model (`sight`, which the caller says), they
 *      squeeze on too, and lift in doubt after that. Blind fingers let go at once, and the others with them. While the
 *      object is held, a blind finger goes to the command of the grasp, and opens in the time of the release.
 *      While the object is held and the mission `watches`, an object that sinks in the hand (mission_see) or a contact
 *      that bears hardly anything makes them squeeze harder by `firm`; where that goes on, it is set down.
 *   2. mission_setpoints gives the setpoints over the horizon, and the state the weights and limits of the phase.
 *
 * Of several fingers each has a mission; the first one leads. To it is reported whether all others bear enough
 * (MISSION_BEARS, MISSION_DOUBTS) or one is blind, to the others what it decided; what is reported may be a period old.
 *
 * Setpoints are smooth functions of the instant of a plan in which nothing is waited for: those at first, and moves,
 * each by a row, from its begin over its length. What ends by a decision is foreseen to go on; that one is asked to
 * release is not.
 *
 * Dimensions: MISSION_PHASES, MISSION_MOVES, MISSION_NR (setpoints), MISSION_NU, MISSION_NC (contacts); and `real`.
 */
#ifndef MISSION_H
#define MISSION_H
#include "checks.h"

#define MISSION_SIZE(n) ((n) > 0 ? (n) : 1)

enum { MISSION_WAITS = 0, MISSION_LIFTS = 1, MISSION_LETS_GO = 2 };     /* decision before the lift */
enum { MISSION_UNKNOWN = 0, MISSION_BEARS = 1, MISSION_LACKS = 2, MISSION_DOUBTS = 3, MISSION_BLIND = 4 };
/* Forces at the contacts, when they count; 3: enough, by an estimate in doubt; 4: whatever they are, the finger was blind
 * before the lift. */
enum { MISSION_USUAL = 0, MISSION_FIRM = 1, MISSION_SETS_DOWN = 2 };    /* grip of what is held */
enum { MISSION_SINKS = 1, MISSION_PARTS = 2, MISSION_REPORTED = 3 };    /* what makes it firm */
enum { MISSION_NOMINAL = 0, MISSION_SQUEEZES = 1, MISSION_HOLDS = 2 };  /* limits of the command */
enum { MISSION_FOLLOWED = 4 };                                          /* what phases may follow: rows of weights */

typedef struct {
  real period;
  real begin[MISSION_PHASES], length[MISSION_PHASES];   /* of each phase, in the plan; the longest wait of `confirm` */
  int follows[MISSION_PHASES];  /* row of weights from its begin on; -1: weights and limits stay */
  int limits[MISSION_PHASES];
  int confirm, lower, release;  /* numbers of phases */
  int holds_on;                 /* whether the object is held until mission_release, not to the end of the plan */
  int leads;                    /* whether this finger decides */
  real patience;                /* longest wait for forces [s] */
  real needed[MISSION_SIZE(MISSION_NC)];        /* least normal force at each contact [N] */
  int watches;                  /* whether slip is answered */
  int answers;                  /* whether the fingers have more force for that; else what slips is set down at once */
  /* Page's test of lost height, doi:10.1093/biomet/41.1-2.100: while it is held; while it is lifted, or firmly held; while
   * the grip becomes firm. */
  real sunk[3];                 /* loss beyond which doubt grows: since the lift; of late, or since the grip was firm; since the lift [m] */
  real weight[3];               /* of each meter beyond, per height; doubt of 1 is answered */
  real glitch;                  /* most doubt of one height */
  real fresh;                   /* share of a new height in the smoothed one */
  int settles;                  /* heights until a firm grip counts as such */
  int parts, stays;             /* calls in a row in which a contact bears less than `lost` [N], for the same; `parts` calls in
                                   which all bear what is needed lift */
  real lost[MISSION_SIZE(MISSION_NC)];
  real firm[MISSION_SIZE(MISSION_NR)];          /* further setpoints of a firm grip */
  real weights[MISSION_FOLLOWED][MISSION_SIZE(MISSION_NR)];
  real u_min[MISSION_NU], u_max[MISSION_NU];
  real low[3][MISSION_NU], high[3][MISSION_NU]; /* by the kind of limits, within u_min and u_max */
  int follows_command;          /* whether those of MISSION_HOLDS move with the command before, from `held` */
  real held[MISSION_NU];
  real first[MISSION_SIZE(MISSION_NR)];
  real moves_at[MISSION_MOVES], moves_for[MISSION_MOVES], moves_by[MISSION_MOVES][MISSION_SIZE(MISSION_NR)];
} mission_settings;

typedef struct {
  int phase, changed;           /* changed: whether weights or limits did in the last call */
  int decision, bears;
  int borne;                    /* for how many calls all contacts have borne what is needed */
  int sight;                    /* worth of the estimate, as in checks.h */
  int follows;                  /* row of weights */
  real start;                   /* of the phase [s] */
  int limits;                   /* kind of the limits of the command */
  real u_min[MISSION_NU], u_max[MISSION_NU];
  real u_min_before[MISSION_NU], u_max_before[MISSION_NU];      /* before the phase that set them */
  real moved[MISSION_NU];       /* of commanded positions at the lift, against those of the grasp */
  int fades;                    /* whether a blind finger opens with the time of `release`, from what it held with */
  real left[MISSION_SIZE(MISSION_NR)];  /* of setpoints before a release or an abort; fades from `left_at` on */
  real left_at;
  int opens_at_once;            /* whether setpoints are those of the end of `release`: let go before the lift */
  int grip, noticed;            /* how it is held, and what made it firm; 0: nothing */
  int seen, open;               /* whether a height is known, and for how many calls a contact has borne hardly anything */
  real height, base, lost;      /* smoothed height in the hand, that from which losses count, the last loss [m] */
  real doubt;                   /* that it is held; 0: none, from 1 on: enough for an answer */
  int settled;                  /* heights seen under a firm grip */
} mission_state;

void mission_enter(mission_state *state, const mission_settings *settings, int phase, real t, const real *u);
/* Begin the first phase at an instant t, with the command u before. */
void mission_start(mission_state *state, const mission_settings *settings, real t, const real *u);
/* Whether mission_advance counts estimated forces, before the lift and where slip is watched. */
int mission_asks(const mission_state *state, const mission_settings *settings);
/* Begin what is due at t by the command u before, the estimated forces (null: not yet known) and what is reported;
 * whether the mission goes on. */
int mission_advance(mission_state *state, const mission_settings *settings, real t, const real *forces, const real *u,
                    int reported);
/* What was measured of the object's height in the hand [m], before the call; only what is lost of it counts. */
void mission_see(mission_state *state, const mission_settings *settings, real height);
/* Squeeze what is held firmly from now on, for what was noticed. */
void mission_squeeze(mission_state *state, const mission_settings *settings, int noticed);
/* Let the object go at t: lowered first where it may hang, or at once. */
void mission_release(mission_state *state, const mission_settings *settings, real t, const real *u, int at_once);
/* Setpoints at an instant, as they are foreseen now. */
void mission_setpoints(const mission_state *state, const mission_settings *settings, real t, real *row);
#endif
