"""From what the solver found to a plan."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.nlp import Attempt
from continuum_grasp.planning.problem import PlanProblem
from continuum_grasp.planning.result import Constraint

__all__ = ["constraints_of", "objective_of"]

Array = NDArray[np.float64]


def constraints_of(problem: PlanProblem, attempt: Attempt) -> dict[str, Constraint]:
    """All constraints by name, in physical units."""
    motion, assembly = problem.motion, problem.assembly
    unit_cost, lam = motion.scales.objective, attempt.multipliers
    found = {}
    for block in assembly.blocks:
        values = problem.bounds.values(attempt.x, attempt.g, block)
        found[block.name] = Constraint(
            block.name,
            block.key,
            block.unit,
            values * block.scale,
            block.lower * block.scale,
            block.upper * block.scale,
            lam.constraints[block.rows] * unit_cost / block.scale,
        )
    unit = "N m" if motion.nu == 1 else "N"
    of_input = "finger.tendons" if motion.nu == 2 else "input.moment_max"
    bounded = [("input", of_input, unit, problem.inputs, motion.scales.u)]
    bounded.append(("duration", "duration", "s", problem.grid.time, np.array([motion.scales.time])))
    if motion.linear and motion.scene.input.rate_max is not None:
        bounded.append(("input rate", "input.rate_max", f"{unit}/s", problem.grid.v, motion.scales.rate))
    low, high = np.array(assembly.low), np.array(assembly.high)
    for name, key, unit, columns, scale in bounded:
        parts = (attempt.x[columns] * scale, low[columns] * scale, high[columns] * scale)
        found[name] = Constraint(name, key, unit, *parts, lam.bounds[columns] * unit_cost / scale)
    return found


def objective_of(problem: PlanProblem, attempt: Attempt) -> float:
    """The objective in its own unit, without what makes inputs unique."""
    motion = problem.motion
    if motion.scene.objective == "least_time":
        return problem.path(attempt.x).duration
    return attempt.objective * motion.scales.objective
