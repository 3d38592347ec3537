"""Contact forces and tensions of a given shape, by linear programming.

Unknowns: two tensions per finger, then N, f and lift per contact. Friction cones out of the plane are cut by planes,
and cut again where an answer breaks them, until none is broken by more than a part in 1e9: what comes out is the
least of the conic program from below, to that part.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import linprog

from benchmarks.grasp_oracle.geometry import Posture
from benchmarks.grasp_oracle.numbers import Hand, Numbers
from benchmarks.grasp_oracle.rod import Array, Section, section

DIRECTIONS = 16
"""Planes per cone to begin with."""


@dataclass
class Touch:
    """A contact."""

    name: str
    point: Array
    """On the object [m]."""
    normal: Array
    """Outward of the object."""
    friction: float | None
    hand: int = -1
    section: Section | None = None

    @property
    def across(self) -> Array:
        """The normal turned by 90 degrees."""
        return np.array([-self.normal[1], self.normal[0]])


class Balance:
    """The equations of fingers and object at given shapes: ``rows @ x = right`` [N], moments divided by a length.

    ``weight`` is what ``right`` gains per kilogram of the object.
    """

    def __init__(self, numbers: Numbers, postures: list[Posture]) -> None:
        self.numbers = numbers
        self.touches: list[Touch] = []
        for k, (hand, posture) in enumerate(zip(numbers.hands, postures, strict=True)):
            self._touch(k, hand, posture)
        self.touches += [Touch(r.name, np.array(r.point), np.array(r.normal), r.friction) for r in numbers.rests]
        self.first = 2 * len(numbers.hands)
        self.width = self.first + 3 * len(self.touches)
        self._equations: list[tuple[Array, float, float]] = []
        for k, (hand, posture) in enumerate(zip(numbers.hands, postures, strict=True)):
            self._finger(k, hand, posture)
        self._object()
        self.rows, self.right, self.weight = (np.array(part) for part in zip(*self._equations, strict=True))

    def _touch(self, k: int, hand: Hand, posture: Posture) -> None:
        def at(s: float) -> Section:
            return section(hand.base, hand.angle, posture.ends, posture.lengths, s)

        spots = []
        if hand.middle:
            spots.append(("middle", at(float(posture.lengths[: hand.before].sum()))))
        if hand.tip:
            spots.append(("tip", at(float(posture.lengths.sum()))))
        for name, there in spots:
            normal = self.numbers.outline(hand.thickness).nearest(there.point)[1]
            place = there.point - hand.thickness * normal
            self.touches.append(Touch(f"{hand.name}.{name}", place, normal, None, k, there))

    def _add(self, row: Array, right: float, weight: float = 0.0) -> None:
        self._equations.append((row, right, weight))

    def _finger(self, k: int, hand: Hand, posture: Posture) -> None:
        ends, lengths = posture.ends, posture.lengths
        count, bend = len(lengths), np.repeat(0.5 * lengths, 2)
        at, gravity = (hand.base, hand.angle, ends, lengths), np.array(self.numbers.gravity)
        missing = bending_work(hand.stiffness, ends - hand.rest, lengths)
        missing -= weight_work(at, hand.linear_density, hand.masses, gravity)
        free = basis(hand.family, count)
        rows = np.zeros((2 * count, self.width))
        rows[:, 2 * k], rows[:, 2 * k + 1] = hand.offset * bend, -hand.offset * bend
        for c, touch in enumerate(self.touches):
            if touch.hand == k and touch.section is not None:
                there = touch.section
                rows[:, self.first + 3 * c] = there.moves @ touch.normal
                rows[:, self.first + 3 * c + 1] = there.moves @ touch.across - hand.thickness * there.turns
        unit = hand.length**2  # moment per curvature, as a force
        for row, right in zip(free @ rows / unit, free @ missing / unit, strict=True):
            self._add(row, float(right))
        if hand.family == "matched_clothoid":
            row = np.zeros(self.width)
            row[2 * k], row[2 * k + 1] = hand.offset, -hand.offset
            for c, touch in enumerate(self.touches):
                if touch.name == f"{hand.name}.tip":
                    row[self.first + 3 * c + 1] = -hand.thickness
            self._add(row / hand.length, hand.stiffness * (ends[-1, 1] - hand.rest) / hand.length)

    def _object(self) -> None:
        numbers = self.numbers
        force, moment = np.zeros((2, self.width)), np.zeros(self.width)
        lift, tilt = np.zeros(self.width), np.zeros((2, self.width))
        for c, touch in enumerate(self.touches):
            at = self.first + 3 * c
            arm = (touch.point - np.array(numbers.com)) / numbers.size
            for j, direction in enumerate((touch.normal, touch.across)):
                force[:, at + j] = direction
                moment[at + j] = arm[0] * direction[1] - arm[1] * direction[0]
            lift[at + 2] = 1.0
            tilt[:, at + 2] = arm
        for axis in range(2):
            self._add(force[axis], 0.0, numbers.gravity[axis])
        self._add(moment, 0.0)
        self._add(lift, 0.0, numbers.lift)
        if numbers.balance:
            self._add(tilt[0], 0.0)
            self._add(tilt[1], 0.0)

    def coefficient(self, c: int, friction: float) -> float:
        """Friction coefficient of a contact."""
        own = self.touches[c].friction
        return friction if own is None else own


class Forces:
    """Linear programs over the equations; the planes that cut the cones are retained from one to the next."""

    def __init__(self, numbers: Numbers, cuts: dict[str, list[float]] | None = None) -> None:
        self.numbers = numbers
        self.cuts: dict[str, list[float]] = {} if cuts is None else cuts

    def least(
        self, balance: Balance, aim: str = "sum", exact: bool = True, drop: tuple[int, ...] = (), loose: float = 0.0
    ) -> tuple[float, Array] | None:
        """Least of something over all forces that hold; None where there are none.

        ``aim``: the sum of the tensions; the greatest "tension"; the greatest "normal" force; minus the object's
        "mass"; or "slack", the force by which every limit of tensions and contact forces must give way [N]. ``exact``:
        cut the cones until they hold. ``drop``: equations left out. ``loose``: residual of the equations that counts as
        none, per the scale of forces: of shapes that are rounded.
        """
        limits, numbers, first = self.numbers.limits, self.numbers, balance.first
        width = balance.width + 1  # one more: what is aimed at
        count = len(balance.touches)
        scale = numbers.scale
        rows = np.hstack([balance.rows, np.zeros((len(balance.rows), 1))])
        right = balance.right + (0.0 if aim == "mass" else limits.mass) * balance.weight
        if aim == "mass":
            rows[:, -1] = -balance.weight / scale
        keep = [k for k in range(len(rows)) if k not in drop and np.abs(rows[k]).max() > 0.0]
        cost = np.zeros(width)
        if aim == "sum":
            cost[:first] = 1.0
        else:
            cost[-1] = -1.0 if aim == "mass" else 1.0
        most_normal = np.inf if aim == "normal" else limits.normal
        bounds: list[tuple[Any, Any]] = []
        for hand in numbers.hands:
            most_tension = np.inf if aim == "tension" else numbers.most_tension(hand)
            for t, used in zip(hand.least, hand.used, strict=True):
                bounds.append((t / scale, (most_tension if used else t) / scale))
        spatial = numbers.lift != 0.0
        bounds += [(0.0, most_normal / scale), (None, None), (None, None) if spatial else (0.0, 0.0)] * count
        bounds.append((0.0, 0.0) if aim == "sum" else (0.0, None))
        upper: list[Array] = []
        above: list[float] = []
        if aim == "slack":
            for k, (low, high) in enumerate(bounds[:-1]):
                if high != 0.0 and low is not None:
                    upper += [_row(width, {k: 1.0, width - 1: -1.0}), _row(width, {k: -1.0, width - 1: -1.0})]
                    above += [high, -low]
                    bounds[k] = (None, None)
        if loose:
            upper += [sign * rows[k] for k in keep for sign in (1.0, -1.0)]
            above += [sign * right[k] / scale + loose for k in keep for sign in (1.0, -1.0)]
            keep = []
        for k in range(first if aim == "tension" else 0):
            upper.append(_row(width, {k: 1.0, width - 1: -1.0}))
        for c in range(count if aim == "normal" else 0):
            upper.append(_row(width, {first + 3 * c: 1.0, width - 1: -1.0}))
        for _ in range(40):
            cone = []
            for c, touch in enumerate(balance.touches):
                mu = balance.coefficient(c, limits.friction)
                for angle in self._angles(touch.name, spatial):
                    entries = {first + 3 * c: -mu, first + 3 * c + 1: math.cos(angle)}
                    entries[first + 3 * c + 2] = math.sin(angle)
                    if aim == "slack":
                        entries[width - 1] = -1.0
                    cone.append(_row(width, entries))
            matrix = np.array(upper + cone)
            right_above = np.zeros(len(matrix))
            right_above[: len(above)] = above
            found = linprog(
                cost,
                A_ub=matrix if len(matrix) else None,
                b_ub=right_above if len(matrix) else None,
                A_eq=rows[keep],
                b_eq=right[keep] / scale,
                bounds=bounds,
                method="highs",
                options={"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10},
            )
            if found.status != 0:
                return None
            x = found.x
            slack = x[-1] if aim == "slack" else 0.0
            if not spatial or not exact or not self._cut(balance, x, slack):
                break
        value = float(found.fun)
        if aim == "mass":
            return -value, np.append(x[:-1] * scale, x[-1])
        return value * scale, x[:-1] * scale

    def _angles(self, name: str, spatial: bool) -> list[float]:
        if not spatial:
            return [0.0, math.pi]
        if name not in self.cuts:
            self.cuts[name] = [2.0 * math.pi * k / DIRECTIONS for k in range(DIRECTIONS)]
        return self.cuts[name]

    def _cut(self, balance: Balance, x: Array, slack: float) -> bool:
        """Add planes where an answer breaks the cones; whether any was needed."""
        broken = False
        scale = float(np.abs(x[balance.first : -1]).max(initial=1e-300))
        for c, touch in enumerate(balance.touches):
            n, f, lift = x[balance.first + 3 * c : balance.first + 3 * c + 3]
            over = math.hypot(f, lift) - balance.coefficient(c, self.numbers.limits.friction) * n - slack
            if over > 1e-9 * scale:
                self.cuts[touch.name].append(math.atan2(lift, f))
                broken = True
        return broken


def _row(width: int, entries: dict[int, float]) -> Array:
    row = np.zeros(width)
    for k, value in entries.items():
        row[k] = value
    return row


def basis(family: str, count: int) -> Array:
    """How the curvatures at the elements' ends follow the coordinates in which a finger is in equilibrium."""
    if family == "arc":
        return np.kron(np.eye(count), np.ones(2))
    nodes = np.zeros((count + 1, 2 * count))
    for k in range(count):
        nodes[k, 2 * k] = nodes[k + 1, 2 * k + 1] = 1.0
    return nodes[:-1] if family == "matched_clothoid" else nodes


def bending_work(stiffness: float, lean: Array, lengths: Array) -> Array:
    """Change of the elastic energy with the curvatures at both ends of each element, given these above rest."""
    a, b = lean.T
    return stiffness * np.stack([lengths * (2 * a + b) / 6.0, lengths * (a + 2 * b) / 6.0], axis=1).ravel()


def weight_work(at: tuple[Any, ...], density: float, masses: Iterable[tuple[float, float]], gravity: Array) -> Array:
    """Work of the weight of a rod and of masses on it with these curvatures; ``at``: what ``section`` takes first."""
    lengths = at[3]
    if not gravity.any():
        return np.zeros(2 * len(lengths))
    work = density * section(*at, float(lengths.sum())).mean_moves @ gravity
    for place, mass in masses:
        work = work + mass * section(*at, place).moves @ gravity
    return work
