/* Real-time iterations of an optimal control problem on RTI_N stages: M. Diehl et al., J. Process Control 12 (2002)
 * 577, doi:10.1016/S0959-1524(02)00023-1.
 *
 * One iteration linearizes the problem at the plan (rti_prepare) and solves the resulting QP once the state is known
 * (rti_feedback): what does not need the state is done before it arrives. With z = [x, u] and dz the change of the
 * plan, the QP is
 *
 *   min  sum_k  dz_k' H_k dz_k / 2 + g_k' dz_k  +  sum_k sum_i  linear_i s_ki + quadratic_i s_ki^2 / 2
 *   s.t. dx_0 = x0 - x_0,  dx_k+1 = A_k dx_k + B_k du_k + (F(x_k, u_k) - x_k+1),
 *        u_min <= u_k + du_k <= u_max,  c_min - s_k <= c_k + C_k dz_k <= c_max + s_k,  s_k >= 0.
 *
 * The constraints c are soft, so that the QP is always feasible. Rows 0 to RTI_NS - 1 apply at the nodes 1 to RTI_N,
 * the others at 0 to RTI_N - 1. A bound of 1e30 or more is no bound.
 *
 * With scenarios (RTI_ROBUST) there is such a problem per plant, from the same state and with its first inputs in common;
 * its cost has the weight of the plant, its constraints and penalties have not.
 *
 * Dimensions are set before this file is read: RTI_N, RTI_NX, RTI_NU (1 or more), RTI_NC, RTI_NS, RTI_NP, RTI_NR, with
 * RTI_ROBUST also RTI_SCENARIOS; and the type `real`, with RTI_SINGLE defined if that is float. The functions of a stage
 * stand before the other parts: stage_step, stage_cost, terminal_cost. No function allocates or has static data, so that
 * any number of controllers run side by side.
 */
#ifndef RTI_H
#define RTI_H

#define RTI_NZ (RTI_NX + RTI_NU)
#ifndef RTI_W
#define RTI_W RTI_NZ                          /* length of a row of RTI_NZ numbers, with zeros behind them */
#endif
#define RTI_SIZE(n) ((n) > 0 ? (n) : 1)
#define RTI_ROWS (RTI_NU + RTI_NC)            /* bounded quantities of a node: inputs, then rows of c */
#define RTI_SIDES (2 * RTI_ROWS)
#ifndef RTI_LANES
#define RTI_LANES 8                           /* doubles of the widest vector register (AVX-512): rows of the interior point
                                                 are padded to it, so that loops over nodes have no remainder */
#endif
#define RTI_MEMORY 3                          /* iterations back with which the change of the plan is compared */
#ifndef RTI_ROBUST                              /* else how many plants there are, each with RTI_N stages */
#define RTI_SCENARIOS 1
#endif
#define RTI_STAGES (RTI_SCENARIOS * RTI_N)      /* stage k of scenario b is b RTI_N + k */
#define RTI_NODES (RTI_SCENARIOS * (RTI_N + 1)) /* and node k of it b (RTI_N + 1) + k */
#define RTI_LENGTH ((RTI_STAGES + RTI_LANES - 1) / RTI_LANES * RTI_LANES)

enum {
  RTI_SOLVED = 0,
  RTI_ITERATION_LIMIT = 1,    /* usable, but not solved to the tolerance */
  RTI_ROW_VIOLATED = 2,       /* solved, and a soft constraint is violated */
  RTI_BAD_INPUT = -1,         /* state, parameters, setpoints, plan or settings are not finite, or bounds cross */
  RTI_BAD_LINEARIZATION = -2, /* model or cost are not finite at the plan */
  RTI_BAD_SOLUTION = -3,      /* the new plan or its cost is not finite */
  RTI_NOT_PREPARED = -4       /* no preparation succeeded before */
};

typedef struct {
  real weights[RTI_SIZE(RTI_NR)], terminal_weights[RTI_SIZE(RTI_NR)];
  real u_min[RTI_NU], u_max[RTI_NU];
  real c_min[RTI_SIZE(RTI_NC)], c_max[RTI_SIZE(RTI_NC)];
  real linear[RTI_SIZE(RTI_NC)], quadratic[RTI_SIZE(RTI_NC)];     /* penalty weights, 0 or more */
  real stage;                 /* length of a stage [s], of the integration; the cost has its own */
  int substeps;               /* Runge-Kutta steps per stage */
  int iterations;             /* greatest number of factorizations of a QP, beyond that of the preparation */
  real tolerance;             /* of the solution, relative */
  real regularization[RTI_NU];        /* added to the Hessian's diagonal of the inputs */
#ifdef RTI_ROBUST
  real share[RTI_SCENARIOS];  /* weights of the plants, RTI_SCENARIOS in sum */
  real scale[RTI_SCENARIOS][RTI_SIZE(RTI_NP)], shift[RTI_SCENARIOS][RTI_SIZE(RTI_NP)];  /* parameters: scale p + shift */
#endif
} rti_settings;

typedef struct {
  real x[RTI_NODES][RTI_NX], u[RTI_STAGES][RTI_NU];
  /* of the QP that it solves: multipliers of the rows, active set, by how many stages the plan was shifted since, and
   * whether the next QP has its bounds active at the same nodes rather than at the same instants */
  real a[RTI_SIZE(RTI_NC)][RTI_STAGES], moved;
  signed char active[RTI_ROWS][RTI_STAGES], stays;
} rti_plan;

typedef struct {
  int status;
  int iterations;             /* factorizations beyond that of the preparation */
  real kkt;                   /* largest residual of the optimality conditions, relative; 0 if no bound is active */
  real violation;             /* largest violation of a row */
  real cost;                  /* of the QP at its solution, penalties included; the mean of the scenarios */
  real excess[RTI_SIZE(RTI_NC)];      /* of each row that is reported as violated its largest violation, else 0 */
} rti_report;

typedef struct {
  int row, soft;              /* bounded quantity, whether it has a linear penalty */
  real sign, bound, linear, compliance; /* sign y <= bound; compliance = 1 / quadratic of a purely quadratic penalty */
  real quadratic;
} rti_side;

typedef struct {
  int ready, is_free;         /* whether there is a QP; whether the factors are those without bounds */
  int has_stiffness;          /* whether `stiffness` is that of all bounded quantities */
  /* of a rollout whose derivatives are in M: its substeps, 0: there is none; stage, parameters */
  int driven;
  real stage, p[RTI_SIZE(RTI_NP)];
  /* of iterations from one state: their number, changes of the last ones, whether the step length is searched for, whether
   * the last one was a full step, and the cost of the trajectory that the search has reached */
  int taken, search, full;
  real change[RTI_MEMORY], reached;
  /* the QP: written by rti_prepare, read by rti_feedback */
  real x[RTI_NODES][RTI_NX], u[RTI_STAGES][RTI_NU];
  real M[RTI_STAGES][RTI_NX][RTI_W];              /* [A B] */
  real defect[RTI_STAGES][RTI_NX];
  real l[RTI_NODES], g[RTI_NODES][RTI_W], H[RTI_NODES][RTI_NZ][RTI_W];
  real c[RTI_NODES][RTI_SIZE(RTI_NC)], C[RTI_NODES][RTI_SIZE(RTI_NC)][RTI_NZ];
  /* affine feedback, at first of the solution without bounds; inverse: that of the Hessian of an input */
  real K[RTI_STAGES][RTI_NU][RTI_W], inverse[RTI_STAGES][RTI_NU], constant[RTI_STAGES][RTI_NU];
  /* the solution: change of the plan, bounded quantities */
  real z[RTI_NODES][RTI_W], dz[RTI_NODES][RTI_W], saved[RTI_NODES][RTI_W];
  real y[RTI_ROWS][RTI_LENGTH], dy[RTI_ROWS][RTI_LENGTH];
  real stiffness[RTI_ROWS][RTI_LENGTH];       /* second derivative of the cost along a bounded quantity */
  /* a Newton step: of bounded quantities weight (diagonal), multiplier (force) and constant part (push); weights of the
   * factors, Hessians of the cost to go (lower triangles); gradients */
  real weight[RTI_ROWS][RTI_LENGTH], force[RTI_ROWS][RTI_LENGTH], push[RTI_ROWS][RTI_LENGTH];
  real factored[RTI_ROWS][RTI_LENGTH], P[RTI_NODES][RTI_NX][RTI_W];
  real residual[RTI_STAGES][RTI_NU], gradient_size[RTI_NU];
  /* sides of bounds: slack t, its multiplier m, violation s, its multiplier n, and their changes */
  int sides;
  rti_side side[RTI_SIDES];
  real t[RTI_SIDES][RTI_LENGTH], m[RTI_SIDES][RTI_LENGTH], s[RTI_SIDES][RTI_LENGTH], n[RTI_SIDES][RTI_LENGTH];
  real dt[RTI_SIDES][RTI_LENGTH], dm[RTI_SIDES][RTI_LENGTH], ds[RTI_SIDES][RTI_LENGTH], dn[RTI_SIDES][RTI_LENGTH];
  real W[RTI_SIDES][RTI_LENGTH], V[RTI_SIDES][RTI_LENGTH];      /* weight, and 1 / stiffness of the violation */
  real e[RTI_SIDES][RTI_LENGTH], f[RTI_SIDES][RTI_LENGTH];      /* shift of multiplier and of violation */
  /* active set: which bound holds, multipliers */
  signed char active[RTI_ROWS][RTI_LENGTH];
  real a[RTI_ROWS][RTI_LENGTH];
  rti_plan next;
} rti_work;

/* Start a plan that stays at a state with an input. */
void rti_start(rti_plan *plan, const real *x0, const real *u0);
/* Integrate the inputs of a plan from x0, with the derivatives of the stages, which the next preparation takes; the plan is
 * not usable if the result is negative. */
int rti_rollout(rti_plan *plan, rti_work *work, const rti_settings *settings, const real *x0, const real *p);
/* Linearize at the plan; refs has RTI_N + 1 rows of RTI_NR. */
int rti_prepare(rti_work *work, const rti_plan *plan, const rti_settings *settings, const real *p, const real *refs);
/* Solve for the state x0. If the result is 0 or more, the plan is replaced and its first input is to be applied. */
int rti_feedback(rti_work *work, rti_plan *plan, const rti_settings *settings, const real *x0, rti_report *report);
#ifdef RTI_CHECKS_GAPS
/* What the gaps of a plan cost: the quadratic part of the cost, as last prepared, at F(x, u) - x of each next node. Small beside
 * the cost of the QP where full steps converge; of its size where the plan is no motion of the model. */
real rti_gaps(const rti_work *work, const rti_plan *plan, const rti_settings *settings, const real *p);
#endif
/* Repeated iterations from one state take full steps, which may cycle or leave what can be linearized. rti_begin before
 * the first one, rti_continue after each, with its status and with what it was given, take a search for the step length to
 * those, and cost nothing while steps shrink. The result is a status; the iterations are over where work->search is
 * RTI_STUCK. */
enum { RTI_FULL_STEPS = 0, RTI_SEARCH = 1, RTI_STUCK = 2 };
void rti_begin(rti_work *work);
int rti_continue(rti_work *work, rti_plan *plan, const rti_settings *settings, const real *x0, const real *p,
                 const real *refs, int status);
/* Shift the plan by a number of stages, whole or not. */
void rti_shift(rti_plan *plan, const rti_settings *settings, real stages);
#endif
