"""Between the unknowns of a grasp problem and physical numbers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.grasp.problem.parts import PlacedPart
from continuum_grasp.grasp.problem.problem import GraspProblem
from continuum_grasp.grasp.problem.unit_finger import UnitFinger
from continuum_grasp.grasp.problem.values import Units, Values, node_places
from continuum_grasp.grasp.starts.curves import curvature_at, turning
from continuum_grasp.grasp.starts.values import GraspStart
from continuum_grasp.model import Feature
from continuum_grasp.scene import FAMILIES, FingerSetup, GraspScene

PRESSED = 1e-2
"""Least normal force of a contact to start with, as a part of the weight."""


def starting_point(problem: GraspProblem, scene: GraspScene, start: GraspStart, features: dict[str, Feature]) -> Array:
    units = Units.of(scene)
    values: Values = {"object pose": units.pose(start.object_pose)}
    for setup, placed in zip(scene.setups, problem.fingers, strict=True):
        unknowns = _finger_start(setup, placed.part.finger, start, units)
        values |= {f"{setup.name}.{key}": value for key, value in unknowns.items()}
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


def _finger_start(setup: FingerSetup, finger: UnitFinger, whole: GraspStart, units: Units) -> Values:
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


def wound_start(setup: FingerSetup, finger: UnitFinger, turn: float, pulls: Sequence[float] | Array) -> Values:
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


def coordinates(setup: FingerSetup, finger: UnitFinger, lengths: Array, knots: Array, curvatures: Array) -> Array:
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
    setup: FingerSetup, finger: UnitFinger, q: Array, lengths: Array, tip: float, pulls: Array
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


def stored_arrays(problem: GraspProblem, scene: GraspScene, start: GraspStart, x: Array, p: Array) -> dict[str, Array]:
    """Stored arrays of a point."""
    units = Units.of(scene)
    m = units.length
    out: dict[str, Array] = {"object.pose": problem.pose(x, p) * [m, m, 1.0]}
    contacts = _stored_contacts(problem.whole, x, p, [])
    for setup, placed in zip(scene.setups, problem.fingers, strict=True):
        part, name, length = placed.part, setup.name, setup.finger.rod.length
        q, shares, tip, pulls, base, joints = placed.values(part.stored, x, p)
        base = base.ravel()
        elements = shares.ravel() * length
        tensions = pulls.ravel() * setup.stiffness / length / setup.tendons.offset
        bending = bending_arrays(setup, part.finger, q.ravel(), elements, float(tip.ravel()[0]), tensions)
        line = np.array(part.finger.shared.line(*placed.values(part.state, x, p))).T
        points = (line[:, 1] + 1j * line[:, 2]) * np.exp(1j * base[2]) * length
        points += m * (base[0] + 1j * base[1])
        out |= {f"{name}.{key}": value for key, value in bending.items()} | {
            f"{name}.family": np.array(setup.family),
            f"{name}.lengths": elements,
            f"{name}.tensions": tensions,
            f"{name}.base": base * [m, m, 1.0],
            f"{name}.backbone": np.stack([line[:, 0] * length, points.real, points.imag, line[:, 3] + base[2]], axis=1),
        }
        if name in start.friction_states:
            out[f"{name}.friction_states"] = np.array(start.friction_states[name])
        contacts |= _stored_contacts(placed, x, p, [*(length * joints.ravel()), length])
    names = [contact.name for contact in problem.spec.contacts]
    point, normal, force, station = (np.array([contacts[name][k] for name in names]) for k in range(4))
    return out | {
        "contact_names": np.array(names),
        "contact_positions": point.reshape(-1, 2) * m,
        "contact_normals": normal.reshape(-1, 2),
        "contact_forces": force.reshape(-1, 3) * units.force,
        "contact_stations": station,
        "contact_parts": np.array([start.contacts[name].part for name in names], dtype=int),
    }


def _stored_contacts(
    placed: PlacedPart[Any], x: Array, p: Array, stations: Sequence[float]
) -> dict[str, tuple[Array, Array, Array, float]]:
    """Point, normal, force and station [m] of each contact of a part, by name; stations are those of middle contacts
    and tip, supports have none.
    """
    points, normals, forces, _ = placed.values(placed.part.touched, x, p)
    names = placed.names[-len(placed.part.contacts) :] if placed.part.contacts else ()
    stored = {}
    for k, (name, contact) in enumerate(zip(names, placed.part.contacts, strict=True)):
        station = stations[contact.spec.joint] if stations else np.nan
        stored[name] = points[:, k], normals[:, k], forces[:, k], float(station)
    return stored
