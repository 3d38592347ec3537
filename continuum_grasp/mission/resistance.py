"""Disturbances that a grasp resists in a mission, whose drives hold, with other friction and another mass."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from continuum_grasp.arrays import Array
from continuum_grasp.grasp.quality.resistance import Resistance, resistance
from continuum_grasp.grasp.quality.response import GraspResponse
from continuum_grasp.grasp.result import GraspResult
from continuum_grasp.scene.grasp_options import PlanarGravity

ROUNDING = 1e-6
"""Excess, as a part of a number, that is none: the certificate itself holds to this."""


def promised(grasp: GraspResult) -> Resistance:
    """Multiples of the scene's disturbances that a mission may count on, whose drives hold.

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
    down = scene.gravity.vector if isinstance(scene.gravity, PlanarGravity) else (0.0, 0.0)
    more = (mass - scene.object.mass) * np.array([*down, 0.0])
    response.contacts.forces[:, :2] += response.to_wrenches("locked").forces @ more
    return resistance(response, tendons="locked", wrenches=wrenches)
