"""Starts, budgets and results of solver runs."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Literal

import numpy as np

from continuum_grasp.base import Array, interrupt_pressed, interrupts_held
from continuum_grasp.scene import SolverOptions

STALLED, KNOWN, SPENT, STOP_REQUESTED = "Stalled", "Known", "Budget_Spent", "User_Requested_Stop"
"""Outcomes of a run that lost its patience, that came to a known solution, whose budget was spent, and that was stopped
in another way."""
_VIOLATED, _SAME, _STILL = 1e-3, 0.03, 1e-3
"""Violation from which on a run may lose its patience, and relative changes of one that stays as it is, and of one that
stands still: where steps become so short, IPOPT is at a point that violates least nearby, or about to restore
feasibility."""
_WORDS = {
    "Infeasible_Problem_Detected": "the solver stopped where nearby points cannot satisfy the constraints",
    "Invalid_Number_Detected": "values were not finite",
    "Maximum_Iterations_Exceeded": "the iterations were used up",
    "Restoration_Failed": "the solver stopped where no step lowers the violation",
    "Search_Direction_Becomes_Too_Small": "further steps gained almost nothing",
    STOP_REQUESTED: "the search was interrupted",
    STALLED: "constraints stayed violated while the solver went on",
    SPENT: "the iterations of this start were used up",
}


class SolverStatus(StrEnum):
    """Outcome of a solver run; the same words for every solver."""

    SOLVED = "solved"
    """At a point where the conditions of optimality hold to the full tolerance, whatever the solver says of it."""
    ACCEPTABLE = "acceptable"
    """At a point that satisfies them to 100 times the tolerance, without further progress."""
    INFEASIBLE = "infeasible"
    """At a point with the least violation nearby: start elsewhere, or relax a constraint."""
    ITERATION_LIMIT = "iteration_limit"
    """Out of iterations of its own: raise ``max_iterations``."""
    STOPPED = "stopped"
    """Stopped by the budget, by Ctrl-C, or as a start says (see `Start.patience` and `Start.known`)."""
    FAILED = "failed"
    """Anything else, such as values that are not finite; the solver's own status says more."""


_STATUS = {
    "Solve_Succeeded": SolverStatus.SOLVED,
    "Solved_To_Acceptable_Level": SolverStatus.ACCEPTABLE,
    "Infeasible_Problem_Detected": SolverStatus.INFEASIBLE,
    "Maximum_Iterations_Exceeded": SolverStatus.ITERATION_LIMIT,
    **dict.fromkeys((STOP_REQUESTED, STALLED, KNOWN, SPENT), SolverStatus.STOPPED),
}
"""Status by outcome; any other is a failure."""


@dataclass(frozen=True, eq=False)
class Multipliers:
    """Lagrange multipliers of the bounds of the unknowns and of the constraints; negative at lower bounds."""

    bounds: Array
    constraints: Array


OptionSet = Literal["default", "refined", "refined_monotone"]
"""Assumed distance of a start from a solution; a solver has options for each, and builds for those that are used."""


@dataclass(frozen=True)
class Approach:
    """Properties of a start that decide on the options of a solver; see `Start`."""

    option_set: OptionSet = "default"
    barrier: float | None = None
    warm: bool = False  # whether multipliers are known


class Stalling:
    """Whether a run stalls: asked with its violation after each iteration.

    Violations of 1e-3 and less never do; ``patience`` and ``standstill`` are as of `Start`.
    """

    def __init__(self, patience: int | None, standstill: int | None) -> None:
        self._patience = patience
        self._standstill = standstill
        # Iterations without a change since the violation was so much, those in a row, and the violation before.
        self._idle = 0
        self._mark = np.inf
        self._still = 0
        self._last = np.inf

    def __call__(self, violation: float) -> bool:
        change = abs(violation - self._last)
        last = self._last
        self._last = violation
        self._still = self._still + 1 if change < _STILL * last else 0
        if violation < 0.5 * self._mark:
            self._idle = 0
            self._mark = violation
        elif change < _SAME * last:
            self._idle += 1
        impatient = self._patience is not None and self._idle >= self._patience
        stands = self._standstill is not None and self._still >= self._standstill
        return violation > _VIOLATED and (impatient or stands)


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
    option_set : {"default", "refined", "refined_monotone"}
        Distance from a solution: rough, so that the settings hold; nearly exact, for few, bold iterations; nearly
        exact, where bold iterations left it.
    patience : int or None
        Greatest number of iterations until a violation falls to half; otherwise the run ends as `Attempt.stalled`.
        None: any number.
    standstill : int or None
        Greatest number of iterations in a row that change a violation by less than 0.1 %; then the run ends in the same
        way.
    known : sequence of (n,) ndarray
        Solutions: a run that comes to one of them ends as `Attempt.known`.
    """

    x: Array
    low: Array
    high: Array
    lower: Array
    upper: Array
    p: Array = field(default_factory=lambda: np.empty(0))
    multipliers: Multipliers | None = None
    barrier: float | None = None
    option_set: OptionSet = "default"
    patience: int | None = None
    standstill: int | None = None
    known: Sequence[Array] = ()

    @property
    def approach(self) -> Approach:
        """Properties that decide on the options of a solver."""
        return Approach(self.option_set, self.barrier, self.multipliers is not None)

    def stalling(self) -> Stalling | None:
        """Return a rule that decides whether a run from here stalls; None if it never stalls."""
        if self.patience is None and self.standstill is None:
            return None
        return Stalling(self.patience, self.standstill)

    def violation(self, x: Array, g: Array) -> float:
        """Largest amount by which a point leaves a bound of an unknown or of a constraint; infinite if not finite."""
        if not (np.isfinite(x).all() and np.isfinite(g).all()):
            return float("inf")
        excess = np.concatenate([self.low - x, x - self.high, self.lower - g, g - self.upper])
        return float(excess.max(initial=0.0))


@dataclass(frozen=True, eq=False)
class Attempt:
    """Result of a solver run.

    Attributes
    ----------
    status : SolverStatus
    outcome : str
        The solver's own return status.
    x, g : ndarray
        Unknowns and constraints at the end.
    objective : float
    multipliers : Multipliers
    iterations : int
    seconds : float
    violation : float
        Largest amount by which a constraint or a bound is violated, in units of the problem.
    error : float
        Scaled error in the conditions of optimality; see `NLP.optimality_error`. Infinite where a constraint is
        violated by more than an acceptable point may.
    """

    status: SolverStatus
    outcome: str
    x: Array
    g: Array
    objective: float
    multipliers: Multipliers
    iterations: int
    seconds: float
    violation: float
    error: float

    @staticmethod
    def status_of(outcome: str) -> SolverStatus:
        """Status by the outcome of a run; CasADi's solvers share these names."""
        return _STATUS.get(outcome, SolverStatus.FAILED)

    def moved(self, x: Array, g: Array, objective: float) -> Attempt:
        """The run with a point that it did not find itself: it has failed, whatever the point is worth."""
        return replace(self, status=SolverStatus.FAILED, x=x, g=g, objective=objective)

    @property
    def converged(self) -> bool:
        """Whether it is a local optimum, if only to the acceptable tolerance."""
        return self.status in (SolverStatus.SOLVED, SolverStatus.ACCEPTABLE)

    @property
    def stalled(self) -> bool:
        """Whether the run lost its patience; see `Start.patience`."""
        return self.outcome == STALLED

    @property
    def spent(self) -> bool:
        """Whether its iterations were used up."""
        return self.outcome == SPENT

    @property
    def known(self) -> bool:
        """Whether the run came to a known solution; see `Start.known`."""
        return self.outcome == KNOWN

    @property
    def why_it_ended(self) -> str:
        """Why the run ended, for those who do not know the solver's own names."""
        if " " in self.outcome:  # words already
            return self.outcome
        return _WORDS.get(self.outcome) or f"the solver ended with {self.outcome.replace('_', ' ').lower()}"


@dataclass
class Budget:
    """Iterations left, shared by all solver runs of a search.

    Attributes
    ----------
    left : float
        Iterations that may still be spent; a run spends one more than it reports, for its first evaluation.
    until : float
        ``time.monotonic()`` of the emergency stop [s].
    stopped : bool
        Whether the emergency stop cut a run short.
    listener : callable, optional
        Takes a line of text about the search now and then.

    Examples
    --------
    >>> from continuum_grasp.nlp import Budget
    >>> budget = Budget(left=100)
    >>> with budget.share(60) as part:
    ...     part.left -= 11
    >>> budget.left, budget.over
    (89, False)
    """

    left: float = float("inf")
    until: float = float("inf")
    stopped: bool = False
    listener: Callable[[str], None] | None = None

    @classmethod
    def of(cls, options: SolverOptions, listener: Callable[[str], None] | None = None) -> Budget:
        """The budget that a scene gives, from now on."""
        return cls(options.max_total_iterations, time.monotonic() + options.time_limit, listener=listener)

    def tell(self, text: str) -> None:
        """Report the state of the search to the listener."""
        if self.listener is not None:
            self.listener(text)

    @contextmanager
    def share(self, iterations: int | None) -> Iterator[Budget]:
        """Limit the iterations of the runs in the block (by default to all that are left)."""
        granted = min(iterations or self.left, self.left)
        # The callback that counts also sees the start, before the first iteration.
        part = Budget(granted + 1, self.until)
        try:
            yield part
        finally:
            self.left -= min(granted, granted + 1 - part.left)
            self.stopped |= part.stopped

    @staticmethod
    def last_iterates() -> AbstractContextManager[Callable[[], bool]]:
        """Let Ctrl-C end the runs in the block, which then return their last iterates; yield whether it was pressed."""
        return interrupts_held(quietly=True)

    @property
    def over(self) -> bool:
        """Whether there is nothing left to spend, or the emergency stop came; who asks acts on it: it counts as one."""
        if self.left <= 0:
            return True
        self.stopped |= time.monotonic() > self.until
        return self.stopped

    @property
    def stops(self) -> bool:
        """Whether a run has to end: Ctrl-C was pressed, or the budget is over."""
        return interrupt_pressed() or self.over

    @property
    def outcome_of_stop(self) -> str:
        """Outcome of a run that was stopped: by this budget, or by a user."""
        return SPENT if self.over else STOP_REQUESTED

    @property
    def cut(self) -> str:
        """Limit that cut the search short: ``clock``, ``iterations``, or none."""
        if self.stopped:
            return "clock"
        if self.left <= 0:
            return "iterations"
        return ""
