"""A finger in space as a chain: what small turns of its sections do to the energy.

Sections turn by exp(psi(s)). To second order (Kirchhoff rod; the moment M in a section and the force F beyond it are
come from the contacts and the weight)

    2 E = int psi' . K psi' - M . (psi x psi') - F . (psi x (psi x t)) ds + sum h f . (psi x (psi x n))

with K = E I z z^T + E I_l across across^T + G J t t^T, f the force on the finger and n the object's normal.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.grasp.certificate.recomputed import RecomputedFinger

LINKS = 24
"""Links per finger: least eigenvalues of six grasps by three tips are then within 0.2 % of those with 96, and the load
at which a straight finger buckles to the side within 0.2 % of Prandtl's; errors fall with the square of the number."""
SMOOTH = 12.0
"""Part of ``length * int |psi'|^2 ds`` that counts as much as the square of a turn of the object: hinges of a chain of
12 links by their squares, whatever the number of links is."""


class ChainTouch(Protocol):
    """A contact of a finger in space."""

    joint: int
    station: float
    radius: float
    load: Array  # force on the finger (3,) [N]
    moment: float  # on the finger about the normal [N m]
    normal: Array  # outward normal of the object (3,)
    point: Array  # where the object's surface is touched (3,) [m]
    center: Array  # of the finger's section (3,) [m]


class ChainFrame(Protocol):
    """The plane of a finger."""

    @property
    def axes(self) -> Array:
        """Axes x, y and normal as columns (3, 3)."""
        ...

    def world(self, points: Array) -> Array:
        """Points (..., 3) of the plane's frame in space [m]."""
        ...


class ChainFinger(Protocol):
    """A finger in space: within its plane, and how it is displaced along the normal of that."""

    name: str
    length: float
    plane: RecomputedFinger
    lateral: float  # stiffness to the side and in torsion, by the scale of that in the plane [N m2]
    torsion: float
    # Arrays at the ends of panels: displacement along the normal (P + 1,) [m], and turns in the plane (P + 1, 2).
    deflections: Any
    turns: Any

    @property
    def frame(self) -> ChainFrame:
        """The plane."""
        ...

    @property
    def contacts(self) -> Sequence[ChainTouch]:
        """Contacts along it."""
        ...


class FingerChain:
    """A finger by the turns psi of its sections at nodes, linear between; coordinates are turns from node to node.

    Contacts are at nodes. Geometry belongs to the displaced finger, as the hand sees it.
    """

    def __init__(self, finger: ChainFinger, gravity: Array, links: int) -> None:
        self.finger, self.gravity = finger, gravity
        plane = finger.plane
        rod = finger.plane.rod
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
        # Moment per turn in the plane of each link [N m].
        mesh = rod.mesh
        curve = plane.profile.bending_stiffness
        self._give = (
            1.0 / curve(mesh.nodes) if curve.constant is None else np.full(mesh.nodes.size, 1.0 / curve.constant)
        )
        uniform = curve.constant is not None
        self.springs = curve.constant / self.ds if uniform else 1.0 / np.diff(mesh.integrate(self._give, self.edges))

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
        """Force and moment (N, 3) of everything beyond the middle of each link [N, N m]."""
        plane = self.finger.plane
        force = np.zeros(self.center.shape)
        moment = np.zeros(self.center.shape)

        def add(load: Array, place: Array, couple: Array | float, at: float) -> None:
            there = (self.middles < at)[:, None]
            force[:] += np.where(there, load, 0.0)
            moment[:] += np.where(there, couple + np.cross(place - self.center, load), 0.0)

        for contact in self.finger.contacts:
            couple = contact.moment * contact.normal - contact.radius * np.cross(contact.normal, contact.load)
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
        finger = self.finger
        count = self.ds.size
        shares = np.array([finger.torsion, finger.lateral, finger.plane.stiffness]) / finger.plane.stiffness
        spatial = np.einsum("k,kia,a,kja->kij", self.springs, self.frames, shares, self.frames)
        force, moment = self._beyond()
        pulls = [twice_turned(-f, t) * d for f, t, d in zip(force, self.chords, self.ds, strict=True)]
        # In the turns at nodes 0 to N; node 0 does not turn.
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
            hinges[k, :, k] += spatial[k]
        return np.asarray(hinges.reshape(self.size, self.size)) + self._locked_tendons()

    def _locked_tendons(self) -> Array | float:
        """Hessian of tendons whose drives hold their position: springs on the path that a motion draws in."""
        plane = self.finger.plane
        if plane.wound is None or not plane.wound.law.locks:
            return 0.0
        (channel,), matrix = plane.finger.channels, np.zeros((self.size, self.size))
        path = self._path(channel)
        for arm, spring in zip(channel.arms, plane.wound.springs, strict=True):
            # Of which friction passes on a share; a motion's work counts, so the symmetric part.
            passed = path if plane.friction is None else path * plane.friction.shares(arm, self.middles)
            draws, pulls = ((along[:, None] * self.frames[:, :, 2]).ravel() for along in (path, passed))
            work = arm**2 * spring * np.outer(pulls, draws)
            matrix += 0.5 * (work + work.T)
        return matrix

    def node(self, contact: ChainTouch) -> int:
        """Index of the node at a contact."""
        return int(np.argmin(np.abs(self.edges - contact.station)))

    def turn(self, contact: ChainTouch, axis: Array) -> Array:
        """Turn (3 N,) about an axis of the section that touches, by the turns from node to node."""
        beyond = np.arange(self.ds.size) < self.node(contact)
        return np.outer(beyond, axis).ravel()

    def motion(self, contact: ChainTouch) -> Array:
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
        plane = self.finger.plane
        mids = 0.5 * (self.points[1:] + self.points[:-1])
        loads = np.zeros((len(mids), 3, 3))
        carried = list(
            zip(self.middles, self.center, plane.profile.linear_density(self.middles) * self.ds, strict=True)
        )
        carried += [(body.at, self._at(np.array([body.at]))[0][0], body.mass) for body in plane.finger.masses]
        for at, place, mass in carried:
            for j in np.flatnonzero(self.middles < at):
                loads[j] += mass * skew(place - mids[j])
        return loads.reshape(-1, 3)

    def pulled(self, channel: Any, arm: float) -> Array:
        """Generalized force of a tendon's tension at the drive (3 N,) [m], of which friction passes on a share."""
        friction = self.finger.plane.friction
        path = arm * self._path(channel)
        passed = path if friction is None else path * friction.shares(arm, self.middles)
        return (passed[:, None] * self.frames[:, :, 2]).ravel()

    def _path(self, channel: Any) -> Array:
        """Mean arm of a tendon on each link, weighted by how a moment bends the finger there."""
        if channel.shape.constant is not None:
            return np.full(self.ds.size, channel.shape.constant)
        mesh = self.finger.plane.rod.mesh
        return np.asarray(self.springs * np.diff(mesh.integrate(self._give * channel.shape(mesh.nodes), self.edges)))


def skew(vector: Array) -> Array:
    """Matrix of the cross product with a vector from the left."""
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def twice_turned(force: Array, arm: Array) -> Array:
    """Matrix of ``force . (psi x (psi x arm))`` as a quadratic form of psi."""
    outer = np.outer(force, arm)
    return np.asarray(0.5 * (outer + outer.T) - float(force @ arm) * np.eye(3))
