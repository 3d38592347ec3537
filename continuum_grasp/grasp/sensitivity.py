"""Change of the answer with friction, mass and pose: from the multipliers of the solution, without solving again."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.problem.values import Units, problem_values, tension_weight
from continuum_grasp.grasp.search import Tried
from continuum_grasp.scene.grasp import GraspScene

Array = NDArray[Any]


@dataclass(frozen=True)
class Sensitivity:
    """By how much what is sought changes with one number of the scene, to first order."""

    name: str
    derivative: float
    """Derivative of the sum of tensions [N] where that is the objective, else of the objective as minimized, per
    ``unit``."""
    unit: str  # of the number that changes


def sensitivities(scene: GraspScene, found: Tried) -> tuple[Sensitivity, ...]:
    """Derivatives of the answer of a converged attempt with respect to friction, mass, and the pose of the object
    before the hand.

    They hold as long as the same limits stay active. The pose is that of the object with its supports, moved against
    all fingers' bases together; bases that are free do not move.
    """
    attempt, problem = found.attempt, found.solver.problem
    # At an optimum the objective changes with a number as the Lagrangian does: unknowns and multipliers stand still.
    slope = np.asarray(found.solver.nlp.slope(attempt.x, attempt.numbers, 1.0, attempt.multipliers.constraints)).ravel()
    units = 1.0 / tension_weight(scene) if scene.objective == "least_tension" else 1.0
    at = problem.numbers.at
    touching = [at[f"{contact.name}.friction"] for contact in problem.spec.contacts if contact.finger >= 0]
    changes = [("friction between fingers and object", "1", sum(float(slope[rows].sum()) for rows in touching))]
    if scene.weight > 0.0:
        changes.append(("mass of the object", "kg", float(slope @ _by_mass(scene, found))))
    moves = [slope @ _by_move(scene, found, *move) for move in np.eye(3).tolist()]
    moved = ("object along x", "m"), ("object along y", "m"), ("object turned about its center of mass", "rad")
    changes += [(name, unit, float(move)) for (name, unit), move in zip(moved, moves, strict=True)]
    return tuple(Sensitivity(name, derivative * units, unit) for name, unit, derivative in changes)


def _by_mass(scene: GraspScene, found: Tried) -> Array:
    """Derivative of the problem's numbers by the object's mass [1/kg]."""
    attempt, problem = found.attempt, found.solver.problem
    # They are smooth in it, so that a difference of 1e-6 is good to six digits.
    mass = 1e-6 * scene.object.mass
    heavier = scene.object.model_copy(update={"mass": scene.object.mass + mass})
    now, then = (
        problem.numbers.pack(problem_values(problem, each, attempt.start, attempt.features), 0.0)
        for each in (scene, scene.model_copy(update={"object": heavier}))
    )
    return np.asarray((then - now) / mass)


def _by_move(scene: GraspScene, found: Tried, x: float, y: float, turn: float) -> Array:
    """Derivative of the problem's numbers by a move of the object about its center of mass: all bases move back."""
    c, s = np.cos(scene.object.angle), np.sin(scene.object.angle)
    com = np.asarray(scene.object.position) + np.array([[c, -s], [s, c]]) @ scene.object.com
    at, out = found.solver.problem.numbers.at, np.zeros(found.solver.problem.numbers.size)
    for name, finger in scene.named_fingers.items():
        if f"{name}.base" in at:
            arm = np.asarray(finger.base.position) - com
            shift = turn * np.array([arm[1], -arm[0]]) - [x, y]
            out[at[f"{name}.base"]] = Units.of(scene).pose([*shift.tolist(), -turn])
    return out
