"""Sensitivity of a grasp of rods, from the multipliers of its problem: at an optimum,

    df = lam_g dg - lam_x dx,    with lam_g of rows, which change by dg at fixed unknowns, and lam_x of bounds that move

(A. V. Fiacco, Introduction to Sensitivity and Stability Analysis in Nonlinear Programming, 1983).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.grasp.rods.solving import RodGrasp
from continuum_grasp.grasp.values import Sensitivity
from continuum_grasp.scene import GraspScene


def sensitivities_of(scene: GraspScene, grasp: RodGrasp) -> tuple[Sensitivity, ...]:
    """Derivatives of the answer by friction, mass, and the pose of the object before the hand.

    They hold as long as the same limits stay active. The pose moves the object with its supports against the bases of
    all fingers together; bases that are free do not move.
    """
    unit = 1.0
    if scene.objective == "least_tension":
        # The objective is the sum of tensions per sum of the greatest ones.
        unit = sum(finger.setup.max_tension for finger in grasp.problem.numbers.fingers) / scene.weights.least_tension
    return tuple(Sensitivity(name, unit * slope, of) for name, of, slope in _slopes(scene, grasp))


def _slopes(scene: GraspScene, grasp: RodGrasp) -> Iterator[tuple[str, str, float]]:
    """Name, unit, and derivative of the objective."""
    yield "friction between fingers and object", "1", _by_friction(scene, grasp)
    if scene.weight > 0.0:
        weight = grasp.problem.numbers.weight
        forces = grasp.attempt.multipliers.constraints[grasp.problem.balance]
        # The rows of the balance are the negative weight.
        yield "mass of the object", "kg", float(forces @ weight) / scene.object.mass
    moved = ("object along x", "m"), ("object along y", "m"), ("object turned about its center of mass", "rad")
    for (name, of), move in zip(moved, np.eye(3).tolist(), strict=True):
        yield name, of, _by_move(scene, grasp, *move)


def _by_friction(scene: GraspScene, grasp: RodGrasp) -> float:
    """Derivative by the coefficient of all contacts of fingers [1]."""
    problem, x = grasp.problem, grasp.attempt.x
    touching = {name for finger in problem.numbers.fingers for name in finger.contacts}
    total = 0.0
    for block in problem.blocks:
        contact = block.name.removeprefix("friction, ")
        if block.name != contact and contact in touching:
            pressed = float(x[problem.contacts[contact][0]]) * (1.0 - float(x[problem.margin][0]))
            total += pressed * float(grasp.attempt.multipliers.constraints[block.rows].sum())
    return total * (1.0 - scene.contacts.reserve)


def _by_move(scene: GraspScene, grasp: RodGrasp, x: float, y: float, turn: float) -> float:
    """Derivative by a move of the object about its center of mass: all bases move back."""
    problem = grasp.problem
    numbers = problem.numbers
    angle = scene.object.angle
    pose: Array = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    center = np.asarray(scene.object.position) + pose @ np.asarray(scene.object.com)
    total = 0.0
    for finger, part in zip(numbers.fingers, problem.parts, strict=True):
        if finger.setup.finger.base_free is not None:
            continue
        arm = np.asarray(finger.setup.finger.base.position) - center
        shift = np.array([turn * arm[1] - x, -turn * arm[0] - y]) / finger.length
        forces = grasp.attempt.multipliers.bounds[part.nodes[0][:3]]
        total -= float(forces @ np.array([*shift, -turn]))
    return total
