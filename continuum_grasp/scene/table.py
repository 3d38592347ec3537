"""Tables in CSV files and bags, their units, and the place of everything that is wrong in them."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import datetime
from fractions import Fraction
from functools import reduce
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.base import Array, InputError, check_arguments, nearest
from continuum_grasp.scene.bag import bag_cells, is_bag, is_bag_folder
from continuum_grasp.scene.bag_topics import bag_bytes, is_own_bag
from continuum_grasp.scene.document import text_of
from continuum_grasp.scene.instants import in_order
from continuum_grasp.scene.table_text import COMMA, HEADING, number_in, parsed
from continuum_grasp.scene.units import unit_in, units_of

MAX_BYTES = 200_000_000
"""Greatest size of a file: cells as Python texts take some ten times that in memory."""
_LARGEST = 1e15
"""Greatest number in a file [its unit]: larger ones were never measured, and its square may overflow."""
_MISSING = {
    *("", "-", "--", "?", "*", "x", "n/a", "na", "<na>", "nil", "none", "null", "missing", "lost"),
    *("nan", "+nan", "-nan", "nan(ind)", "-nan(ind)", "1.#qnan", "-1.#qnan", "1.#ind", "-1.#ind"),
    *("#n/a", "#na", "#null!", "#div/0!", "#num!", "#value!", "#ref!"),
}
"""Cells without a value, in lower case, as written by cameras, spreadsheets, C, R, Julia and Python."""
_SUFFIX = re.compile(
    r"(.+?)(?:_|\s*/\s*|,?\s+in\s+|,\s*|\s+)"
    r"(mm|cm|um|µm|m|deg|°|rad|s|sec|ms|us|ns|N|mN|g|kg|gf|kgf|Hz|rpm|Nm|Nmm|mNm|kPa|MPa|bar|mbar)"
)
"""Heading with a unit behind its name, except in, min and h: tension_in is an input, x_min a minimum."""
_DATE = re.compile(r"\d{4}-\d{2}-\d{2}[T ]\d{2}:")
_OFF = 30.0
"""Greatest factor, up or down, between the actual and the expected time between rows [1]; beyond it, the reader asks
for the unit. In logarithm, this is half way between the right unit and one a thousand times as large."""
_CLOCK = 1e8
"""Later first instants come from a clock that counts from 1970 or so [s]: three years, longer than any motion."""
_SLOW = 1.0
"""Least time between rows without a unit at which the reader asks for the unit [s]: fingers move faster, and
milliseconds of a logger of 1 kHz are 1 apart."""
_WEIGHTS = {"g": "gf", "kg": "kgf", "lb": "lbf", "oz": "ozf"}
"""Masses that stand for their weight where a force is expected."""
_SURE = 0.6
"""Least likelihood of a point of DeepLabCut that counts [1]: the default of its own plots (``pcutoff``)."""


@dataclass(frozen=True)
class DataTable:
    """Rows of text cells, and the line of each. Every method raises `InputError` with the place of the fault.

    Attributes
    ----------
    file : str
    headings : tuple of str
        Without the units.
    units : tuple of str or None
        Unit of each column, where its heading has one in brackets.
    rows : tuple of tuple of str
    lines : tuple of int
        Line of each row in the file, from 1.
    header_line : int
    """

    file: str
    headings: tuple[str, ...]
    units: tuple[str | None, ...]
    rows: tuple[tuple[str, ...], ...]
    lines: tuple[int, ...]
    header_line: int
    comma: bool = False
    """Whether numbers have decimal commas."""
    topics: tuple[str, ...] = ()
    """Topic of each column of a bag, empty for stamps; rows are messages then, and ``lines`` count them."""
    notes: tuple[str, ...] = ()
    """Changed order of rows, and skipped rows."""

    @classmethod
    def of(cls, columns: Sequence[str], rows: Sequence[tuple[str, ...]]) -> DataTable:
        """A table of columns, with units in brackets, that is in no file."""
        parts = [cast(re.Match[str], HEADING.fullmatch(column)) for column in columns]
        lines = tuple(range(2, len(rows) + 2))
        return cls("", tuple(part[1] for part in parts), tuple(part[2] for part in parts), tuple(rows), lines, 1)

    @staticmethod
    @check_arguments
    def read(
        path: str | Path,
        names: Sequence[str] = (),
        *,
        columns: Sequence[str] = (),
        leader: str | None = None,
        stamps: Literal["header", "log"] | None = None,
        max_age: float | None = None,
    ) -> DataTable:
        r"""Read a table: UTF-8, a line of headings; empty lines and comments, behind #, %, // or ;, are skipped.

        Commas, semicolons, tabs or blanks separate columns; numbers have decimal points, or commas where these
        separate nothing. Headings may stand in a comment above the numbers, as numpy and MATLAB write them. Tables of
        DeepLabCut (headings in three lines) and Tracker (a line of tracks above the headings) are read as well, and
        units in a line below the headings; lines that repeat the headings are skipped.

        Bags of ROS 2 (MCAP, SQLite) are tables too: a column is a field of a topic, ``/finger/tip.position.x``, an
        entry of a list, ``/joint_states.position[0]``, a topic for its stamps, which count from the first on [s], or
        the name of a field that one topic alone has. Values are SI unless a unit stands behind a blank: ``/tip.x
        [mm]``. Topics with stamps of their own are never interpolated: each row is a message of the leading topic, with
        the last value of the others that is no older than ``max_age``; without a leading topic, rows are the messages
        of one stamp.

        Parameters
        ----------
        path : path-like
        names : sequence of str
            Names of the columns of a table without a line of headings, which is then no error; headings may also stand
            behind # in the line above the numbers, as numpy writes them.
        columns : sequence of str
            Columns to read from a bag; none: all numbers of topics with stamps. All columns of a table are read.
        leader : str, optional
            Column of a bag whose topic leads. None: no topic does, and there is a column ``t`` of all stamps.
        stamps : {"header", "log"}, optional
            Stamps of a bag: of the messages' headers, by default, or of their recording.
        max_age : float, optional
            Greatest age of a value from a topic that does not lead [s]. None: the value has the stamp of the row.

        Raises
        ------
        InputError
            With the line of a wrong form; if a bag lacks a column, is cut off, or its libraries are missing; if stamps
            are stated for a table that is no bag.

        Examples
        --------
        >>> import pathlib, tempfile
        >>> from continuum_grasp.scene import DataTable
        >>> file = pathlib.Path(tempfile.mkdtemp()) / "tip.csv"
        >>> _ = file.write_text("t [s],x [mm]\n0.0,1.5\n0.1,1.2\n")
        >>> table = DataTable.read(file)
        >>> table.headings, table.units, table.rows[0]
        (('t', 'x'), ('s', 'mm'), ('0.0', '1.5'))
        """
        if is_bag(path):
            cells = bag_cells(path, columns, leader, stamps, max_age)
            table = DataTable(str(path), *cells[:4], header_line=1, topics=cells.topics)
            return reduce(DataTable.noted, cells.notes, table)
        text = text_of(path, MAX_BYTES)  # a bag that is missing is no table
        for key, value in (("stamps", stamps), ("max_age", max_age)):
            if value is not None:
                raise InputError("is for bags of ROS 2: the rows of this table have their times", key=key)
        found, of_deep_lab_cut = parsed(text, names, str(path))
        table = DataTable(str(path), *found)
        return _sure(table) if of_deep_lab_cut else table

    @staticmethod
    def bag(topics: Mapping[str, tuple[Array, Mapping[str, Sequence[Any] | Array]]], start: int = 0) -> bytes:
        """Write tables as a bag of ROS 2 (MCAP).

        Each topic has its instants (K,) [s] after ``start`` [ns], which are the stamps of its messages, and columns of
        K numbers or texts by name and unit, which are fields. Definitions of messages, with the units, are in the bag.
        InputError where its libraries are missing.
        """
        return bag_bytes(topics, start)

    @staticmethod
    def is_bag_folder(path: Path) -> bool:
        """Whether a path is the folder of a bag, which `read` accepts like a file."""
        return is_bag_folder(path)

    @staticmethod
    def is_own_bag(file: str | Path) -> bool:
        """Whether `bag` wrote a file, judged by its message definitions."""
        return is_own_bag(file)

    def index(self, heading: str) -> int:
        """Number of a column, from 0, by its heading with or without the unit."""
        wanted = HEADING.fullmatch(heading.strip())
        name = wanted[1] if wanted and heading not in self.headings else heading
        if name in self.headings:
            return self.headings.index(name)
        hint = nearest(name, self.headings, say_all=False)
        if len(self.headings) == 1:
            hint = "; separate cells by commas, semicolons or tabs"
        raise self.error(f"no column {heading!r}{hint} (it has {', '.join(self.headings)})", 0)

    def chosen(self, heading: str, texts: Sequence[str]) -> DataTable:
        """Return the rows whose entry in a column is one of some texts; numbers are compared as numbers."""
        at = self.index(heading)
        keep = [k for k, row in enumerate(self.rows) if any(_same(row[at], text) for text in texts)]
        if not keep:
            present = ", ".join(list(dict.fromkeys(row[at] for row in self.rows))[:8])
            raise InputError(f"no row in which {heading} is {' or '.join(texts)}; it is {present}", file=self.file)
        return self._taken(keep)

    def noted(self, note: str) -> DataTable:
        """Return the table with another note, after the name of the file."""
        return replace(self, notes=(*self.notes, f"{Path(self.file).name}: {note}"))

    def _taken(self, rows: Iterable[int]) -> DataTable:
        """Return some rows, in the given order."""
        taken = [int(k) for k in rows]
        return replace(self, rows=tuple(self.rows[k] for k in taken), lines=tuple(self.lines[k] for k in taken))

    def in_time(self, t: Array, heading: str, *, several: bool = False) -> tuple[DataTable, Array]:
        """Return the table with rows in the order of their instants, and the instants (rows,); ``notes`` report
        changes.

        If several rows have the same instant, only the first counts, unless ``several`` rows may share it, such as the
        points of a shape. InputError if the table has two runs.
        """
        at = self.index(heading)
        name = self.headings[at]
        order, note = in_order(
            t.tolist(), "rows", lambda message, row: self.error(f"column {name}: {message}", at, row)
        )
        table = self._taken(order).noted(f"{note} in column {name}") if note else self
        t = t[order]
        fresh = np.diff(t, prepend=-math.inf) > 0.0
        if several or fresh.all():
            return table, t
        repeated = f"{np.count_nonzero(~fresh)} of {t.size} rows repeat the instant of another in column {name}"
        return table._taken(np.flatnonzero(fresh)).noted(f"{repeated}: the first of each counts"), t[fresh]

    def groups(self, heading: str | None) -> list[NDArray[np.intp]]:
        """Rows that have the same text in a column, in the order of the first of each; None: each row by itself."""
        if heading is None:
            return [np.array([k]) for k in range(len(self.rows))]
        at = self.index(heading)
        groups = dict[str, list[int]]()
        for k, row in enumerate(self.rows):
            groups.setdefault(row[at], []).append(k)
        return [np.array(rows) for rows in groups.values()]

    def numbers(self, heading: str, *, gaps: bool = False) -> Array:
        """A column as finite numbers (rows,), as they stand in the file; with gaps, empty cells are NaN."""
        at = self.index(heading)
        return np.array([self._number(k, at, gaps) for k in range(len(self.rows))])

    def in_si(self, heading: str, si: str, unit: str | None = None, zero: float = 0.0, *, gaps: bool = False) -> Array:
        """A column (rows,) less ``zero`` of its own unit, in an SI unit.

        ``unit`` is the unit of the data if the heading does not state it, in brackets or behind the name. With gaps,
        empty cells are NaN. Dates with times in ISO 8601, and clocks that count from 1970 or so, start at the earliest
        row.
        """
        if si == "s" and (seconds := self._dates(heading)) is not None:
            return seconds - zero
        at = self.index(heading)
        heading_unit = self.units[at]
        try:
            stated = None if unit is None else _factor_to_si(unit, si)
            headed = None if heading_unit is None else _factor_to_si(heading_unit, si)
        except InputError as error:
            raise self.error(f"column {self.headings[at]}: {error.message}", at) from None
        if stated is not None and headed is not None and stated != headed:
            raise self.error(f"its heading says [{heading_unit}], the configuration {unit!r}", at)
        behind = self.unit_behind(heading, si)
        usual = 1.0 if behind is None else _factor_to_si(behind, si)
        factor = next((each for each in (stated, headed) if each is not None), usual)
        if si == "s" and not gaps and (seconds := self._since_earliest(at, factor)) is not None:
            return seconds - factor * zero
        return factor * (self.numbers(heading, gaps=gaps) - zero)

    def unit_behind(self, heading: str, si: str) -> str | None:
        """Return the unit behind the name in a heading without brackets, as in x_mm, if it converts to an SI unit."""
        at = self.index(heading)
        match = _SUFFIX.fullmatch(self.headings[at]) if self.units[at] is None else None
        if match is None:
            return None
        with suppress(InputError):
            _factor_to_si(match[2], si)
            return match[2]
        return None

    def named(self) -> dict[str, tuple[str, str | None]]:
        """Heading of each column, and a unit behind its name (x_mm, x / mm, x in mm), by the name in small letters."""
        columns = dict[str, tuple[str, str | None]]()
        for heading, unit in zip(self.headings, self.units, strict=True):
            match = _SUFFIX.fullmatch(heading) if unit is None else None
            name = (match[1] if match else heading).lower()
            if name in columns:
                raise self.error(f"two columns are called {name!r}", self.index(heading))
            columns[name] = heading, match[2] if match else None
        return columns

    def check_clock(self, t: Array, heading: str, unit: str | None = None, period: float | None = None) -> None:
        """Refuse times (rows,) [s] that are too far apart, or too near, for their unit.

        ``unit`` is the configuration's unit; ``period`` is the time between rows that the scene expects [s], or None.
        """
        at = self.index(heading)
        if self._dates(heading) is not None or (self.topics and not self.topics[at]):
            return
        read_in = unit or self.units[at] or "s"
        apart = float(np.median(steps)) if (steps := np.diff(np.unique(t))).size else 0.0
        stated = unit is not None or self.units[at] is not None
        usual = stated or apart < _SLOW if period is None else 1.0 / _OFF < apart / period < _OFF
        if usual or not apart:
            return
        others = {other: float(size) / _factor_to_si(read_in, "s") for other, size in units_of("s").items()}
        wanted = period or 0.01  # of cameras and loggers
        likely = min(others, key=lambda other: abs(math.log(others[other] * apart / wanted)))
        if likely != read_in:
            name = self.headings[at]
            message = f"column {name}: rows are {apart:g} s apart, read in {read_in}"
            message += "" if period is None else f", and periods of the controller {period:g} s"
            headed = f"{name} [{likely}]" + (f", or {name} [{read_in}]," if period is None else "")
            raise self.error(f"{message}; is {name} in {likely}? Write {headed} as its heading", at)

    def error(self, message: str, at: int, row: int | None = None) -> InputError:
        """An error at a cell, or at the heading of a column; in a bag with the number of the message."""
        if self.topics:
            return InputError(message + ("" if row is None else f" (message {self.lines[row]})"), file=self.file)
        line = self.header_line if row is None else self.lines[row]
        headed = zip(self.headings, self.units, strict=True)
        cells = [f"{name} [{unit}]" if unit else name for name, unit in headed] if row is None else self.rows[row]
        column = 1 + sum(len(cell) + 1 for cell in cells[:at])
        return InputError(message, file=self.file, line=line, column=column)

    def empty(self, at: int, row: int) -> InputError:
        """An error at an empty cell."""
        return self.error(f"column {self.headings[at]}: the cell is empty; expected a number", at, row)

    def _dates(self, heading: str) -> Array | None:
        """Return the seconds (rows,) since the earliest date in a column of ISO 8601 dates with times; None for
        numbers.
        """
        at = self.index(heading)
        if _DATE.match(self.rows[0][at]) is None:
            return None
        dates = list[datetime]()
        for k, row in enumerate(self.rows):
            try:
                dates.append(datetime.fromisoformat(row[at]))
            except ValueError:
                message = f"expected a date with a time as in the first row, got {row[at]!r:.40}"
                raise self.error(f"column {self.headings[at]}: {message}", at, k) from None
        try:
            earliest = min(dates)
            return np.array([(date - earliest).total_seconds() for date in dates])
        except TypeError:
            raise self.error("some dates have a time zone and others have none", at) from None

    def _since_earliest(self, at: int, factor: float) -> Array | None:
        """Return the seconds (rows,) since the earliest instant of a clock that began years ago; None for other
        columns.

        Differences are exact: a double holds nanoseconds since 1970 to 256 ns.
        """
        first = number_in(self._text(0, at))
        if first is None or not _CLOCK < first * factor < math.inf:
            return None
        try:
            exact = [Fraction(self._text(k, at)) for k in range(len(self.rows))]
        except ValueError:  # the caller reports the cell
            return None
        earliest = min(exact)
        return np.array([float((each - earliest) * Fraction(factor)) for each in exact])

    def _text(self, row: int, at: int) -> str:
        """Return the cell with a decimal point and an ASCII minus."""
        text = self.rows[row][at].replace("\u2212", "-")
        return text.replace(",", ".") if self.comma else text

    def _number(self, row: int, at: int, gaps: bool) -> float:
        text = self.rows[row][at]
        if gaps and text.lower() in _MISSING:
            return math.nan
        if not text:
            raise self.empty(at, row)
        value = number_in(self._text(row, at))
        if value is None:
            hint, (first, *more) = "", text.split()
            if COMMA.fullmatch(text):
                hint = " (write a decimal point, not a comma)"
            elif more and number_in(first) is not None:
                hint = f" (write units in the heading: {self.headings[at]} [{' '.join(more)}])"
            raise self.error(f"column {self.headings[at]}: expected a number, got {text[:40]!r}{hint}", at, row)
        if not abs(value) <= _LARGEST:  # NaN too
            wanted = f"a number up to {_LARGEST:g}" if math.isfinite(value) else "a finite number"
            raise self.error(f"column {self.headings[at]}: expected {wanted}, got {text[:40]!r}", at, row)
        return value


def _sure(table: DataTable) -> DataTable:
    """The table of DeepLabCut with points that are hardly likely as empty cells."""
    rows = [list(row) for row in table.rows]
    for at, heading in enumerate(table.headings):
        if heading.endswith("_likelihood"):
            point = [
                k for k, other in enumerate(table.headings) if other.rpartition("_")[0] == heading.rpartition("_")[0]
            ]
            for row, value in zip(rows, table.numbers(heading, gaps=True), strict=True):
                if not value >= _SURE:
                    for k in point:
                        row[k] = row[k] if k == at else ""
    return replace(table, rows=tuple(map(tuple, rows)))


def _same(cell: str, text: str) -> bool:
    a, b = number_in(cell), number_in(text)
    return cell == text if a is None or b is None else math.isclose(a, b, rel_tol=1e-12)


def _factor_to_si(unit: str, si: str) -> float:
    """Factor from a unit to an SI unit such as ``N m``; InputError if it is unknown, or of another dimension."""
    if unit == si:
        return 1.0
    meant = _WEIGHTS.get(unit, unit) if si == "N" else unit
    spelled = unit_in(f" {meant}", si)
    if spelled is not None:
        return float(units_of(si)[spelled])
    known = list(units_of(si)) or [si]
    # Names of one or two letters resemble each other by chance.
    hint = nearest(unit, known, say_all=False, cutoff=0.75)
    raise InputError(f"expected a unit like {', '.join(known)}, got {unit!r}{hint}")
