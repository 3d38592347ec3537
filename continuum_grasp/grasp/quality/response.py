"""The elastic response of a grasp to a small wrench: fingers bend, the object moves, contacts roll without slip.

To first order about the stored grasp. Unknown are the changes of curvature of each finger on a fine mesh, of the
object's pose and of the contact forces; contacts neither slip nor part, supports do not move. Stiffness comes from the
rod, from the forces on the bent rod (weight and contacts), and from contact points that wander as surfaces roll.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any, Literal

import numpy as np

from continuum_grasp.base import Numbers as Array
from continuum_grasp.grasp.judge.borne_push import bears
from continuum_grasp.grasp.quality.bent_finger import BentFinger, rolled
from continuum_grasp.grasp.quality.contact_set import ContactSet
from continuum_grasp.scene import GraspScene

Tendons = Literal["retensioned", "locked"]
"""Whether tensions are chosen anew for a disturbance, or tendon lengths stay fixed."""

COMPLIANCE = 1e-8
"""Give of each contact, as a part of L^3 / (E I) of the stiffest finger: it shares out forces that rigid contacts would
leave open, between two ends of a face on a wall for instance."""


@dataclass(frozen=True)
class UnitChanges:
    """Changes by K unit causes."""

    pose: Array  # (3, K) of the object: center of mass [m], angle [rad]
    forces: Array  # (C, 2, K) normal and friction force, along directions that turn with the contact [N]
    differences: Array  # (F, K) tension 1 less tension 2 of each finger [N]
    bends: Array  # (F, K) angle of each finger's tip [rad]


class GraspResponse:
    """First-order response of a grasp, which must be an equilibrium, with F fingers and C contacts, by its ``arrays``.

    ``springs`` (F,) are differences of a finger's tensions per path drawn in while its drives hold [N/m], where others
    carry the grasp out than the scene's; ``compliance`` the give of each contact [m/N], next to none by default.
    """

    def __init__(
        self,
        scene: GraspScene,
        arrays: Mapping[str, Any],
        springs: Sequence[float] | None = None,
        compliance: float | None = None,
    ) -> None:
        self._scene = scene
        self._arrays = arrays
        self.contacts = ContactSet(scene, arrays)
        self.setups = scene.setups
        self.tensions = np.array([np.asarray(arrays[f"{s.name}.tensions"], dtype=float) for s in self.setups])  # [N]
        self._fingers = [BentFinger(setup, arrays, self.contacts) for setup in self.setups]
        starts = np.cumsum([0, *(finger.size for finger in self._fingers)])
        self._slices = [slice(a, b) for a, b in pairwise(starts)]
        self._object = int(starts[-1])
        size = self._object + 3
        count = self.contacts.count
        self._stiffness = np.zeros((size, size))
        self._jacobian = np.zeros((2 * count, size))
        self._turn_of_normal = np.zeros((count, size))
        # Difference of the tensions per path drawn in while drives hold; infinite where tendons do not elongate.
        stiffness = [np.inf if f.wound is None else float(f.wound.springs.sum()) for f in self._fingers]
        self._springs = stiffness if springs is None else [*springs]
        # Change of a tendon's path per its offset, and the work of its tension: with tendon friction, which the motion
        # leaves as it is, the two differ and locked tendons make the system unsymmetric.
        self._plain, self._shared, self._turned = (np.zeros((len(self._fingers), size)) for _ in range(3))
        self._arms = np.array([finger.arm for finger in self._fingers])
        for k, (finger, part) in enumerate(zip(self._fingers, self._slices, strict=True)):
            self._stiffness[part, part] += finger.bending + finger.load_stiffness()
            self._turned[k, part] = finger.tip_turn
            self._plain[k, part], self._shared[k, part] = finger.tendon_path, finger.tendon_work
        for contact in range(count):
            self._add_contact(contact)
        rigid = COMPLIANCE * min(f.length**3 / f.stiffness for f in self._fingers)
        self._compliance = rigid if compliance is None else compliance

    def changed(
        self,
        *,
        scene: GraspScene | None = None,
        contact_forces: Array | None = None,
        springs: Sequence[float] | None = None,
        compliance: float | None = None,
    ) -> GraspResponse:
        """Response of the same grasp with other limits of a scene, contact forces (C, 3) [N] or drives and contacts."""
        arrays = self._arrays
        if contact_forces is not None:
            arrays = {**arrays, "contact_forces": contact_forces}
        return GraspResponse(scene or self._scene, arrays, springs, compliance)

    def stable(self, tendons: Tendons) -> bool:
        """Whether every small motion that the contacts and, where locked, the tendons leave raises the energy."""
        length = max(finger.length for finger in self._fingers)
        # Weights that make the unknowns comparable: L per curvature squared, 1 / L^2 per shift squared.
        parts = [np.full(finger.size, finger.length**2 / finger.size) for finger in self._fingers]
        scale = np.sqrt(np.concatenate([*parts, [length**-2, length**-2, 1.0]]))
        # Rows of the tendons' constraints times L, which makes them lengths like the contacts' rows.
        springs = np.array(self._springs) if tendons == "locked" else np.zeros(len(self._fingers))
        stiff = np.isinf(springs)
        jacobian = np.concatenate([self._jacobian, length * self._plain[stiff]])
        # Finsler's lemma: positive definite where the constraints hold, if it is so with a great enough penalty.
        hessian = self._stiffness + jacobian.T @ jacobian / (10.0 * self._compliance)
        for spring, arm, path in zip(springs[~stiff], self._arms[~stiff], self._plain[~stiff], strict=True):
            hessian += spring * np.outer(arm * path, arm * path)
        hessian = 0.5 * (hessian + hessian.T) / np.outer(scale, scale)
        # Zero up to rounding, a motion without stiffness, is not stable.
        least = 1e-9 * min(f.stiffness / f.length for f in self._fingers)
        try:
            np.linalg.cholesky(hessian - least * np.eye(len(hessian)))
        except np.linalg.LinAlgError:
            return False
        return True

    @cached_property
    def push(self) -> float:
        """Greatest push that the grasp bears in every direction [N]: at constant tensions, or with locked tendons if
        the scene's disturbances have these. Zero for an unstable grasp, unless the scene ignores stability.
        """
        # Without new tensions the tensions are constant.
        tendons: Tendons = self._scene.disturbances.tendons
        ignored = self._scene.stability == "ignore"
        if not self.contacts.count or not (ignored or self.stable(tendons)):
            return 0.0
        slopes = np.zeros((self.contacts.count, 3, 2))
        slopes[:, :2] = self.to_wrenches(tendons).forces[..., :2]
        each = zip(self.contacts.forces, slopes, self.contacts.friction, self.contacts.normal_max, strict=True)
        inward = np.array([1.0, 0.0, 0.0])
        return min(bears(force, slope, inward, friction, most) for force, slope, friction, most in each)

    def to_wrenches(self, tendons: Tendons) -> UnitChanges:
        """Response to a force along x and y [1 N] and a moment about the center of mass [1 N m]: K = 3."""
        causes = np.zeros((self._object + 3, 3))
        causes[self._object :] = np.eye(3)
        return self._solve(causes, tendons)

    def to_tensions(self) -> UnitChanges:
        """Response to each finger's tension 1 less tension 2 growing by 1 N: K = F."""
        return self._solve(self._shared.T, "retensioned")

    def _add_contact(self, k: int) -> None:
        contacts = self.contacts
        size = self._object + 3
        normal = contacts.normals[k]
        across = contacts.across[k]
        arm = contacts.arms[k]
        spin = np.zeros(size)
        spin[-1] = 1.0
        # Motion of the touching part, less the motion of the object's point.
        move = np.zeros((2, size))
        move[:, self._object : self._object + 2] = -np.eye(2)
        move[:, -1] = [arm[1], -arm[0]]
        turn = np.zeros(size)  # of the finger's section; supports do not turn
        push = float(contacts.forces[k, 0])
        name = contacts.finger_of(k)
        if name is None:
            other = contacts.support_curvature(k)
        else:
            at = [setup.name for setup in self.setups].index(name)
            part = self._slices[at]
            shift, section_turn, half, other = self._fingers[at].section(k)
            turn[part] = section_turn
            move[:, part] += shift - half * np.outer(across, section_turn)
            # The surface circles about the backbone: h turn^2 / 2 along the normal, on which the normal force works.
            self._stiffness[part, part] -= half * push * np.outer(section_turn, section_turn)
        travel, finger_share, object_share = rolled(contacts.curvature(k), other, contacts.scene.object.size)
        # The arm of a dead force turns with the object, and the point of contact wanders as the surfaces roll.
        self._stiffness -= float(contacts.pushes[k] @ arm) * np.outer(spin, spin)
        self._stiffness += push * travel * np.outer(turn - spin, turn - spin)
        self._jacobian[2 * k : 2 * k + 2] = np.stack([normal @ move, across @ move])
        self._turn_of_normal[k] = finger_share * turn + object_share * spin

    def _solve(self, causes: Array, tendons: Tendons) -> UnitChanges:
        """Solve the saddle point problem of motions, contact forces and, where locked, tension differences."""
        count = self.contacts.count
        fingers = len(self._fingers) if tendons == "locked" else 0
        with np.errstate(divide="ignore"):
            compliances = np.diag(1.0 / (np.array(self._springs) * self._arms)[:fingers])
        none = np.zeros((2 * count, fingers))
        matrix = np.block(
            [
                [self._stiffness, -self._jacobian.T, -self._shared[:fingers].T],
                [self._jacobian, self._compliance * np.eye(2 * count), none],
                [self._plain[:fingers], none.T, compliances],
            ]
        )
        right = np.pad(causes, ((0, len(matrix) - len(causes)), (0, 0)))
        motion, pushed, pulled = np.split(np.linalg.solve(matrix, right), np.cumsum([len(causes), 2 * count]))
        changed = pushed.reshape(count, 2, -1)
        # Seen along the turned directions, a force changes by its cross product with the turn too.
        turned = self._turn_of_normal @ motion
        stored = self.contacts.forces
        forces = [changed[:, 0] + stored[:, 1, None] * turned, changed[:, 1] - stored[:, 0, None] * turned]
        differences = np.zeros((len(self._fingers), causes.shape[1]))
        differences[:fingers] = pulled
        return UnitChanges(motion[self._object :], np.stack(forces, axis=1), differences, self._turned @ motion)
