"""Solvers of nonlinear problems by name: what all share, and the seam for a new one.

A solver is a file of this package whose name is the value of the YAML key ``solver.method``. It holds a
class of that name, a `Solver` that names its CasADi plugin and gives that plugin's options.
"""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any, ClassVar, cast

import casadi as ca
import numpy as np

from continuum_grasp.base import InputError, interrupts_held
from continuum_grasp.nlp.attempt import (
    KNOWN,
    STALLED,
    STOP_REQUESTED,
    Approach,
    Attempt,
    Budget,
    Multipliers,
    SolverStatus,
    Start,
)
from continuum_grasp.nlp.problem import NLP

CLOSE = 1e-3
"""Greatest distance of every unknown from a known solution that ends a run there [units of the problem]."""
_UNKNOWNS, _CONSTRAINTS = map(ca.nlpsol_out().index, ("x", "g"))
"""Places of unknowns and constraints among what CasADi passes to a callback, in the order of its outputs."""
_ACCEPTABLE = 100.0
"""Errors of an acceptable point per tolerance."""


@dataclass(frozen=True)
class Settings:
    """Options of a solver.

    Attributes
    ----------
    method : str
        Its name.
    tolerance : float
        On the scaled conditions of optimality.
    constraint_tolerance : float
        On violations, in units of the problem; 1e-4 is IPOPT's default.
    max_iterations : int
        Of one run.
    tuning : mapping
        Options of single solvers, by their names there: options of other solvers are left out.
    """

    method: str = "ipopt"
    tolerance: float = 1e-8
    constraint_tolerance: float = 1e-4
    max_iterations: int = 3000
    tuning: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    def solver(self) -> Solver:
        """Make the solver of this name.

        Examples
        --------
        >>> import casadi as ca
        >>> import numpy as np
        >>> from continuum_grasp.nlp import NLP, Budget, Settings, Start
        >>> x = ca.SX.sym("x", 2)
        >>> start = Start(np.array([0.0, -1.0]), *np.array([[-9.0, -9.0], [9.0, 9.0]]), *np.zeros((2, 1)))
        >>> found = Settings().solver().solve(NLP("circle", x, x[0] + x[1], ca.dot(x, x) - 2), start, Budget())
        >>> found.status, found.x.round(6)
        (<SolverStatus.SOLVED: 'solved'>, array([-1., -1.]))
        """
        module = import_module(f"continuum_grasp.nlp.{self.method}")
        return cast("Solver", getattr(module, self.method.capitalize())(self))

    @staticmethod
    def qp_plugin(key: str = "solver.method") -> str:
        """Name of the plugin for quadratic programs; InputError with the key that asks for it where CasADi has it
        not.
        """
        if ca.has_conic("piqp"):
            return "piqp"
        raise InputError(f"needs PIQP, which comes with CasADi 3.8; this is {ca.CasadiMeta.version()}", key=key)


class Solver(ABC):
    """Solves problems from starts; it retains everything that it builds for a problem.

    Parameters
    ----------
    settings : Settings
    """

    plugin: ClassVar[str]
    """Name of CasADi's plugin."""

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self._built: dict[tuple[NLP, Approach], tuple[ca.Function, _Stop]] = {}

    @abstractmethod
    def options(self, problem: NLP, approach: Approach) -> dict[str, Any]:
        """Options of the plugin, derivatives of the problem included.

        Parameters
        ----------
        problem : NLP
        approach : Approach
            Knowledge about the starts.
        """

    def prepare(self, problem: NLP) -> None:
        """Build the functions for starts with and without multipliers; otherwise this counts as time of the first
        run.
        """
        for warm in (False, True):
            self._function(problem, Approach(warm=warm))

    def solve(self, problem: NLP, start: Start, until: Budget) -> Attempt:
        """Solve from a start until it is solved or the budget ends.

        Raises
        ------
        KeyboardInterrupt
            Ctrl-C was pressed meanwhile; a block ``Budget.last_iterates()`` around it gets the last iterate instead.
        """
        began = time.perf_counter()
        function, stop = self._function(problem, start.approach)
        stop.begin(start, until)
        warm_start = {}
        if start.multipliers is not None:
            warm_start = {"lam_x0": start.multipliers.bounds, "lam_g0": start.multipliers.constraints}
        bounds = {"lbx": start.low, "ubx": start.high, "lbg": start.lower, "ubg": start.upper}
        with interrupts_held():  # an exception within the callback would be lost in C++
            solution = function(x0=np.clip(start.x, start.low, start.high), p=start.p, **bounds, **warm_start)
        stats = self.statistics(function)
        x, g, bound_forces, forces = (np.array(solution[name]).ravel() for name in ("x", "g", "lam_x", "lam_g"))
        iterations = int(stats.get("iter_count", stop.calls - 1))
        outcome = stop.outcome or str(stats["return_status"])
        if outcome == STOP_REQUESTED:
            outcome = until.outcome_of_stop
        multipliers = Multipliers(bound_forces, forces)
        violation = start.violation(x, g)
        # Where constraints are violated, the other conditions say nothing.
        near = violation <= _ACCEPTABLE * self.settings.constraint_tolerance
        error = problem.optimality_error(start, x, multipliers) if near else np.inf
        status = self._status(Attempt.status_of(outcome), error, violation)
        seconds = time.perf_counter() - began
        objective = float(solution["f"])
        return Attempt(status, outcome, x, g, objective, multipliers, iterations, seconds, violation, error)

    def _status(self, reported: SolverStatus, error: float, violation: float) -> SolverStatus:
        """The status of a point, which is solved if, and only if, the conditions of optimality say so."""
        # The last step of a solver may fail by rounding, or the budget end, at a solution.
        tolerance = self.settings.tolerance
        constraint_tolerance = self.settings.constraint_tolerance
        if error <= tolerance and violation <= constraint_tolerance:
            return SolverStatus.SOLVED
        if reported in (SolverStatus.SOLVED, SolverStatus.ACCEPTABLE, SolverStatus.FAILED):
            near = error <= _ACCEPTABLE * tolerance and violation <= _ACCEPTABLE * constraint_tolerance
            return SolverStatus.ACCEPTABLE if near else SolverStatus.FAILED
        return reported

    def statistics(self, function: ca.Function) -> dict[str, Any]:
        """Report of the solver on its last run: ``return_status``, ``iter_count``."""
        return dict(function.stats())

    def _function(self, problem: NLP, approach: Approach) -> tuple[ca.Function, _Stop]:
        key = problem, approach
        if key not in self._built:
            stop = _Stop(problem)
            common: dict[str, Any] = {
                "print_time": False,
                "error_on_fail": False,  # the status reports it
                "show_eval_warnings": False,
                "inputs_check": False,  # prints where equations outnumber unknowns, which the status reports
                # Assembled derivatives have no derivatives of their own, which these two would need.
                "no_nlp_grad": True,
                "calc_lam_p": False,
                "iteration_callback": stop,
            }
            expressions = {"x": problem.x, "p": problem.p, "f": problem.f, "g": problem.g}
            options = common | self.options(problem, approach)
            self._built[key] = ca.nlpsol(problem.name, self.plugin, expressions, options), stop
        return self._built[key]


class _Stop(ca.Callback):
    """Counts iterations; stops the solver at the end of the budget or of the start's patience, or on Ctrl-C, which an
    exception cannot.
    """

    def __init__(self, problem: NLP) -> None:
        ca.Callback.__init__(self)
        n, m, p = (int(part.numel()) for part in (problem.x, problem.g, problem.p))
        self._sizes = {"x": n, "lam_x": n, "g": m, "lam_g": m, "f": 1, "lam_p": p}
        self.construct("stop", {})

    def begin(self, start: Start, until: Budget) -> None:
        """Count calls and iterations from zero."""
        self.start = start
        self.until = until
        self.calls = 0
        self._stalls = start.stalling()
        self.outcome = ""  # where a start ends it
        self._known = np.array(start.known).reshape(-1, start.x.size)

    def get_n_in(self) -> int:
        return int(ca.nlpsol_n_out())

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        return ca.Sparsity.dense(self._sizes[ca.nlpsol_out(i)], 1)

    def has_eval_buffer(self) -> bool:
        return True  # takes a quarter of the time that matrices of CasADi take

    def eval_buffer(self, point: Any, stop: Any) -> int:
        self.calls += 1
        self.until.left -= 1
        if self._stalls is not None:
            g = np.frombuffer(point[_CONSTRAINTS])
            violation = float(np.maximum(self.start.lower - g, g - self.start.upper).max(initial=0.0))
            self.outcome = STALLED if self._stalls(violation) else ""
        if self._known.size and (np.abs(np.frombuffer(point[_UNKNOWNS]) - self._known) < CLOSE).all(axis=1).any():
            self.outcome = KNOWN
        np.frombuffer(stop[0])[0] = self.until.stops or bool(self.outcome)
        return 0
