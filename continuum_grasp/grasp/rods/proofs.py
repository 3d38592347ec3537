"""Proofs that a scene has no grasp, which solve nothing, and overlaps of a scene at rest."""

from __future__ import annotations

import math

import numpy as np

from continuum_grasp.base import amount_text
from continuum_grasp.grasp.at_rest import CLEAR, free_line, overlaps_at_rest
from continuum_grasp.grasp.bound import cannot_balance
from continuum_grasp.grasp.shape import ROUNDING
from continuum_grasp.grasp.values import Reason
from continuum_grasp.scene import FingerSetup, GraspScene, HandScene


def proof_of_none(scene: GraspScene | HandScene) -> str:
    """Return the reason why no forces or no shapes hold the object, in a sentence; empty where there is no proof."""
    if isinstance(scene, HandScene):
        most = _greatest_force(scene)
        need = scene.weight
        if need <= most:
            return ""
        return (
            f"contacts exert {amount_text(most, 'N', '.3g')} at most; the object weighs {amount_text(need, 'N', '.3g')}"
        )
    if (reach := out_of_reach(scene)) is not None:
        return reach.text
    return "no forces at any place of the object balance its weight" if cannot_balance(scene) else ""


def _greatest_force(scene: HandScene) -> float:
    """Sum of the greatest forces in any direction of all contacts within their cones [N], wherever they touch."""
    share = 1.0 - scene.contacts.reserve
    total = 0.0
    for setup in scene.setups:
        count = sum(switch != "off" for switch in setup.switches.values())
        total += count * setup.normal_force_max * math.hypot(1.0, setup.held_friction)
    for contact in scene.support_contacts:
        total += scene.contacts.normal_force_max * math.hypot(1.0, share * contact.support.friction)
    return total


def overlaps_of(scene: GraspScene | HandScene) -> list[str]:
    """Return sentences about fingers that pass through the object, a support or themselves while no tendon pulls."""
    found = [str(overlap) for overlap in overlaps_at_rest(scene)]
    for setup in scene.setups:
        depth = _depth_in_itself(setup)
        if depth > CLEAR * setup.finger.rod.length:
            found.append(f"{setup.name} at rest passes through itself: {1e3 * depth:.3g} mm deep")
    return found


def _depth_in_itself(setup: FingerSetup) -> float:
    """Depth of a finger at rest in itself [m], negative where it is apart.

    Parts are half a circle of its half thickness from each other along it: closer by, bending keeps them apart.
    """
    stations, line = free_line(setup.finger)
    half = np.asarray(setup.finger.profile.half_thickness(stations)) + np.zeros(len(stations))
    thick = np.maximum(half[:, None], half)
    far = stations[:, None] - stations > np.pi * thick
    if not far.any():
        return -float(half.max())
    gaps = np.linalg.norm(line[:, None] - line, axis=2) - half[:, None] - half
    return -float(gaps[far].min())


def out_of_reach(scene: GraspScene) -> Reason | None:
    """The exact test of distance: no shape at all can touch."""
    needed = [s for s in scene.setups if "on" in (*s.middles, s.tip) or len(scene.setups) == 1]
    away = [(_distance(scene, setup), _reach(setup)) for setup in needed]
    missing, distance, reach = max(((d - r, d, r) for d, r in away), key=lambda gap: gap[0], default=(0.0, 0.0, 0.0))
    if missing <= ROUNDING * reach:
        return None
    text = f"the object is out of reach: it is {distance:.4g} m from the base; the finger reaches {reach:.4g} m"
    repair = f"move object and base closer together, by at least {missing:.4g} m"
    return Reason("reach", "object.position", "m", distance, reach, text, repair)


def _reach(setup: FingerSetup) -> float:
    """Greatest distance from its base at which a finger can touch [m]."""
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
    return away - body.greatest_shift - setup.finger.base_shift
