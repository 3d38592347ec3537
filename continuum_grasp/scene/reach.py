"""What a finger can reach: goals, setpoints and waypoints are compared with it before anything is computed."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from continuum_grasp.errors import InputError
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
) -> None:
    """Refuse goals and setpoints that a finger cannot meet, however it bends.

    A section of an inextensible rod is as far from its base as it is along the rod, or nearer. An object is touched
    where it is as far as the tip, or farther by its own extent and half the finger's thickness.

    Parameters
    ----------
    finger : Finger
    key : str
        Where they stand in the scene, such as ``goal``.
    given : mapping of str to value
        Rows, constant, over time or on a circle: x, y [m] of ``tip``, ``shape`` and of an object's ``position`` or
        ``object_position``, ``bending`` and ``tip_angle`` [rad]; nothing else is compared, nor functions of time.
    at : sequence of float
        Positions along the finger of the points of ``shape`` [m].
    body : GraspObject, optional
        The object that is to be touched.
    ranges : sequence of float
        Bending range of each element of the model [rad]; without these, angles are not compared.

    Raises
    ------
    InputError
        With the key of the first that is out of reach, its value and the reach.
    """
    length, base = finger.rod.length, finger.base
    touched = length + (finger.thickness_radius + max(part.extent for part in body.parts) if body else 0.0)
    reaches = {"tip": [length], "shape": at, "object_position": [touched], "position": [touched]}
    bends = {"bending": (0.0, ranges), "tip_angle": (base.angle, [sum(ranges)] if ranges else [])}
    for name, value in given.items():
        for where, row in _rows(f"{key}.{name}" if key else name, value):
            for x, y, reach in zip(row[::2], row[1::2], reaches.get(name, ()), strict=False):
                far = math.dist((x, y), base.position)
                if far > reach * (1.0 + _ROUNDING):
                    words = f"({x:g}, {y:g}) m is {far:.4g} m from the finger's base"
                    raise InputError(f"out of reach: {words}, expected {reach:.4g} m at most", key=where)
            middle, most = bends.get(name, (0.0, ()))
            for angle, reach in zip(row, most, strict=False):
                if abs(angle - middle) > reach * (1.0 + _ROUNDING):
                    words = f"expected {middle - reach:.4g} to {middle + reach:.4g} rad, the bending range of the model"
                    raise InputError(f"out of reach: {words} (fidelity.bending_range), got {angle:g} rad", key=where)
        if isinstance(value, CircleReference):
            center, limit = math.dist(value.center, base.position), length * (1.0 + _ROUNDING)
            near, far = abs(center - value.radius), center + value.radius
            if near > limit:
                words = f"the circle is nowhere nearer than {near:.4g} m to the finger's base"
                raise InputError(f"out of reach: {words}, expected {length:.4g} m at most", key=f"{key}.tip")
            if far > limit:
                doubt(
                    f"{key}.tip is up to {far:.4g} m from the finger's base, which is out of its reach of {length:g} m"
                )


def _rows(key: str, value: Any) -> Iterator[tuple[str, Sequence[float]]]:
    """Rows of numbers that a value states, each with its key."""
    if hasattr(value, "values"):
        yield from ((f"{key}.values[{k}]", row) for k, row in enumerate(value.values))
    elif isinstance(value, Sequence):
        yield key, value
