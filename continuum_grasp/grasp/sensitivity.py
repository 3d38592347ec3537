"""How the answer changes with friction, mass and pose: from the multipliers of the solution, without solving again."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.problem.values import problem_values, tension_weight
from continuum_grasp.grasp.search import Tried
from continuum_grasp.scene.grasp import GraspScene

Array = NDArray[Any]


@dataclass(frozen=True)
class Sensitivity:
    """By how much what is sought changes with one number of the scene, to first order."""

    name: str
    derivative: float
    """Of the sum of tensions [N] where that is the objective, else of the objective as minimized, per ``unit``."""
    unit: str  # of the number that changes


def sensitivities(scene: GraspScene, found: Tried) -> tuple[Sensitivity, ...]:
    """Derivatives of the answer of a converged attempt with respect to friction, mass, and the pose of the object
    before the hand.

    They hold as long as the same limits stay active. The pose is that of the object with its supports, moved against
    all fingers' bases together; bases that are free do not move.
    """
    attempt, problem = found.attempt, found.solver.problem
    # At an optimum the objective changes with a number as the Lagrangian does: unknowns and multipliers stand still.
    slope = np.asarray(found.solver.slope(attempt.x, attempt.numbers, attempt.multipliers.constraints)).ravel()
    units = 1.0 / tension_weight(scene) if scene.objective == "least_tension" else 1.0

    def values(changed: GraspScene) -> Array:
        numbers = problem_values(problem, changed, attempt.start, attempt.features)
        return problem.numbers.pack(numbers, 0.0)

    now = values(scene)
    return tuple(
        Sensitivity(name, float(slope @ ((values(changed) - now) / step)) * units, unit)
        for name, unit, step, changed in _changes(scene)
    )


def _changes(scene: GraspScene) -> list[tuple[str, str, float, GraspScene]]:
    """Name, unit, step and changed scene."""
    # The numbers of the problem are smooth in the scene's, so that a difference of 1e-6 is good to six digits.
    step, reach = 1e-6, 1e-6 * scene.object.size
    rougher = {}
    for setup in scene.setups:
        contacts = setup.finger.contacts.model_copy(update={"friction": setup.friction + step})
        rougher[setup.name] = setup.finger.model_copy(update={"contacts": contacts})
    found = [("friction between fingers and object", "1", step, scene.with_fingers(rougher))]
    if scene.weight > 0.0:
        mass = step * scene.object.mass
        heavier = scene.object.model_copy(update={"mass": scene.object.mass + mass})
        found.append(("mass of the object", "kg", mass, scene.model_copy(update={"object": heavier})))
    return [
        *found,
        ("object along x", "m", reach, _moved(scene, reach, 0.0, 0.0)),
        ("object along y", "m", reach, _moved(scene, 0.0, reach, 0.0)),
        ("object turned about its center of mass", "rad", step, _moved(scene, 0.0, 0.0, step)),
    ]


def _moved(scene: GraspScene, x: float, y: float, turn: float) -> GraspScene:
    """All bases moved the other way."""
    c, s = np.cos(scene.object.angle), np.sin(scene.object.angle)
    ours = scene.object.com
    arm = np.array([c * ours[0] - s * ours[1], s * ours[0] + c * ours[1]])
    com = np.asarray(scene.object.position) + arm
    back = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    fingers = {}
    for name, finger in scene.named_fingers.items():
        at = com + back @ (np.asarray(finger.base.position) - com) - [x, y]
        pose = {"position": (float(at[0]), float(at[1])), "angle": finger.base.angle - turn}
        fingers[name] = finger.model_copy(update={"base": finger.base.model_copy(update=pose)})
    return scene.with_fingers(fingers)
