"""Second-order test of a hand's grasp: does every small motion in space that the contacts allow raise the energy?

`continuum_grasp.grasp.certificate.space` describes the fingers and the points that touch.
At palm and table, with reaction N against n and the radii of curvature rho of the surface, the object rolls:

    u + phi x a = 0,  2 E += N (phi x n) . rho (phi x n)
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.grasp.certificate.chain import LINKS, skew
from continuum_grasp.grasp.certificate.check import EXACT
from continuum_grasp.grasp.certificate.space import CREEPS, SpatialStability, SpatialSystem, held_directions, least_mode
from continuum_grasp.grasp.certificate.stability import held_by
from continuum_grasp.grasp.hand.recomputed import HandTouch, ObjectTouch, RecomputedHand

TURNED = math.radians(1.0)
"""Turn of the object, or shift per quarter of the first finger, after which torsional friction has to hold it [rad]:
trials count it as lost beyond."""
BESIDE = 1e-3
"""Distance from a contact, per size of the object, at which the surface's normals give its curvature [1]."""
ASSUMPTIONS = (
    "contacts that press stick as pins, on fingers without rolling; others are left out; "
    "bases are fixed; tendons do not stiffen the fingers against twist"
)


@dataclass(frozen=True)
class HandResponse:
    """Motion and contact forces, to first order, under a wrench on the object (force along x, y, z and moment about the
    center of mass) while tensions stay, or drives that lock. Contacts are those that press.
    """

    pose: Array  # (6, 6) shift [m] and turn [rad] of the object per wrench
    forces: Array  # (C, 3, 6) change of the contact forces on the fingers per wrench
    pose_by_tension: Array  # (6, T) shift and turn of the object per tension, of all tendons by finger
    forces_by_tension: Array  # (C, 3, T) change of the contact forces per tension
    pose_by_gravity: Array  # (6, 3) shift and turn of the object per gravity along x, y, z, of fingers too
    forces_by_gravity: Array  # (C, 3, 3) change of the contact forces per gravity
    moments: Array  # (C, 6) change of the moments about the normals on the fingers per wrench
    moments_by_gravity: Array  # (C, 3) change of these moments per gravity
    places: tuple[Array, ...]  # of each finger: nodes of its displaced backbone (N + 1, 3) [m]
    places_by_tension: tuple[Array, ...]  # (N + 1, 3, T) their displacement per tension


def hand_stability(hand: RecomputedHand, links: int = LINKS) -> SpatialStability:
    """Least eigenvalue of the energy's Hessian on the motions that the contacts leave."""
    system = steadying_system(hand, links)
    assumptions = f"{held_by([finger.plane for finger in hand.fingers])}; {ASSUMPTIONS}"
    unit = hand.fingers[0].plane.stiffness / hand.fingers[0].length
    if not (np.isfinite(system.hessian).all() and np.isfinite(system.rows).all()):
        return SpatialStability(float("nan"), float("nan"), assumptions=assumptions)
    held = held_directions(system.rows)
    if held.shape[1] == len(system.hessian):
        return SpatialStability(float("inf"), float("inf"), assumptions=assumptions)
    least, vector = least_mode(system.hessian, held)
    return SpatialStability(least / unit, least, system.describe(vector), vector[-6:], assumptions)


def steadying_system(hand: RecomputedHand, links: int = LINKS) -> HandSystem:
    """The system whose least eigenvalue counts: contacts with torsional friction turn with what they touch where all of
    that friction, in each motion that is less stable with points, is as good at `TURNED` as a stiffness that makes up
    for it. Otherwise contacts are points.
    """
    system = HandSystem(hand, links)
    if not system.turning or not np.isfinite(system.hessian).all():
        return system
    points = HandSystem(hand, links, turning=False)
    held = held_directions(points.rows)
    left = np.linalg.svd(held, full_matrices=True)[0][:, held.shape[1] :]
    values, vectors = np.linalg.eigh(left.T @ points.hessian @ left)
    least, _ = least_mode(system.hessian, held_directions(system.rows))
    missing = min(least, CREEPS * hand.fingers[0].plane.stiffness / hand.fingers[0].length) - values
    modes = (left @ vectors)[:, missing > 0.0]
    turned = np.abs(system.rows[[row for _, row in system.turning]] @ modes)
    pressing = [hand.pressing[k] for k, _ in system.turning]
    friction = np.array([contact.arm * contact.friction * contact.normal_force for contact in pressing])
    # Per unit of a mode, which moves the object by its part of that.
    borne = (friction @ turned) * np.linalg.norm(modes[-6:], axis=0)
    return system if (borne >= TURNED * missing[missing > 0.0]).all() else points


def points_response(hand: RecomputedHand, links: int = LINKS) -> HandResponse | None:
    """Response of a grasp whose contacts turn about their normals at the moments that they bear; None where there is no
    torsional friction, or the object is not stable so.
    """
    if not any(contact.arm for contact in hand.pressing):
        return None
    points = HandSystem(hand, links, turning=False)
    least, _ = least_mode(points.hessian, held_directions(points.rows))
    unit = hand.fingers[0].plane.stiffness / hand.fingers[0].length
    return hand_response(hand, links, turning=False) if least > CREEPS * unit else None


def hand_response(hand: RecomputedHand, links: int = LINKS, *, turning: bool = True) -> HandResponse | None:
    """Response of a grasp to wrenches on the object and to tensions, at its equilibrium; None where nothing holds
    the object. Where ``turning`` is False, contacts turn about their normals at the moments that they bear.
    """
    if not hand.pressing:
        return None
    system = HandSystem(hand, links, turning=turning)
    hessian, rows, scale = system.hessian, system.rows, system.scale
    loads = np.concatenate([np.eye(len(scale))[:, -6:], system.weights, system.tendons], axis=1) * scale[:, None]
    left, singular, right = np.linalg.svd(rows)
    rank = int((singular > EXACT * singular[0]).sum())
    free = right[rank:].T
    try:
        moved = free @ np.linalg.solve(free.T @ hessian @ free, free.T @ loads)
    except np.linalg.LinAlgError:
        return None
    # What the constraints take of the loads: forces on the fingers, least squares where the contacts are indeterminate.
    forces = left[:, :rank] @ ((right[:rank] @ (hessian @ moved - loads)) / singular[:rank, None])
    moved = scale[:, None] * moved
    moments = np.zeros((len(hand.pressing), forces.shape[1]))
    twists = np.array([row for _, row in system.turning], dtype=int)
    moments[[contact for contact, _ in system.turning]] = forces[twists]
    forces = np.delete(forces, twists, axis=0).reshape(len(moments), 3, -1)
    pose = moved[-6:]
    shapes = [chain.displaced(moved[span, 9:]) for chain, span in zip(system.chains, system.spans, strict=True)]
    points = tuple(chain.points for chain in system.chains)
    wrench = slice(6)
    gravity = slice(6, 9)
    tension = slice(9, None)
    return HandResponse(
        pose[:, wrench],
        forces[..., wrench],
        pose[:, tension],
        forces[..., tension],
        pose[:, gravity],
        forces[..., gravity],
        moments[:, wrench],
        moments[:, gravity],
        points,
        tuple(shapes),
    )


class HandSystem(SpatialSystem):
    """The system of a hand, with what tensions and gravity do; where ``turning`` is False, contacts are points."""

    def __init__(self, hand: RecomputedHand, links: int, *, turning: bool = True) -> None:
        super().__init__(hand.fingers, hand.gravity, hand.com, links)
        tendons = []
        rows = list[Array]()
        # Contacts that press and the rows by which they turn about the normal with what they touch.
        self.turning = list[tuple[int, int]]()
        for finger, chain, span in zip(hand.fingers, self.chains, self.spans, strict=True):
            for channel in finger.plane.finger.channels:
                tendons += [np.zeros(self.size) for _ in channel.arms]
                for arm, force in zip(channel.arms, tendons[-len(channel.arms) :], strict=True):
                    force[span] = chain.pulled(channel, arm)
        for number, contact in enumerate(hand.pressing):
            if isinstance(contact, HandTouch):
                k = next(k for k, finger in enumerate(hand.fingers) if contact in finger.contacts)
                rows.append(self.pinned(contact, k))
                if contact.arm and turning:
                    self.turning.append((number, sum(map(len, rows))))
                    rows.append(self.twisted(contact, k)[None])
            else:
                across = skew(contact.normal)
                radii = curvature_radii(hand, contact)
                self.hessian[-3:, -3:] += contact.normal_force * across.T @ radii @ across
                rows.append(self.supported(contact.point, contact.load))
        self.take(rows)
        self.tendons = np.array(tendons).reshape(-1, self.size).T
        # Per gravity along x, y and z, about the center of mass of the object.
        self.weights = np.zeros((self.size, 3))
        self.weights[-6:-3] = hand.scene.object.weighed * np.eye(3)
        for chain, span in zip(self.chains, self.spans, strict=True):
            self.weights[span] = chain.weights()

    def describe(self, vector: Array) -> str:
        """A motion in words."""
        if finger := self.moving_finger(vector):
            name, aside = finger
            return f"{name} {'swings sideways' if aside else 'bends in its plane'}"
        shift = vector[-6:-3]
        turn = vector[-3:]
        axis = int(np.argmax(np.abs(turn)))
        # 1e-6: rounding does not decide where a roll turns as much as it shifts
        if float(turn @ turn) < (1.0 - 1e-6) * float(shift @ shift):
            return f"shifts along {'xyz'[int(np.argmax(np.abs(shift)))]}"
        return "turns about the hand's axis" if axis == 2 else f"tilts about {'xy'[axis]}"


def curvature_radii(hand: RecomputedHand, contact: ObjectTouch) -> Array:
    """Radii of curvature (3, 3) of the object's surface at a contact [m], as a tensor of the tangent plane.

    At the border of a flat part the curved side counts: the object then rolls over the border.
    """
    normal = contact.normal
    first = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    axes = np.stack([first / np.linalg.norm(first), np.cross(normal, first) / np.linalg.norm(first)])
    step = BESIDE * hand.size
    # Beside the surface normals change with the place by 1 / (radius + distance), and differences are exact.
    at = contact.point + step * normal
    # The turns of the normal on both sides of an axis, in the tangent plane.
    away = np.concatenate([axes, -axes])
    turns = hand.surface.nearest(at + step * away).normal @ axes.T
    ahead = turns[:2]
    behind = -turns[2:]
    _, directions = np.linalg.eigh(0.5 * (ahead + behind) + 0.5 * (ahead + behind).T)
    axes = directions.T @ axes
    turns = (hand.surface.nearest(at + step * np.concatenate([axes, -axes])).normal) @ axes.T
    slopes = np.maximum(np.diag(turns[:2]), -np.diag(turns[2:]))
    # tan of the turn is step / (radius + step).
    radii = [max(step * math.sqrt(max(1.0 - s * s, 0.0)) / s - step, 0.0) if s > 0.0 else np.inf for s in slopes]
    return np.asarray(axes.T @ np.diag(np.minimum(radii, hand.size)) @ axes)
