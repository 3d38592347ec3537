"""Bounds that are kept between the nodes too: where a plan leaves them there, they are tightened at the nodes."""

from __future__ import annotations

import numpy as np

from continuum_grasp.errors import NumericalError
from continuum_grasp.planning.fine import excess_over_intervals, simulated
from continuum_grasp.planning.ipopt import Attempt, ProgrammeSolver
from continuum_grasp.planning.problem import PlanProblem

__all__ = ["kept_between_nodes"]

_ROUNDS = 5
_LEFT = 2e-4
"""Share of a bound's scale that may be left between the nodes."""
_MORE = 1.1
"""What is taken more than what was left."""


def kept_between_nodes(problem: PlanProblem, solver: ProgrammeSolver, found: Attempt) -> tuple[Attempt, int]:
    """The plan with bounds tightened where they were left, and how often that was done.

    Where no plan keeps the tightened bounds, the last one that was found is kept.
    """
    motion, grid = problem.motion, problem.grid
    hard = motion.hard
    if not hard.any():
        return found, 0
    margins = np.zeros((grid.intervals, motion.stages.ns))
    for k in range(_ROUNDS):
        path = problem.path(found.w)
        try:
            excess = excess_over_intervals(motion, simulated(motion.scene, motion.prediction, path, path.x[0]))
        except NumericalError:
            return found, k
        excess[:, ~hard] = 0.0
        if excess.max() <= _LEFT:
            return found, k
        # An interval lies between two nodes; the one at the start cannot move.
        before, after = np.zeros_like(margins), _MORE * excess
        before[:-1] = _MORE * excess[1:]
        margins += np.maximum(before, after)
        problem.bounds.tighten(margins)
        attempt = solver.run(found.w, found.multipliers)
        if not attempt.converged:
            attempt = solver.run(found.w)
        if not attempt.converged or solver.watch.budget.over or solver.watch.interrupted:
            return found, k
        found = attempt
    return found, _ROUNDS
