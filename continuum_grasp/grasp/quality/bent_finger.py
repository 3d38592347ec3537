"""Small motions of a bent finger about its stored shape, on a mesh of its own, and how its contacts roll."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.grasp.certificate.drives import StoredFinger
from continuum_grasp.grasp.quality.contact_set import ContactSet
from continuum_grasp.grasp.shape import skin
from continuum_grasp.rod import DenseRod
from continuum_grasp.scene import FingerSetup

CELLS = 32
"""Least number of cells along a finger: the responses of shipped grasps are within 3e-5 of those with 128."""


class BentFinger(StoredFinger):
    """A finger in its stored shape; the n unknowns are changes of curvature [1/m], linear in each cell.

    They are continuous but at the middle contacts, where a couple of friction makes them jump. ``tip_turn`` (n,) is the
    change of the whole bend per unknown; a tendon's path changes by its offset at the base times ``tendon_path`` (n,),
    which weighs the bend with the offset along the finger. ``tendon_work`` (n,) is the work of a unit of tension,
    weighted with the share of the tension that gets past tendon friction.
    """

    def __init__(self, setup: FingerSetup, arrays: Mapping[str, Any], contacts: ContactSet) -> None:
        super().__init__(setup, arrays)
        self._contacts = contacts
        dry = self.dry
        self.touching = contacts.of(setup.name)  # the contacts of this finger
        self.length = float(self.shape.joints[-1])
        self.stiffness = setup.stiffness
        self._tip = setup.tip_name
        inner = [float(contacts.stations[k]) for k in self.touching if contacts.names[k] != self._tip]
        marks = [*inner, *(mass.at for mass in self.finger.masses)]
        marks += [] if dry is None else dry.edges[1:-1].tolist()
        self.rod = DenseRod(self.finger, self.shape.joints, 1.0 / CELLS, self.base, marks=marks)
        bent = self.shape.curvature(self.rod.nodes)
        self._angles = self.rod.edge_angle(bent)
        mesh = self.rod.mesh
        hats = self._hats(inner)
        self.size = hats.shape[1]  # n
        angle = self.rod.angle(bent)
        self._turns = mesh.to_edges(hats.T).T
        self._spins = mesh.forward @ hats
        self._tangents = np.stack([-np.sin(angle), np.cos(angle)], axis=1)
        # A turn of a section moves all beyond it along the normal: the derivative of the tangent by the angle.
        normals = -np.cos(angle), -np.sin(angle)
        self._shifts = np.stack([mesh.to_edges(normal * self._spins.T).T for normal in normals], axis=1)
        stiffness = mesh.weights * self.profile.bending_stiffness(mesh.nodes)
        self.bending = hats.T @ (stiffness[:, None] * hats)  # (n, n) [N m2 m]
        if dry is not None:
            # Branches that stick as the grasp is reached are springs on the turn of their cells.
            turns = np.diff(self._turns[[self.rod.edge_index(s) for s in dry.edges]], axis=0)
            self.bending += turns.T @ (dry.sticking[:, None] * turns)
        self._density = self.profile.linear_density(mesh.nodes)
        self.tip_turn = self._turns[-1]
        # A scene has one pair of tendons that run alike; the one that pulls more is that whose tension changes.
        (channel,) = self.finger.channels
        left, right = self.tensions
        shares = np.ones(mesh.panels)
        if self.friction is not None:
            arm = channel.arms[0 if left >= right else 1]
            middles = 0.5 * (self.rod.edges[1:] + self.rod.edges[:-1])
            shares = self.friction.shares(arm, middles)
        self.arm = abs(channel.arms[0])
        paths = mesh.to_edges(channel.shape(mesh.nodes) * hats.T).T
        self.tendon_path = paths[-1]
        self.tendon_work = channel.arms[0] * (shares @ np.diff(paths, axis=0))

    def section(self, contact: int) -> tuple[Array, Array, float, float]:
        """Changes of world position (2, n) and angle (n,) of the section at a contact per unknown; half the thickness
        there [m], and the curvature of the side or rounded tip, positive where convex, infinite at a sharp tip [1/m].
        """
        station = float(self._contacts.stations[contact])
        edge = self.rod.edge_index(station)
        thickness = skin(self.finger.profile.half_thickness)
        half = float(thickness(np.array(station)))
        lean = thickness.slope(station)
        bent = self._curvature(edge)
        if self._contacts.names[contact] == self._tip:
            skin_curvature = 1.0 / half if half > 0.0 else math.inf
        else:
            angle = self._angles[edge]
            inward = -np.array([math.cos(angle), math.sin(angle)])  # where positive curvature bends to
            towards = -bent if self._contacts.normals[contact] @ inward > 0.0 else bent
            # A parallel curve at distance h of one with curvature k has k / (1 - k h); sharper bends than 1 / h are
            # cusps. Where h changes by its slope, the normal leans: k / (cos(lean) - k h).
            skin_curvature = -towards / max(math.sqrt(1.0 - lean**2) - towards * half, 1e-9)
        return self._shifts[edge], self._turns[edge], half, skin_curvature

    def load_stiffness(self) -> Array:
        """Stiffness (n, n) that contact forces and weight, dead in the world, give the bent finger.

        Pulled along, it stiffens; pushed, it softens.
        """
        contacts = self._contacts
        mesh = self.rod.mesh
        gravity = np.asarray(self._contacts.scene.gravity[:2])
        beyond = (mesh.to_edges(self._density)[-1] - mesh.to_nodes(self._density))[:, None] * gravity
        forces = [(float(contacts.stations[k]), contacts.pushes[k]) for k in self.touching]
        forces += [(mass.at, mass.mass * gravity) for mass in self.finger.masses]
        # As for a column: the force beyond a section times half the square of its turn, along the tangent.
        for at, force in forces:
            beyond[mesh.nodes < at] += force
        along = np.einsum("gi,gi->g", beyond, self._tangents) * self.rod.weights
        return np.asarray(self._spins.T @ (along[:, None] * self._spins))

    def _hats(self, inner: Sequence[float]) -> Array:
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

    def _curvature(self, edge: int) -> float:
        """Curvature of the section at an edge [1/m], the mean of both sides where it jumps."""
        s = self.rod.edges[edge]
        sides = [self.shape.curvature(np.array(s), tip_side=side) for side in (False, True)]
        for k in np.flatnonzero(self.rod.joints[1:-1] == s):
            sides = [self.shape.curvatures[k, -1], self.shape.curvatures[k + 1, 0]]
        return float(np.mean(sides))


def rolled(object_curvature: float, other_curvature: float | None, size: float) -> tuple[float, float, float]:
    """Rolling without slip of a finger or support on an object of a size, surfaces having these curvatures [1/m],
    positive where convex, infinite at corners; none of a face that lies on another.

    Gives the way of the contact point along the surfaces per turn of one against the other [m], and the turns of the
    normal per turn of the finger's section and of the object. The point wanders by the relative turn over the sum of
    curvatures (D. J. Montana, 1988, doi:10.1177/027836498800700302); at a corner it stays, and the normal belongs
    to the other surface.
    """
    if other_curvature is None:
        return 0.0, 0.0, 0.0
    if math.isinf(other_curvature):
        return 0.0, 0.0, 1.0
    if math.isinf(object_curvature):
        return 0.0, 1.0, 0.0
    # 1e-3: least relative curvature of two surfaces that touch in a point, over the object's size: below it they count
    # as lying against each other and do not turn
    total = max(object_curvature + other_curvature, 1e-3 / size)
    share = object_curvature / total
    return 1.0 / total, share, 1.0 - share
