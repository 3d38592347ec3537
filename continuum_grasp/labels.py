"""Labels of entries: ``"name [unit]"``."""

from __future__ import annotations

import math

SHOWN_IN = {"m": (1e3, "mm"), "rad": (180.0 / math.pi, "deg")}
"""Factor and unit in which errors are shown to people, by SI unit."""


def split_unit(label: str) -> tuple[str, str]:
    """Name and unit of a label; the unit is empty where there is none."""
    name, bracket, unit = label.partition(" [")
    return (name, unit[:-1]) if bracket and unit.endswith("]") else (label, "")


def name_of(label: str) -> str:
    """The name without its unit."""
    return split_unit(label)[0]


def unit_of(label: str) -> str:
    """The unit behind a name."""
    return split_unit(label)[1]
