"""A multi-aspect grasp index: object, configuration and kinetics for a task; the definition is this toolkit's own.

The index of Cheraghpour, Moosavian and Nahvi (2011) has the same three aspects. Its formula was not available here; the
one below is not theirs, hence the name. See ``docs/grasp_quality.md``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.quality.bent_finger import BentFinger
from continuum_grasp.grasp.quality.contact_set import ContactSet
from continuum_grasp.scene.grasp import GraspScene

Array = NDArray[Any]

TRANSLATION = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
"""Carrying the object without turning it, in both directions."""


@dataclass(frozen=True)
class MagLike:
    """The index and its three aspects, each from 0 to 1 and the geometric mean over the tasks."""

    # How little of the contact forces is spent on the moment that the task's force has about the contacts' center.
    object_aspect: float
    # How well the fingers' shapes suit motions along the task, against their best direction.
    configuration_aspect: float
    # Share of the kinetic energy that is the object's.
    kinetic_aspect: float

    @property
    def value(self) -> float:
        """Geometric mean of the aspects [1]."""
        return float(np.cbrt(self.object_aspect * self.configuration_aspect * self.kinetic_aspect))


def mag_like(
    scene: GraspScene, arrays: Mapping[str, Any], tasks: Sequence[tuple[float, float, float]] = TRANSLATION
) -> MagLike:
    """The index of a grasp; only contacts with fingers count.

    Tasks are directions of motion of the object: x and y of the center of mass, turning times ``scene.torque_scale``.
    """
    contacts = ContactSet(scene, arrays)
    fingers = [BentFinger(setup, arrays, contacts) for setup in scene.setups if contacts.of(setup.name)]
    if not fingers:
        return MagLike(0.0, 0.0, 0.0)
    touching = [k for k in range(contacts.count) if contacts.finger_of(k) is not None]
    mobilities = [_Mobility(finger, contacts) for finger in fingers]
    mass = scene.object.mass
    # Scenes have no moment of inertia: that of a disc of the object's size.
    inertia = np.array([mass, mass, 0.5 * mass * scene.object.size**2])
    found = []
    for task in tasks:
        twist = np.asarray(task) / np.linalg.norm(task) / np.array([1.0, 1.0, scene.torque_scale])
        energy = float(twist @ (inertia * twist))
        bending, moving = zip(*(mobility.along(twist) for mobility in mobilities), strict=True)
        whole = energy + float(sum(moving))
        balance = _object_aspect(contacts.arms[touching], inertia * twist)
        found.append((balance, float(np.prod(bending)) ** (1.0 / len(bending)), energy / whole if whole > 0.0 else 0.0))
    return MagLike(*(np.prod(np.array(found), axis=0) ** (1.0 / len(found))).tolist())


def _object_aspect(arms: Array, wrench: Array) -> float:
    """Least squares of contact forces for a wrench: the part that is left if its force acted at their center."""
    center = arms.mean(axis=0)
    # Forces of least squares for a force F and a moment M about the center of C contacts: |F|^2 / C + M^2 / spread.
    spread = float(((arms - center) ** 2).sum())
    off = float(center[0] * wrench[1] - center[1] * wrench[0])
    force = float(wrench[:2] @ wrench[:2]) / len(arms)
    size = float(np.hypot(*arms.T).max())
    # All contacts in one place resist no moment.
    if spread <= 1e-24 * max(size, 1e-300) ** 2:
        return 1.0 if wrench[2] == 0.0 and abs(off) <= 1e-12 * size * float(np.hypot(*wrench[:2])) else 0.0
    wanted = force + float(wrench[2]) ** 2 / spread
    return wanted / (wanted + off**2 / spread) if wanted > 0.0 else 0.0


class _Mobility:
    """How the c contacts of one finger move with the object, and how the finger follows."""

    def __init__(self, finger: BentFinger, contacts: ContactSet) -> None:
        rows, grasp = [], []
        for k in finger.touching:
            section = finger.section(k)
            rows.append(section.shift - section.half * np.outer(contacts.across[k], section.turn))
            x, y = contacts.arms[k]
            grasp.append(np.array([[1.0, 0.0, -y], [0.0, 1.0, x]]))
        jacobian, inertia = np.concatenate(rows), finger.inertia()
        # Rods without weight but with a mass at the tip have a singular mass matrix.
        inertia += 1e-12 * np.trace(inertia) / len(inertia) * np.eye(len(inertia))
        self.grasp = np.concatenate(grasp)  # (2 c, 3) velocities of the contact points per twist of the object
        # (2 c, 2 c) motions per contact force, with the rod's stiffness and with the finger's inertia
        self.compliance = jacobian @ np.linalg.solve(finger.bending, jacobian.T)
        self.mobility = (
            jacobian @ np.linalg.solve(inertia, jacobian.T) if inertia.any() else np.zeros_like(self.compliance)
        )

    def along(self, twist: Array) -> tuple[float, float]:
        """Configuration aspect, and the finger's energy (twice), of a motion."""
        motion = self.grasp @ twist
        size = float(motion @ motion)
        if size == 0.0:
            return 1.0, 0.0
        best = float(np.linalg.eigvalsh(self.compliance)[-1])
        heavy = float(np.linalg.eigvalsh(self.mobility)[-1]) if self.mobility.any() else 0.0
        energy = _cost(motion, self.mobility, heavy) if heavy > 0.0 else 0.0
        return min(1.0, size / (_cost(motion, self.compliance, best) * best)), energy


def _cost(motion: Array, matrix: Array, greatest: float) -> float:
    """Motion @ inverse @ motion; very large, not infinite, for a motion that the finger cannot follow."""
    return float(motion @ np.linalg.solve(matrix + 1e-12 * greatest * np.eye(len(matrix)), motion))
