"""Measurements in CSV files, their units, and the place of everything that is wrong in them."""

from __future__ import annotations

import csv
import difflib
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.arguments import check_arguments
from continuum_grasp.errors import InputError
from continuum_grasp.scene.document import refuse_what_is_no_file
from continuum_grasp.scene.units import factor_to_si

Array = NDArray[np.float64]

MAX_BYTES = 200_000_000
"""Greatest size of a file: cells as Python texts take some ten times that in memory."""
_LARGEST = 1e15
"""Greatest number in a file [its unit]: larger ones were never measured, and its square may overflow."""
_HEADING = re.compile(r"^(.*?)\s*(?:\[([^\]]*)\])?$")


@dataclass(frozen=True)
class Table:
    """Rows of text cells, and the line of each. Every method raises `InputError` with the place of what is wrong.

    Attributes
    ----------
    file : str
    headings : tuple of str
        Without the units.
    units : tuple of str or None
        Of each column, where its heading has one in brackets.
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

    def index(self, heading: str) -> int:
        """Number of a column, from 0, by its heading with or without the unit."""
        wanted = _HEADING.fullmatch(heading.strip())
        name = wanted[1] if wanted and heading not in self.headings else heading
        if name in self.headings:
            return self.headings.index(name)
        near = difflib.get_close_matches(name, self.headings, n=1)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        raise self.error(f"no column {heading!r}{hint} (it has {', '.join(self.headings)})", 0)

    def chosen(self, heading: str, texts: Sequence[str]) -> Table:
        """The rows in which a column has one of some texts; numbers are compared as such."""
        at = self.index(heading)
        keep = [k for k, row in enumerate(self.rows) if any(_same(row[at], text) for text in texts)]
        if not keep:
            found = ", ".join(list(dict.fromkeys(row[at] for row in self.rows))[:8])
            raise InputError(f"no row in which {heading} is {' or '.join(texts)}; it is {found}", file=self.file)
        return replace(self, rows=tuple(self.rows[k] for k in keep), lines=tuple(self.lines[k] for k in keep))

    def numbers(self, heading: str, *, gaps: bool = False) -> Array:
        """A column as finite numbers (rows,), as they stand in the file; with gaps, empty cells are NaN."""
        at = self.index(heading)
        return np.array([self._number(k, at, gaps) for k in range(len(self.rows))])

    def in_si(self, heading: str, si: str, unit: str | None = None, zero: float = 0.0, *, gaps: bool = False) -> Array:
        """A column (rows,) less ``zero`` of its own unit, in an SI unit.

        ``unit`` is that of the data where its heading does not say it. With gaps, empty cells are NaN.
        """
        at = self.index(heading)
        own = self.units[at]
        if unit is not None and own is not None and unit != own:
            raise self.error(f"its heading says [{own}], the configuration {unit!r}", at)
        try:
            factor = factor_to_si(unit or own or si, si)
        except InputError as error:
            raise self.error(f"column {self.headings[at]}: {error.message}", at) from None
        return factor * (self.numbers(heading, gaps=gaps) - zero)

    def error(self, message: str, at: int, row: int | None = None) -> InputError:
        """An error at a cell, or at the heading of a column."""
        line = self.header_line if row is None else self.lines[row]
        cells = self.headings if row is None else self.rows[row]
        column = 1 + sum(len(cell) + 1 for cell in cells[:at])
        return InputError(message, file=self.file, line=line, column=column)

    def _number(self, row: int, at: int, gaps: bool) -> float:
        text = self.rows[row][at]
        if not text and gaps:
            return math.nan
        if not text:
            raise self.error(f"column {self.headings[at]}: the cell is empty; expected a number", at, row)
        value = _number_in(text)
        if value is None:
            hint = " (write a decimal point, not a comma)" if re.fullmatch(r"[-+]?\d+,\d+", text) else ""
            raise self.error(f"column {self.headings[at]}: expected a number, got {text[:40]!r}{hint}", at, row)
        if not abs(value) <= _LARGEST:  # NaN too
            wanted = f"a number up to {_LARGEST:g}" if math.isfinite(value) else "a finite number"
            raise self.error(f"column {self.headings[at]}: expected {wanted}, got {text[:40]!r}", at, row)
        return value


@check_arguments
def read_table(path: str | Path) -> Table:
    r"""Read a CSV file: UTF-8, commas, one line of headings; empty lines and lines that begin with # are skipped.

    Parameters
    ----------
    path : path-like

    Raises
    ------
    InputError
        With the line, where it is not of that form.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> from continuum_grasp.identification import read_table
    >>> file = pathlib.Path(tempfile.mkdtemp()) / "tip.csv"
    >>> _ = file.write_text("t [s],x [mm]\n0.0,1.5\n0.1,1.2\n")
    >>> table = read_table(file)
    >>> table.headings, table.units, table.rows[0]
    (('t', 'x'), ('s', 'mm'), ('0.0', '1.5'))
    """
    name = str(path)
    refuse_what_is_no_file(path)
    try:
        data = Path(path).read_bytes()
    except FileNotFoundError:
        raise InputError("no such file", file=name) from None
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", file=name) from None
    if len(data) > MAX_BYTES:
        raise InputError(f"the file is too large; expected at most {MAX_BYTES} bytes", file=name)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise InputError("the file is not UTF-8 text", file=name, line=line) from None
    numbered = [(k, line) for k, line in enumerate(text.splitlines(), 1) if line.strip() and line.lstrip()[0] != "#"]
    if len(numbered) < 2:
        raise InputError("expected a line of headings and rows of numbers", file=name)
    (header_line, header), *body = numbered
    cells = _cells(header)
    if len(cells) == 1 and (";" in header or "\t" in header):
        raise InputError("expected columns that are separated by commas", file=name, line=header_line)
    parts = [_HEADING.fullmatch(cell) for cell in cells]
    headings = tuple(part[1] if part else cell for part, cell in zip(parts, cells, strict=True))
    units = tuple(part[2] if part else None for part in parts)
    for k, heading in enumerate(headings):
        if not heading:
            raise InputError(f"column {k + 1} has no heading", file=name, line=header_line)
        if heading in headings[:k]:
            raise InputError(f"two columns are called {heading!r}", file=name, line=header_line)
        if _number_in(heading) is not None:
            raise InputError(f"expected headings, got the number {heading}", file=name, line=header_line)
    rows = tuple(_cells(line) for _, line in body)
    for (line, _), row in zip(body, rows, strict=True):
        if len(row) != len(headings):
            raise InputError(f"expected {len(headings)} cells, got {len(row)}", file=name, line=line)
    return Table(name, headings, units, rows, tuple(line for line, _ in body), header_line)


def _cells(line: str) -> tuple[str, ...]:
    return tuple(cell.strip() for cell in next(csv.reader([line])))


def _number_in(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None


def _same(cell: str, text: str) -> bool:
    a, b = _number_in(cell), _number_in(text)
    return cell == text if a is None or b is None else math.isclose(a, b, rel_tol=1e-12)
