"""Scenes in other units of length, mass and time, powers of two: what has no unit of its own is the same to the bit."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any, get_args

from continuum_grasp.scene.units import Unit
from continuum_grasp.scene.value import Value

BASE = {"m": "L", "kg": "M", "s": "T", "N": "LM/TT", "Pa": "M/LTT", "Hz": "/T", "rad": "", "1": ""}


def power(unit: str, sizes: Mapping[str, int]) -> int:
    """Power of two by which a value in a unit is larger."""
    total = 0
    above, *below = unit.split("/")
    for words, sign in ((above, 1), *((part, -1) for part in below)):
        for symbol, times in re.findall(r"(kg|Pa|Hz|rad|[msN1])([2-4]?)", words):
            over, _, under = BASE[symbol].partition("/")
            total += sign * int(times or 1) * (sum(map(sizes.get, over)) - sum(map(sizes.get, under)))
    return total


def _units(annotation: Any) -> Iterator[Unit]:
    for one in (*getattr(annotation, "__metadata__", ()), *get_args(annotation)):
        if isinstance(one, Unit):
            yield one
        else:
            yield from _units(one)


def larger(value: Any, sizes: Mapping[str, int], unit: str | None = None) -> Any:
    """A part of a scene in other units."""
    if isinstance(value, Value):
        fields = type(value).model_fields
        of = {key: [*fields[key].metadata, *_units(fields[key].annotation)] for key, _ in value}
        units = {key: next((one.si for one in found if isinstance(one, Unit)), None) for key, found in of.items()}
        changed = {key: larger(entry, sizes, units[key] or unit) for key, entry in value}
        return value.replaced(**{key: entry for key, entry in changed.items() if entry != getattr(value, key)})
    if isinstance(value, tuple):
        return tuple(larger(entry, sizes, unit) for entry in value)
    if isinstance(value, dict):
        return {key: larger(entry, sizes, unit) for key, entry in value.items()}
    return value * 2.0 ** power(unit, sizes) if isinstance(value, float) and unit else value
