"""What a grasp resists with drives that hold, as those of a mission do, whatever its certificate lets them do."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.quality.resistance import Resistance, resistance
from continuum_grasp.grasp.quality.response import GraspResponse
from continuum_grasp.grasp.result import GraspResult
from continuum_grasp.scene.finger import Finger
from continuum_grasp.scene.grasp_drive import DriveLaw
from continuum_grasp.scene.grasp_options import PlanarGravity

Array = NDArray[np.float64]

ROUNDING = 1e-6
"""Excess, as a part of a number, that is none: the certificate itself holds to this."""


def promised(grasp: GraspResult) -> Resistance:
    """Multiples of the scene's disturbances that a mission may count on.

    Those of the certificate where it has the tendons locked. Where it lets tensions be chosen anew for a disturbance,
    which a mission does not do, those with locked tendons and the weight shared out evenly: the least tension puts a
    contact on its cone, at which nothing could be resisted.
    """
    certified = grasp.quality.resistance
    if certified.tendons == "locked":
        return certified
    friction = np.array([grasp.scene.friction(contact.name) for contact in grasp.contacts])
    return held_resistance(grasp, friction, grasp.scene.object.mass, evenly=True)


def held_resistance(
    grasp: GraspResult,
    friction: Array,
    mass: float,
    *,
    max_tension: float | None = None,
    evenly: bool = False,
    wrenches: Sequence[Sequence[float]] | None = None,
) -> Resistance:
    """Multiples of the disturbances resisted with locked tendons, other friction (C,) [1] and mass [kg].

    The weight is shared out as in the certificate, in proportion; ``evenly``, or where that is beyond a cone, each
    contact bears an equal part of what it has left beside its friction in the plane. ``max_tension`` [N] is that of
    the grasp where not given, ``wrenches`` those of its scene.
    """
    scene, arrays = grasp.scene, grasp.arrays
    if max_tension is not None:
        fingers = {name: own.with_tendons(max_tension=max_tension) for name, own in scene.named_fingers.items()}
        scene = scene.with_fingers(fingers)
    forces = np.array(arrays["contact_forces"], dtype=float)
    normal, across, lift = forces.T
    lift = lift * mass / scene.object.mass
    cone = friction * normal
    if evenly or (np.hypot(across, lift) > cone * (1.0 + ROUNDING)).any():
        spare = np.sqrt(np.maximum(cone**2 - across**2, 0.0))
        lift = spare * lift.sum() / max(float(spare.sum()), 1e-300)
    forces[:, 2] = lift
    response = GraspResponse(scene, {**arrays, "contact_forces": forces})
    response.contacts.friction = friction
    # Weight in the plane beyond that of the grasp is one more wrench, to which all contacts respond.
    more = (mass - scene.object.mass) * np.array([*plane_gravity(grasp), 0.0])
    response.contacts.forces[:, :2] += response.to_wrenches("locked").forces @ more
    return resistance(response, tendons="locked", wrenches=wrenches)


def plane_gravity(grasp: GraspResult) -> tuple[float, float]:
    """Gravity in the plane [m/s2]; zero where it acts out of it."""
    gravity = grasp.scene.gravity
    return gravity.vector if isinstance(gravity, PlanarGravity) else (0.0, 0.0)


def keep_position(fingers: Sequence[Finger]) -> bool:
    """Whether the drives keep their position while a pull grows: winches, and motors under a position servo."""
    return all(bool(finger.winches) if (law := DriveLaw.of(finger)) is None else law.locks for finger in fingers)


def lowered(
    grasp: GraspResult, fingers: Sequence[Finger], pulls: Array, mass: float, stiffness: float
) -> tuple[Array, Array]:
    """How far pulls (K, 3) lower an object that weighs in the plane, once it rests (K) [m].

    The first is that of the fingers that carry the grasp out, with the plant's mass [kg] and contacts of a stiffness
    [N/m]; the second that of the certificate: drives that keep their position, and contacts that do not give. Both are
    for small motions. Controllers that follow a force give way further than drives that keep their tension.
    """
    down = np.array(plane_gravity(grasp))
    wrenches = pulls + (mass - grasp.scene.object.mass) * np.array([*down, 0.0])
    laws = [DriveLaw.of(finger) for finger in fingers]
    springs = [np.inf if law is None else sum(law.springs(2 * [1.0 / (law.series + law.axial)])) for law in laws]
    there = GraspResponse(grasp.scene, grasp.arrays, springs, 1.0 / stiffness)
    changes = (
        there.to_wrenches("locked" if keep_position(fingers) else "retensioned"),
        GraspResponse(grasp.scene, grasp.arrays).to_wrenches("locked"),
    )
    mission, certified = (down / np.hypot(*down) @ change.pose[:2] @ wrenches.T for change in changes)
    return mission, certified
