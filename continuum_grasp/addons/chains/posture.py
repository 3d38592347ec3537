"""The posture of a hand's finger as a chain of links with three hinges each."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from continuum_grasp.addons.chains.controls import Control
from continuum_grasp.addons.chains.links import Links
from continuum_grasp.base import Array

_AXES = (2, 0, 1)
"""Axes of a link about which it bends in the plane, bends to the side, and twists."""
_ROUNDS = 8
"""Rounds of angles from moments and moments from angles: linear theory, to which each adds the turns so far."""


class HandFingerChain:
    """A finger of a grasp as links; hinges before a link bend in the plane, to the side, and twist.

    They follow `order`: the axes of two would be turned by half the bend of all, an error of first order, if
    bending came first everywhere; where it comes first and last in turn, the error is of second order.
    """

    def __init__(self, result: Any, index: int, hinges: int) -> None:
        scene = result.scene
        self.setup = scene.setups[index]
        self.torsional_friction = scene.contacts.torsional_friction
        self.frame = result.frames[index]
        self.name, self.finger = self.setup.name, self.setup.finger
        self.links = Links.of(self.finger, hinges, even=True)
        self.section = (scene.hand.named_bases[self.name].finger or scene.hand.finger).cross_section
        self.stiffness = self.links.stiffness[:, None] * [1.0, self.section.lateral, self.section.torsion]
        self.gravity = np.array(scene.acceleration)
        self.contacts = [c for c in result.contacts if c.name.rpartition(".")[0] == self.name]
        self.tensions = result.tensions[self.name]
        self.wound = result.wound.get(self.name)
        self.friction = result.tendon_friction.get(self.name)
        s, _, _, angle = result.arrays[f"{self.name}.backbone"].T
        self.bends = np.diff(np.interp(self.links.edges, s, angle))

    def radius(self, k: int) -> float:
        """Half the thickness of a link [m]: where it touches, else amid it."""
        touching = [c.station for c in self.contacts if self.links.link_of(c.station) == k]
        at = touching[0] if touching else 0.5 * sum(self.links.span(k))
        return float(self.finger.profile.half_thickness(at))

    def levers(self, control: Control) -> Array:
        """Lengths by which each hinge draws in a tendon per angle, times the share of its tension there (N,) [m]."""
        shares = 1.0 if self.friction is None else self.friction.shares(control.arm, self.links.at)
        return np.asarray(control.levers(self.links.at) * shares)

    def bent_by(self, control: Control) -> list[tuple[str, float]]:
        """Names of the hinges that a tendon bends, with its levers there."""
        levers = enumerate(self.levers(control).tolist(), 1)
        return [(f"{self.name}_bend_{k}", lever) for k, lever in levers if lever != 0.0]

    @staticmethod
    def order(k: int) -> list[int]:
        """Order of the hinges before a link: in the plane (0), to the side (1), of twist (2)."""
        return [0, 1, 2] if k % 2 == 0 else [2, 1, 0]

    def in_order(self, angles: Array) -> Array:
        """Angles (3 N,) in the order of the hinges."""
        return np.concatenate([row[self.order(k)] for k, row in enumerate(angles)])

    def angles(self) -> Array:
        """Angles (N, 3) of the hinges [rad]: in the plane the rod's angles, else what the planned forces take."""
        angles = np.zeros((len(self.bends), 3))
        angles[:, 0] = self.bends
        for _ in range(_ROUNDS):
            angles[:, 1:] = self.moments(angles)[:, 1:] / self.stiffness[:, 1:]
        return angles

    def moments(self, angles: Array) -> Array:
        """Moments (N, 3) of weight and planned contact forces about the hinges at some angles [N m]."""
        links = self.links
        placed = list(self._placed(angles))
        places = np.array([place for place, _, _ in placed])
        forces = links.mass[:, None] * self.gravity
        at = places + (links.center - links.at)[:, None] * np.array([turn[:, 1] for _, _, turn in placed])
        couples = np.cross(at, forces)
        for contact in self.contacts:
            k = links.link_of(contact.station)
            forces[k] += contact.force
            couples[k] += np.cross(contact.position, contact.force)
        # What acts on a link, the hinges before it bear.
        force, couple = (np.cumsum(values[::-1], axis=0)[::-1] for values in (forces, couples))
        moments = couple - np.cross(places, force)
        return np.asarray(np.einsum("kia,ki->ka", np.array([axes for _, axes, _ in placed]), moments))

    def at(self, angles: Array, station: float) -> Array:
        """Point (3,) of the chain at a position along the finger, as the hand sees it [m]."""
        k = self.links.link_of(station)
        if k < 0:
            return np.asarray(self.frame.base + station * self.frame.axes[:, 1])
        place, _, turn = list(self._placed(angles))[k]
        return np.asarray(place + turn @ [0.0, station - self.links.at[k], 0.0])

    def _placed(self, angles: Array) -> Iterator[tuple[Array, Array, Array]]:
        """Place (3,) of each hinge, its three axes as columns, and the axes of the link behind it."""
        turn = self.frame.axes
        place = self.frame.base + self.links.at[0] * self.frame.axes[:, 1]
        for k, (row, bar) in enumerate(zip(angles, self.links.bars, strict=True)):
            axes = np.zeros((3, 3))
            for kind in self.order(k):
                axis = _AXES[kind]
                axes[:, kind] = turn[:, axis]
                turn = turn @ _turned(axis, row[kind])
            yield place, axes, turn
            place = place + bar * turn[:, 1]


def _turned(axis: int, angle: float) -> Array:
    """Matrix (3, 3) of a turn about an axis of coordinates."""
    matrix = np.eye(3)
    j, k = (axis + 1) % 3, (axis + 2) % 3
    matrix[j, j] = matrix[k, k] = np.cos(angle)
    matrix[k, j] = np.sin(angle)
    matrix[j, k] = -matrix[k, j]
    return matrix


def quaternion(axes: Array) -> Array:
    """Unit quaternion (4,), the scalar first, of a rotation matrix (3, 3)."""
    # Eigenvector of the symmetric matrix whose largest eigenvalue is 3 for a rotation (I. Y. Bar-Itzhack, Journal of
    # Guidance 23 (2000) 1085).
    m = axes
    vector = np.array([m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]])
    matrix = np.zeros((4, 4))
    matrix[0, 0], matrix[0, 1:], matrix[1:, 0] = np.trace(m), vector, vector
    matrix[1:, 1:] = m + m.T - np.trace(m) * np.eye(3)
    _, vectors = np.linalg.eigh(matrix)
    found = vectors[:, -1]
    return np.asarray(found if found[np.abs(found).argmax()] > 0.0 else -found)
