"""Labels of entries: ``"name [unit]"``."""

from __future__ import annotations


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
