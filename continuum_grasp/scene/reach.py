"""Reach of a finger: goals, setpoints and waypoints are compared with it before anything is computed."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from continuum_grasp.base import InputError
from continuum_grasp.scene.cost import CircleReference
from continuum_grasp.scene.finger import Finger
from continuum_grasp.scene.objects import GraspObject
from continuum_grasp.scene.value import doubt

_ROUNDING = 1e-6
"""Share of a reach by which a number may exceed it [1]: the tip of a straight finger, written with six digits."""


def check_reach(
    finger: Finger,
    key: str,
    given: Mapping[str, Any],
    at: Sequence[float] = (),
    body: GraspObject | None = None,
    ranges: Sequence[float] = (),
    touching: Sequence[float] = (),
    moves: bool = True,
) -> None:
    """Refuse goals and setpoints that a finger cannot meet, however it bends.

    A section of an inextensible rod is as far from its base as it is along the rod, or nearer. An object is touched
    where it is as far as the tip, or farther by its own extent and half the finger's thickness. Contacts push. The
    error has the key of the first that is out of reach, below ``key``, where they stand in the scene.

    ``given`` are rows, constant, over time or on a circle: x, y [m] of ``tip``, ``shape`` and of an object's
    ``position`` or ``object_position``, ``bending``, ``tip_angle`` and ``object_angle`` [rad], ``contact_force`` [N]
    and ``gap`` [m]; nothing else is compared, nor functions of time. Points of ``shape`` are ``at`` positions along the
    finger [m], places of ``gap`` at ``touching``; an object that ``moves`` has no greatest gap. Without ``ranges``, the
    bending range of each element [rad], angles are not compared.
    """
    length, base = finger.rod.length, finger.base
    half = finger.thickness_radius
    touched = length + (half + max(part.extent for part in body.parts) if body else 0.0)
    reaches = {"tip": [length], "shape": at, "object_position": [touched], "position": [touched]}
    limits: dict[str, tuple[str, str, Iterable[tuple[float, float]]]] = {
        "contact_force": ("N", "contacts push", itertools.repeat((0.0, math.inf))),
    }
    if ranges:
        bent, whole = "the bending range of the model, fidelity.bending_range", sum(ranges)
        limits["bending"] = "rad", bent, [(-limit, limit) for limit in ranges]
        limits["tip_angle"] = "rad", bent, [(base.angle - whole, base.angle + whole)]
    if body is not None:
        limits["object_angle"] = "rad", "a turn", [(body.angle - 2.0 * math.pi, body.angle + 2.0 * math.pi)]
        apart, deepest = body.distance(base.position), -2.0 * body.size - half
        near = [
            (deepest, math.inf) if moves else (max(deepest, apart - place - half), apart + place) for place in touching
        ]
        limits["gap"] = "m", "the distance of the object", near
    for name, value in given.items():
        for where, row in _rows(f"{key}.{name}" if key else name, value):
            for x, y, reach in zip(row[::2], row[1::2], reaches.get(name, ()), strict=False):
                far = math.dist((x, y), base.position)
                if far > reach * (1.0 + _ROUNDING):
                    words = f"({x:g}, {y:g}) m is {far:.4g} m from the finger's base"
                    raise InputError(f"out of reach: {words}, expected {reach:.4g} m at most", key=where)
            unit, why, pairs = limits.get(name, ("", "", ()))
            for number, (low, high) in zip(row, pairs, strict=False):
                margin = _ROUNDING * (high - low if math.isfinite(high) else abs(low))
                if not low - margin <= number <= high + margin:
                    words = f"{low:.4g} {unit} or more" if math.isinf(high) else f"{low:.4g} to {high:.4g} {unit}"
                    raise InputError(f"out of reach: expected {words} ({why}), got {number:g} {unit}", key=where)
        if isinstance(value, CircleReference):
            _check_circle(finger, f"{key}.tip", value)


def _check_circle(finger: Finger, key: str, circle: CircleReference) -> None:
    """Refuse a circle that no tip meets; doubt one that is met in part."""
    center, length = math.dist(circle.center, finger.base.position), finger.rod.length
    near_by, far, limit = abs(center - circle.radius), center + circle.radius, length * (1.0 + _ROUNDING)
    if near_by > limit:
        words = f"the circle is nowhere nearer than {near_by:.4g} m to the finger's base"
        raise InputError(f"out of reach: {words}, expected {length:.4g} m at most", key=key)
    if far > limit:
        doubt(f"{key} is up to {far:.4g} m from the finger's base, which is out of its reach of {length:g} m")


def _rows(key: str, value: Any) -> Iterator[tuple[str, Sequence[float]]]:
    """Rows of numbers that a value states, each with its key."""
    if hasattr(value, "values"):
        yield from ((f"{key}.values[{k}]", row) for k, row in enumerate(value.values))
    elif isinstance(value, Sequence):
        yield key, value
