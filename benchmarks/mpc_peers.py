"""Other solvers of the same receding-horizon problem: CasADi's SQP generated to C, and IPOPT to convergence."""

from __future__ import annotations

import time
from typing import Any

import casadi as ca
import numpy as np

from benchmarks.harness import defines, one_core
from benchmarks.mpc_cases import Case
from benchmarks.mpc_loop import FOLDER, CLoop, LoopRun
from benchmarks.mpc_nlp import Nlp
from continuum_grasp.arrays import Array

FORMS = {
    "own": "derivatives by CasADi alone",
    "custom_jacobian": "dynamics with the variational equations as their Jacobian",
    "jac_fg": "all derivatives given at once",
    "soft": "as custom_jacobian, and rows may be violated at their penalty",
}
"""How CasADi's problem is written; rows of all but the last are hard, which makes smaller problems."""

QP_ITERATIONS = 250
"""Limit of qrqp's, which has 1000 by itself and reaches it wherever its hard rows cannot be satisfied."""


def sqp_loop(case: Case, form: str) -> CLoop:
    """CasADi's ``sqpmethod`` and ``qrqp``, one Gauss-Newton iteration per step, as generated C in a closed loop.

    The guess is shifted, multipliers too, and its first state is the measured one. After a failure it starts again
    from the state. ``form`` is one of ``FORMS``.
    """
    stages = case.stages
    nlp = Nlp(stages, soft=form == "soft", variational=form in ("custom_jacobian", "soft"))
    quiet = dict.fromkeys(("print_iter", "print_header", "print_info", "error_on_fail"), False)
    quiet["max_iter"] = QP_ITERATIONS
    options: dict[str, Any] = {"qpsol": "qrqp", "qpsol_options": quiet, "max_iter": 1, "max_iter_ls": 0}
    options |= dict.fromkeys(("print_time", "print_header", "print_iteration", "print_status"), False)
    options |= {"hess_lag": nlp.hess_lag(), "calc_lam_p": False, "error_on_fail": False}
    if form == "jac_fg":
        options["jac_fg"] = nlp.jac_fg
    solver = ca.nlpsol("rti", "sqpmethod", nlp.problem, options)
    sizes = {f"SZ_{name.upper()}": getattr(solver, f"sz_{name}")() for name in ("arg", "res", "iw", "w")}
    sizes |= {"N": stages.stages, "NX": stages.nx, "NU": stages.nu, "NP": stages.np, "NZ": stages.nx + stages.nu}
    sizes |= {"COUNT": nlp.w.numel(), "ROWS": solver.size1_in("lbg"), "PARAMETERS": solver.size1_in("p")}
    numbers = {**nlp.bounds, "u_min": stages.u_min, "u_max": stages.u_max}
    shift = " ".join(
        f"memmove({name} + {start}, {name} + {start + width}, sizeof(double) * {(stages.stages - 1) * width});"
        for name, start, width in _blocks(nlp)
    )
    words = defines(**sizes, **{name.upper(): braces(values) for name, values in numbers.items()}, SHIFT=shift)
    return CLoop(case, words + (FOLDER / "mpc_sqp.c").read_text(encoding="utf-8"), solver, late=True)


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


def braces(values: Array) -> str:
    """Numbers as C initializes an array by them."""
    return "{" + ", ".join(repr(float(v)).replace("inf", "1e400") for v in values) + "}"


def converged(case: Case, *, exact: bool = False, soft: bool = True) -> LoopRun:
    """The closed loop with every problem solved by IPOPT, from the shifted solution before.

    ``exact``: the exact Hessian in place of Gauss-Newton's; ``soft``: violations at their penalty, as the real-time
    iteration has them, in place of hard rows.
    """
    nlp = Nlp(case.stages, soft=soft)
    options: dict[str, Any] = {"ipopt.print_level": 0, "ipopt.sb": "yes", "ipopt.tol": 1e-9, "ipopt.max_iter": 200}
    options |= dict.fromkeys(("print_time", "error_on_fail", "calc_lam_p"), False)
    if not exact:
        options["hess_lag"] = nlp.hess_lag(triangle=True)
    cold_solver = ca.nlpsol("cold", "ipopt", nlp.problem, options)
    warm = {"warm_start_init_point": "yes", "mu_init": 1e-6}
    warm |= {f"warm_start_{k}": 1e-9 for k in ("bound_push", "mult_bound_push", "slack_bound_push")}
    options |= {f"ipopt.{k}": v for k, v in warm.items()}
    solver = ca.nlpsol("warm", "ipopt", nlp.problem, options)
    plant, stages, bounds = case.plant(), case.stages, {k: v.copy() for k, v in nlp.bounds.items()}
    count = case.steps
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
    return LoopRun(x, u, seconds, cold, good)
