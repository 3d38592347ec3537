"""Tables as text: which lines have headings and numbers, the separators of cells, the styles of other programs."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from typing import NamedTuple

from continuum_grasp.base import InputError
from continuum_grasp.scene.units import any_unit

_UNITS = any_unit()
HEADING = re.compile(rf"^(.*?)\s*(?:[\[(]((?<=\[)[^\]]*(?=\])|(?<=\()(?:{_UNITS})(?=\)))[\])])?$")
"""Heading with a unit: any unit in brackets, a known unit in parentheses, which may also contain other words."""
COMMA, _POINT = re.compile(r"[-+]?\d*,\d+(?:[eE][-+]?\d+)?"), re.compile(r"[-+]?\d*\.\d*(?:[eE][-+]?\d+)?")
_COMMENTS = ("#", "%", "//")
"""Beginnings of comment lines, except the semicolon, which separates cells in other files."""
_DIRECTIVE = re.compile(r"sep=.?")
"""First line that states the character between cells to Excel."""
_WORD = re.compile(r"[^\s\[(]+(?:\s*[\[(][^\])]*[\])])?")
_UNIT = re.compile(_UNITS)
"""Return the unit in a line below the headings."""


class TableText(NamedTuple):
    """Text of a table: headings without their units, units, rows of cells, and the lines of all in the file."""

    headings: tuple[str, ...]
    units: tuple[str | None, ...]
    rows: tuple[tuple[str, ...], ...]
    lines: tuple[int, ...]
    header_line: int
    comma: bool  # whether numbers have decimal commas


def parsed(text: str, names: Sequence[str], file: str) -> tuple[TableText, bool]:
    """Read a text as a table, and whether DeepLabCut wrote it; ``names`` are for columns without headings."""
    separator, numbered = _written(text)
    headed = _with_headings(text, separator, numbered)
    if not names or _columns(headed[:1], separator) == set(names):  # else any comment may have as many words
        numbered = headed
    if len(numbered) < (1 if names else 2):
        raise InputError("expected a line of headings and rows of numbers", file=file)
    cells = _trimmed([_cells(line, separator) for _, line in numbered])
    top, names = (0, names) if names and number_in(cells[0][0]) is not None else _headings(cells)
    header_line = numbered[max(top - 1, 0)][0]
    # the headings of a file that was started again
    retained = [k for k in range(top, len(cells)) if cells[k] != cells[top - 1] or not top]
    rows = tuple(cells[k] for k in retained)
    row_lines = tuple(numbered[k][0] for k in retained)
    if not rows:
        raise InputError("expected rows of numbers below the headings", file=file, line=header_line)
    parts = [HEADING.fullmatch(cell) for cell in names]
    headings = tuple(part[1] if part else cell for part, cell in zip(parts, names, strict=True))
    units = tuple(part[2] if part else None for part in parts)
    _check_headings(headings, names, file, header_line)
    _check_widths(rows, row_lines, headings, separator, file)
    every = [cell for row in rows for cell in row]
    comma = not any(map(_POINT.fullmatch, every)) and any(map(COMMA.fullmatch, every))
    found = TableText(headings, units, rows, row_lines, header_line, comma)
    return found, cells[0][0] == "scorer"


def _check_headings(headings: Sequence[str], names: Sequence[str], file: str, line: int) -> None:
    """Refuse headings that are empty, numbers, or there twice; ``names`` have their units with them."""
    for k, heading in enumerate(headings):
        if not heading:
            raise InputError(f"column {k + 1} has no heading", file=file, line=line)
        if heading in headings[:k]:
            place = 1 + sum(len(cell) + 1 for cell in names[:k])
            message = f"two columns are called {heading!r}: rename one, as nothing reads it then"
            raise InputError(message, file=file, line=line, column=place)
        if number_in(heading) is not None:
            raise InputError(f"expected headings, got the number {heading}", file=file, line=line)


def _check_widths(
    rows: Sequence[Sequence[str]], lines: Sequence[int], headings: Sequence[str], separator: str, file: str
) -> None:
    """Refuse rows that have not as many cells as there are headings."""
    for line, row in zip(lines, rows, strict=True):
        if len(row) == len(headings):
            continue
        hint = ""
        if separator == "," and len(row) > len(headings):
            hint = "; write decimal points, or semicolons between cells"
        if len(headings) == 1:
            hint = f"; begin lines above the headings with #, as {headings[0]!r:.40}"
        elif line == lines[-1] and len(row) < len(headings):
            hint = "; the last line is cut off: delete it"
        raise InputError(f"expected {len(headings)} cells, got {len(row)}{hint}", file=file, line=line)


def _written(text: str) -> tuple[str, list[tuple[int, str]]]:
    """Return the character between cells, and the lines of a table with their numbers, without empty ones and comments.

    A line that begins with a semicolon is a comment too, unless semicolons separate as many cells as in other lines.
    """
    numbered = [(k, line) for k, line in enumerate(text.splitlines(), 1) if line.strip()]
    if numbered and _DIRECTIVE.fullmatch(numbered[0][1].strip()):
        numbered = numbered[1:]
    written = [(k, line) for k, line in numbered if not line.lstrip().startswith(_COMMENTS)]
    if not written:
        return ",", []
    last = next((line for _, line in reversed(written) if line.lstrip()[0] != ";"), written[-1][1])
    separator = _separator(last)
    width = len(_cells(last, separator)) if separator == ";" else 0
    return separator, [(k, line) for k, line in written if line.lstrip()[0] != ";" or line.count(";") + 1 == width]


def _with_headings(text: str, separator: str, numbered: list[tuple[int, str]]) -> list[tuple[int, str]]:
    """Return the lines with the line of headings; if they begin with numbers, it is the last comment above them."""
    if not numbered or any(number_in(cell) is None for cell in _cells(numbered[0][1], separator) if cell):
        return numbered
    width = len(_cells(numbered[0][1], separator))
    first = numbered[0][0]
    for k, line in reversed(list(enumerate(text.splitlines()[: first - 1], 1))):
        heading = line.strip().lstrip("#%/;").strip()
        for between in (separator, _separator(heading)):
            if len(cells := _cells(heading, between)) == width:
                return [(k, separator.join(cells) if between != separator else heading), *numbered]
    return numbered


def _separator(line: str) -> str:
    """Character between the cells of a line of numbers: of semicolon, tab, blank and comma the first that is there."""
    if ";" in line or "\t" in line:
        return ";" if ";" in line else "\t"
    words = line.split()
    numbers = [COMMA.fullmatch(word) or number_in(word) is not None for word in words]
    return " " if len(words) > 1 and all(numbers) else ","


def _cells(line: str, separator: str) -> tuple[str, ...]:
    """Cells of a line; between blanks a heading has its unit with it."""
    if separator == " ":
        return tuple(_WORD.findall(line))
    return tuple(cell.strip() for cell in next(csv.reader([line], delimiter=separator)))


def _trimmed(rows: Sequence[tuple[str, ...]]) -> list[tuple[str, ...]]:
    """Return the rows without the empty columns that separators after the last cells begin."""
    width = max((k for row in rows for k, cell in enumerate(row, 1) if cell), default=1)
    return [row[:width] for row in rows]


def _columns(line: list[tuple[int, str]], separator: str) -> set[str]:
    """Headings in a line, without their units."""
    cells = [cell for _, text in line for cell in _cells(text, separator)]
    return {part[1] if (part := HEADING.fullmatch(cell)) else cell for cell in cells}


def _headings(rows: Sequence[Sequence[str]]) -> tuple[int, Sequence[str]]:
    """Return the number of lines above the numbers, and a heading per column.

    DeepLabCut has lines of scorer, individuals, bodyparts and coords: a column is called BODYPART_x. Tracker has a line
    of its tracks above t, x, y: a column is called TRACK_x, or x if there is only one track.
    """
    if rows[0][0] == "scorer":
        top = next((k for k, row in enumerate(rows) if row[0] == "coords"), 2) + 1
        columns = list(zip(*rows[1:top], strict=True))[1:]
        return top, ["frame", *("_".join(dict.fromkeys(part for part in cells if part)) for cells in columns)]
    first = rows[0]
    second = rows[min(1, len(rows) - 1)]
    if (
        (len(first) != len(second) or not all(first))
        and "t" in second
        and all(number_in(cell) is None for cell in second)
    ):
        tracks = [word for word in first if word]
        if len(tracks) < 2:
            return 2, second
        names = list[str]()
        last = ""
        for k, cell in enumerate(second):
            last = first[k] if k < len(first) and first[k] else last
            names.append(cell if cell == "t" else f"{last}_{cell}")
        return 2, names
    units = [cell.strip("[]()") for cell in second]
    if len(first) == len(second) and any(units) and all(_UNIT.fullmatch(unit) for unit in units if unit):
        return 2, [f"{cell} [{unit}]" if unit else cell for cell, unit in zip(first, units, strict=True)]
    return 1, first


def number_in(text: str) -> float | None:
    try:
        return None if "_" in text else float(text)  # which Python takes between digits
    except ValueError:
        return None
