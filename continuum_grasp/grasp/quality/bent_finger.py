"""Small motions of a bent finger about its stored shape, on a mesh of its own, and how its contacts roll."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.quality.contact_set import ContactSet, object_part
from continuum_grasp.rod.dense_rod import DenseRod, curvature_profile
from continuum_grasp.scene.finger import Finger
from continuum_grasp.scene.grasp import GraspScene

Array = NDArray[Any]

CELLS = 32
"""Least number of cells along a finger: the responses of shipped grasps are within 3e-5 of those with 128."""
_NODES = 4
"""Gauss points per cell: exact for the stiffness, and to rounding for the motions of cells that bend by some 0.1
rad."""

CONFORMING = 1e-3
"""Least relative curvature of two surfaces that touch in a point, over the object's size: below it they count
as lying against each other and do not turn."""
_CORNER = 1e-6
"""Distance from a corner, as a part of the object's size, that counts as on it: the tolerance of stored contacts."""


@dataclass(frozen=True)
class Section:
    """A section of the finger and how it moves with the changes of curvature.

    Attributes
    ----------
    position : ndarray, shape (2,)
        World position of the backbone [m].
    angle : float
        World angle of the section's X axis [rad].
    curvature : float
        [1/m]
    shift : ndarray, shape (2, n)
        Change of position [m] per change of each unknown [1/m].
    turn : ndarray, shape (n,)
        Change of angle [rad].
    """

    position: Array
    angle: float
    curvature: float
    shift: Array
    turn: Array


class BentFinger:
    """A finger in its stored shape; the unknowns are changes of curvature, linear in each cell.

    They are continuous but at the middle contacts, where a couple of friction makes them jump.

    Parameters
    ----------
    finger : Finger
    arrays : mapping
        Of the finger: ``q``, ``lengths``, ``curvature_shapes``, ``tip_curvature``, ``base``.
    stations : sequence of float, optional
        Positions of contacts along the finger [m].

    Attributes
    ----------
    size : int
        Number n of unknowns.
    bending : ndarray, shape (n, n)
        Stiffness of the rod [N m2 m].
    tip_turn : ndarray, shape (n,)
        Change of the whole bend, by which a tendon's path changes, per offset [m].
    tendon_turn : ndarray, shape (n,)
        The same weighted with the share of the tension that gets past tendon friction.
    """

    def __init__(self, finger: Finger, arrays: Mapping[str, Any], stations: Sequence[float] = ()) -> None:
        self.finger = finger
        lengths = np.asarray(arrays["lengths"], dtype=float)
        q, tip = np.asarray(arrays["q"], dtype=float), float(arrays["tip_curvature"])
        self._profile = curvature_profile(arrays["curvature_shapes"], q, tip)
        self.length = float(lengths.sum())
        inner = [s for s in stations if 1e-9 < s / self.length < 1.0 - 1e-9]
        marks = [*inner, *(mass.at for mass in finger.masses)]
        self.rod = DenseRod(finger, lengths, 1.0 / CELLS, arrays["base"], marks=marks, nodes=_NODES)
        self.angles = self.rod.edge_angle(self._profile)
        self.points = self.rod.edge_points(self._profile)
        self._motions(self._unknowns(inner))

    def section(self, station: float) -> Section:
        """The section nearest to a position along the finger; contacts, joints and masses are met exactly."""
        edge = self.rod.edge_index(station)
        return Section(self.points[edge], self.angles[edge], self._curvature(edge), self.shifts[edge], self.turns[edge])

    def load_stiffness(self, loads: Sequence[tuple[float, Array]], gravity: Array | None = None) -> Array:
        """Stiffness (n, n) that dead forces give the bent finger: pulled along, it stiffens; pushed, it softens.

        Parameters
        ----------
        loads : sequence of (float, ndarray)
            Position along the finger [m], world force [N].
        gravity : ndarray, shape (2,), optional
            World gravity [m/s2], which acts on rod and masses.
        """
        s = self.rod.mesh.nodes
        beyond = np.zeros((s.size, 2))
        forces = list(loads)
        if gravity is not None:
            beyond += self.finger.rod.mass_per_length * (self.length - s)[:, None] * gravity
            forces += [(mass.at, mass.mass * gravity) for mass in self.finger.masses]
        for at, force in forces:
            beyond[s < at] += force
        along = np.einsum("gi,gi->g", beyond, self._tangents) * self.rod.weights
        return np.asarray(self._spins.T @ (along[:, None] * self._spins))

    def inertia(self) -> Array:
        """Mass matrix (n, n) of rod and point masses, in motions of the unknowns [kg m2 m2]."""
        share = np.zeros(self.rod.edges.size)
        share[:-1] += 0.5 * self.rod.mesh.widths
        share[1:] += 0.5 * self.rod.mesh.widths
        share *= self.finger.rod.mass_per_length
        for mass in self.finger.masses:
            share[self.rod.edge_index(mass.at)] += mass.mass
        return np.asarray(np.einsum("e,ein,eim->nm", share, self.shifts, self.shifts))

    def _unknowns(self, inner: Sequence[float]) -> Array:
        """Change of curvature (G, n) at the nodes by each unknown: hat functions, cut in two at inner contacts."""
        mesh = self.rod.mesh
        jumps = np.zeros(mesh.panels, dtype=int)
        jumps[[self.rod.edge_index(s) for s in inner]] = 1  # between the cell before and this one
        left = np.repeat(np.arange(mesh.panels) + np.cumsum(jumps), mesh.count)
        share = (mesh.nodes - np.repeat(mesh.edges[:-1], mesh.count)) / np.repeat(mesh.widths, mesh.count)
        hats = np.zeros((mesh.size, int(left[-1]) + 2))
        rows = np.arange(mesh.size)
        hats[rows, left], hats[rows, left + 1] = 1.0 - share, share
        return hats

    def _motions(self, hats: Array) -> None:
        """Turns and shifts of the sections per unknown, stiffness, and what the tendons feel."""
        mesh, angle = self.rod.mesh, self.rod.angle(self._profile)
        self.size = hats.shape[1]
        self.turns = mesh.to_edges(hats.T).T
        self._spins = mesh.forward @ hats
        self._tangents = np.stack([-np.sin(angle), np.cos(angle)], axis=1)
        normals = -np.cos(angle), -np.sin(angle)
        self.shifts = np.stack([mesh.to_edges(normal * self._spins.T).T for normal in normals], axis=1)
        self.bending = self.finger.rod.stiffness * (hats.T @ (mesh.weights[:, None] * hats))
        turned = np.abs(np.diff(self.angles))
        friction = 0.0 if self.finger.tendons is None else self.finger.tendons.friction
        shares = np.exp(-friction * (np.cumsum(turned) - 0.5 * turned))
        self.tip_turn = self.turns[-1]
        self.tendon_turn = shares @ np.diff(self.turns, axis=0)

    def _curvature(self, edge: int) -> float:
        """Of the section at an edge [1/m], the mean of both sides where it jumps."""
        s = self.rod.edges[edge]
        for k in np.flatnonzero(self.rod.joints[1:-1] == s):
            return float(0.5 * (self._profile[k, -1] + self._profile[k + 1, 0]))
        return float(self.rod.curvature(self._profile, s))


@dataclass(frozen=True)
class Rolling:
    """Rolling without slip of a finger or support on the object.

    Attributes
    ----------
    travel : float
        Way of the contact point along the surfaces per turn of one against the other, 1 / (sum of curvatures) [m].
    finger_share, object_share : float
        Turn of the normal per turn of the finger's section, and per turn of the object.
    """

    travel: float
    finger_share: float
    object_share: float

    @classmethod
    def of(cls, object_curvature: float, other_curvature: float, size: float) -> Rolling:
        """Rolling of two surfaces with these curvatures [1/m], positive where convex, infinite at corners."""
        if math.isinf(object_curvature) and math.isinf(other_curvature):
            return cls(0.0, 0.0, 1.0)
        if math.isinf(object_curvature):
            return cls(0.0, 1.0, 0.0)
        if math.isinf(other_curvature):
            return cls(0.0, 0.0, 1.0)
        total = max(object_curvature + other_curvature, CONFORMING / size)
        share = object_curvature / total
        return cls(1.0 / total, share, 1.0 - share)


def finger_rolling(
    scene: GraspScene, contacts: ContactSet, contact: int, section: Section, thickness: float, at_tip: bool
) -> Rolling:
    """Rolling of a finger's side or rounded tip on the object."""
    part, local = object_part(scene, contacts, contact)
    size = scene.object.size
    if at_tip:
        other = 1.0 / thickness if thickness > 0.0 else math.inf
    else:
        inward = -np.array([math.cos(section.angle), math.sin(section.angle)])  # where positive curvature bends to
        towards = -section.curvature if contacts.normals[contact] @ inward > 0.0 else section.curvature
        other = -towards / max(1.0 - towards * thickness, 1e-9)
    return Rolling.of(part.curvature((local[0], local[1]), _CORNER * size), other, size)


def support_rolling(scene: GraspScene, contacts: ContactSet, contact: int) -> Rolling:
    """Rolling of the object on a wall or peg; a flat face on a wall touches at two points and does not roll."""
    name, size = contacts.names[contact], scene.object.size
    part, local = object_part(scene, contacts, contact)
    for peg in scene.pegs:
        if peg.name == name:
            other = 1.0 / peg.radius if peg.radius > 0.0 else math.inf
            return Rolling.of(part.curvature((local[0], local[1]), _CORNER * size), other, size)
    for wall in scene.walls:
        if wall.name == name:
            offset = contacts.positions[contact] - np.asarray(wall.point)
            at_end = abs(float(np.hypot(*offset)) - wall.half_length) <= _CORNER * size
            return Rolling.of(part.curvature((local[0], local[1]), _CORNER * size), math.inf if at_end else 0.0, size)
    return Rolling(0.0, 0.0, 0.0)
