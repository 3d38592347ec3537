"""The numbers of a scene, in units of its problem, and the bounds of the unknowns."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.problem.problem import GraspProblem
from continuum_grasp.grasp.problem.relaxations import RELAXATIONS
from continuum_grasp.grasp.problem.structure import support_of
from continuum_grasp.grasp.problem.unit_finger import finger_numbers
from continuum_grasp.grasp.starts.values import ContactStart, Start
from continuum_grasp.model.surfaces import surface_of
from continuum_grasp.model.surfaces.offset_polygon import SHARP
from continuum_grasp.model.surfaces.surface import Feature
from continuum_grasp.scene.grasp import FingerSetup, GraspScene
from continuum_grasp.scene.grasp_options import PlanarGravity
from continuum_grasp.scene.objects.body import Freedom, pose_bounds

Array = NDArray[Any]
Values = dict[str, Any]

LITTLE = 1e-5
"""Weight of the tensions where they are no aim."""
HELD = 1e-3
"""Least normal force of a contact, as a part of the weight, where slipping or disturbances are an aim."""


@dataclass(frozen=True)
class Units:
    """Units of a problem.

    Attributes
    ----------
    length : float
        Length of the longest finger [m].
    force : float
        Greatest E I / L^2 of the fingers [N].
    """

    length: float
    force: float

    @staticmethod
    def of(scene: GraspScene) -> Units:
        """The units for a scene."""
        rods = [finger.rod for finger in scene.named_fingers.values()]
        return Units(max(r.length for r in rods), max(r.stiffness / r.length**2 for r in rods))

    @property
    def amounts(self) -> dict[str, float]:
        """What one unit of the problem is in SI."""
        return {"m": self.length, "N": self.force, "N m": self.force * self.length}


def contact_features(scene: GraspScene, contacts: dict[str, ContactStart]) -> dict[str, Feature]:
    """The face, corner or smooth part that each contact of a start sits on."""
    found = {}
    for name, start in contacts.items():
        part = scene.object.parts[start.part]
        surface = surface_of(part)
        found[name] = surface.features(part)[surface.nearest_feature(part, start.point, start.normal_angle)]
    return found


def problem_values(problem: GraspProblem, scene: GraspScene, start: Start, features: dict[str, Feature]) -> Values:
    """All run-time numbers but those of clearance, with no limit relaxed."""
    units = Units.of(scene)
    values: Values = {
        "tolerance": scene.solver.penetration_tolerance,
        "effort weight": 1.0,
        "relaxation weights": np.zeros(len(RELAXATIONS)),
        "force reference": max(scene.weight, units.force) / units.force,
        **_object_values(scene, units),
        **_objective_values(scene, units),
    }
    gravity = scene.gravity.vector if isinstance(scene.gravity, PlanarGravity) else (0.0, 0.0)
    for setup in scene.setups:
        values |= finger_numbers(setup, gravity)
        values |= _finger_values(scene, setup, units)
        values |= {f"{setup.name}.joint_{k}": count / setup.elements for k, count in enumerate(setup.before)}
    for contact in problem.spec.contacts:
        values |= _contact_values(scene, contact.name, start.contacts[contact.name], features[contact.name], units)
    return values


def problem_bounds(problem: GraspProblem, scene: GraspScene, features: dict[str, Feature]) -> tuple[Array, Array]:
    """Bounds of the unknowns, with no limit relaxed."""
    units = Units.of(scene)
    low: Values = {f"relaxed {r.name}": 0.0 for r in RELAXATIONS}
    high: Values = dict(low)
    low["greatest normal force"] = 0.0
    low["friction margin"], high["friction margin"] = 0.0, 1.0
    for setup in scene.setups:
        name, finger, length = setup.name, setup.finger, setup.finger.rod.length
        for k in range(len(setup.middles)):
            low[f"{name}.joint_{k}"], high[f"{name}.joint_{k}"] = (s / length for s in setup.middle_bounds)
        least = setup.tendons.min_tension * setup.tendons.offset * length / finger.rod.stiffness
        low[f"{name}.pulls"] = [least, least]
        if finger.tendons_used != "both":
            high[f"{name}.pulls"] = [np.inf, 0.0] if finger.tendons_used == "left" else [0.0, np.inf]
        if finger.base_free is not None:
            pose = (*finger.base.position, finger.base.angle)
            low[f"{name}.base"], high[f"{name}.base"] = _pose_bounds(pose, finger.base_free, units.length)
    if scene.object.free is not None:
        low["object pose"], high["object pose"] = _pose_bounds(scene.object.pose, scene.object.free, units.length)
    steady = bool({"greatest_disturbance", "greatest_friction_margin"} & set(problem.spec.aims))
    for contact in problem.spec.contacts:
        name, feature = contact.name, features[contact.name]
        low[f"place, {name}"], high[f"place, {name}"] = list(feature.lower), list(feature.upper)
        if (
            contact.finger < 0 and not contact.surface.is_smooth
        ):  # the wall's normal decides, also at the end of a corner's cone
            low[f"place, {name}"][1], high[f"place, {name}"][1] = -np.inf, np.inf
        least = HELD * max(scene.weight / units.force, 1.0) if steady else 0.0
        low[f"force, {name}"] = (
            [least, -np.inf, -np.inf] if problem.spec.gravity == "out_of_plane" else [least, -np.inf]
        )
    return problem.parts.pack(low, -np.inf), problem.parts.pack(high, np.inf)


def _finger_values(scene: GraspScene, setup: FingerSetup, units: Units) -> Values:
    finger, name = setup.finger, setup.name
    length, offset, most = finger.rod.length, setup.tendons.offset, setup.tendons.max_tension
    moment = finger.rod.stiffness / length
    used = finger.tendons_used
    least = setup.tendons.min_tension * offset / moment
    return {
        f"{name}.length": length / units.length,
        f"{name}.force share": moment / length / units.force,
        f"{name}.thickness": finger.thickness_radius / length,
        f"{name}.base": [c / units.length for c in finger.base.position] + [finger.base.angle],
        f"{name}.pull_max": most * offset / moment,
        f"{name}.pull_min": [least, least],
        f"{name}.pull_most": [most * offset / moment if used in ("both", side) else 0.0 for side in ("left", "right")],
        f"{name}.pull_per_force": units.force * offset / moment,
        f"{name}.tension weight": tension_weight(scene) * moment / offset,
    }


def tension_weight(scene: GraspScene) -> float:
    """Of the sum of all tensions in the objective [1/N]; a little where it is no aim, so that they are unique."""
    if scene.aims == ("least_tension",):
        rods = ((setup.finger.rod, setup.tendons.offset) for setup in scene.setups)
        return 1.0 / max(rod.stiffness / rod.length / offset for rod, offset in rods)
    return max(scene.weights.least_tension, LITTLE) / sum(setup.tendons.max_tension for setup in scene.setups)


def _objective_values(scene: GraspScene, units: Units) -> Values:
    weights, alone = scene.weights, len(scene.aims) == 1
    most = scene.contacts.normal_force_max / units.force
    per_force = max(scene.weight, units.force)
    return {
        "normal weight": 1.0 / (per_force / units.force) if alone else weights.least_normal_force / most,
        "margin weight": 1.0 if alone else weights.greatest_friction_margin,
        "disturbance weight": 1.0 if alone else weights.greatest_disturbance,
        "wrenches": [
            [fx / units.force, fy / units.force, m / (units.force * units.length)] for fx, fy, m in scene.wrenches
        ],
    }


def _object_values(scene: GraspScene, units: Units) -> Values:
    body, gravity, m = scene.object, scene.gravity, units.length
    weight: Any = scene.weight / units.force
    if isinstance(gravity, PlanarGravity):
        weight = [body.mass * g / units.force for g in gravity.vector]
    values: Values = {
        "object pose": [body.pose[0] / m, body.pose[1] / m, body.pose[2]],
        "center of mass": [c / m for c in body.com],
        "size": body.size / m,
        "weight": weight,
    }
    for k, part in enumerate(body.parts):
        values[f"part_{k}"] = surface_of(part).numbers(part, m)
    planes = (wall for wall in scene.walls if math.isinf(wall.half_length))
    for k, wall in enumerate(planes):
        values |= {f"plane_{k}.normal": wall.normal, f"plane_{k}.point": [c / m for c in wall.point]}
        values[f"plane_{k}.angle"] = wall.normal_angle
    lines = (wall for wall in scene.walls if math.isfinite(wall.half_length))
    for k, wall in enumerate(lines):
        values[f"line_{k}.ends"] = [c / m for end in wall.ends for c in end]
    for k, peg in enumerate(scene.pegs):
        values |= {f"peg_{k}.position": [c / m for c in peg.position], f"peg_{k}.radius": peg.radius / m}
    return values


def _contact_values(scene: GraspScene, name: str, start: ContactStart, feature: Feature, units: Units) -> Values:
    m, surface = units.length, surface_of(scene.object.parts[start.part])
    values: Values = {
        f"{name}.friction": scene.friction(name),
        f"{name}.normal_force_max": scene.normal_force_max(name) / units.force,
        f"{name}.feature": surface.feature_numbers(feature, m),
        f"{name}.point": [c / m for c in start.point],
        f"{name}.normal": [math.cos(start.normal_angle), math.sin(start.normal_angle)],
    }
    values[f"{name}.curvature"] = feature.curvature * m
    values[f"{name}.support curvature"] = 0.0
    support = support_of(name, scene)
    for wall in scene.walls:
        if wall.name == support:
            values |= {
                f"{name}.wall normal": wall.normal,
                f"{name}.wall point": [c / m for c in wall.point],
                f"{name}.half length": wall.half_length / m,
            }
    for peg in scene.pegs:
        if peg.name == support:
            values |= {f"{name}.position": [c / m for c in peg.position], f"{name}.radius": peg.radius / m}
            values[f"{name}.support curvature"] = m / max(peg.radius, SHARP)
    return values


def _pose_bounds(pose: tuple[float, float, float], free: Freedom, length: float) -> tuple[list[float], list[float]]:
    bounds = pose_bounds(pose, free)
    scales = (length, length, 1.0)
    low = [b[0] / s for b, s in zip(bounds, scales, strict=True)]
    return low, [b[1] / s for b, s in zip(bounds, scales, strict=True)]
