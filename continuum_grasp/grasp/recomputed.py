"""Everything about a grasp that follows from its stored numbers, computed anew by numpy alone."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.dense_rod import DenseRod
from continuum_grasp.scene.grasp import GraspScene, PlanarGravity

__all__ = ["RecomputedGrasp", "across"]

Array = NDArray[Any]


class RecomputedGrasp:
    """Shape, normals, forces and potential of a grasp from its stored numbers.

    Parameters
    ----------
    scene : GraspScene
    arrays : mapping
        See `continuum_grasp.grasp.certify`.
    """

    def __init__(self, scene: GraspScene, arrays: Mapping[str, Any]) -> None:
        self.scene = scene
        self.finger = scene.finger
        self.family = str(arrays["family"])
        self.q = np.asarray(arrays["q"], dtype=float)
        self.lengths = np.asarray(arrays["lengths"], dtype=float)
        self.tip_curvature = float(arrays["tip_curvature"])
        self.tensions = np.asarray(arrays["tensions"], dtype=float)
        self.names = [str(name) for name in arrays["contact_names"]]
        self.stored_positions = np.asarray(arrays["contact_positions"], dtype=float)
        self.stored_normals = np.asarray(arrays["contact_normals"], dtype=float)
        self.forces = np.asarray(arrays["contact_forces"], dtype=float)
        self.stored_backbone = np.asarray(arrays["backbone"], dtype=float)
        self.total = self.finger.rod.length
        bending = self.finger.rod.stiffness / self.total**2
        self.force_scale = max(float(np.abs(self.forces).max(initial=0.0)), 9.81 * scene.object.mass, bending)
        """What a residual force is compared with [N]."""
        self.centre = np.asarray(scene.object.position)
        self.reach = scene.object.radius + self.finger.thickness_radius
        self.rod = DenseRod(self.finger, self.lengths)
        self.ends = self.curvature_ends(self.q)
        self.tendon_shares = self.capstan()
        self.points = self.rod.edge_points(self.ends)
        self.angles = self.rod.edge_angle(self.ends)
        self.middle_edge = self.rod.edge_index(self.rod.joints[scene.elements_before_middle])
        self.normals = {name: self.normal(name) for name in self.names}
        self.world_forces = {
            name: force[0] * self.normals[name] + force[1] * across(self.normals[name])
            for name, force in zip(self.names, self.forces, strict=True)
        }

    def curvature_ends(self, q: Array) -> Array:
        """Curvature at start and end of each element (N, 2) [1/m]."""
        if self.family == "arc":
            return np.repeat((q / self.lengths)[:, None], 2, axis=1)
        nodes = np.concatenate([q, [self.tip_curvature]]) if self.family == "matched_clothoid" else q
        return np.stack([nodes[:-1], nodes[1:]], axis=1)

    def normal(self, name: str) -> Array:
        """Outward normal of the object at a contact, from the geometry."""
        if name == "palm" and self.scene.palm is not None:
            return -np.asarray(self.scene.palm.normal)
        offset = self.points[self.middle_edge if name == "middle" else -1] - self.centre
        if name == "middle":  # the finger is tangent there: its own normal, on the side away from the object
            angle = self.angles[self.middle_edge]
            across = np.array([np.cos(angle), np.sin(angle)])
            return across if across @ offset >= 0 else -across
        return np.asarray(offset / np.linalg.norm(offset))

    def tip_moment(self) -> float:
        """Moment of the tendons at the tip [N m]."""
        tendons = self.finger.tendons
        return 0.0 if tendons is None else float((self.tensions[0] - self.tensions[1]) * tendons.offset)

    def capstan(self) -> Array:
        """Share of the tendons' moment that reaches each element's middle past the rubbing guides."""
        tendons = self.finger.tendons
        if tendons is None or tendons.friction == 0.0:
            return np.ones(self.lengths.size)
        bends = 0.5 * self.lengths * self.ends.sum(axis=1)
        rounded = 1e-3 * self.lengths / self.lengths.sum()
        turned = bends**2 / np.sqrt(bends**2 + rounded**2)  # without sign, rounded off where straight
        return np.asarray(np.exp(-tendons.friction * (np.cumsum(turned) - 0.5 * turned)))

    def couple(self, name: str) -> float:
        """Couple of a contact's friction about the backbone [N m]."""
        return -self.finger.thickness_radius * float(self.forces[self.names.index(name)][1])

    def potential(self, q: Array) -> Any:
        """Energy of bending and of all loads, contact forces and couples frozen [J]; q may be complex."""
        ends = self.curvature_ends(q)
        bent = self.rod.curvature(ends) - self.rod.rest
        energy = 0.5 * self.finger.rod.stiffness * (self.rod.weights * bent**2).sum()
        points, angles = self.rod.edge_points(ends), self.rod.edge_angle(ends)
        bends = 0.5 * self.lengths * ends.sum(axis=1)
        energy = energy - self.tip_moment() * (self.tendon_shares * bends).sum()
        if isinstance(self.scene.gravity, PlanarGravity):
            g = np.asarray(self.scene.gravity.vector)
            energy = energy - self.finger.rod.mass_per_length * (self.rod.mean_point(ends) @ g)
            for mass in self.finger.masses:
                energy = energy - mass.mass * (points[self.rod.edge_index(mass.at)] @ g)
        for name, edge in (("middle", self.middle_edge), ("tip", -1)):
            if name in self.names:
                energy = energy - points[edge] @ self.world_forces[name] - angles[edge] * self.couple(name)
        return energy

    def friction(self, name: str) -> float:
        """Friction coefficient of a contact."""
        return self.scene.palm_friction if name == "palm" else self.scene.contacts.friction

    def friction_margin(self) -> float:
        margins = [
            1.0 - np.hypot(f, lift) / (self.friction(name) * n) if n > 0 else 0.0
            for name, (n, f, lift) in zip(self.names, self.forces, strict=True)
            if self.friction(name) > 0
        ]
        return float(min(margins, default=0.0))


def across(normal: Array) -> Array:
    """The normal turned by +90 degrees."""
    return np.array([-normal[1], normal[0]])
