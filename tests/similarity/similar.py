"""Scenes in other units of length, mass and time, powers of two: what has no unit of its own is the same to the bit."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any, get_args

from continuum_grasp.scene import Unit, Value

BASE = {"m": "L", "kg": "M", "s": "T", "N": "LM/TT", "Pa": "M/LTT", "Hz": "/T", "rad": "", "1": ""}
OF_MATERIALS = {"dissipation"}
"""Keys whose default has a unit: 1 s/m is rubber's, in fingers of all sizes."""


def power(unit: str, sizes: Mapping[str, int]) -> float:
    """Power of two by which a value in a unit is larger."""
    total = 0.0
    # A root of a power spectral density: that of an acceleration is rad/s2 per root of Hz.
    above, *below = unit.replace("/s2 s^0.5", "/s1.5").replace("s^0.5", "s0.5").split("/")
    for words, sign in ((above, 1), *((part, -1) for part in below)):
        for symbol, times in re.findall(r"(kg|Pa|Hz|rad|[msN1])([0-9.]*)", words):
            over, _, under = BASE[symbol].partition("/")
            total += sign * float(times or 1) * (sum(map(sizes.get, over)) - sum(map(sizes.get, under)))
    return total


def _units(annotation: Any) -> Iterator[Unit]:
    for one in (*getattr(annotation, "__metadata__", ()), *get_args(annotation)):
        if isinstance(one, Unit):
            yield one
        else:
            yield from _units(one)


def larger(value: Any, sizes: Mapping[str, int], *, unit: str | None = None, of_input: str = "N") -> Any:
    """A part of a scene in other units; ``of_input`` is that of the commands.

    What a scene leaves open stays open: defaults but those of ``OF_MATERIALS`` have no units of their own.
    """
    if isinstance(value, Value):
        fields = type(value).model_fields
        changed = {}
        for name, entry in value:
            if name not in value.model_fields_set | OF_MATERIALS:
                continue
            found = [*fields[name].metadata, *_units(fields[name].annotation)]
            own = next((one.si for one in found if isinstance(one, Unit)), None)
            changed[name] = larger(entry, sizes, unit=_in_words(own, unit, of_input), of_input=of_input)
        return value.replaced(**{name: entry for name, entry in changed.items() if entry != getattr(value, name)})
    if isinstance(value, tuple):
        return tuple(larger(entry, sizes, unit=unit, of_input=of_input) for entry in value)
    if isinstance(value, dict):
        return {name: larger(entry, sizes, unit=unit, of_input=of_input) for name, entry in value.items()}
    return value * 2.0 ** power(unit, sizes) if isinstance(value, float) and unit else value


def _in_words(own: str | None, outer: str | None, of_input: str) -> str | None:
    """Unit of a field: its own, that of what it is given for, or in words that of an error or of the commands."""
    squared = " ".join(f"{one}2" for one in of_input.split())
    words = {
        "per second and square of the error's unit": f"{outer}/s",
        "per square of the error's unit": outer,
        "per second and square of the input's unit": f"1/{squared}/s",
        "s per square of the input's unit": f"s/{squared}",
        "unit of the input per second": f"{of_input}/s",
        "unit of the input": of_input,
        "N or N m": of_input,
    }
    return words.get(own, own) if own else outer
