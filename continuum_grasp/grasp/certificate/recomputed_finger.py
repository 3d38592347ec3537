"""Shape, loads and potential of one finger of a grasp from its stored numbers, computed anew by numpy alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.rod.dense_rod import DenseRod, curvature_profile
from continuum_grasp.scene.grasp import FingerSetup
from continuum_grasp.scene.grasp_options import GraspGravity, PlanarGravity

Array = NDArray[Any]

_COARSE = 1 / 64
"""Panels for the equilibrium: with five Gauss points each, exact to rounding; the fine ones are for clearances."""


@dataclass(frozen=True)
class FingerLoad:
    """What a contact does to a finger.

    Attributes
    ----------
    name : str
        Of the contact.
    joint : int
        Number of elements between the base and it.
    force : ndarray, shape (2,)
        World force on the finger [N].
    couple : float
        Of the friction force, which acts at the surface, about the backbone [N m].
    """

    name: str
    joint: int
    force: Array
    couple: float


class RecomputedFinger:
    """One finger.

    Parameters
    ----------
    setup : FingerSetup
    gravity : GraspGravity
    arrays : mapping
        See `continuum_grasp.grasp.certify`.
    """

    def __init__(self, setup: FingerSetup, gravity: GraspGravity, arrays: Mapping[str, Any]) -> None:
        self.setup, self.name, self.finger = setup, setup.name, setup.finger

        def stored(key: str) -> Array:
            return np.asarray(arrays[f"{setup.name}.{key}"], dtype=float)

        self.q, self.lengths, self.tensions = stored("q"), stored("lengths"), stored("tensions")
        self.stored_tip_curvature, self.stored_backbone = float(stored("tip_curvature")), stored("backbone")
        self.base, self._shapes = stored("base"), stored("curvature_shapes")
        self.length = self.finger.rod.length
        self.stiffness = self.finger.rod.stiffness
        self.thickness = self.finger.thickness_radius
        self.gravity = gravity_vector(gravity)
        self.rod = DenseRod(self.finger, self.lengths, base=self.base)
        self.profile = self.curvatures(self.q)
        self.angles = self.rod.edge_angle(self.profile)
        self.points = self.rod.edge_points(self.profile)
        self.joint_edges = np.searchsorted(self.rod.edges, self.rod.joints)
        self.tendon_shares = self._capstan()
        self.loads: list[FingerLoad] = []

    def curvatures(self, q: Array) -> Array:
        """Curvature (..., N, D) [1/m] at places along each element, from coordinates (..., n)."""
        return curvature_profile(self._shapes, q, self.stored_tip_curvature)

    @property
    def matches_tip(self) -> bool:
        """Whether the curvature at the tip is no coordinate, but set by the moment balance there."""
        return bool(self._shapes.shape[-1] > self.q.size)

    @property
    def tip_moment(self) -> float:
        """Moment of the tendons at the tip [N m]."""
        return float((self.tensions[0] - self.tensions[1]) * self.setup.tendons.offset)

    @property
    def tip_couple(self) -> float:
        """Couples of contacts at the tip [N m]."""
        return sum(load.couple for load in self.loads if load.joint == self.lengths.size)

    def joint_position(self, joint: int) -> float:
        """Where a joint lies along the finger [m]."""
        return float(self.rod.joints[joint])

    def moment_scale(self, force: float) -> float:
        """Greatest moment in play [N m], with a floor for straight fingers under forces of up to ``force`` [N]."""
        bent = float(np.abs(self.rod.curvature(self.profile) - self.rod.rest).max())
        least = 0.01 * max(force * self.length, self.stiffness / self.length)
        return float(np.max([abs(self.tip_moment), self.stiffness * bent, least]))

    def imbalance(self) -> float:
        """Greatest virtual work of all moments and forces [N m], per greatest turn of a section."""
        return float(np.max(np.abs(self.virtual_work())))

    def virtual_work(self) -> Array:
        """Virtual work of all moments and forces in each bending coordinate, per greatest turn of a section (n,) [N m].

        The potential of bending, weight, tendons and contact forces must be stationary in the bending
        coordinates; its gradient is taken by complex steps.
        """
        # A complex step subtracts nothing, so the derivative is exact to rounding (Squire and Trapp 1998).
        step = 1e-30
        rod = DenseRod(self.finger, self.lengths, _COARSE, self.base)
        shifted = self.q + 1j * step * np.eye(self.q.size)
        profile = self.curvatures(shifted)
        angles = rod.edge_angle(profile)
        slopes = self._potential(rod, profile, angles).imag / step
        turns = np.abs(angles.imag).max(axis=-1) / step
        return np.asarray(slopes / turns)

    def _potential(self, rod: DenseRod, profile: Array, edge_angles: Array) -> Array:
        """Energy of bending and of all loads, contact forces and couples frozen (...,) [J]."""
        bent = rod.curvature(profile) - rod.rest
        angle = rod.angle(profile)
        points = rod.edge_points(profile, angle)
        bends = rod.bends(profile)
        energy = 0.5 * self.stiffness * (bent**2 @ rod.weights) - self.tip_moment * (bends @ self.tendon_shares)
        if self.gravity.any():
            energy = energy - self.finger.rod.mass_per_length * (rod.mean_point(profile, angle) @ self.gravity)
            for mass in self.finger.masses:
                energy = energy - mass.mass * (points[..., rod.edge_index(mass.at), :] @ self.gravity)
        for load in self.loads:
            edge = int(np.searchsorted(rod.edges, rod.joints[load.joint]))
            energy = energy - points[..., edge, :] @ load.force - edge_angles[..., edge] * load.couple
        return np.asarray(energy)

    def _capstan(self) -> Array:
        """Share of the tendons' moment that reaches each element's middle past the friction of the guides."""
        friction = self.setup.tendons.friction
        if friction == 0.0:
            return np.ones(self.lengths.size)
        bends = self.rod.bends(self.profile)
        rounded = 1e-3 * self.lengths / self.lengths.sum()
        turned = bends**2 / np.sqrt(bends**2 + rounded**2)  # without sign, rounded off where straight
        return np.asarray(np.exp(-friction * (np.cumsum(turned) - 0.5 * turned)))


def gravity_vector(gravity: GraspGravity) -> Array:
    """Gravity in the plane [m/s2]."""
    return np.asarray(gravity.vector if isinstance(gravity, PlanarGravity) else (0.0, 0.0), dtype=float)
