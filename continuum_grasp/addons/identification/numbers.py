"""Measured numbers: a table for each set, and the numbers of all sets in one order."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.base import Array

SHOWN_IN = {"m": (1e3, "mm"), "rad": (180.0 / math.pi, "deg")}
"""Factor and unit in which errors are shown to people, by SI unit."""


class MeasuredColumn(NamedTuple):
    """Description of a column of measured numbers."""

    name: str
    """Quantity and place."""
    group: str
    """Columns of one group share a standard deviation."""
    unit: str
    sigma: float | None = None
    """Standard deviation, where known."""
    quantity: str = ""
    place: float | None = None
    """Position along the finger [m] where it was measured; None: not along the finger."""


@dataclass(frozen=True)
class MeasuredSet:
    """Measured numbers of a set: ``values`` (R, columns) in rows, or at instants [s], ``at`` (R,)."""

    name: str
    columns: tuple[MeasuredColumn, ...]
    at: Array
    values: Array
    fitted: NDArray[np.bool_]
    """Whether each row was fitted (R,)."""
    moves: bool = False
    """Whether the rows are instants of a motion."""
    ordered: bool = False
    """Whether the rows follow one another."""
    offsets: Any = 0.0
    """Distances of the markers from the backbone (R, columns), or one for all [m]."""
    signals: Sequence[Any] = ()
    """Records that the rows were read from, a `Signal` each; none where these are not known."""


class MeasuredNumbers:
    """The m measured numbers of all ``sets``: set by set, and of each set row by row."""

    sets: Sequence[MeasuredSet]

    @cached_property
    def measured(self) -> Array:
        """Measured values (m,)."""
        return np.concatenate([of.values.ravel() for of in self.sets])

    @cached_property
    def fitted(self) -> NDArray[np.bool_]:
        """Mask of the numbers that were fitted (m,)."""
        return np.concatenate([np.repeat(of.fitted, len(of.columns)) for of in self.sets]).astype(bool)

    @cached_property
    def at(self) -> Array:
        """Row or instant [s] of each number (m,)."""
        return np.concatenate([np.repeat(of.at, len(of.columns)) for of in self.sets])

    @cached_property
    def described(self) -> list[MeasuredColumn]:
        """Column of each number (m)."""
        return [column for of in self.sets for _ in of.at for column in of.columns]

    @cached_property
    def groups(self) -> dict[str, NDArray[np.bool_]]:
        """Mask (m,) of the numbers that share a standard deviation, by the name of their group."""
        names = np.array([column.group for column in self.described])
        return {name: names == name for name in dict.fromkeys(names.tolist())}

    @cached_property
    def slices(self) -> list[slice]:
        """Numbers of each set."""
        ends = list(accumulate((of.values.size for of in self.sets), initial=0))
        return [slice(*ends[k : k + 2]) for k in range(len(self.sets))]

    @cached_property
    def by_column(self) -> list[tuple[int, MeasuredColumn, NDArray[np.intp]]]:
        """Number of the set, and numbers (R,), of each column."""
        return [
            (k, column, np.arange(rows.start + j, rows.stop, len(of.columns)))
            for k, (of, rows) in enumerate(zip(self.sets, self.slices, strict=True))
            for j, column in enumerate(of.columns)
        ]

    @property
    def labels(self) -> tuple[str, ...]:
        """Name of each number, with its row or instant."""
        return tuple(
            f"{column.name} at {at:g} s" if of.moves else f"{column.name}, row {at:.0f}"
            for of in self.sets
            for at in of.at.tolist()
            for column in of.columns
        )
