"""What the contacts alone could do for the object where everything stays in place: least friction, greatest mass.

Only the object's balance counts: fingers and supports are taken to push with any normal force up to its limit. So the
least friction found here is never above, and the greatest mass never below, what the fingers can really do.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.errors import NumericalError
from continuum_grasp.grasp.quality.contact_set import ContactSet
from continuum_grasp.grasp.quality.lp import ROUNDS, VIOLATION, Cones, solve_lp, solve_socp
from continuum_grasp.scene.grasp import GraspScene
from continuum_grasp.scene.grasp_options import OutOfPlaneGravity, PlanarGravity

Array = NDArray[Any]

MOST = 1e4
"""Friction coefficients above this are no answer: no surface has them."""
_SLACK = 1e-9
"""Excess over a cone, as a part of the weight, that is none."""


@dataclass(frozen=True)
class LeastFriction:
    """What the friction of C contacts must be at least."""

    factor: float  # what all friction coefficients must be multiplied with; infinite where none is enough
    coefficients: dict[str, float]  # the resulting ones by contact [1]
    forces: Array  # (C, 3) that then balance the object: N, f, lift [N]; NaN where none do

    @property
    def enough(self) -> bool:
        """Whether the scene's own friction is enough for the object's balance."""
        return self.factor <= 1.0 + 1e-9


def least_friction(scene: GraspScene, arrays: Mapping[str, Any], *, same: bool = False) -> LeastFriction:
    """Least friction with which contact forces within their limits could balance the object where it is.

    The object's pose, contacts and normals of a grasp count; its forces and fingers do not. The scene's coefficients
    are multiplied with a common factor, so that contacts without friction stay so; with ``same`` all contacts have one
    coefficient, which is the factor.

    Raises
    ------
    NumericalError
        The problems could not be solved.
    """
    contacts = ContactSet(scene, arrays)
    balance = _Balance(scene, contacts)
    base = np.ones(contacts.count) if same else contacts.friction
    rough = float(base.max(initial=0.0))
    forces, factor = balance.forces(0.0 * base), 0.0
    if forces is None:
        factor = math.inf
        for trial in (1.0, 10.0, 1e2, 1e3, MOST) if rough > 0.0 else ():
            forces = balance.forces(base * trial / rough)
            if forces is not None:
                factor = balance.used(forces, base)
                break
    # Down from one balance to the next, which presses harder and needs less friction.
    while forces is not None and factor > 0.0:
        better = balance.forces(base * factor * (1.0 - VIOLATION))
        if better is None:
            break
        forces, factor = better, min(balance.used(better, base), factor * (1.0 - VIOLATION))
    found = np.full((contacts.count, 3), np.nan) if forces is None else forces
    coefficients = {n: float(factor * mu) if mu > 0.0 else 0.0 for n, mu in zip(contacts.names, base, strict=True)}
    return LeastFriction(float(factor), coefficients, found)


def greatest_mass(scene: GraspScene, arrays: Mapping[str, Any]) -> float:
    """Greatest mass that contact forces within their limits could hold where everything is [kg].

    Infinite without gravity; 0 where the contacts can balance no weight at all.
    """
    contacts = ContactSet(scene, arrays)
    balance = _Balance(scene, contacts)
    if balance.weight_per_mass == 0.0:
        return float("inf")
    return balance.greatest(contacts.friction)


class _Balance:
    """The object's balance over (N, f, lift) of each contact and the mass, in units of a force and of its weight."""

    def __init__(self, scene: GraspScene, contacts: ContactSet) -> None:
        count, gravity = contacts.count, scene.gravity
        self.count, self.lifted = count, isinstance(gravity, OutOfPlaneGravity)
        vector = np.array(gravity.vector if isinstance(gravity, PlanarGravity) else (0.0, 0.0), dtype=float)
        planar = float(np.hypot(*vector))
        self.weight_per_mass = gravity.magnitude if isinstance(gravity, OutOfPlaneGravity) else planar
        most = float(contacts.normal_max.max(initial=0.0)) or 1.0
        weight = scene.object.mass * self.weight_per_mass
        self.force = weight if 0.0 < weight < most else most
        self.weight = weight / self.force
        length = max(float(np.abs(contacts.arms).max(initial=0.0)), 1e-300)
        # Rows: force x and y, moment, lift, tilt about x and y; columns: N, f, lift of each contact, and the weight.
        self.rows = rows = np.zeros((6, 3 * count + 1))
        per_contact = rows[:, :-1].reshape(6, count, 3)
        per_contact[:3, :, :2] = contacts.wrench_map() / np.array([1.0, 1.0, length])[:, None, None]
        rows[:2, -1] = vector / max(planar, 1e-300)
        if isinstance(gravity, OutOfPlaneGravity):
            per_contact[3, :, 2] = 1.0
            rows[3, -1] = -1.0
            if gravity.tilt == "balance":
                per_contact[4:, :, 2] = contacts.arms.T / length
        self.normal_max = contacts.normal_max / self.force
        matrix = np.zeros((count, 2, 3 * count + 1))
        self._unit_width = np.zeros((count, 3 * count + 1))
        for k in range(count):
            matrix[k, 0, 3 * k + 1] = 1.0
            matrix[k, 1, 3 * k + 2] = 1.0 if self.lifted else 0.0
            self._unit_width[k, 3 * k] = 1.0
        self.cones = Cones.made(matrix, np.zeros((count, 2)), self._unit_width, np.zeros(count))

    def forces(self, friction: Array) -> Array | None:
        """Forces (C, 3) [N] that balance the object's own weight, None where there are none.

        Over N, and friction forces as parts of their coefficients, the greatest excess over a cone is made as small
        as can be.
        """
        turned = np.ones((self.count, 3))
        turned[:, 1:] = friction[:, None]
        rows = np.column_stack([self.rows[:, :-1] * turned.ravel(), np.zeros(6)])
        lower, upper = self._bounds()
        lower[-1], upper[-1] = -float(self.normal_max.max(initial=0.0)), 2.0 * float(self.normal_max.sum()) + 1.0
        cones, load = self.cones, -self.rows[:, -1] * self.weight
        cones.width = np.column_stack([self._unit_width[:, :-1], np.ones(self.count)])
        for _ in range(ROUNDS):
            planes, limit = cones.planes()
            found = solve_lp(
                np.append(np.zeros(3 * self.count), 1.0),
                np.concatenate([rows, planes]),
                np.concatenate([load, np.full(limit.size, -np.inf)]),
                np.concatenate([load, limit]),
                lower,
                upper,
            )
            if found.status == "infeasible" or (found.optimal and found.x[-1] > _SLACK):
                return None
            if not found.optimal:
                break
            shares = found.x[:-1].reshape(self.count, 3)
            excess = (np.hypot(shares[:, 1], shares[:, 2]) - shares[:, 0]).max(initial=0.0)
            if excess <= 2.0 * _SLACK or not cones.cut(found.x):
                return np.asarray(shares * turned * self.force)
        raise NumericalError("the balance of the object could not be distinguished from imbalance")

    def used(self, forces: Array, base: Array) -> float:
        """Greatest friction per normal force and coefficient."""
        friction_force = np.hypot(forces[:, 1], forces[:, 2])
        live = (friction_force > _SLACK * self.force) & (base > 0.0)
        return float((friction_force[live] / np.maximum(base[live] * forces[live, 0], 1e-300)).max(initial=0.0))

    def greatest(self, friction: Array) -> float:
        """Greatest mass [kg]."""
        lower, upper = self._bounds()
        upper[-1] = float(self.normal_max.sum()) * (1.0 + float(friction.max(initial=0.0))) + 1.0
        cost = np.append(np.zeros(3 * self.count), -1.0)
        cones = replace(self.cones, width=self._unit_width * friction[:, None])
        found = solve_socp(cost, self.rows, 0.0, 0.0, lower, upper, cones)
        if not found.optimal:  # without weight nothing has to push
            raise NumericalError("the greatest mass could not be computed")
        return max(0.0, float(found.x[-1])) * self.force / self.weight_per_mass

    def _bounds(self) -> tuple[Array, Array]:
        """Least and most of the contacts' forces, and zeros for the last unknown."""
        lower, upper = np.zeros(3 * self.count + 1), np.zeros(3 * self.count + 1)
        # Cones limit friction forces; LPs over tangent planes alone need a finite bound beyond what cones could allow.
        reach = np.repeat(1e6 * self.normal_max[:, None], 2, axis=1)
        lower[:-1].reshape(-1, 3)[:, 1:] = -reach
        upper[:-1].reshape(-1, 3)[:, 0] = self.normal_max
        upper[:-1].reshape(-1, 3)[:, 1:] = reach if self.lifted else reach * np.array([1.0, 0.0])
        return lower, upper
