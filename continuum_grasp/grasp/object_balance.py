"""What the contacts alone could do for the object where everything stays in place: least friction, greatest mass.

Only the object's balance counts: fingers and supports are taken to push with any normal force up to its limit. So the
least friction found here is never above, and the greatest mass never below, what the fingers can really do.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.conic_program import Cones, solve_conic
from continuum_grasp.grasp.contact_set import ContactSet
from continuum_grasp.scene.grasp import GraspScene, OutOfPlaneGravity

__all__ = ["LeastFriction", "greatest_mass", "least_friction"]

Array = NDArray[Any]

MOST = 1e4
"""Friction coefficients above this are no answer."""
_SLACK = 1e-8
"""Imbalance, as a part of the weight, that counts as balance."""


@dataclass(frozen=True)
class LeastFriction:
    """Answer of `least_friction`.

    Attributes
    ----------
    factor : float
        What all friction coefficients must be multiplied with, at least; infinite where none is enough.
    coefficients : dict
        The coefficients by contact that this makes [1].
    forces : ndarray, shape (C, 3)
        Forces that then balance the object: N, f, lift [N]; NaN where none do.
    """

    factor: float
    coefficients: dict[str, float]
    forces: Array

    @property
    def enough(self) -> bool:
        """Whether the scene's own friction is enough for the object's balance."""
        return self.factor <= 1.0 + 1e-9


def least_friction(
    scene: GraspScene, arrays: Mapping[str, Any], *, same: bool = False, tolerance: float = 1e-9
) -> LeastFriction:
    """Least friction with which contact forces within their limits could balance the object where it is.

    Parameters
    ----------
    scene : GraspScene
    arrays : mapping
        Of a grasp: object's pose, contacts and their normals; forces and fingers are not looked at.
    same : bool, optional
        True: one coefficient for all contacts in place of the scene's, ``factor`` being that coefficient. False: the
        scene's coefficients times a common factor; contacts without friction stay so.
    tolerance : float, optional
        Relative; of the bisection.
    """
    contacts = ContactSet.of(scene, arrays)
    balance = _Balance(scene, contacts)
    base = np.ones(contacts.count) if same else contacts.friction
    rough = float(base.max(initial=0.0))
    low, high = 0.0, np.inf
    forces, factor = balance.forces(0.0 * base), 1.0
    if forces is not None:
        high = 0.0
    elif rough > 0.0:
        factor = 1.0 / rough
    while rough > 0.0 and high > low * (1.0 + tolerance):
        found = balance.forces(factor * base)
        if found is None:
            low = factor
            if factor * rough >= MOST:
                break
        else:
            forces, high = found, factor
            if high * rough < 1e-9:
                break
        factor = min(2.0 * low, MOST / rough) if np.isinf(high) else 0.5 * (low + high)
    forces = np.full((contacts.count, 3), np.nan) if forces is None else forces
    coefficients = {name: float(high * mu) if mu > 0.0 else 0.0 for name, mu in zip(contacts.names, base, strict=True)}
    return LeastFriction(float(high), coefficients, forces)


def greatest_mass(scene: GraspScene, arrays: Mapping[str, Any]) -> float:
    """Greatest mass that contact forces within their limits could hold where everything is [kg].

    Infinite without gravity; 0 where the contacts can balance no weight at all.

    Parameters
    ----------
    scene : GraspScene
    arrays : mapping
        Of a grasp, as in `least_friction`.
    """
    contacts = ContactSet.of(scene, arrays)
    balance = _Balance(scene, contacts)
    if balance.weight_per_mass == 0.0:
        return float("inf")
    return balance.greatest(contacts.friction)


class _Balance:
    """The object's balance over (N, f, lift) of each contact and the mass, in units of a force and of its weight."""

    def __init__(self, scene: GraspScene, contacts: ContactSet) -> None:
        count = contacts.count
        lifted = isinstance(scene.gravity, OutOfPlaneGravity)
        direction = np.zeros(3)
        self.weight_per_mass = 0.0
        if isinstance(scene.gravity, OutOfPlaneGravity):
            self.weight_per_mass = scene.gravity.magnitude
        elif scene.gravity.mode == "planar":
            direction[:2] = scene.gravity.vector
            self.weight_per_mass = float(np.hypot(*direction[:2]))
            direction /= max(self.weight_per_mass, 1e-300)
        self.count, self.lifted = count, lifted
        most = float(contacts.normal_max.max(initial=0.0)) or 1.0
        self.weight = scene.object.mass * self.weight_per_mass
        self.force = self.weight if 0.0 < self.weight < most else most
        length = max(float(np.abs(contacts.arms).max(initial=0.0)), 1e-300)
        rows = np.zeros((6, 3 * count + 1))
        grasp = contacts.wrench_map() / np.array([1.0, 1.0, length])[:, None, None]
        rows[:3, :-1].reshape(3, count, 3)[:, :, :2] = grasp
        rows[:3, -1] = direction
        if lifted:
            lifts = rows[3:, :-1].reshape(3, count, 3)
            lifts[0, :, 2] = 1.0
            rows[3, -1] = -1.0
            if scene.gravity.tilt == "balance":  # type: ignore[union-attr]
                lifts[1:, :, 2] = contacts.arms.T / length
        self.rows = rows
        self.normal_max = contacts.normal_max / self.force
        matrix = np.zeros((count, 2, 3 * count + 1))
        width = np.zeros((count, 3 * count + 1))
        for k in range(count):
            matrix[k, 0, 3 * k + 1] = 1.0
            matrix[k, 1, 3 * k + 2] = 1.0 if lifted else 0.0
            width[k, 3 * k] = 1.0
        self.cones = Cones.made(matrix, np.zeros((count, 2)), width, np.zeros(count))
        self._unit_width = width

    def forces(self, friction: Array) -> Array | None:
        """Forces (C, 3) [N] that balance the object's own weight, None where there are none."""
        weight = self.weight / self.force
        size = 3 * self.count + 1
        imbalance = np.concatenate([np.eye(6), -np.eye(6)], axis=1)
        rows = np.concatenate([self.rows, imbalance], axis=1)
        cones = self._with(friction, extra=12)
        lower, upper = self._bounds(weight, weight)
        cost = np.concatenate([np.zeros(size), np.ones(12)])
        found = solve_conic(
            cost, rows, 0.0, 0.0, np.append(lower, np.zeros(12)), np.append(upper, np.full(12, np.inf)), cones
        )
        self.cones.cuts = cones.cuts
        if not found.optimal or found.objective > _SLACK * max(weight, 1e-6):
            return None
        return np.asarray(found.x[: size - 1].reshape(self.count, 3) * self.force)

    def greatest(self, friction: Array) -> float:
        """Greatest mass [kg]."""
        most = float(self.normal_max.sum()) * (1.0 + float(friction.max(initial=0.0))) + 1.0
        lower, upper = self._bounds(0.0, most)
        cost = np.zeros(3 * self.count + 1)
        cost[-1] = -1.0
        found = solve_conic(cost, self.rows, 0.0, 0.0, lower, upper, self._with(friction, extra=0))
        return float(found.x[-1]) * self.force / self.weight_per_mass if found.optimal else 0.0

    def _with(self, friction: Array, extra: int) -> Cones:
        width = self._unit_width * friction[:, None]
        pad = ((0, 0), (0, extra))
        matrix = np.pad(self.cones.matrix, ((0, 0), *pad))
        return Cones(matrix, self.cones.offset, np.pad(width, pad), self.cones.room, list(self.cones.cuts))

    def _bounds(self, least: float, most: float) -> tuple[Array, Array]:
        lower, upper = np.zeros(3 * self.count + 1), np.zeros(3 * self.count + 1)
        reach = np.repeat(1e6 * self.normal_max[:, None], 2, axis=1)
        lower[:-1].reshape(-1, 3)[:, 1:] = -reach
        upper[:-1].reshape(-1, 3)[:, 0] = self.normal_max
        upper[:-1].reshape(-1, 3)[:, 1:] = reach if self.lifted else reach * np.array([1.0, 0.0])
        lower[-1], upper[-1] = least, most
        return lower, upper
