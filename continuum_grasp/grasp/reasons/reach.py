"""The exact test of distance: whether fingers can reach the object at all."""

from __future__ import annotations

import math

from continuum_grasp.grasp.values import Reason
from continuum_grasp.scene.grasp import FingerSetup, GraspScene
from continuum_grasp.scene.objects.body import greatest_shift

_ROUNDING = 1e-9
"""Part of its reach by which a straight finger may end short of the object."""


def out_of_reach(scene: GraspScene) -> Reason | None:
    """The exact test of distance: no shape at all can touch."""
    needed = [s for s in scene.setups if "on" in (*s.middles, s.tip) or len(scene.setups) == 1]
    away = [(_distance(scene, setup), _reach(setup)) for setup in needed]
    missing, distance, reach = max(((d - r, d, r) for d, r in away), key=lambda one: one[0], default=(0.0, 0.0, 0.0))
    if missing <= _ROUNDING * reach:
        return None
    text = f"the object is out of reach: it is {distance:.4g} m from the base, {reach:.4g} m can be reached"
    repair = f"bring object and base nearer to each other, by {missing:.4g} m at least"
    return Reason("reach", "object.position", "m", distance, reach, text, repair)


def _reach(setup: FingerSetup) -> float:
    """How far from its base a finger can touch at most [m]."""
    length = setup.finger.rod.length
    middle = setup.middle_bounds[1] if "on" in setup.middles else length
    return min(middle, length) + setup.finger.thickness_radius


def _distance(scene: GraspScene, setup: FingerSetup) -> float:
    """Least distance between a base and the object's surface [m]; a lower bound where a pose is free."""
    x, y = setup.finger.base.position
    body = scene.object
    if body.free is None or body.free.angle is None:
        away = body.distance((x, y))
    else:
        # However it is turned about its position, the object lies within its size of its center of mass.
        away = math.dist((x, y), body.position) - math.hypot(*body.com) - body.size
    return away - greatest_shift(body.free, body.position) - greatest_shift(setup.finger.base_free, (x, y))
