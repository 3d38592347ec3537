"""Bounds that hold between the nodes too: where a plan violates them there, they are tightened at the nodes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from continuum_grasp.errors import NumericalError
from continuum_grasp.nlp import Attempt
from continuum_grasp.planning.fine import excess_over_intervals, simulated
from continuum_grasp.planning.problem import PlanProblem

__all__ = ["satisfied_between_nodes"]

_ROUNDS = 5
"""Most rounds; shipped plans need up to three."""
_EXCESS = 2e-4
"""Share of a bound's scale by which it may be violated between the nodes; a plan's warning begins at 1e-3."""
_OVER_TIGHTENING = 1.1
"""Factor on the excess, so that rounds converge from the safe side."""


def satisfied_between_nodes(
    problem: PlanProblem, found: Attempt, solved: Callable[..., Attempt], over: Callable[[], bool]
) -> tuple[Attempt, int]:
    """Tighten bounds at the nodes where a plan violates them in between: the plan, and how often that was done.

    Where no plan satisfies the tightened bounds, the last one that was found is retained. ``solved`` solves the problem
    from unknowns and, if they are known, multipliers; ``over`` tells whether the search has to end.
    """
    motion, grid = problem.motion, problem.grid
    hard = motion.hard
    if not hard.any():
        return found, 0
    margins = np.zeros((grid.intervals, len(motion.hard)))
    for k in range(_ROUNDS):
        path = problem.path(found.x)
        try:
            excess = excess_over_intervals(motion, simulated(motion.scene, motion.prediction, path, path.x[0]))
        except NumericalError:
            return found, k
        excess[:, ~hard] = 0.0
        if excess.max() <= _EXCESS:
            return found, k
        # An interval lies between two nodes; the one at the start cannot move.
        before, after = np.zeros_like(margins), _OVER_TIGHTENING * excess
        before[:-1] = _OVER_TIGHTENING * excess[1:]
        margins += np.maximum(before, after)
        problem.bounds.tighten(margins)
        attempt = solved(problem, found.x, found.multipliers)
        if not attempt.converged:
            attempt = solved(problem, found.x)
        if not attempt.converged or over():
            return found, k
        found = attempt
    return found, _ROUNDS
