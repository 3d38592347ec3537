"""The numbers of a scene, in units of its problem, and the bounds of the unknowns."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.grasp.certificate.drives import StoredFinger
from continuum_grasp.grasp.problem.curves import curve_numbers
from continuum_grasp.grasp.problem.problem import GraspProblem
from continuum_grasp.grasp.problem.relaxations import RELAXATIONS
from continuum_grasp.grasp.problem.structure import inner_masses
from continuum_grasp.grasp.starts.values import ContactStart, FingerStart, GraspStart
from continuum_grasp.grasp.values import LITTLE, NEAR
from continuum_grasp.model import SHARP, Feature, surface_of
from continuum_grasp.scene import FingerSetup, GraspScene, HandScene, Wall

Values = dict[str, Any]

APEX = 2e-4
"""Rounding e of the apex of spatial friction cones, as a part of the weight: (mu N)^2 >= f^2 + l^2 + e^2 in place of
(mu N)^2 >= f^2 + l^2, all inside the true cone, which the certificate checks. A contact that carries nothing presses by
e / mu, one that carries a share s of the weight by e^2 / (2 s^2) more, relatively: 2e-8 of the tension in the median of
99 random scenes and 0.02 % at most; 2e-7 where the finger is stiff and presses by much more than the weight needs."""
BETWEEN = 1e-5
"""Part of the length that a finger may be inside the object between stations, which touch it like the vertices of a
polygon; the certificate allows 1e-4."""
FINE = 64
"""Intervals per segment in which the lengths of a graded finger's elements are measured out, and per element at whose
ends the depth is looked at: parabolas through the deepest place the probes."""


@dataclass(frozen=True)
class Units:
    """Units of a problem."""

    length: float  # of the longest finger [m]
    force: float  # greatest E I / L^2 of the fingers [N]

    @staticmethod
    def of(scene: GraspScene) -> Units:
        rods = [(setup.finger.rod.length, setup.stiffness) for setup in scene.setups]
        return Units(max(length for length, _ in rods), max(stiff / length**2 for length, stiff in rods))

    @property
    def amounts(self) -> dict[str, float]:
        """Amounts of the problem's units in SI."""
        return {"m": self.length, "N": self.force, "N m": self.force * self.length}

    def pose(self, pose: Sequence[float]) -> list[float]:
        """A pose [m, rad] in units of the problem."""
        x, y, angle = pose
        return [x / self.length, y / self.length, angle]

    def point(self, point: Sequence[float]) -> list[float]:
        """A point [m] in units of the problem."""
        return [c / self.length for c in point]


def units_of_rows(scene: GraspScene) -> dict[str, tuple[float, str]]:
    """Amount of a unit of the problem, and the SI unit in which a violated constraint is reported, by the unit of a
    row.
    """
    units = Units.of(scene)
    shown = {unit: (amount, unit) for unit, amount in units.amounts.items()}
    shown["moment per size"] = units.force * scene.object.size, "N m"
    for setup in scene.setups:
        # Pulls are moments of tensions in units of E I / L.
        tension = setup.stiffness / setup.finger.rod.length / setup.tendons.offset
        shown[f"tension, {setup.name}"] = tension, "N"
        if setup.drive is not None:
            shown[f"torque, {setup.name}"] = tension * setup.drive.radius, "N m"
    return shown


def contact_features(scene: GraspScene, contacts: Mapping[str, ContactStart]) -> dict[str, Feature]:
    """The part of the outline that each contact of a start may slide along."""
    bodies = _touching_radii(scene)
    features = {}
    for name, start in contacts.items():
        part = scene.object.parts[start.part]
        features[name] = surface_of(part).near(part, *start.place, bodies.get(name, 0.0))
    return features


def _touching_radii(scene: GraspScene) -> dict[str, float]:
    """Radii of the round bodies that may touch, by contact [m]: half of a finger's thickness, radii of pegs."""
    radii = {peg.name: peg.radius for peg in scene.pegs}
    for setup in scene.setups:
        half, length = setup.finger.profile.half_thickness, setup.finger.rod.length
        radii |= {name: float(half(s)) for name, s in zip(setup.middle_names, setup.middle_places, strict=True)}
        radii[setup.tip_name] = float(half(length))
    return radii


def moved_features(
    before: GraspScene, after: GraspScene, contacts: Mapping[str, ContactStart], features: dict[str, Feature]
) -> dict[str, Feature]:
    """Parts of the outline in a scene whose object may have other dimensions."""
    moved = dict(features)
    if before.object.parts == after.object.parts:
        return moved
    for name, contact in contacts.items():
        part = after.object.parts[contact.part]
        feature = features[name]
        moved[name] = surface_of(part).feature(part, feature.piece, feature.grown)
    return moved


def problem_values(problem: GraspProblem, scene: GraspScene, start: GraspStart, features: dict[str, Feature]) -> Values:
    """All run-time numbers except clearances, with no limit relaxed."""
    units = Units.of(scene)
    values: Values = {
        "tolerance": scene.solver.penetration_tolerance,
        "effort weight": 1.0,
        "relaxation weights": np.zeros(len(RELAXATIONS)),
        "cone share": 1.0 - scene.contacts.reserve,
        "force reference": max(scene.weight, units.force) / units.force,
        # Without a weight, contacts press by what bends the fingers.
        "cone rounding": APEX * (scene.weight or units.force) / units.force,
        **_object_values(scene, units),
        **_support_values(scene, units),
        **_objective_values(scene, units),
    }
    for setup in scene.setups:
        tolerance = scene.solver.penetration_tolerance
        if setup.stations:
            tolerance = tolerance_of(setup, scene) * setup.finger.rod.length / units.length
        values |= finger_values(setup, start, units, scene.gravity[:2], tension_weight(scene), tolerance)
    for contact in problem.spec.contacts:
        values |= _contact_values(scene, contact.name, start.contacts[contact.name], features[contact.name], units)
    return values


def problem_bounds(problem: GraspProblem, scene: GraspScene, features: dict[str, Feature]) -> tuple[Array, Array]:
    """Bounds of the unknowns, with no limit relaxed."""
    units = Units.of(scene)
    low: Values = {f"relaxed {r.name}": np.zeros(r.size) for r in RELAXATIONS}
    high: Values = dict(low)
    low["greatest normal force"] = 0.0
    low["friction margin"], high["friction margin"] = 0.0, 1.0
    # The lower bound of the push is the required push, or a push that is negligible to the fingers.
    low["borne push"] = max(scene.contacts.push or 0.0, NEAR * units.force) / units.force
    for setup in scene.setups:
        name = setup.name
        finger = setup.finger
        length = setup.finger.rod.length
        for k, bounds in enumerate(setup.contact_bounds):
            low[f"{name}.joint_{k}"], high[f"{name}.joint_{k}"] = (s / length for s in bounds)
        least = setup.tendons.min_tension * setup.tendons.offset * length / setup.stiffness
        low[f"{name}.pulls"] = [least, least]
        # Greatest tensions are constraints, which can be relaxed; a tendon that is not there has a bound.
        if finger.tendons_used != "both":
            high[f"{name}.pulls"] = [np.inf, 0.0] if finger.tendons_used == "left" else [0.0, np.inf]
        low[f"{name}.base"], high[f"{name}.base"] = map(units.pose, zip(*finger.base_bounds, strict=True))
    low["object pose"], high["object pose"] = map(units.pose, zip(*scene.object.pose_bounds, strict=True))
    steady = bool({"greatest_disturbance", "greatest_friction_margin", "greatest_push"} & set(problem.spec.aims))
    # If the objective has slip, disturbances or pushes, each contact presses.
    least = NEAR * max(scene.weight / units.force, 1.0) if steady else 0.0
    if "reserve" in problem.x.at:  # which says whether contacts press
        least = -np.inf
    sideways = [-np.inf] * (problem.spec.dimensions - 1)
    for contact in problem.spec.contacts:
        name = contact.name
        feature = features[contact.name]
        low[f"place, {name}"], high[f"place, {name}"] = list(feature.lower), list(feature.upper)
        low[f"force, {name}"] = [least, *sideways]
    return problem.x.pack(low, -np.inf), problem.x.pack(high, np.inf)


def _graded_values(setup: FingerSetup, start: FingerStart) -> Values:
    """Numbers of a graded finger: what its curves are at the nodes of a start."""
    finger = setup.finger
    profile = setup.finger.profile
    nodes = node_places(setup, start.joints)
    segments = np.repeat(np.diff([0.0, *start.joints, profile.length]), _counts(setup))
    (channel,) = finger.channels
    return {
        "shares": np.diff(nodes) / segments,
        "node stiffness": profile.bending_stiffness(nodes) / setup.stiffness,
        "node shapes": channel.shape(nodes),
        "curvature_limit": finger.strain_limit or 0.0,
    }


def node_places(setup: FingerSetup, joints: Sequence[float]) -> Array:
    """Positions (N + 1,) of the ends of a finger's elements for positions of the middle contacts [m].

    Between contacts they are equal, of graded fingers as parts of the integral of (rho A / E I)^(1/4), the local length
    of bending waves.
    """
    profile = setup.finger.profile
    marks = [0.0, *joints, setup.finger.profile.length]
    pieces: list[Array] = []
    for (a, b), count in zip(pairwise(marks), _counts(setup), strict=True):
        at = np.linspace(a, b, FINE + 1 if setup.graded else 2)
        parts = profile.waves(at) if setup.graded else at - a
        pieces.append(np.interp(np.linspace(0.0, parts[-1], count + 1)[:-1], parts, at))
    return np.concatenate([*pieces, marks[-1:]])


def _counts(setup: FingerSetup) -> list[int]:
    """Number of elements of each segment between base, middle contacts and tip."""
    return [b - a for a, b in pairwise((0, *setup.before, setup.elements))]


def finger_values(
    setup: FingerSetup, whole: GraspStart, units: Units, gravity: Sequence[float], weight: float, tolerance: float
) -> Values:
    """Numbers of a finger in its plane, with ``gravity`` there [m/s2], the ``weight`` of its tensions in the objective
    [1/N], and the depth that it may have in obstacles, in units of the problem.
    """
    finger = setup.finger
    rod = setup.finger.rod
    tendons = setup.tendons
    start = whole.fingers[setup.name]
    tensions = whole.tensions.get(setup.name, (0.0, 0.0))
    states = whole.friction_states.get(setup.name)
    length = rod.length
    offset = tendons.offset
    greatest_tension = setup.max_tension
    used = finger.tendons_used
    moment = setup.stiffness / length
    rod_mass = rod.mass_per_length * length
    inner = inner_masses(finger)
    least = tendons.min_tension * offset / moment
    values: Values = {
        "length": length / units.length,
        "curves": curve_numbers(setup, any(gravity)),
        "force share": moment / length / units.force,
        "base": [*units.point(finger.base.position), finger.base.angle],
        # Weight per length in units of E I / L^3: how far a finger sags per length, whatever its size.
        "weight": [g * rod.mass_per_length * length**3 / setup.stiffness for g in gravity],
        "tendon_friction": tendons.friction,
        # As `FingerModel` takes them: whether it was pulled from its shape at rest on stands last.
        "friction_history": np.append(np.zeros(setup.friction_states), 1.0) if states is None else [*states, 0.0],
        "tip_mass": sum(mass.mass for mass in finger.masses if mass not in inner) / rod_mass,
        "bending_range": setup.bending_range,
        "pull_max": greatest_tension * offset / moment,
        "pull_min": [least, least],
        "pull_most": [
            greatest_tension * offset / moment if used in ("both", side) else 0.0 for side in ("left", "right")
        ],
        "pull_per_force": units.force * offset / moment,
        "tension weight": weight * moment / offset,
        "pull_held": [t * offset / moment for t in tensions],
    }
    law = setup.drive
    if law is not None:
        pull = moment / offset  # of one newton
        values |= {
            "onset": law.onset / length,
            "arm": offset / length,
            "series": law.series * pull / length,
            "axial": law.axial * pull / length,
            "servo": law.servo * pull / length if law.locks else 0.0,
            "pulling": law.onset / (law.series + law.axial) / pull,
            "start": law.start / length,
            # Winches that follow a length have no limit: no difference of tensions is twice their greatest.
            "torque_max": min(law.greatest, 2.0 * greatest_tension) / pull,
        }
    if setup.graded:
        values |= _graded_values(setup, start)
    else:
        values |= {
            "rest_curvature": float(finger.profile.rest_curvature(0.0)) * length,
            "curvature_limit": finger.curvature_limit * length if finger.strain_limit is not None else 0.0,
        }
    for k, branch in enumerate(finger.damping.dry_friction, 1):
        values[f"dry_friction_{k}_stiffness"] = branch.stiffness / setup.stiffness
        values[f"dry_friction_{k}_moment"] = branch.moment / moment
    for k, mass in enumerate(inner):
        values |= {f"mass_{k}": mass.mass / rod_mass, f"mass_{k}.at": mass.at / length}
    values |= {f"joint_{k}": s / length for k, s in enumerate(setup.middle_places)}
    values["tolerance"] = tolerance
    return {f"{setup.name}.{key}": value for key, value in values.items()}


def held_values(setup: FingerSetup, arrays: Mapping[str, Any]) -> Array:
    """Quantities that the drives of a finger of a grasp hold, in units of its problem."""
    length = setup.finger.rod.length
    pulls = setup.tendons.offset * length / setup.stiffness
    wound = None if setup.drive is None else StoredFinger(setup, arrays).wound
    if wound is None:
        return np.asarray(pulls * arrays[f"{setup.name}.tensions"])
    return np.asarray(wound.held / length if wound.law.locks else wound.held * pulls)


def tolerance_of(setup: FingerSetup, scene: GraspScene | HandScene) -> float:
    """Depth that a finger may have in obstacles, as a part of the length."""
    return max(BETWEEN if setup.stations else 0.0, scene.solver.penetration_tolerance)


def tension_weight(scene: GraspScene) -> float:
    """Weight of the sum of all tensions in the objective [1/N]; a little where it is no aim, so that they are
    unique.
    """
    if scene.aims == ("least_tension",):
        return 1.0 / max(s.stiffness / s.finger.rod.length / s.tendons.offset for s in scene.setups)
    return max(scene.weights.least_tension, LITTLE) / sum(setup.tendons.max_tension for setup in scene.setups)


def _objective_values(scene: GraspScene, units: Units) -> Values:
    weights = scene.weights
    alone = len(scene.aims) == 1
    greatest_force = scene.contacts.normal_force_max / units.force
    per_force = max(scene.weight, units.force)
    # A single aim is in units of about one; of several, each is a share of its limit times its weight.
    return {
        "normal weight": 1.0 / (per_force / units.force) if alone else weights.least_normal_force / greatest_force,
        "margin weight": 1.0 if alone else weights.greatest_friction_margin,
        "disturbance weight": 1.0 if alone else weights.greatest_disturbance,
        "push weight": 1.0 if alone else weights.greatest_push / greatest_force,
        "push": (scene.contacts.push or 0.0) / units.force,
        "wrenches": [
            [fx / units.force, fy / units.force, m / (units.force * units.length)] for fx, fy, m in scene.wrenches
        ],
    }


def _object_values(scene: GraspScene, units: Units) -> Values:
    body = scene.object
    return {
        "object pose": units.pose(body.pose),
        "center of mass": units.point(body.com),
        "size": body.size / units.length,
        "weight": [body.mass * g / units.force for g in (scene.gravity if scene.spatial else scene.gravity[:2])],
        **{f"part {k}": surface_of(part).numbers(part, units.length) for k, part in enumerate(body.parts)},
    }


def _support_values(scene: GraspScene, units: Units) -> Values:
    values: Values = {}
    planes = (wall for wall in scene.walls if math.isinf(wall.half_length))
    for k, wall in enumerate(planes):
        values |= {f"plane {k}.normal": wall.normal, f"plane {k}.point": units.point(wall.point)}
        values[f"plane {k}.angle"] = wall.normal_angle
    for k, peg in enumerate(scene.pegs):
        values |= {f"peg {k}.position": units.point(peg.position), f"peg {k}.radius": peg.radius / units.length}
    return values


def _contact_values(scene: GraspScene, name: str, start: ContactStart, feature: Feature, units: Units) -> Values:
    m = units.length
    surface = surface_of(scene.object.parts[start.part])
    values: Values = {
        "friction": scene.friction(name),
        "normal_force_max": scene.normal_force_max(name) / units.force,
        "feature": surface.feature_numbers(feature, m),
        "point": units.point(start.point),
        "normal": [math.cos(start.normal_angle), math.sin(start.normal_angle)],
        "curvature": feature.curvature * m,
        "support curvature": 0.0,
    }
    support = scene.support_of(name)
    if isinstance(support, Wall):
        values |= {"wall normal": support.normal, "wall point": units.point(support.point)}
        values["half length"] = support.half_length / m
    elif support is not None:
        values |= {"position": units.point(support.position), "radius": support.radius / m}
        values["support curvature"] = m / max(support.radius, SHARP)
    return {f"{name}.{key}": value for key, value in values.items()}
