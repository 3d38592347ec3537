"""Between the unknowns of a grasp problem and physical numbers."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.grasp.problem.unknowns import FingerLayout, Layout
from continuum_grasp.grasp.problem.values import Units, Values, node_places
from continuum_grasp.grasp.starts.curves import curvature_at, turning
from continuum_grasp.grasp.starts.values import GraspStart
from continuum_grasp.model import Feature
from continuum_grasp.scene import FAMILIES, FingerSetup, GraspScene

PRESSED = 1e-2
"""Least normal force of a contact to start with, as a part of the weight."""


def starting_point(problem: Layout, scene: GraspScene, start: GraspStart, features: dict[str, Feature]) -> Array:
    units = Units.of(scene)
    values: Values = {"object pose": units.pose(start.object_pose)}
    for setup, finger in zip(scene.setups, problem.fingers, strict=True):
        values |= {f"{setup.name}.{key}": value for key, value in _finger_start(setup, finger, start, units).items()}
    force = max(scene.weight / units.force, 1.0)
    lift = -scene.object.mass * scene.gravity[2] / units.force / max(len(problem.spec.contacts), 1)
    values["greatest normal force"] = force
    for contact in problem.spec.contacts:
        at = start.contacts[contact.name]
        part = scene.object.parts[at.part]
        feature = features[contact.name]
        values[f"place, {contact.name}"] = contact.surface.place(part, feature, *at.place)
        pressed = (force, 0.0, lift)
        if contact.name in start.forces:
            n, f, carried = (component / units.force for component in start.forces[contact.name])
            # A contact without force is where the cone has its apex: IPOPT starts a little inside.
            pressed = max(n, PRESSED * force), f, carried
        values[f"force, {contact.name}"] = pressed[: problem.spec.dimensions]
    return problem.x.pack(values, 0.0)


def _finger_start(setup: FingerSetup, finger: FingerLayout, whole: GraspStart, units: Units) -> Values:
    """The unknowns of a finger, whose curvature equals the start's at the places of its family."""
    tendons = setup.tendons
    start = whole.fingers[setup.name]
    length = setup.finger.rod.length
    stiffness = setup.stiffness
    joints = [s / length for s in start.joints]
    lengths = np.diff(node_places(setup, start.joints)) / length
    ends = np.concatenate([[0.0], np.cumsum(lengths)])
    knots = np.array([start.knots]) / length
    curvatures = np.array([start.curvatures]) * length
    tensions = whole.tensions.get(setup.name, (tendons.min_tension,) * 2)
    pulls = [t * tendons.offset * length / stiffness for t in tensions]
    return {
        **wound_start(setup, finger, float(turning(knots, curvatures, ends[None, -1:])[0, -1]), pulls),
        "q": coordinates(setup, finger, lengths, knots, curvatures),
        "pulls": pulls,
        "base": units.pose(start.base),
        **{f"joint_{k}": s for k, s in enumerate(joints)},
    }


def wound_start(setup: FingerSetup, finger: FingerLayout, turn: float, pulls: Sequence[float] | Array) -> Values:
    """Cable that drives have wound up at pulls (2,) where the tip has turned; none where tensions can be chosen."""
    law, drive, length = setup.drive, finger.spec.drive, setup.finger.rod.length
    if drive is None or law is None:
        return {}
    path = setup.tendons.offset / length * turn
    give = (law.series + law.axial) * setup.stiffness / (length**2 * setup.tendons.offset)
    stretched = [give * pull for pull in pulls]
    if drive.winds:
        return {"command": [pulls[0] - pulls[1]], "wound": [stretched[0] - law.start / length]}
    each = [path + stretched[0], -path + stretched[1]]
    return {"command": [each[0] - law.start / length] if drive.pulley else each}


def coordinates(setup: FingerSetup, finger: FingerLayout, lengths: Array, knots: Array, curvatures: Array) -> Array:
    """Coordinates of the unit finger near a shape, curvatures being linear between knots (1, K) along it."""
    ends = np.concatenate([[0.0], np.cumsum(lengths)])
    family = finger.family
    places = ends[:-1, None] + lengths[:, None] * family.places
    at = curvature_at(knots, curvatures, places.reshape(1, -1)).reshape(places.shape)
    bends = np.diff(turning(knots, curvatures, ends[None])[0])
    # The model's unit finger is straight at rest but for run-time numbers.
    length = setup.finger.rod.length
    rest = length * setup.finger.profile.rest_curvature(length * places)
    return np.asarray(family.coordinates(bends - rest.mean(axis=1) * lengths, at - rest)[: finger.size])


def bending_arrays(
    setup: FingerSetup, finger: FingerLayout, q: Array, lengths: Array, tip: float, pulls: Array
) -> Values:
    """Coordinates above rest, their shapes and the curvature at the tip, as a result stores them (SI)."""
    length = setup.finger.rod.length
    profile = setup.finger.profile
    family = finger.family
    shapes = family.curvature_shapes(lengths.tolist())
    if not setup.graded:
        tip = (tip - float(profile.rest_curvature(0.0)) * length) / length
        return {"q": family.coordinate_size(q, length), "curvature_shapes": shapes, "tip_curvature": np.array(tip)}
    ends = np.concatenate([[0.0], np.cumsum(lengths)])
    # Nodes have the stiffness of their base side; at a jump, the element beyond bends by another curvature.
    stiffness, beyond = (profile.bending_stiffness(ends, tip_side=side) for side in (False, True))
    moments = q * setup.stiffness / length
    if FAMILIES[setup.family].matches_tip:
        (channel,) = setup.finger.channels
        moments = moments + np.dot(channel.arms, pulls) * channel.shape(ends)
    bent = moments / stiffness
    shapes[:, 0] *= (stiffness / beyond)[:-1, None]
    return {"q": bent[: finger.size], "curvature_shapes": shapes, "tip_curvature": np.array(float(bent[-1]))}


def stored_arrays(problem: Layout, scene: GraspScene, start: GraspStart, values: list[ca.DM]) -> dict[str, Array]:
    """Stored arrays of a point, from the ``values`` that the problem's reader gives there."""
    units = Units.of(scene)
    spec = problem.spec
    pose, points, normals, forces, stations, *rest = (np.array(v) for v in values)
    m = units.length
    out: dict[str, Array] = {"object.pose": pose.ravel() * [m, m, 1.0]}
    for k, setup in enumerate(scene.setups):
        q, shares, tip, pulls, base, line = rest[6 * k : 6 * k + 6]
        name = setup.name
        length = setup.finger.rod.length
        elements = shares.ravel() * length
        tensions = pulls.ravel() * setup.stiffness / length / setup.tendons.offset
        bending = bending_arrays(setup, problem.fingers[k], q.ravel(), elements, float(tip.ravel()[0]), tensions)
        out |= {f"{name}.{key}": value for key, value in bending.items()} | {
            f"{name}.family": np.array(setup.family),
            f"{name}.lengths": elements,
            f"{name}.tensions": tensions,
            f"{name}.base": base.ravel() * [m, m, 1.0],
            f"{name}.backbone": line.T * [length, m, m, 1.0],
        }
        if name in start.friction_states:
            out[f"{name}.friction_states"] = np.array(start.friction_states[name])
    # Supports have no station.
    lengths = [scene.setups[c.finger].finger.rod.length if c.finger >= 0 else np.nan for c in spec.contacts]
    return out | {
        "contact_names": np.array([contact.name for contact in spec.contacts]),
        "contact_positions": points.T * m,
        "contact_normals": normals.T,
        "contact_forces": forces.T * units.force,
        "contact_stations": stations.ravel() * lengths,
        "contact_parts": np.array([start.contacts[contact.name].part for contact in spec.contacts], dtype=int),
    }
