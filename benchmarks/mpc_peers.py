"""Other solvers of the same receding-horizon problem: CasADi's SQP generated to C, and IPOPT to convergence."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from benchmarks.machine import one_core
from benchmarks.mpc_cases import Case
from benchmarks.mpc_loop import CLoop, LoopRun
from benchmarks.mpc_nlp import Nlp

Array = NDArray[np.float64]

FORMS = {
    "own": "derivatives by CasADi alone",
    "custom_jacobian": "dynamics with the variational equations as their Jacobian",
    "jac_fg": "all derivatives given at once",
    "soft": "as custom_jacobian, and rows may be violated at their penalty",
}
"""How CasADi's problem is written; rows of all but the last are hard, which makes smaller problems."""

QP_ITERATIONS = 250
"""Limit of qrqp's, which has 1000 by itself and reaches it wherever its hard rows cannot be satisfied."""

_HOOKS = """
#include <string.h>
int rti(const double **arg, double **res, long long int *iw, double *w, int mem);
static const double fixed_lbx[] = {lbx}, fixed_ubx[] = {ubx}, lbg[] = {lbg}, ubg[] = {ubg};
static double w[{count}], lam_x[{count}], lam_g[{rows}], next_w[{count}], next_x[{count}], next_g[{rows}];
static double lbx[{count}], ubx[{count}], parameters[{parameters}];
static long long int iw[{sz_iw} + 1];
static double work[{sz_w} + 1];

/* Whether all numbers are finite, by their bits: compilers may assume that they are. */
static int finite(const double *a, int count)
{{
  int bad = 0;
  for (int i = 0; i < count; ++i) {{
    unsigned long long bits;
    memcpy(&bits, a + i, sizeof bits);
    bad |= (bits & 0x7ff0000000000000ULL) == 0x7ff0000000000000ULL;
  }}
  return !bad;
}}
void solver_start(const double *x0, const double *u0)
{{
  memset(w, 0, sizeof w);
  memset(lam_x, 0, sizeof lam_x);
  memset(lam_g, 0, sizeof lam_g);
  memcpy(lbx, fixed_lbx, sizeof lbx);
  memcpy(ubx, fixed_ubx, sizeof ubx);
  for (int k = 0; k < {N}; ++k) {{
    memcpy(w + k * {nz}, x0, sizeof(double) * {nx});
    memcpy(w + k * {nz} + {nx}, u0, sizeof(double) * {nu});
  }}
  memcpy(w + {N} * {nz}, x0, sizeof(double) * {nx});
}}
void solver_shift(void)
{{
{shift}
  memcpy(w + ({N} - 1) * {nz}, w + {N} * {nz}, sizeof(double) * {nx});
}}
void solver_prepare(const double *p, const double *refs)
{{
  memcpy(parameters, p, sizeof(double) * {np});
  memcpy(parameters + {np}, refs, sizeof(double) * {refs});
}}
int solver_feedback(const double *x0)
{{
  memcpy(w, x0, sizeof(double) * {nx});
  memcpy(lbx, x0, sizeof(double) * {nx});
  memcpy(ubx, x0, sizeof(double) * {nx});
  const double *arg[{sz_arg} + 1] = {{w, parameters, lbx, ubx, lbg, ubg, lam_x, lam_g}};
  double *res[{sz_res} + 1] = {{next_w, 0, 0, next_x, next_g, 0}};
  rti(arg, res, iw, work, 0);
  if (!finite(next_w, {count}) || !finite(next_x, {count}) || !finite(next_g, {rows})) {{  /* the problem failed */
    double u[{nu}];
    memcpy(u, w + {nx}, sizeof u);
    solver_start(x0, u);
    return -1;
  }}
  memcpy(w, next_w, sizeof w);
  memcpy(lam_x, next_x, sizeof lam_x);
  memcpy(lam_g, next_g, sizeof lam_g);
  return 0;
}}
const double *solver_input(void)
{{
  static const double least[] = {u_min}, most[] = {u_max};
  static double u[{nu}];
  for (int i = 0; i < {nu}; ++i) {{
    u[i] = w[{nx} + i];
    u[i] = u[i] < least[i] ? least[i] : u[i] > most[i] ? most[i] : u[i];
  }}
  return u;
}}
void solver_plan(double *to)
{{
  for (int k = 0; k <= {N}; ++k) memcpy(to + k * {nx}, w + k * {nz}, sizeof(double) * {nx});
  for (int k = 0; k < {N}; ++k) memcpy(to + ({N} + 1) * {nx} + k * {nu}, w + k * {nz} + {nx}, sizeof(double) * {nu});
}}
"""


def sqp_loop(case: Case, form: str) -> CLoop:
    """CasADi's ``sqpmethod`` and ``qrqp``, one Gauss-Newton iteration per step, as generated C in a closed loop.

    The guess is shifted, multipliers too, and its first state is the measured one. After a failure it starts again
    from the state.

    Parameters
    ----------
    case : Case
        The loop.
    form : str
        One of ``FORMS``.
    """
    stages = case.stages
    nlp = Nlp(stages, soft=form == "soft", variational=form in ("custom_jacobian", "soft"))
    quiet: dict[str, Any] = {"print_iter": False, "print_header": False, "print_info": False, "error_on_fail": False}
    quiet |= {"max_iter": QP_ITERATIONS}
    options: dict[str, Any] = {
        "qpsol": "qrqp",
        "qpsol_options": quiet,
        "max_iter": 1,
        "max_iter_ls": 0,
        "hess_lag": nlp.hess_lag(),
        "print_time": False,
        "print_header": False,
        "print_iteration": False,
        "print_status": False,
        "calc_lam_p": False,
        "error_on_fail": False,
    }
    if form == "jac_fg":
        options["jac_fg"] = nlp.jac_fg
    solver = ca.nlpsol("rti", "sqpmethod", nlp.problem, options)
    numbers = {name: _braces(values) for name, values in nlp.bounds.items()}
    hooks = _HOOKS.format(
        **numbers,
        u_min=_braces(stages.u_min),
        u_max=_braces(stages.u_max),
        shift="\n".join(
            f"  memmove({name} + {start}, {name} + {start + width}, sizeof(double) * {(stages.stages - 1) * width});"
            for name, start, width in _blocks(nlp)
        ),
        count=nlp.w.numel(),
        rows=solver.size1_in("lbg"),
        parameters=solver.size1_in("p"),
        refs=(stages.stages + 1) * stages.nr,
        N=stages.stages,
        nx=stages.nx,
        nu=stages.nu,
        np=stages.np,
        nz=stages.nx + stages.nu,
        **{f"sz_{name}": getattr(solver, f"sz_{name}")() for name in ("arg", "res", "iw", "w")},
    )
    return CLoop(case, hooks, solver, late=True)


def _blocks(nlp: Nlp) -> list[tuple[str, int, int]]:
    """Arrays of which a part belongs to each stage: name, start, and entries per stage."""
    s, rows, count = nlp.stages, nlp.problem["g"].numel(), nlp.count
    found = [("w", 0, s.nx + s.nu), ("lam_x", 0, s.nx + s.nu)]
    if not nlp.soft:
        return [*found, ("lam_g", 0, rows // s.stages)]
    per = len(nlp.row_nodes) // s.stages
    starts = [s.stages * s.nx + k * s.stages * per for k in range(2)]
    found += [("w", count, per), ("lam_x", count, per), ("lam_g", 0, s.nx)]
    return found + [("lam_g", start, per) for start in starts]


def _braces(values: Array) -> str:
    return "{" + ", ".join(_literal(v) for v in values) + "}"


def _literal(value: float) -> str:
    return repr(float(value)) if np.isfinite(value) else ("1e400" if value > 0 else "-1e400")


def converged(
    case: Case,
    *,
    exact: bool = False,
    compiled: bool = False,
    soft: bool = True,
    steps: int | None = None,
    progress: Callable[[int], None] | None = None,
) -> LoopRun:
    """The closed loop with every problem solved by IPOPT, from the shifted solution before.

    Parameters
    ----------
    case : Case
        The loop.
    exact : bool
        Exact Hessian instead of Gauss-Newton.
    compiled : bool
        Compile the problem's functions first.
    soft : bool
        Violations at their penalty, as the real-time iteration has them; otherwise hard rows.
    steps : int, optional
        Only the first.
    progress : callable, optional
        Called with the number of each step.
    """
    nlp = Nlp(case.stages, soft=soft)
    options: dict[str, Any] = {
        "ipopt.print_level": 0,
        "ipopt.sb": "yes",
        "print_time": False,
        "error_on_fail": False,
        "ipopt.tol": 1e-9,
        "ipopt.max_iter": 200,
        "calc_lam_p": False,
    }
    if not exact:
        options["hess_lag"] = nlp.hess_lag(triangle=True)
    if compiled:
        options |= {"jit": True, "compiler": "shell", "jit_options": {"flags": ["-O2", "-march=native"]}}
    cold_solver = ca.nlpsol("cold", "ipopt", nlp.problem, options)
    warm = {"warm_start_init_point": "yes", "mu_init": 1e-6}
    warm |= {f"warm_start_{k}": 1e-9 for k in ("bound_push", "mult_bound_push", "slack_bound_push")}
    options |= {f"ipopt.{k}": v for k, v in warm.items()}
    solver = ca.nlpsol("warm", "ipopt", nlp.problem, options)
    plant, stages, bounds = case.plant(), case.stages, {k: v.copy() for k, v in nlp.bounds.items()}
    count = case.steps if steps is None else steps
    x, u = np.zeros((count + 1, stages.nx)), np.zeros((count, stages.nu))
    seconds, good, cold = np.zeros((count, 2)), np.zeros(count, bool), 0.0
    x[0] = case.x0
    planned = np.tile(case.x0, (stages.stages + 1, 1)), np.tile(case.u0, (stages.stages, 1))
    duals: dict[str, Any] = {}
    with one_core():
        for k in range(count):
            planned[0][0] = x[k]
            bounds["lbx"][: stages.nx] = bounds["ubx"][: stages.nx] = x[k]
            guess = nlp.guess(*planned, case.p)
            given = {**bounds, "p": nlp.parameters(case.p, case.references[k]), "x0": guess}
            began = time.thread_time()
            found = (solver if k else cold_solver)(**given, **duals)
            taken = time.thread_time() - began
            good[k] = (solver if k else cold_solver).stats()["success"]
            if not good[k] and k:  # warm starts do fail: count the time of both
                found = cold_solver(**given)
                taken = time.thread_time() - began
                good[k] = cold_solver.stats()["success"]
            seconds[k, 1] = taken
            cold = taken if k == 0 else cold
            duals = {"lam_x0": found["lam_x"], "lam_g0": found["lam_g"]}
            px, pu = nlp.plan(np.array(found["x"]).ravel())
            u[k] = np.clip(pu[0], stages.u_min, stages.u_max)
            x[k + 1] = np.array(plant(x[k], u[k], case.plant_p[k])).ravel()
            planned = np.vstack([px[1:], px[-1:]]), np.vstack([pu[1:], pu[-1:]])
            if progress is not None:
                progress(k)
    return LoopRun(x, u, seconds, cold, good)
