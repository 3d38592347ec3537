"""The elastic response of a grasp to a small wrench: fingers bend, the object moves, contacts roll without slip.

To first order about the stored grasp. Unknown are the changes of curvature of each finger on a fine mesh, of the
object's pose and of the contact forces; contacts neither slip nor part, supports do not move. Stiffness comes from the
rod, from the forces on the bent rod (weight and contacts), and from contact points that wander as surfaces roll.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.quality.bent_finger import BentFinger, Rolling, finger_rolling, support_rolling
from continuum_grasp.grasp.quality.contact_set import ContactSet
from continuum_grasp.scene.grasp import FingerSetup, GraspScene
from continuum_grasp.scene.grasp_options import PlanarGravity

Array = NDArray[Any]
Tendons = Literal["retensioned", "locked"]

COMPLIANCE = 1e-8
"""Give of each contact, as a part of L^3 / (E I) of the stiffest finger: it shares out forces that rigid contacts would
leave open, between two ends of a face on a wall for instance."""


@dataclass(frozen=True)
class Change:
    """What K unit causes change.

    Attributes
    ----------
    pose : ndarray, shape (3, K)
        Of the object: center of mass [m], angle [rad].
    forces : ndarray, shape (C, 2, K)
        Normal and friction force of each contact, along directions that turn with the contact [N].
    differences : ndarray, shape (F, K)
        Tension 1 less tension 2 of each finger [N].
    bends : ndarray, shape (F, K)
        Angle of each finger's tip [rad].
    """

    pose: Array
    forces: Array
    differences: Array
    bends: Array


class GraspResponse:
    """First-order response of a grasp.

    Parameters
    ----------
    scene : GraspScene
    arrays : mapping
        Of the grasp; an equilibrium.

    Attributes
    ----------
    contacts : ContactSet
    setups : tuple of FingerSetup
        Of the F fingers.
    tensions : ndarray, shape (F, 2)
        Stored tensions [N].
    """

    def __init__(self, scene: GraspScene, arrays: Mapping[str, Any]) -> None:
        self.scene = scene
        self.contacts = ContactSet.of(scene, arrays)
        self.setups = scene.setups
        self.tensions = np.array([np.asarray(arrays[f"{s.name}.tensions"], dtype=float) for s in self.setups])
        self._fingers = [self._bent(setup, arrays) for setup in self.setups]
        starts = np.cumsum([0, *(finger.size for finger in self._fingers)])
        self._slices = [slice(a, b) for a, b in pairwise(starts)]
        self._object = int(starts[-1])
        size, count = self._object + 3, self.contacts.count
        self._stiffness = np.zeros((size, size))
        self._jacobian = np.zeros((2 * count, size))
        self._turn_of_normal = np.zeros((count, size))
        self._plain, self._shared = np.zeros((len(self._fingers), size)), np.zeros((len(self._fingers), size))
        for k, (setup, finger, part) in enumerate(zip(self.setups, self._fingers, self._slices, strict=True)):
            self._add_finger(setup, finger, part)
            self._plain[k, part], self._shared[k, part] = finger.tip_turn, setup.tendons.offset * finger.tendon_turn
        for contact in range(count):
            self._add_contact(contact)
        self._compliance = COMPLIANCE * min(f.length**3 / f.finger.rod.stiffness for f in self._fingers)

    def stable(self, tendons: Tendons) -> bool:
        """Whether every small motion that the contacts and, where locked, the tendons leave raises the energy."""
        scale = np.sqrt(self._metric())
        jacobian = self._jacobian if tendons == "retensioned" else np.concatenate([self._jacobian, self._locks()])
        hessian = self._stiffness + jacobian.T @ jacobian / (10.0 * self._compliance)
        hessian = 0.5 * (hessian + hessian.T) / np.outer(scale, scale)
        least = 1e-9 * min(f.finger.rod.stiffness / f.length for f in self._fingers)
        try:
            np.linalg.cholesky(hessian - least * np.eye(len(hessian)))
        except np.linalg.LinAlgError:
            return False
        return True

    def to_wrenches(self, tendons: Tendons) -> Change:
        """Response to a force along x and y [1 N] and a moment about the center of mass [1 N m]: K = 3."""
        causes = np.zeros((self._object + 3, 3))
        causes[self._object :] = np.eye(3)
        return self._solve(causes, tendons)

    def to_tensions(self) -> Change:
        """Response to each finger's tension 1 less tension 2 growing by 1 N: K = F."""
        return self._solve(self._shared.T, "retensioned")

    # -- making ----------------------------------------------------------------------------------------------

    def _bent(self, setup: FingerSetup, arrays: Mapping[str, Any]) -> BentFinger:
        own = {
            key: arrays[f"{setup.name}.{key}"] for key in ("q", "lengths", "curvature_shapes", "tip_curvature", "base")
        }
        mine = [k for k in range(self.contacts.count) if self.contacts.finger_of(k) == setup.name]
        return BentFinger(setup.finger, own, [float(self.contacts.stations[k]) for k in mine])

    def _add_finger(self, setup: FingerSetup, finger: BentFinger, part: slice) -> None:
        contacts = self.contacts
        loads = [
            (float(contacts.stations[k]), self._force(k))
            for k in range(contacts.count)
            if contacts.finger_of(k) == setup.name
        ]
        gravity = np.asarray(self.scene.gravity.vector) if isinstance(self.scene.gravity, PlanarGravity) else None
        self._stiffness[part, part] += finger.bending + finger.load_stiffness(loads, gravity)

    def _force(self, k: int) -> Array:
        """World force on what touches the object [N]."""
        normal, friction, _ = self.contacts.forces[k]
        return np.asarray(normal * self.contacts.normals[k] + friction * self.contacts.across[k])

    def _add_contact(self, k: int) -> None:
        contacts, size = self.contacts, self._object + 3
        normal, across, arm = contacts.normals[k], contacts.across[k], contacts.arms[k]
        spin = np.zeros(size)
        spin[-1] = 1.0
        move = np.zeros((2, size))
        move[:, self._object : self._object + 2] = -np.eye(2)
        move[:, -1] = [arm[1], -arm[0]]
        turn = np.zeros(size)
        name = contacts.finger_of(k)
        rolling = support_rolling(self.scene, contacts, k) if name is None else self._add_section(k, name, move, turn)
        push = float(contacts.forces[k, 0])
        self._stiffness -= float(self._force(k) @ arm) * np.outer(spin, spin)
        self._stiffness += push * rolling.travel * np.outer(turn - spin, turn - spin)
        self._jacobian[2 * k : 2 * k + 2] = np.stack([normal @ move, across @ move])
        self._turn_of_normal[k] = rolling.finger_share * turn + rolling.object_share * spin

    def _add_section(self, k: int, name: str, move: Array, turn: Array) -> Rolling:
        """Put in how the finger's surface moves and turns at a contact."""
        at = [setup.name for setup in self.setups].index(name)
        finger, part, thickness = self._fingers[at], self._slices[at], self.setups[at].finger.thickness_radius
        station = float(self.contacts.stations[k])
        section = finger.section(station)
        turn[part] = section.turn
        move[:, part] += section.shift - thickness * np.outer(self.contacts.across[k], section.turn)
        self._stiffness[part, part] -= (
            thickness * float(self.contacts.forces[k, 0]) * np.outer(section.turn, section.turn)
        )
        at_tip = station >= finger.length * (1.0 - 1e-9)
        return finger_rolling(self.scene, self.contacts, k, section, thickness, at_tip)

    # -- solving ---------------------------------------------------------------------------------------------

    def _metric(self) -> Array:
        """Weights that make the unknowns comparable: L per curvature squared, 1 / L^2 per shift squared."""
        length = max(finger.length for finger in self._fingers)
        parts = [np.full(finger.size, finger.length**2 / finger.size) for finger in self._fingers]
        return np.concatenate([*parts, [length**-2, length**-2, 1.0]])

    def _locks(self) -> Array:
        """Rows of the tendons' constraints, as lengths [m]."""
        length = max(finger.length for finger in self._fingers)
        return length * self._plain

    def _solve(self, causes: Array, tendons: Tendons) -> Change:
        size, forces = self._object + 3, 2 * self.contacts.count
        fingers = len(self._fingers) if tendons == "locked" else 0
        matrix = np.zeros((size + forces + fingers, size + forces + fingers))
        matrix[:size, :size] = self._stiffness
        matrix[:size, size : size + forces] = -self._jacobian.T
        matrix[size : size + forces, :size] = self._jacobian
        matrix[size : size + forces, size : size + forces] = self._compliance * np.eye(forces)
        if fingers:
            matrix[:size, size + forces :] = -self._shared.T
            matrix[size + forces :, :size] = self._plain
        right = np.zeros((matrix.shape[0], causes.shape[1]))
        right[:size] = causes
        unknowns, lengths = np.linalg.solve(matrix, right), self.contacts.count
        motion = unknowns[:size]
        changed = unknowns[size : size + forces].reshape(lengths, 2, -1)
        turned = self._turn_of_normal @ motion
        stored = self.contacts.forces
        along = np.stack(
            [
                changed[:, 0] + stored[:, 1, None] * turned,
                changed[:, 1] - stored[:, 0, None] * turned,
            ],
            axis=1,
        )
        differences = np.zeros((len(self._fingers), causes.shape[1]))
        differences[:fingers] = unknowns[size + forces :]
        return Change(motion[self._object :], along, differences, self._plain @ motion)
