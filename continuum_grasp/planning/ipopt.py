"""IPOPT on the programme of a plan, with a budget and Ctrl-C."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from continuum_grasp import interrupt
from continuum_grasp.grasp.budget import Budget
from continuum_grasp.planning.programme import Programme
from continuum_grasp.scene.plan import PlanSolver

__all__ = ["Attempt", "Multipliers", "ProgrammeSolver"]

Array = NDArray[np.float64]

CONVERGED = ("Solve_Succeeded", "Solved_To_Acceptable_Level")
_NEAR = 1e-4
"""Barrier parameter, and distance that is kept from bounds, next to an answer."""
_CLOSE = 1e-6
"""Distance that is kept from bounds by a start that is worth staying near."""
_PUSHES = ("bound_push", "bound_frac", "slack_bound_push", "slack_bound_frac", "mult_bound_push")


@dataclass(frozen=True)
class Multipliers:
    """Of the bounds of the unknowns, and of the constraints."""

    bounds: Array
    constraints: Array


@dataclass(frozen=True)
class Attempt:
    """What one start gave.

    Attributes
    ----------
    outcome : str
        The solver's own return status.
    w, g : ndarray
        Unknowns and constraints where it stopped.
    objective : float
        In units of the programme.
    multipliers : Multipliers
    iterations : int
    seconds : float
    violation : float
        Largest amount by which a constraint or bound is left, in units of the programme.
    """

    outcome: str
    w: Array
    g: Array
    objective: float
    multipliers: Multipliers
    iterations: int
    seconds: float
    violation: float

    @property
    def converged(self) -> bool:
        """Whether it is a local optimum."""
        return self.outcome in CONVERGED


class _Watch(ca.Callback):
    """Stops the solver at the end of the budget or on Ctrl-C, which an exception cannot."""

    def __init__(self, unknowns: int, constraints: int, budget: Budget) -> None:
        ca.Callback.__init__(self)
        self._sizes = {"x": unknowns, "lam_x": unknowns, "g": constraints, "lam_g": constraints, "f": 1, "lam_p": 0}
        self.budget = budget
        self.interrupted = False
        self.construct("watch", {})

    def get_n_in(self) -> int:
        return int(ca.nlpsol_n_out())

    def get_n_out(self) -> int:
        return 1

    def get_name_in(self, i: int) -> str:
        return str(ca.nlpsol_out(i))

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        return ca.Sparsity.dense(self._sizes[ca.nlpsol_out(i)], 1)

    def eval(self, _: Any) -> list[int]:
        self.budget.left -= 1
        return [int(interrupt.pressed() or self.budget.over)]


class ProgrammeSolver:
    """IPOPT for one programme."""

    def __init__(self, programme: Programme, options: PlanSolver, budget: Budget) -> None:
        self._programme = programme
        self.watch = _Watch(programme.size, programme.count, budget)
        self._options: dict[str, Any] = {
            "print_time": False,
            "error_on_fail": False,
            "calc_lam_p": False,
            "no_nlp_grad": True,
            "show_eval_warnings": False,
            "iteration_callback": self.watch,
            "ipopt.print_level": 0,
            "ipopt.sb": "yes",
            "ipopt.tol": options.tolerance,
            "ipopt.constr_viol_tol": min(1e-8, options.tolerance),
            "ipopt.acceptable_tol": 100.0 * options.tolerance,
            "ipopt.acceptable_iter": 20,
            "ipopt.bound_relax_factor": 0.0,
            "ipopt.max_iter": options.max_iterations,
            "ipopt.mu_strategy": "adaptive",
            **programme.functions,
        }

    def run(self, w: Array, multipliers: Multipliers | None = None, barrier: float | None = None) -> Attempt:
        """Solve from a start.

        Parameters
        ----------
        w : ndarray
            Unknowns to begin with.
        multipliers : Multipliers, optional
            Where they are known, the start is next to an answer.
        barrier : float, optional
            First barrier parameter, for a start that is worth staying near.
        """
        options, given = dict(self._options), {}
        bounds = self._programme.bounds
        if multipliers is not None:
            options |= {"ipopt.warm_start_init_point": "yes", "ipopt.mu_strategy": "monotone", "ipopt.mu_init": _NEAR}
            options |= {f"ipopt.warm_start_{name}": _NEAR for name in _PUSHES}
            given = {"lam_x0": multipliers.bounds, "lam_g0": multipliers.constraints}
        elif barrier is not None:
            options |= {"ipopt.mu_strategy": "monotone", "ipopt.mu_init": barrier}
            options |= {f"ipopt.{name}": _CLOSE for name in _PUSHES[:4]}
        began = time.perf_counter()
        solver = ca.nlpsol("plan", "ipopt", self._programme.nlp, options)
        with interrupt.held(quietly=True) as pressed:
            found = solver(x0=np.clip(w, bounds["lbx"], bounds["ubx"]), **bounds, **given)
        self.watch.interrupted |= pressed()
        stats = solver.stats()
        x, g = (np.array(found[name]).ravel() for name in ("x", "g"))
        off = [bounds["lbx"] - x, x - bounds["ubx"], bounds["lbg"] - g, g - bounds["ubg"]]
        worst = max((float(part.max(initial=0.0)) for part in off), default=0.0)
        finite = np.isfinite(x).all() and np.isfinite(g).all()
        return Attempt(
            str(stats["return_status"]),
            x,
            g,
            float(found["f"]),
            Multipliers(*(np.array(found[name]).ravel() for name in ("lam_x", "lam_g"))),
            int(stats["iter_count"]),
            time.perf_counter() - began,
            max(worst, 0.0) if finite else float("inf"),
        )
