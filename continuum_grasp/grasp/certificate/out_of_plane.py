"""Second-order test of a planar grasp against motions out of its plane: the one of `space`, of fingers in one plane.

The object is a prism, and so are walls and pegs: they touch along lines, which keep the object from tilting and, where
there is friction, from turning about the normal of the surface and from sliding along the line. Motions within the
plane and out of it are coupled by forces out of it alone; the former follow the latter, as far as they are stable: with
the Hessian H of both on the motions that the contacts leave, o out of the plane and i within,

    S = H_oo - H_oi H_ii^-1 H_io

Within the plane tips and supports roll on the object as in `stability`: with the radii h and rho of both, N the normal
force and phi, psi the turns of section and object, 2 E += N h rho / (h + rho) (phi - psi)^2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.grasp.certificate.chain import LINKS
from continuum_grasp.grasp.certificate.check import EXACT
from continuum_grasp.grasp.certificate.recomputed import RecomputedContact, RecomputedFinger, RecomputedGrasp
from continuum_grasp.grasp.certificate.rolling import rolling_radius, surface_radius
from continuum_grasp.grasp.certificate.space import SpatialStability, SpatialSystem, held_directions, least_mode

ASSUMPTIONS = (
    "contacts of fingers that press stick as points, others are left out; the object and its supports are prisms, "
    "which touch along lines; fingers lie in the plane even where they bear weight out of it; bases are fixed; tendons "
    "do not stiffen the fingers against twist"
)
Z = np.array([0.0, 0.0, 1.0])


class _Plane:
    """The plane of all fingers, the world's plane."""

    axes = np.eye(3)

    def world(self, points: Array) -> Array:
        """Points as they are."""
        return points


@dataclass
class FlatTouch:
    """A contact of a finger in the plane, with the force out of it."""

    joint: int
    station: float
    radius: float
    load: Array
    normal: Array
    point: Array
    center: Array
    moment: float = 0.0


class FlatFinger:
    """A planar finger in space."""

    def __init__(self, plane: RecomputedFinger) -> None:
        section = plane.finger.section
        if section is None:
            raise ValueError(f"{plane.name} has no section")
        self.plane = plane
        self.name = plane.name
        self.length = plane.length
        self.frame = _Plane()
        self.lateral = plane.stiffness * section.lateral
        self.torsion = plane.stiffness * section.torsion
        self.deflections = np.zeros(plane.rod.edges.size)
        self.turns = np.zeros((plane.rod.edges.size, 2))
        self.touches = {c.name: self._touch(c) for c in plane.contacts}

    @property
    def contacts(self) -> list[FlatTouch]:
        """Contacts along it."""
        return list(self.touches.values())

    def _touch(self, contact: RecomputedContact) -> FlatTouch:
        plane = self.plane
        at = self.plane.joint_position(contact.joint)
        center = plane.points[plane.joint_edges[contact.joint]]
        return FlatTouch(
            contact.joint, at, contact.radius, load_of(contact), flat(contact.normal), flat(contact.point), flat(center)
        )


def flat(vector: Array) -> Array:
    """A vector of the plane in space."""
    return np.array([*vector, 0.0])


def load_of(contact: RecomputedContact) -> Array:
    """Force on what touches the object (3,) [N]."""
    return np.array([*contact.force, -contact.lift])


def stability_out_of_plane(grasp: RecomputedGrasp, links: int = LINKS) -> SpatialStability | None:
    """Least eigenvalue of motions out of the plane; None where the section of a finger is not given."""
    if any(finger.finger.section is None for finger in grasp.fingers):
        return None
    system = FlatSystem(grasp, links)
    unit = grasp.fingers[0].stiffness / grasp.fingers[0].length
    if not (np.isfinite(system.hessian).all() and np.isfinite(system.rows).all()):
        return SpatialStability(float("nan"), float("nan"), assumptions=ASSUMPTIONS)
    found = system.least()
    if found is None:
        return SpatialStability(float("inf"), float("inf"), assumptions=ASSUMPTIONS)
    least, vector = found
    sinks = system.sinks(grasp.scene.object.mass) if least > 0.0 and grasp.scene.spatial else 0.0
    return SpatialStability(least / unit, least, system.describe(vector), vector[-6:], ASSUMPTIONS, sinks)


class FlatSystem(SpatialSystem):
    """The system of a planar grasp."""

    def __init__(self, grasp: RecomputedGrasp, links: int) -> None:
        fingers = [FlatFinger(finger) for finger in grasp.fingers]
        self.gravity = np.array(grasp.scene.gravity)
        super().__init__(fingers, self.gravity, flat(grasp.object.com), links)
        turn = np.eye(self.size)[-3:]  # of the object
        rows = [turn[:2]] if grasp.scene.upright else []  # something else bears what tilts it
        for contact in grasp.contacts:
            if not contact.normal_force > EXACT * grasp.force_scale:
                continue
            roll = turn[2]
            radius = rolling_radius(contact.radius, surface_radius(grasp, contact))
            if contact.finger is not None:
                k = grasp.fingers.index(contact.finger)
                touch = fingers[k].touches[contact.name]
                row = self.pinned(touch, k)
                roll = -turn[2]
                roll[self.spans[k]] = self.chains[k].turn(touch, Z)
                radius = 0.0 if contact.kind == "middle" else radius
            else:
                row = self.supported(flat(contact.point), load_of(contact))
                normal = flat(contact.normal)
                rows.append((np.cross(Z, normal) @ turn)[None])
                if contact.friction > 0.0:
                    rows.append((normal @ turn)[None])
                if np.isinf(radius):  # a flat face on a wall
                    rows.append(turn[2:])
                    radius = 0.0
            rows.append(row if contact.friction > 0.0 else row[:2])
            self.hessian += contact.normal_force * radius * np.outer(roll, roll)
        self.take(rows)
        aside = np.ones(self.size, dtype=bool)
        aside[2:-6:3] = False  # turns of sections about the normal
        aside[[-6, -5, -1]] = False
        self.aside = aside

    def least(self) -> tuple[float, Array] | None:
        """Least eigenvalue of motions out of the plane [N m] and its mode; None where there are none."""
        free = self._free(self.aside)
        if not free.shape[1]:
            return None
        stiff = self._stiffness(free)
        if stiff is None:  # which `stability` finds, too
            return least_mode(self.hessian, held_directions(self.rows))
        values, vectors = np.linalg.eigh(stiff)
        return float(values[0]), free @ vectors[:, 0]

    def sinks(self, mass: float) -> float:
        """Displacement of an object of some mass out of the plane by its weight and the fingers' weight [m]."""
        free = self._free(self.aside)
        stiff = self._stiffness(free)
        weight = np.zeros(self.size)
        if stiff is None or not free.shape[1]:
            return float("nan")
        weight[-4] = mass * self.gravity[2]
        for chain, span in zip(self.chains, self.spans, strict=True):
            weight[span] = chain.weights() @ self.gravity
        moved = free @ np.linalg.solve(stiff, free.T @ (self.scale * weight))
        return abs(float(self.scale[-4] * moved[-4]))

    def _stiffness(self, free: Array) -> Array | None:
        """Stiffness (m, m) of motions out of the plane (n, m), which those within it follow; None where these fail."""
        within = self._free(~self.aside)
        stiff = free.T @ self.hessian @ free
        coupled = within.T @ self.hessian @ free
        if coupled.any():
            inner = within.T @ self.hessian @ within
            if float(np.linalg.eigvalsh(inner)[0]) <= 0.0:
                return None
            stiff = stiff - coupled.T @ np.linalg.solve(inner, coupled)
        return np.asarray(0.5 * (stiff + stiff.T))

    def _free(self, among: Array) -> Array:
        """Orthonormal motions (n, m) among some coordinates that the contacts leave."""
        motions = np.eye(self.size)[:, among]
        rows = self.rows[:, among]
        held = held_directions(rows[np.abs(rows).max(axis=1, initial=0.0) > 0.0])
        left = np.linalg.svd(held, full_matrices=True)[0][:, held.shape[1] :]
        return np.asarray(motions @ left)

    def describe(self, vector: Array) -> str:
        """A motion in words."""
        if finger := self.moving_finger(vector):
            name, aside = finger
            return f"{name} {'leans out of the plane' if aside else 'bends in the plane'}"
        shift = vector[-6:-3] ** 2
        turn = vector[-3:] ** 2
        line = round(np.degrees(np.arctan2(vector[-2], vector[-3]))) % 180
        words = {
            f"tilts out of the plane about a line at {line} degrees from x": float(turn[:2].sum()),
            "shifts out of the plane": float(shift[2]),
            "turns in the plane": float(turn[2]),
            "shifts in the plane": float(shift[:2].sum()),
        }
        return max(words, key=words.__getitem__)
