"""Entries of public structs from the names of a controller's vectors."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.export.fields import Field

__all__ = ["identifiers", "named_fields", "unit_of"]

Array = NDArray[np.float64]


def identifiers(labels: Iterable[str]) -> list[str]:
    """C identifiers of labels ``name [unit]``, each once."""
    found: list[str] = []
    for label in labels:
        name = re.sub(r"\W+", "_", label.split(" [")[0], flags=re.ASCII).strip("_")
        name = f"_{name}" if name[:1].isdigit() else name or "unnamed"
        count = 2
        unique = name
        while unique in found:
            unique, count = f"{name}_{count}", count + 1
        found.append(unique)
    return found


def unit_of(label: str) -> str:
    """Unit of a label; 1 where it has none, as names of a scene's zones do."""
    found = re.search(r" \[([\w ]+(?:/[\w ]+)*)\]$", label, re.ASCII)
    return found[1] if found else "1"


def named_fields(labels: Sequence[str], ranges: Array | None = None, text: str = "") -> tuple[Field, ...]:
    """Entries of a vector, with their ranges (size, 2)."""
    pairs = np.tile([-np.inf, np.inf], (len(labels), 1)) if ranges is None else ranges
    return tuple(
        Field(name, unit_of(label), text, float(low), float(high))
        for name, label, (low, high) in zip(identifiers(labels), labels, pairs, strict=True)
    )
