"""Readings of a table with a row for each pose or instant, or for each point of one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.addons.identification.data import KIND_OF, UNIT_OF, Reading
from continuum_grasp.addons.identification.scene import (
    Column,
    ColumnLike,
    ReadingColumn,
    StaticPoses,
    TipTrajectory,
    as_column,
)
from continuum_grasp.base import Array, InputError
from continuum_grasp.scene import DataTable, Scene


@dataclass(frozen=True)
class Points:
    """Readings of a table with a row for each pose or instant, or for each point of one, in groups of rows (R,).

    All rows of a group have the same cell in the column ``heading``.
    """

    of: StaticPoses | TipTrajectory
    table: DataTable
    scene: Scene
    key: str
    groups: Sequence[NDArray[np.intp]]
    heading: str | None

    @property
    def first(self) -> NDArray[np.intp]:
        """Return the first row (R,) of each group."""
        return np.array([rows[0] for rows in self.groups])

    def same(self, values: Array, name: str) -> Array:
        """Return the values (R,) of the groups, equal in all rows of a group; NaN if all cells are empty."""
        same = np.full(len(self.groups), np.nan)
        for k, rows in enumerate(self.groups):
            there = rows[np.isfinite(values[rows])]
            other = there[values[there] != values[there[:1]]]
            if other.size:
                message = f"{name} differs from the first row with the same {self.heading}"
                raise self.table.error(message, 0, int(other[0]))
            same[k] = values[there[0]] if there.size else np.nan
        return same

    def readings(self, m: ReadingColumn, key: str) -> Iterator[Reading]:
        """Return the readings of a column, one per place; NaN for groups without the place."""
        table = self.table
        data_set = self.of
        length = self.scene.finger.rod.length
        quantity = m.quantity
        sign = 1.0
        if quantity in ("x", "y"):
            axis = data_set.axes["xy".index(quantity)]
            quantity = "x" if axis[-1] == "x" else "y"
            sign = -1.0 if axis[0] == "-" else 1.0
        elif quantity in KIND_OF and data_set.axes != ("x", "y"):
            raise InputError(f"axes apply to x and y only: use scale for {quantity}", key=f"{self.key}.axes")
        origin = data_set.origin["xy".index(quantity)] if quantity in ("x", "y") else 0.0
        values = sign * read_column(table, m, UNIT_OF[quantity], gaps=True) + origin
        if quantity in ("x", "y") and m.sigma is not None and m.sigma > length:
            message = f"{m.sigma:g} m is more than the finger's length: sigma is in m, whatever the unit of the column"
            raise InputError(message, key=f"{self.key}.{key}.sigma")
        offset = read_column(table, m.offset, "m", gaps=True) if isinstance(m.offset, Column) else m.offset
        places = read_column(table, m.at, "m") if isinstance(m.at, Column) else None
        for at in [m.place] if places is None else np.unique(places).tolist():
            here = np.full(len(self.groups), -1)
            for k, rows in enumerate(self.groups):
                mine = rows if places is None else rows[places[rows] == at]
                if len(mine) > 1:
                    hint = "say which place each has: at: {column: ...}" if places is None else "expected one"
                    raise table.error(f"{len(mine)} rows of one {self.heading} at one place; {hint}", 0, int(mine[1]))
                here[k] = mine[0] if len(mine) else -1
            for word, where in (("at", at), ("since", m.since)):
                # 1e-6: part of the length by which a measured place may be beyond the tip: places are written with six
                # digits
                if where is not None and not 0.0 <= where <= length * (1 + 1e-6):
                    message = f"{where:g} m is not on the finger of {length:g} m"
                    if word == "at" and places is not None:
                        raise table.error(message, table.index(as_column(cast(Column, m.at)).column), int(here.max()))
                    raise InputError(message, key=f"{self.key}.{key}.{word}")
            column = np.where(here < 0, np.nan, values[here])
            offsets = np.broadcast_to(offset, values.shape)[here]
            if isinstance(m.offset, Column):
                self._check_offsets(m.offset.column, np.where(np.isfinite(column), offsets, 0.0), here)
            offsets = np.nan_to_num(offsets)
            is_one = np.ptp(offsets[here >= 0]) == 0.0
            missing = offsets.max(initial=0.0) if is_one else 0.0
            beside = np.where(here < 0, missing, offsets)
            same = float(beside[0]) if np.ptp(beside) == 0.0 else beside
            there = None if at is None else min(at, length)
            yield Reading(quantity, column, there, m.sigma, m.since, m.of, same)

    def _check_offsets(self, heading: str, offsets: Array, rows: NDArray[np.intp]) -> None:
        """Refuse missing offsets, or offsets in another unit, in the rows (R,) of the markers."""
        at = self.table.index(heading)
        length = self.scene.finger.rod.length
        for value, row in zip(offsets.tolist(), rows.tolist(), strict=True):
            if np.isnan(value):
                raise self.table.empty(at, row)
            if abs(value) > length:
                message = f"{value:g} m from the backbone is more than the finger's length of {length:g} m"
                raise self.table.error(message, at, row)

    def patterns(self, measured: Sequence[ReadingColumn]) -> Iterator[tuple[list[Reading], NDArray[np.bool_]]]:
        """Return each combination of readings with the groups that have exactly these, in the order of the first
        group.
        """
        each = [list(self.readings(m, f"measured[{k}]")) for k, m in enumerate(measured)]
        readings = [reading for of in each for reading in of]
        there = np.isfinite([np.asarray(reading.values) for reading in readings]).T
        for k, row in enumerate(there):
            if not row.any():
                raise self.table.empty(self.table.index(measured[0].column), int(self.first[k]))
        for m, of in zip(measured, each, strict=True):
            if not np.isfinite([np.asarray(reading.values) for reading in of]).any():
                message = f"column {m.column}: every cell is empty; expected numbers, or leave it out of measured"
                raise self.table.error(message, self.table.index(m.column))
        for pattern in dict.fromkeys(map(tuple, there)):
            have = [reading for reading, yes in zip(readings, pattern, strict=True) if yes]
            yield have, (there == pattern).all(axis=1)


def read_column(table: DataTable, column: ColumnLike, si: str, *, gaps: bool = False) -> Array:
    """Read a column in an SI unit: subtract its zero and another column, and multiply by its scale."""
    definition = as_column(column)
    behind = table.unit_behind(definition.column, si)
    if definition.unit is None and behind is not None and abs(definition.scale) != 1.0:
        message = f"column {definition.column}: its name states {behind}, and scale is {definition.scale:g}"
        raise table.error(f"{message}; state the unit that scale applies to", table.index(definition.column))
    values = table.in_si(definition.column, si, definition.unit, definition.zero, gaps=gaps)
    if definition.minus is not None:
        values = values - table.in_si(definition.minus, si, definition.unit, gaps=gaps)
    return definition.scale * values
