"""Where a solver starts, and what it gave."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["Attempt", "Multipliers", "Start", "Status"]

Array = NDArray[Any]


class Status(StrEnum):
    """How a solver run ended; the same words for every solver."""

    SOLVED = "solved"
    """At a local optimum, to the full tolerance."""
    ACCEPTABLE = "acceptable"
    """At a local optimum, to 100 times the tolerance, with no further progress."""
    INFEASIBLE = "infeasible"
    """At a point from which no nearby one violates the constraints less: start elsewhere, or relax a constraint."""
    ITERATION_LIMIT = "iteration_limit"
    """Out of iterations of its own: raise ``max_iterations``."""
    STOPPED = "stopped"
    """Stopped by the budget, or by Ctrl-C."""
    FAILED = "failed"
    """Anything else, such as values that are not finite; the solver's own status says more."""


@dataclass(frozen=True, eq=False)
class Multipliers:
    """Lagrange multipliers of the bounds of the unknowns and of the constraints; negative at lower bounds."""

    bounds: Array
    constraints: Array


@dataclass(frozen=True, eq=False)
class Start:
    """A point, and the numbers of the problem.

    Attributes
    ----------
    x : (n,) ndarray
        Unknowns; clipped to their bounds by the solver.
    low, high : (n,) ndarray
        Bounds of the unknowns.
    lower, upper : (m,) ndarray
        Bounds of the constraints.
    p : ndarray
        Parameters of the problem.
    multipliers : Multipliers or None
        Known where the start is next to a solution, which is then looked for nearby.
    barrier : float or None
        First barrier parameter of an interior-point method, for a start that is worth staying near.
    """

    x: Array
    low: Array
    high: Array
    lower: Array
    upper: Array
    p: Array = field(default_factory=lambda: np.empty(0))
    multipliers: Multipliers | None = None
    barrier: float | None = None

    def violation(self, x: Array, g: Array) -> float:
        """Largest amount by which a point leaves a bound of an unknown or of a constraint; infinite if not finite."""
        if not (np.isfinite(x).all() and np.isfinite(g).all()):
            return float("inf")
        excess = np.concatenate([self.low - x, x - self.high, self.lower - g, g - self.upper])
        return float(excess.max(initial=0.0))


@dataclass(frozen=True, eq=False)
class Attempt:
    """What one run of a solver gave.

    Attributes
    ----------
    status : Status
    outcome : str
        The solver's own return status.
    x, g : ndarray
        Unknowns and constraints where it stopped.
    objective : float
    multipliers : Multipliers
    iterations : int
    seconds : float
    violation : float
        Largest amount by which a constraint or a bound is violated, in units of the problem.
    """

    status: Status
    outcome: str
    x: Array
    g: Array
    objective: float
    multipliers: Multipliers
    iterations: int
    seconds: float
    violation: float

    @property
    def converged(self) -> bool:
        """Whether it is a local optimum, if only to the acceptable tolerance."""
        return self.status in (Status.SOLVED, Status.ACCEPTABLE)
