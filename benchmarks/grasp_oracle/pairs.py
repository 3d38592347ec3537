"""Pinches by the tips of several fingers: shapes and forces together, by sequential quadratic programming.

Each finger has two elements of equal length whose curvature is linear, with the tip's curvature given by the balance
of moments there. Unknowns: three curvatures, two tensions and three forces per finger. Many starts; what comes out need
not be the very best, but it holds: every answer is checked with the equations of `forces`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from benchmarks.grasp_oracle.forces import Balance
from benchmarks.grasp_oracle.geometry import Fingers, Posture
from benchmarks.grasp_oracle.numbers import Hand, Numbers
from benchmarks.grasp_oracle.pair_tables import starts
from benchmarks.grasp_oracle.rod import NODES, WEIGHTS, section

Array = NDArray[Any]
STARTS = 6
MOST_STEPS = 80
EXACT = 1e-8
"""Greatest residual of an answer, as a part of the force scale or the length."""


@dataclass(frozen=True)
class Pinch:
    """A pinch.

    Attributes
    ----------
    value : float
        Sum of all tensions [N].
    postures : list of Posture
    x : ndarray
        Two tensions per finger, then N, f, lift per contact [N].
    """

    value: float
    postures: list[Posture]
    x: Array


class Pinches:
    """Pinches of one scene: tips of all fingers, no other contacts."""

    def __init__(self, numbers: Numbers) -> None:
        self.numbers = numbers
        self.hands = numbers.hands
        self.fingers = [Fingers(numbers, hand) for hand in self.hands]
        self.force = max(
            numbers.limits.mass * max(math.hypot(*numbers.gravity), numbers.lift),
            max(h.force_scale for h in self.hands),
        )
        self.pull = max(h.stiffness / (h.length * h.offset) for h in self.hands)
        self.spatial = numbers.lift != 0.0

    def best(self, count: int = STARTS) -> Pinch | None:
        """The least sum of tensions over all starts; None where no start leads to a pinch."""
        found = [self._solve(*start) for start in starts(self, count)]
        return min((f for f in found if f is not None), key=lambda p: p.value, default=None)

    # -- equations ---------------------------------------------------------------------------------------------

    def _solve(self, shapes: Array, nets: Array, borne: Array) -> Pinch | None:
        count = len(self.hands)
        forces = np.zeros((count, 3))
        forces[:, :2] = borne / self.force
        forces[:, 2] = 1.0 / count if self.spatial else 0.0
        pulls = np.stack([np.maximum(nets, 0.0), np.maximum(-nets, 0.0)], axis=1) / self.pull
        x = np.concatenate([shapes, pulls.ravel(), forces.ravel()])
        bounds = self._bounds(count)
        x = np.clip(x, *np.array(bounds).T)
        memory: dict[bytes, tuple[Array, Array]] = {}

        def equations(v: Array) -> tuple[Array, Array]:
            key = v.tobytes()
            if key not in memory:
                memory.clear()
                memory[key] = self._equations(v)
            return memory[key]

        cost = np.zeros(x.size)
        cost[3 * count : 5 * count] = 1.0
        found = minimize(
            lambda v: float(cost @ v),
            x,
            jac=lambda v: cost,
            bounds=bounds,
            method="SLSQP",
            constraints=[
                {"type": "eq", "fun": lambda v: equations(v)[0], "jac": lambda v: equations(v)[1]},
                {"type": "ineq", "fun": lambda v: self._cones(v)[0], "jac": lambda v: self._cones(v)[1]},
            ],
            options={"maxiter": MOST_STEPS, "ftol": 1e-11},
        )
        return self._checked(found.x)

    def _bounds(self, count: int) -> list[tuple[float, float]]:
        limits = self.numbers.limits
        bounds = [(-2.0 * math.pi * 2.0, 2.0 * math.pi * 2.0)] * (3 * count)
        for hand in self.hands:
            for least, used in zip(hand.least, hand.used, strict=True):
                bounds.append((least / self.pull, (limits.tension if used else least) / self.pull))
        far = 1e4
        for _ in range(count):
            bounds += [(0.0, limits.normal / self.force), (-far, far)]
            bounds.append((-far, far) if self.spatial else (0.0, 0.0))
        return bounds

    def _equations(self, v: Array) -> tuple[Array, Array]:
        """Residuals and their Jacobian: gaps and equilibria of the fingers, balance of the object."""
        count = len(self.hands)
        rows, slopes = [], []
        points, normals = np.zeros((count, 7, 2)), np.zeros((count, 7, 2))
        for k, hand in enumerate(self.hands):
            shape = v[3 * k : 3 * k + 3]
            pulls = v[3 * count + 2 * k : 3 * count + 2 * k + 2] * self.pull
            force = v[5 * count + 3 * k : 5 * count + 3 * k + 3] * self.force
            step = 1e-6
            moved = np.concatenate([[shape], shape + step * np.eye(3), shape - step * np.eye(3)])
            value, by_pull, by_force, points[k], normals[k] = self._finger(k, hand, moved, pulls, force)
            slope = np.zeros((4, v.size))
            slope[:, 3 * k : 3 * k + 3] = ((value[1:4] - value[4:7]) / (2 * step)).T
            slope[:, 3 * count + 2 * k] = by_pull * self.pull
            slope[:, 3 * count + 2 * k + 1] = -by_pull * self.pull
            slope[:, 5 * count + 3 * k : 5 * count + 3 * k + 2] = by_force * self.force
            rows.append(value[0])
            slopes.append(slope)
        value, slope = self._object(v, points, normals)
        return np.concatenate([*rows, value]), np.vstack([*slopes, slope])

    def _finger(self, k: int, hand: Hand, shapes: Array, pulls: Array, force: Array) -> tuple[Array, ...]:
        """For some shapes: gap, both equilibria, balance at the tip; slopes of the first by pulls and force."""
        numbers = self.numbers
        half = 0.5 * hand.length
        ends = np.stack([shapes[:, [0, 1]], shapes[:, [1, 2]]], axis=1) / hand.length
        lean = ends - hand.rest
        stiff = np.zeros((len(shapes), 2))
        stiff[:, 0] = half * (2 * lean[:, 0, 0] + lean[:, 0, 1]) / 6
        stiff[:, 1] = half * (lean[:, 0, 0] + 4 * lean[:, 0, 1] + lean[:, 1, 1]) / 6
        bend = np.array([0.5 * half, half])
        point, moves, turns, mean = self._tips(hand, ends, half)
        gap, normal = self.fingers[k].outline.nearest(point)
        across = np.stack([-normal[:, 1], normal[:, 0]], axis=-1)
        unit = hand.length**2 * self.force
        by_normal = np.einsum("bad,bd->ba", moves, normal)
        by_across = np.einsum("bad,bd->ba", moves, across) - hand.thickness * turns
        net = (pulls[0] - pulls[1]) * hand.offset
        gravity = np.array(numbers.gravity)
        work = hand.linear_density * mean @ gravity
        for at, mass in hand.masses:
            if gravity.any():
                work = work + mass * self._masses(hand, ends, half, at) @ gravity
        missing = hand.stiffness * stiff - work - net * bend - force[0] * by_normal - force[1] * by_across
        tip = hand.stiffness * lean[:, 1, 1] - net + hand.thickness * force[1]
        value = np.column_stack([gap / hand.length, missing / unit, tip / (hand.length * self.force)])
        by_pull = -hand.offset * np.array([0.0, *(bend / unit), 1.0 / (hand.length * self.force)])
        by_force = np.zeros((4, 2))
        by_force[1:3, 0], by_force[1:3, 1] = -by_normal[0] / unit, -by_across[0] / unit
        by_force[3, 1] = hand.thickness / (hand.length * self.force)
        return value, by_pull, by_force, point - hand.thickness * normal, normal

    def _tips(self, hand: Hand, ends: Array, half: float) -> tuple[Array, Array, Array, Array]:
        """Tips of many shapes: place, its change per nodal curvature (first two), change of angle, of the mean."""
        s = half * NODES
        w = half * WEIGHTS
        zero = np.zeros((len(ends), 1))
        first = hand.angle + ends[:, 0, :1] * s + (ends[:, 0, 1:] - ends[:, 0, :1]) * s**2 / (2 * half)
        joint = hand.angle + 0.5 * half * ends[:, 0].sum(axis=1, keepdims=True)
        second = joint + ends[:, 1, :1] * s + (ends[:, 1, 1:] - ends[:, 1, :1]) * s**2 / (2 * half)
        swing = np.array([s - s**2 / (2 * half), s**2 / (2 * half)])  # of the first element by its two ends
        swung = np.array([np.full_like(s, 0.5 * half), 0.5 * half + s - s**2 / (2 * half)])
        place = np.array(hand.base) + zero
        moves, mean = np.zeros((len(ends), 2, 2)), np.zeros((len(ends), 2, 2))
        for phi, by in ((first, swing), (second, swung)):
            tangent = np.stack([-np.sin(phi), np.cos(phi)], axis=-1)
            inward = np.stack([-np.cos(phi), -np.sin(phi)], axis=-1)
            mean = mean + half * moves + np.einsum("an,bnd,n->bad", by, inward, w * (half - s))
            place = place + np.einsum("bnd,n->bd", tangent, w)
            moves = moves + np.einsum("an,bnd,n->bad", by, inward, w)
        turns = np.tile([0.5 * half, half], (len(ends), 1))
        return place, moves, turns, mean

    @staticmethod
    def _masses(hand: Hand, ends: Array, half: float, at: float) -> Array:
        lengths = np.array([half, half])
        found = [section(hand.base, hand.angle, e, lengths, at).moves for e in ends]
        return np.array([[m[0], m[1] + m[2]] for m in found])

    def _object(self, v: Array, points: Array, normals: Array) -> tuple[Array, Array]:
        numbers, count = self.numbers, len(self.hands)
        first = 5 * count
        mass = numbers.limits.mass
        forces = v[first:].reshape(count, 3)

        def value(p: Array, n: Array, f: Array) -> Array:
            t = np.stack([-n[:, 1], n[:, 0]], axis=-1)
            load = f[:, :1] * n + f[:, 1:2] * t
            arm = (p - np.array(numbers.com)) / numbers.size
            out = [*(load.sum(axis=0) - mass * np.array(numbers.gravity) / self.force)]
            out.append(float((arm[:, 0] * load[:, 1] - arm[:, 1] * load[:, 0]).sum()))
            if self.spatial:
                out.append(float(f[:, 2].sum() - mass * numbers.lift / self.force))
                if numbers.balance:
                    out += [*(f[:, 2] @ arm)]
            return np.array(out)

        here = value(points[:, 0], normals[:, 0], forces)
        slope = np.zeros((len(here), v.size))
        for k in range(count):
            for j in range(3):
                ahead, behind = (
                    value(
                        np.concatenate([points[:k, 0], points[k, i][None], points[k + 1 :, 0]]),
                        np.concatenate([normals[:k, 0], normals[k, i][None], normals[k + 1 :, 0]]),
                        forces,
                    )
                    for i in (1 + j, 4 + j)
                )
                slope[:, 3 * k + j] = (ahead - behind) / 2e-6
                unit = np.zeros((count, 3))
                unit[k, j] = 1.0
                slope[:, first + 3 * k + j] = value(points[:, 0], normals[:, 0], forces + unit) - here
        return here, slope

    def _cones(self, v: Array) -> tuple[Array, Array]:
        count, mu = len(self.hands), self.numbers.limits.friction
        first = 5 * count
        values, slopes = [], []
        for k in range(count):
            n, f, lift = v[first + 3 * k : first + 3 * k + 3]
            at = slice(first + 3 * k, first + 3 * k + 3)
            if self.spatial:
                entries = [((mu * n) ** 2 - f**2 - lift**2, [2 * mu * mu * n, -2 * f, -2 * lift])]
            else:
                entries = [(mu * n - f, [mu, -1.0, 0.0]), (mu * n + f, [mu, 1.0, 0.0])]
            for value, gradient in entries:
                row = np.zeros(v.size)
                row[at] = gradient
                values.append(value)
                slopes.append(row)
        return np.array(values), np.array(slopes)

    # -- check -------------------------------------------------------------------------------------------------

    def _checked(self, v: Array) -> Pinch | None:
        count = len(self.hands)
        bounds = np.array(self._bounds(count))
        if not np.isfinite(v).all() or np.abs(self._equations(v)[0]).max() > EXACT:
            return None
        if self._cones(v)[0].min() < -EXACT or (v < bounds[:, 0] - EXACT).any() or (v > bounds[:, 1] + EXACT).any():
            return None
        postures = []
        for k, hand in enumerate(self.hands):
            shape = v[3 * k : 3 * k + 3] / hand.length
            ends = np.array([[shape[0], shape[1]], [shape[1], shape[2]]])
            posture = Posture(0.0, 1, ends, np.full(2, 0.5 * hand.length))
            if self.fingers[k].depth([posture])[0] > 1e-6 * hand.length:
                return None
            if np.abs(ends * 0.5 * hand.length).max() > self.numbers.limits.bend:
                return None
            postures.append(posture)
        x = np.concatenate([v[3 * count : 5 * count] * self.pull, v[5 * count :] * self.force])
        balance = Balance(self.numbers, postures)
        left = balance.rows @ x - balance.right - self.numbers.limits.mass * balance.weight
        if np.abs(left).max() > 10 * EXACT * self.force:
            return None
        return Pinch(float(x[: 2 * count].sum()), postures, x)
