"""IPOPT on a grasp problem: one solver, many starts, a common deadline."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.blocks import Violation
from continuum_grasp.grasp.points import PointReader
from continuum_grasp.grasp.problem import GraspProblem
from continuum_grasp.grasp.relaxations import RELAXATIONS

__all__ = ["Attempt", "GraspSolverRun"]

Array = NDArray[Any]

CONSTRAINT_TOLERANCE = 1e-7
"""Scaled violation below which a constraint counts as kept when violations are listed."""
EFFORT_WHEN_RELAXED = 1e-4
"""Weight of the tension beside the amount of a relaxed limit."""


@dataclass(frozen=True)
class Attempt:
    """What one start of the solver gave.

    Attributes
    ----------
    start : str
        Label of the seed.
    outcome : str
        The solver's own return status.
    iterations : int
    seconds : float
    x : ndarray
        Scaled unknowns where it stopped.
    objective : float
    violations : list of Violation
        Constraints that are broken there, worst first.
    """

    start: str
    outcome: str
    iterations: int
    seconds: float
    x: Array
    objective: float
    violations: list[Violation]

    @property
    def converged(self) -> bool:
        """Whether the solver reports a local optimum to its full tolerance."""
        return self.outcome == "Solve_Succeeded"

    @property
    def infeasible(self) -> bool:
        """Whether the solver reports that it converged to a point of local infeasibility."""
        return self.outcome == "Infeasible_Problem_Detected"

    @property
    def badness(self) -> float:
        """Greatest scaled violation."""
        return self.violations[0].scaled if self.violations else 0.0


class _Stop(ca.Callback):
    """Stops the solver once the time is over or Ctrl-C was pressed."""

    def __init__(self, unknowns: int, constraints: int, weights: int) -> None:
        ca.Callback.__init__(self)
        self._sizes = {
            "x": unknowns,
            "g": constraints,
            "lam_x": unknowns,
            "lam_g": constraints,
            "lam_p": weights,
        }
        self.until = float("inf")
        self.interrupted = False
        self.construct("stop", {})

    def get_n_in(self) -> int:
        return int(ca.nlpsol_n_out())

    def get_n_out(self) -> int:
        return 1

    def get_name_in(self, i: int) -> str:
        return str(ca.nlpsol_out(i))

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        return ca.Sparsity.dense(self._sizes.get(ca.nlpsol_out(i), 1), 1)

    def eval(self, _: Any) -> list[int]:
        return [int(self.interrupted or time.monotonic() > self.until)]

    @contextmanager
    def on_interrupt(self) -> Iterator[None]:
        """Keep Ctrl-C until the end of the block, and act on it then: an exception is lost in the solver."""
        usual = signal.getsignal(signal.SIGINT)
        if not callable(usual) or threading.current_thread() is not threading.main_thread():
            yield
            return
        caught: list[Any] = []

        def stop(number: int, frame: Any) -> None:
            self.interrupted = True
            caught[:] = [number, frame]

        self.interrupted = False
        signal.signal(signal.SIGINT, stop)
        try:
            yield
        finally:
            signal.signal(signal.SIGINT, usual)
            if caught:
                usual(*caught)


class GraspSolverRun:
    """IPOPT prepared for one problem.

    Parameters
    ----------
    problem : GraspProblem
    """

    def __init__(self, problem: GraspProblem) -> None:
        self.problem = problem
        self.reader = PointReader(problem)
        parts, wanted = problem.parts, problem.scene.solver
        x, g = parts.x, parts.g
        self._stop = _Stop(x.numel(), g.numel(), problem.weights.numel())
        options: dict[str, Any] = {
            "print_time": False,
            "error_on_fail": False,
            "iteration_callback": self._stop,
            "ipopt.print_level": 0,
            "ipopt.sb": "yes",
            "ipopt.mu_strategy": "monotone",
            "ipopt.tol": wanted.tolerance,
            "ipopt.constr_viol_tol": min(1e-9, wanted.tolerance),
            "ipopt.acceptable_tol": 100 * wanted.tolerance,
            "ipopt.bound_relax_factor": 0.0,
            "ipopt.max_iter": wanted.max_iterations,
        }
        nlp = {"x": x, "f": problem.objective, "g": g, "p": problem.weights}
        self._solver = ca.nlpsol("grasp", "ipopt", nlp, options)

    def run(self, start: str, x0: Array, until: float, relaxed: Mapping[str, float] | None = None) -> Attempt:
        """Solve from a start.

        Parameters
        ----------
        start : str
            Label of the start.
        x0 : ndarray
            Scaled unknowns to start from.
        until : float
            ``time.monotonic()`` at which to stop.
        relaxed : mapping, optional
            Names of limits that may give way and by how much at most (SI); the amount they give is minimised
            then.

        Raises
        ------
        KeyboardInterrupt
            Ctrl-C was pressed meanwhile; this start has no result then.
        """
        parts = self.problem.parts
        low, high = parts.x_bounds
        weights = np.zeros(1 + len(RELAXATIONS))
        weights[0] = EFFORT_WHEN_RELAXED if relaxed else 1.0
        for k, relaxation in enumerate(RELAXATIONS):
            if relaxed and relaxation.name in relaxed:
                variable = parts.variables[f"relaxed {relaxation.name}"]
                most = relaxed[relaxation.name] / variable.scale
                high[variable.start : variable.stop] = most
                if relaxation.size > 1:
                    low[variable.start : variable.stop] = -most
                weights[1 + k] = 1.0
        g_low, g_high = parts.g_bounds
        self._stop.until = until
        began = time.perf_counter()
        with self._stop.on_interrupt():
            found = self._solver(x0=x0, lbx=low, ubx=high, lbg=g_low, ubg=g_high, p=weights)
        seconds = time.perf_counter() - began
        stats = self._solver.stats()
        return Attempt(
            start=start,
            outcome=str(stats["return_status"]),
            iterations=int(stats["iter_count"]),
            seconds=seconds,
            x=np.array(found["x"]).ravel(),
            objective=float(found["f"]),
            violations=parts.violations(np.array(found["g"]).ravel(), CONSTRAINT_TOLERANCE),
        )
