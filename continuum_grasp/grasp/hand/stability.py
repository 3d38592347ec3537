"""Second-order test of a hand's grasp: does every small motion in space that the contacts allow raise the energy?

The sections of a finger turn by exp(psi(s)), the object shifts by u and turns by exp(phi). To second order (Kirchhoff
rod; the moment M in a section and the force F beyond it are those of the contacts and of the weight)

    2 E = int psi' . K psi' - M . (psi x psi') - F . (psi x (psi x t)) ds
          + sum h f . (psi x (psi x n)) + f . (phi x (phi x a))

with K = E I z z^T + E I_l across across^T + G J t t^T, f the force on the finger, n the object's normal and a the arm
from the center of mass to the point of contact, on the motions that leave the points that touch together:

    int psi x t ds - psi x h n = u + phi x a

At palm and table, with reaction N against n and the radii of curvature rho of the surface, the object rolls:

    u + phi x a = 0,  2 E += N (phi x n) . rho (phi x n)
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.grasp.certificate.check import EXACT
from continuum_grasp.grasp.hand.recomputed import HandTouch, ObjectTouch, RecomputedHand, SpatialFinger

LINKS = 24
"""Links per finger: least eigenvalues of six grasps by three tips are then within 0.2 % of those with 96, and the load
at which a straight finger buckles to the side within 0.2 % of Prandtl's; errors fall with the square of the number."""
UNIT = 0.25
"""Shift of the object, per length of the first finger, that counts as much as a turn by 1 rad [1]."""
SMOOTH = 12.0
"""Part of ``length * int |psi'|^2 ds`` that counts as much as the square of a turn of the object: hinges of a chain of
12 links by their squares, whatever the number of links is."""
CREEPS = 0.2
"""Least eigenvalue in units of E I / L of the first finger above which a grasp is stable. Of 16 random grasps simulated
by MuJoCo, for which it is 0.01 N m, those between 0 and it crept by up to 1 mm and 1.7 degrees within 2 s, the 8 above
it moved by 0.14 mm at most, and those below 0 turned away."""
SWINGS = 0.1
"""Part of the least mode that is the object's, below which a finger moves and the object hardly does."""
BESIDE = 1e-3
"""Distance from a contact, per size of the object, at which the surface's normals give its curvature [1]."""
ASSUMPTIONS = (
    "constant tensions; contacts that press stick as pins, those of fingers without rolling; others are left out; "
    "bases are fixed; tendons do not stiffen the fingers against twist"
)


@dataclass(frozen=True)
class HandStability:
    """Verdict of `hand_stability`."""

    # Least one of the reduced Hessian in units of E I / L of the first finger, and in N m with shifts of the object per
    # 30 mm and turns in radians; infinite where no motion is left.
    eigenvalue: float
    stiffness: float
    motion: str  # how what is least stable moves, in words; empty where nothing can
    # Of the object in that motion: shift per quarter of the first finger, turn about the center of mass.
    mode: Array = field(default_factory=lambda: np.zeros(6), compare=False)
    assumptions: str = ASSUMPTIONS

    @property
    def stable(self) -> bool:
        """Whether the least eigenvalue is above the margin below which grasps creep."""
        return bool(self.eigenvalue > CREEPS)

    @property
    def word(self) -> str:
        """Verdict in one word."""
        return "stable" if self.stable else "creeps" if self.eigenvalue > 0.0 else "unstable"

    def __str__(self) -> str:
        least = f"{self.word} ({self.eigenvalue:.3g} E I / L; {CREEPS:g} needed)"
        return f"{least}: {self.motion}" if self.motion else least


@dataclass(frozen=True)
class HandResponse:
    """Motion and contact forces, to first order, under a wrench on the object at constant tensions: force along x, y, z
    and moment about the center of mass. Contacts are those that press.
    """

    pose: Array  # (6, 6) shift [m] and turn [rad] of the object per wrench
    forces: Array  # (C, 3, 6) change of the contact forces on the fingers per wrench
    pose_by_tension: Array  # (6, T) shift and turn of the object per tension, of all tendons by finger
    forces_by_tension: Array  # (C, 3, T) change of the contact forces per tension
    pose_by_gravity: Array  # (6, 3) shift and turn of the object per gravity along x, y, z, of fingers too
    forces_by_gravity: Array  # (C, 3, 3) change of the contact forces per gravity
    places: tuple[Array, ...]  # of each finger: nodes of its displaced backbone (N + 1, 3) [m]
    places_by_tension: tuple[Array, ...]  # (N + 1, 3, T) their displacement per tension


def hand_stability(hand: RecomputedHand, links: int = LINKS) -> HandStability:
    """Least eigenvalue of the energy's Hessian on the motions that the contacts leave."""
    system = HandSystem(hand, links)
    unit = hand.fingers[0].plane.stiffness / hand.fingers[0].length
    if not (np.isfinite(system.hessian).all() and np.isfinite(system.rows).all()):
        return HandStability(float("nan"), float("nan"), "")
    held = held_directions(system.rows)
    if held.shape[1] == len(system.hessian):
        return HandStability(float("inf"), float("inf"), "")
    # In the directions that are held, an eigenvalue that is not the least.
    reduced = system.hessian - held @ (held.T @ system.hessian)
    reduced -= (reduced @ held) @ held.T
    reduced += np.abs(reduced).sum(axis=1).max() * (held @ held.T)
    values, vectors = np.linalg.eigh(0.5 * (reduced + reduced.T))
    least, vector = float(values[0]), vectors[:, 0]
    return HandStability(least / unit, least, system.describe(vector), vector[-6:])


def hand_response(hand: RecomputedHand, links: int = LINKS) -> HandResponse | None:
    """Response of a grasp to wrenches on the object and to tensions, at its equilibrium; None where nothing holds
    the object.
    """
    if not hand.pressing:
        return None
    system = HandSystem(hand, links)
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
    moved, forces = scale[:, None] * moved, forces.reshape(len(rows) // 3, 3, -1)
    pose = moved[-6:]
    shapes = [chain.displaced(moved[span, 9:]) for chain, span in zip(system.chains, system.spans, strict=True)]
    points = tuple(chain.points for chain in system.chains)
    wrench, gravity, tension = slice(6), slice(6, 9), slice(9, None)
    return HandResponse(
        pose[:, wrench],
        forces[..., wrench],
        pose[:, tension],
        forces[..., tension],
        pose[:, gravity],
        forces[..., gravity],
        points,
        tuple(shapes),
    )


def held_directions(rows: Array) -> Array:
    """Orthonormal directions (n, m) in which constraints hold motions; those that are dependent count once."""
    if not len(rows):
        return np.zeros((rows.shape[1], 0))
    _, singular, directions = np.linalg.svd(rows, full_matrices=False)
    return np.asarray(directions[singular > EXACT * singular[0]].T)


class HandSystem:
    """Hessian and constraints in scaled coordinates: turns of all fingers' links, shift and turn of the object."""

    def __init__(self, hand: RecomputedHand, links: int) -> None:
        self.chains = [FingerChain(finger, hand.gravity, links) for finger in hand.fingers]
        ends = np.cumsum([0, *(chain.size for chain in self.chains)])
        self.spans = [slice(int(a), int(b)) for a, b in pairwise(ends)]
        size = int(ends[-1]) + 6
        self.scale = np.concatenate(
            [*(chain.scale for chain in self.chains), [UNIT * hand.fingers[0].length] * 3, [1.0] * 3]
        )
        self.hessian = np.zeros((size, size))
        tendons, rows = [], [np.zeros((0, size))]
        for finger, chain, span in zip(hand.fingers, self.chains, self.spans, strict=True):
            self.hessian[span, span] = chain.hessian()
            for arm in (arm for channel in finger.plane.finger.channels for arm in channel.arms):
                tendons.append(np.zeros(size))
                tendons[-1][span] = arm * chain.turns_in_plane()
        for contact in hand.pressing:
            place, row = contact.point - hand.com, np.zeros((3, size))
            if isinstance(contact, HandTouch):
                k = next(k for k, finger in enumerate(hand.fingers) if contact in finger.contacts)
                row[:, self.spans[k]] = self.chains[k].motion(contact)
            else:
                across = skew(contact.normal)
                radii = curvature_radii(hand, contact)
                self.hessian[-3:, -3:] += contact.normal_force * across.T @ radii @ across
            row[:, -6:-3], row[:, -3:] = -np.eye(3), skew(place)
            rows.append(row)
            self.hessian[-3:, -3:] += twice_turned(contact.load, place)
        self.rows = np.concatenate(rows) * self.scale
        self.hessian = self.hessian * np.outer(self.scale, self.scale)
        self.tendons = np.array(tendons).reshape(-1, size).T
        # Per gravity along x, y and z, about the center of mass of the object.
        self.weights = np.zeros((size, 3))
        self.weights[-6:-3] = hand.scene.object.weighed * np.eye(3)
        for chain, span in zip(self.chains, self.spans, strict=True):
            self.weights[span] = chain.weights()

    def describe(self, vector: Array) -> str:
        """A motion in words."""
        shift, turn = vector[-6:-3], vector[-3:]
        if float(vector[-6:] @ vector[-6:]) < SWINGS:
            shares = [float(vector[span] @ vector[span]) for span in self.spans]
            k = int(np.argmax(shares))
            chain, part = self.chains[k], vector[self.spans[k]]
            bends = (part.reshape(-1, 3) * chain.frames[:, :, 2]).sum(axis=1)
            aside = float(bends @ bends) < 0.5 * shares[k]
            return f"{chain.finger.name} {'swings sideways' if aside else 'bends in its plane'}"
        axis = int(np.argmax(np.abs(turn)))
        if float(turn @ turn) < float(shift @ shift):
            return f"shifts along {'xyz'[int(np.argmax(np.abs(shift)))]}"
        return "turns about the hand's axis" if axis == 2 else f"tilts about {'xy'[axis]}"


def curvature_radii(hand: RecomputedHand, contact: ObjectTouch) -> Array:
    """Radii of curvature (3, 3) of the object's surface at a contact [m], as a tensor of the tangent plane.

    At the border of a flat part, that of the side which curves: the object then rolls over the border.
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
    ahead, behind = turns[:2], -turns[2:]
    _, directions = np.linalg.eigh(0.5 * (ahead + behind) + 0.5 * (ahead + behind).T)
    axes = directions.T @ axes
    turns = (hand.surface.nearest(at + step * np.concatenate([axes, -axes])).normal) @ axes.T
    slopes = np.maximum(np.diag(turns[:2]), -np.diag(turns[2:]))
    # tan of the turn is step / (radius + step).
    radii = [max(step * math.sqrt(max(1.0 - s * s, 0.0)) / s - step, 0.0) if s > 0.0 else np.inf for s in slopes]
    return np.asarray(axes.T @ np.diag(np.minimum(radii, hand.size)) @ axes)


class FingerChain:
    """A finger by the turns psi of its sections at nodes, linear between; coordinates are turns from node to node.

    Contacts are at nodes. Geometry is that of the displaced finger, as the hand sees it.
    """

    def __init__(self, finger: SpatialFinger, gravity: Array, links: int) -> None:
        self.finger, self.gravity = finger, gravity
        plane, rod = finger.plane, finger.plane.rod
        marks = np.unique(rod.joints[[0, *(contact.joint for contact in finger.contacts), plane.lengths.size]])
        counts = np.maximum(2, np.round(links * np.diff(marks) / marks[-1])).astype(int)
        pieces = [np.linspace(a, b, n + 1)[:-1] for a, b, n in zip(marks, marks[1:], counts, strict=False)]
        self.edges = np.concatenate([*pieces, marks[-1:]])
        self.ds = np.diff(self.edges)
        self.middles = 0.5 * (self.edges[1:] + self.edges[:-1])
        self.size = 3 * self.ds.size
        # Every coordinate turns everything beyond its link: what counts is its part of L int |psi'|^2 ds.
        self.scale = np.repeat(np.sqrt(SMOOTH * self.ds / finger.length), 3)
        self.points, _ = self._at(self.edges)
        self.center, self.frames = self._at(self.middles)
        self.chords = np.diff(self.points, axis=0) / self.ds[:, None]

    def _at(self, s: Array) -> tuple[Array, Array]:
        """Displaced points (K, 3) and frames (K, 3, 3): columns t, across and z."""
        finger = self.finger
        points, angle = finger.plane.rod.at(finger.plane.curvature, s)
        shift, x, y = (np.interp(s, finger.plane.rod.edges, v) for v in (finger.deflections, *finger.turns.T))
        zero = np.zeros(s.size)
        frames = np.stack([
            np.stack([-np.sin(angle), np.cos(angle), zero], axis=1),
            np.stack([-np.cos(angle), -np.sin(angle), zero], axis=1),
            np.broadcast_to([0.0, 0.0, 1.0], (s.size, 3)),
        ], axis=2)  # fmt: skip
        psi = np.stack([skew(np.array([a, b, 0.0])) for a, b in zip(x, y, strict=True)])
        turned = frames + psi @ frames + 0.5 * psi @ psi @ frames
        return finger.frame.world(np.column_stack([points, shift])), finger.frame.axes @ turned

    def _beyond(self) -> tuple[Array, Array]:
        """Force and moment (N, 3) of what is beyond the middle of each link [N, N m]."""
        plane, force, moment = self.finger.plane, np.zeros(self.center.shape), np.zeros(self.center.shape)

        def add(load: Array, place: Array, couple: Array | float, at: float) -> None:
            there = (self.middles < at)[:, None]
            force[:] += np.where(there, load, 0.0)
            moment[:] += np.where(there, couple + np.cross(place - self.center, load), 0.0)

        for contact in self.finger.contacts:
            couple = -contact.radius * np.cross(contact.normal, contact.load)
            add(contact.load, contact.center, couple, contact.station)
        if self.gravity.any():
            density = plane.profile.linear_density(self.middles)
            for k, mass in enumerate(density * self.ds):  # of the link itself the half beyond its middle, lumped there
                add(mass * self.gravity, self.center[k], 0.0, self.middles[k])
                force[k] += 0.5 * mass * self.gravity
            for body in plane.finger.masses:
                place, _ = self._at(np.array([body.at]))
                add(body.mass * self.gravity, place[0], 0.0, body.at)
        return force, moment

    def hessian(self) -> Array:
        """Hessian (3 N, 3 N) of bending, twist, weight and contact forces, in the turns from node to node."""
        finger, count = self.finger, self.ds.size
        stiffness = np.array([finger.torsion, finger.lateral, finger.plane.stiffness])
        spatial = np.einsum("kia,a,kja->kij", self.frames, stiffness, self.frames)
        force, moment = self._beyond()
        pulls = [twice_turned(-f, t) * d for f, t, d in zip(force, self.chords, self.ds, strict=True)]
        # In the turns at nodes 0 to N, of which the first does not turn.
        nodal = np.zeros((count + 1, 3, count + 1, 3))
        for k in range(count):
            nodal[k, :, k] += pulls[k] / 3.0
            nodal[k + 1, :, k + 1] += pulls[k] / 3.0
            # -M . (psi x psi') along a link is -M . (one end x the other).
            side = pulls[k] / 6.0 + 0.5 * skew(moment[k])
            nodal[k, :, k + 1] += side
            nodal[k + 1, :, k] += side.T
        for contact in finger.contacts:
            node = self.node(contact)
            nodal[node, :, node] += twice_turned(contact.radius * contact.load, contact.normal)
        nodal = nodal[1:, :, 1:]
        # Turns are sums of those from node to node.
        hinges = np.cumsum(np.cumsum(nodal[::-1, :, ::-1], axis=0), axis=2)[::-1, :, ::-1]
        for k in range(count):
            hinges[k, :, k] += spatial[k] / self.ds[k]
        return np.asarray(hinges.reshape(self.size, self.size))

    def node(self, contact: HandTouch) -> int:
        """Index of the node at a contact."""
        return int(np.argmin(np.abs(self.edges - contact.station)))

    def motion(self, contact: HandTouch) -> Array:
        """Motion (3, 3 N) of the point of the skin that touches, by the turns from node to node."""
        # What turns from a node on: the chord from the middle of its link, and the arm of the skin.
        arm = contact.center - contact.radius * contact.normal - 0.5 * (self.points[1:] + self.points[:-1])
        arm[self.node(contact) :] = 0.0
        return np.concatenate([-skew(away) for away in arm], axis=1)

    def displaced(self, turns: Array) -> Array:
        """Displacements (N + 1, 3, T) of the nodes by turns from node to node (3 N, T)."""
        nodal = np.concatenate(
            [np.zeros((1, 3, turns.shape[1])), np.cumsum(turns.reshape(-1, 3, turns.shape[1]), axis=0)]
        )
        middles = 0.5 * (nodal[1:] + nodal[:-1])
        steps = np.cross(middles, (self.chords * self.ds[:, None])[:, :, None], axis=1)
        return np.concatenate([nodal[:1], np.cumsum(steps, axis=0)])

    def weights(self) -> Array:
        """Generalized forces (3 N, 3) of the weight per gravity along x, y and z, of links at their middles."""
        plane, mids = self.finger.plane, 0.5 * (self.points[1:] + self.points[:-1])
        loads = np.zeros((len(mids), 3, 3))
        for k, mass in enumerate(plane.profile.linear_density(self.middles) * self.ds):
            for j in range(k):
                loads[j] += mass * skew(self.center[k] - mids[j])
        return loads.reshape(-1, 3)

    def turns_in_plane(self) -> Array:
        """Turn of the tip within the plane of bending (3 N,), by which a tendon of constant offset shortens."""
        return self.frames[:, :, 2].ravel()


def skew(vector: Array) -> Array:
    """Matrix of the cross product with a vector from the left."""
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def twice_turned(force: Array, arm: Array) -> Array:
    """Matrix of ``force . (psi x (psi x arm))`` as a quadratic form of psi."""
    outer = np.outer(force, arm)
    return np.asarray(0.5 * (outer + outer.T) - float(force @ arm) * np.eye(3))
