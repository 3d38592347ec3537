"""Pinches by the tips of several fingers, also against walls: shapes and forces together, by SQP.

Each finger has two elements of equal length whose curvature is linear, with the tip's curvature given by the balance
of moments there. Unknowns: three curvatures and two tensions per finger, three forces per contact. Many starts; what
comes out need not be the very best, but it holds: every answer is checked with the equations of `forces`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from benchmarks.grasp_oracle.forces import Balance
from benchmarks.grasp_oracle.geometry import Fingers, Posture
from benchmarks.grasp_oracle.numbers import Hand, Numbers
from benchmarks.grasp_oracle.pinch_tables import starts
from benchmarks.grasp_oracle.rod import NODES, WEIGHTS, section, walk

Array = NDArray[Any]
STARTS = 6
MOST_STEPS = 80
EXACT = 1e-8
"""Greatest residual of an answer, as a part of the force scale or the length."""
GUARDED = (0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.87, 0.93, 0.97)
"""Places along a finger, per its length, that stay clear of the object and the walls from the start."""
ROUNDS = 5
"""How often a solution is made again, clear also at the places where it passed through something."""
DEPTH = 1e-6
"""Depth in the object or a wall that counts as none, as a part of the length."""


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
    """Pinches of one scene: tips of all fingers, and the walls on which the object lies."""

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
        self.rests = numbers.rests
        self.contacts = len(self.hands) + len(self.rests)
        own = [rest.friction for rest in self.rests]
        self.friction = [numbers.limits.friction] * len(self.hands)
        self.friction += [numbers.limits.friction if f is None else f for f in own]

    def best(self, count: int = STARTS) -> Pinch | None:
        """The least sum of tensions over all starts; None where no start leads to a pinch."""
        found = [self.solve(*start) for start in starts(self, count)]
        return min((f for f in found if f is not None), key=lambda p: p.value, default=None)

    # -- equations ---------------------------------------------------------------------------------------------

    def solve(self, shapes: Array, nets: Array, borne: Array) -> Pinch | None:
        """The pinch next to a start; solved once more with clearance where a finger passes through something."""
        forces = np.zeros((self.contacts, 3))
        forces[:, :2] = borne / self.force
        forces[:, 2] = self.numbers.limits.mass * self.numbers.lift / self.force / self.contacts
        pulls = np.stack([np.maximum(nets, 0.0), np.maximum(-nets, 0.0)], axis=1) / self.pull
        x = np.concatenate([shapes, pulls.ravel(), forces.ravel()])
        x = np.clip(x, *np.array(self._bounds()).T)
        guarded = [np.array(GUARDED) for _ in self.hands]
        for _ in range(ROUNDS):
            x = self._minimized(x, guarded)
            if self._residual(x) > EXACT:
                return None
            if self._depth(x) <= DEPTH:
                return self._checked(x)
            guarded = [np.append(g, more) for g, more in zip(guarded, self._valleys(x), strict=True)]
        return None

    def _minimized(self, x: Array, guarded: list[Array]) -> Array:
        count, bounds = len(self.hands), self._bounds()

        @lru_cache(maxsize=1)
        def equated(key: bytes) -> tuple[Array, Array]:
            return self._equations(np.frombuffer(key))

        @lru_cache(maxsize=1)
        def cleared(key: bytes) -> tuple[Array, Array]:
            return self._gaps(np.frombuffer(key), guarded)

        def equations(v: Array) -> tuple[Array, Array]:
            return equated(v.tobytes())

        def gaps(v: Array) -> tuple[Array, Array]:
            return cleared(v.tobytes())

        cost = np.zeros(x.size)
        cost[3 * count : 5 * count] = 1.0
        constraints = [
            {"type": "eq", "fun": lambda v: equations(v)[0], "jac": lambda v: equations(v)[1]},
            {"type": "ineq", "fun": lambda v: self._cones(v)[0], "jac": lambda v: self._cones(v)[1]},
            {"type": "ineq", "fun": lambda v: gaps(v)[0], "jac": lambda v: gaps(v)[1]},
        ]
        found = minimize(
            lambda v: float(cost @ v),
            x,
            jac=lambda v: cost,
            bounds=bounds,
            method="SLSQP",
            constraints=constraints,
            options={"maxiter": MOST_STEPS, "ftol": 1e-11},
        )
        return np.asarray(found.x)

    def _bounds(self) -> list[tuple[float, float]]:
        limits, count = self.numbers.limits, len(self.hands)
        bounds = [(-2.0 * math.pi * 2.0, 2.0 * math.pi * 2.0)] * (3 * count)
        for hand in self.hands:
            for least, used in zip(hand.least, hand.used, strict=True):
                bounds.append((least / self.pull, (self.numbers.most_tension(hand) if used else least) / self.pull))
        far = 1e4
        for _ in range(self.contacts):
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
        forces = v[first:].reshape(self.contacts, 3)
        rest_points = np.array([rest.point for rest in self.rests]).reshape(-1, 2)
        rest_normals = np.array([rest.normal for rest in self.rests]).reshape(-1, 2)

        def value(p: Array, n: Array, f: Array) -> Array:
            p, n = np.concatenate([p, rest_points]), np.concatenate([n, rest_normals])
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
        for k, j in np.ndindex(self.contacts, 3):
            unit = np.zeros((self.contacts, 3))
            unit[k, j] = 1.0
            slope[:, first + 3 * k + j] = value(points[:, 0], normals[:, 0], forces + unit) - here
        return here, slope

    def _cones(self, v: Array) -> tuple[Array, Array]:
        first = 5 * len(self.hands)
        values, slopes = [], []
        for k, mu in enumerate(self.friction):
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

    def _gaps(self, v: Array, guarded: list[Array]) -> tuple[Array, Array]:
        """Gaps of the guarded places to the object and the walls, per length; how much the tips face the object."""
        step = 1e-6
        values, slopes = [], []
        for k, hand in enumerate(self.hands):
            shape = v[3 * k : 3 * k + 3]
            moved = np.concatenate([[shape], shape + step * np.eye(3), shape - step * np.eye(3)])
            ends = np.stack([moved[:, [0, 1]], moved[:, [1, 2]]], axis=1) / hand.length
            gaps = [g / hand.length for g in self._clearances(k, places_on(hand, ends, np.append(guarded[k], 1.0)))]
            gaps[0] = gaps[0][:, :-1]  # the tip touches the object
            tips = places_on(hand, ends, np.array([1.0]))
            angle = hand.angle + 0.25 * hand.length * ends.sum(axis=(1, 2))
            normal = self.fingers[k].outline.nearest(tips)[1][:, 0]
            gaps.append((np.sin(angle) * normal[:, 0] - np.cos(angle) * normal[:, 1])[:, None])
            gap = np.concatenate(gaps, axis=1)
            slope = np.zeros((gap.shape[1], v.size))
            slope[:, 3 * k : 3 * k + 3] = ((gap[1:4] - gap[4:7]) / (2 * step)).T
            values.append(gap[0])
            slopes.append(slope)
        return np.concatenate(values), np.vstack(slopes)

    def _clearances(self, k: int, places: Array) -> list[Array]:
        """Gaps of a finger's places to the object and to each wall [m]."""
        finger = self.fingers[k]
        gaps = [finger.outline.gap(places)]
        for point, normal in self.numbers.walls:
            gaps.append((places - np.array(point)) @ np.array(normal) - finger.allowed(point, normal))
        return gaps

    def _valleys(self, v: Array) -> list[Array]:
        """Where each finger is deepest in something, per its length."""
        found = []
        line = np.linspace(0.0, 1.0, 401)
        for k, (hand, posture) in enumerate(zip(self.hands, self._postures(v), strict=True)):
            places: list[float] = []
            for gap in self._clearances(k, places_on(hand, posture.ends[None], line)):
                before, here, after = gap[0, :-2], gap[0, 1:-1], gap[0, 2:]
                places += list(line[1:-1][(here <= before) & (here <= after) & (here < 0.0)])
            found.append(np.array(places))
        return found

    # -- check -------------------------------------------------------------------------------------------------

    def _residual(self, v: Array) -> float:
        return float(np.abs(self._equations(v)[0]).max()) if np.isfinite(v).all() else math.inf

    def _postures(self, v: Array) -> list[Posture]:
        found = []
        for k, hand in enumerate(self.hands):
            shape = v[3 * k : 3 * k + 3] / hand.length
            ends = np.array([[shape[0], shape[1]], [shape[1], shape[2]]])
            found.append(Posture(0.0, 1, ends, np.full(2, 0.5 * hand.length)))
        return found

    def _depth(self, v: Array) -> float:
        """Deepest that any finger passes through something, per its length."""
        pairs = zip(self.fingers, self._postures(v), strict=True)
        return max(float(finger.depth([posture])[0]) / finger.hand.length for finger, posture in pairs)

    def _checked(self, v: Array) -> Pinch | None:
        count = len(self.hands)
        bounds = np.array(self._bounds())
        if self._residual(v) > EXACT or self._depth(v) > DEPTH:
            return None
        if self._cones(v)[0].min() < -EXACT or (v < bounds[:, 0] - EXACT).any() or (v > bounds[:, 1] + EXACT).any():
            return None
        postures = self._postures(v)
        if max(float(np.abs(p.ends * p.lengths[:, None]).max()) for p in postures) > self.numbers.limits.bend:
            return None
        x = np.concatenate([v[3 * count : 5 * count] * self.pull, v[5 * count :] * self.force])
        balance = Balance(self.numbers, postures)
        left = balance.rows @ x - balance.right - self.numbers.limits.mass * balance.weight
        if np.abs(left).max() > 10 * EXACT * self.force:
            return None
        return Pinch(float(x[: 2 * count].sum()), postures, x)


def places_on(hand: Hand, ends: Array, at: Array) -> Array:
    """Points of backbones of two equal elements, curvatures (n, 2, 2), at parts of the length: (n, places, 2) [m]."""
    half = 0.5 * hand.length
    (a, b), (c, d) = (ends[:, k, :, None].transpose(1, 0, 2) for k in (0, 1))
    first, second = np.clip(2.0 * at, 0.0, 1.0), np.clip(2.0 * at - 1.0, 0.0, 1.0)
    joint = hand.angle + 0.5 * half * (a + b)
    return np.asarray(
        np.array(hand.base)
        + walk(hand.angle, a, a + (b - a) * first, half * first)
        + walk(joint, c, c + (d - c) * second, half * second)
    )
