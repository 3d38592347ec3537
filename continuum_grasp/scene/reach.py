"""Reach of a finger: goals, setpoints and waypoints are compared with it before anything is computed."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from continuum_grasp.base import InputError
from continuum_grasp.scene.cost import CircleReference
from continuum_grasp.scene.doubts import doubt
from continuum_grasp.scene.finger import Finger
from continuum_grasp.scene.objects import GraspObject
from continuum_grasp.scene.value import WRITTEN


class Reach:
    """Limits of goals and setpoints that a finger can meet, however it bends.

    A section of an inextensible rod is at most as far from its base as along the rod. A touched object is at most as
    far as the tip, plus its own extent and half the finger's thickness. Contacts push.

    Rows are x, y [m] of ``tip``, ``shape`` and of an object's ``position`` or ``object_position``, ``bending``,
    ``tip_angle`` and ``object_angle`` [rad], ``contact_force`` [N] and ``gap`` [m]; nothing else is compared. Points of
    ``shape`` are ``at`` positions along the finger [m], places of ``gap`` at ``touching``; an object that ``moves`` has
    no greatest gap. Without ``ranges``, the greatest bend of each element [rad], angles are not compared.
    """

    def __init__(
        self,
        finger: Finger,
        at: Sequence[float] = (),
        body: GraspObject | None = None,
        ranges: Sequence[float] = (),
        touching: Sequence[float] = (),
        moves: bool = True,
    ) -> None:
        self.finger = finger
        length, base = finger.rod.length, finger.base
        half = finger.thickness_radius
        touched = length + (half + max(part.extent for part in body.parts) if body else 0.0)
        self._radii: dict[str, Sequence[float]] = {
            "tip": [length],
            "shape": at,
            "object_position": [touched],
            "position": [touched],
        }
        self._limits: dict[str, tuple[str, str, Iterable[tuple[float, float]]]] = {
            "contact_force": ("N", "contacts push", itertools.repeat((0.0, math.inf))),
        }
        if ranges:
            bent, whole = "as far as its elements may bend", sum(ranges)
            self._limits["bending"] = "rad", bent, [(-limit, limit) for limit in ranges]
            self._limits["tip_angle"] = "rad", bent, [(base.angle - whole, base.angle + whole)]
        if body is not None:
            turn = 2.0 * math.pi
            self._limits["object_angle"] = "rad", "a turn", [(body.angle - turn, body.angle + turn)]
            apart, deepest = body.distance(base.position), -2.0 * body.size - half
            near = [
                (deepest, math.inf) if moves else (max(deepest, apart - place - half), apart + place)
                for place in touching
            ]
            self._limits["gap"] = "m", "the distance of the object", near

    def check(self, key: str, given: Mapping[str, Any]) -> None:
        """Refuse rows out of reach; the error has the key of the first one, below ``key``.

        ``given`` has rows by name, constant, over time or on a circle; functions of time are not compared.
        """
        for name, value in given.items():
            for where, row in rows_of(f"{key}.{name}" if key else name, value):
                self._check_row(name, where, row)
            if isinstance(value, CircleReference):
                _check_circle(self.finger, f"{key}.tip", value)

    def _check_row(self, name: str, where: str, row: Sequence[float]) -> None:
        for x, y, reach in zip(row[::2], row[1::2], self._radii.get(name, ()), strict=False):
            far = math.dist((x, y), self.finger.base.position)
            if far > reach * (1.0 + WRITTEN):
                words = f"({x:g}, {y:g}) m is {far:.4g} m from the finger's base"
                raise InputError(f"out of reach: {words}, expected at most {reach:.4g} m", key=where)
        unit, why, pairs = self._limits.get(name, ("", "", ()))
        for number, (low, high) in zip(row, pairs, strict=False):
            margin = _margin(low, high)
            if not low - margin <= number <= high + margin:
                words = f"{low:.4g} {unit} or more" if math.isinf(high) else f"{low:.4g} to {high:.4g} {unit}"
                raise InputError(f"out of reach: expected {words} ({why}), got {number:g} {unit}", key=where)

    def entries(self, name: str, size: int) -> list[tuple[float, float, float]]:
        """Return the limits of each of ``size`` entries of a row, and a radius: for the x of a point, of its circle.

        The circle has its center between the limits of x and y; the radius is 0 for all other entries. Entries that are
        not compared have infinite limits.
        """
        entries = [(-math.inf, math.inf, 0.0)] * size
        x, y = self.finger.base.position
        for k, reach in enumerate(self._radii.get(name, ())):
            radius = reach * (1.0 + WRITTEN)
            entries[2 * k : 2 * k + 2] = (x - radius, x + radius, radius), (y - radius, y + radius, 0.0)
        for k, (low, high) in zip(range(size), self._limits.get(name, ("", "", ()))[2], strict=False):
            margin = _margin(low, high)
            entries[k] = low - margin, high + margin, 0.0
        return entries


def _margin(low: float, high: float) -> float:
    """By how much a number may exceed its limits."""
    return WRITTEN * (high - low if math.isfinite(high) else abs(low))


def _check_circle(finger: Finger, key: str, circle: CircleReference) -> None:
    """Refuse a circle that no tip meets; doubt one that is met in part."""
    center, length = math.dist(circle.center, finger.base.position), finger.rod.length
    near_by, far, limit = abs(center - circle.radius), center + circle.radius, length * (1.0 + WRITTEN)
    if near_by > limit:
        words = f"every point of the circle is at least {near_by:.4g} m from the finger's base"
        raise InputError(f"out of reach: {words}, expected at most {length:.4g} m", key=key)
    if far > limit:
        doubt(key, f"is up to {far:.4g} m from the finger's base, which is out of its reach of {length:g} m")


def rows_of(key: str, value: Any) -> Iterator[tuple[str, Sequence[float]]]:
    """Rows of numbers that a value states, each with its key."""
    if hasattr(value, "values"):
        yield from ((f"{key}.values[{k}]", row) for k, row in enumerate(value.values))
    elif isinstance(value, Sequence):
        yield key, value
