"""Short texts: labels of entries, ``"name [unit]"``, summaries of large objects, and what was likely meant."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

_PARTS = {"": 1.0, "m": 1e3, "\N{MICRO SIGN}": 1e6}
_MULTIPLES = {"M": 1e-6, "k": 1e-3, "": 1.0}
_PREFIXES = {**dict.fromkeys(("N", "N/s", "N m", "J"), _PARTS), **dict.fromkeys(("Pa", "Pa/s"), _MULTIPLES)}
"""Prefixes of SI units that people are shown: fingers of a millimeter press with micronewtons, chambers have kPa."""


def prefixes(unit: str) -> dict[str, float]:
    """Return the units that display values of an SI unit, the greatest first, and the number of each in the SI unit."""
    return {prefix + unit: factor for prefix, factor in _PREFIXES.get(unit, {"": 1.0}).items()}


def prefixed(unit: str, greatest: float) -> tuple[float, str]:
    """Return factor and unit for the display of values of an SI unit: the first unit that makes the greatest value 0.1
    or more.
    """
    units, size = prefixes(unit), abs(greatest)
    if not 0.0 < size < math.inf:
        return 1.0, unit
    shown = next((name for name, factor in units.items() if factor * size >= 0.1), [*units][-1])
    return units[shown], shown


def amount_text(value: float, unit: str, form: str = ".3g", like: float | None = None) -> str:
    """Write a value with its unit (`prefixed`), in a format; with three digits instead of fixed decimals if its unit is
    not ``unit``. The unit may be that of another value for comparison, ``like``.
    """
    factor, shown = prefixed(unit, value if like is None else like)
    sign = "+" if form.startswith("+") else ""
    form = f"{sign}.3g" if like is None and factor != 1.0 and form.endswith("f") else form
    return f"{factor * value:{form}} {shown}".rstrip()


class SplitLabel(NamedTuple):
    """Return name and unit of an entry; the unit may be empty."""

    name: str
    unit: str

    @property
    def words(self) -> str:
        """Name for a legend, without underscores."""
        return self.name.replace("_", " ")


def split_unit(label: str) -> SplitLabel:
    """Name and unit of a label, ``"name [unit]"``."""
    name, bracket, unit = label.partition(" [")
    return SplitLabel(name, unit[:-1]) if bracket and unit.endswith("]") else SplitLabel(label, "")


_LINE = 96
"""Characters of a line [1]: a notebook's cell and a terminal show it without a break."""
_ROWS = 8
"""Lines below the first [1]: with lines of 96 characters, all stay below 1 kB."""


class Summarized:
    """Something large that is shown by a short summary, where a dataclass would print every array.

    Subclasses override `headline` and `pairs`.
    """

    __slots__ = ()

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        if "__repr__" not in vars(cls):  # a dataclass writes one of its own where its class has none
            cls.__repr__ = Summarized.__repr__  # type: ignore[method-assign]

    def headline(self) -> str:
        """Name and status in one line; empty without them."""
        return ""

    def pairs(self) -> Mapping[str, str]:
        """The main values, with their units, by name."""
        return {}

    def __repr__(self) -> str:
        return self.listed(*self._summary())

    def _repr_html_(self) -> str:
        from html import escape

        head, rows = self._summary()
        cells = "".join(
            f'<tr><th style="text-align:left">{escape(name)}</th><td style="text-align:left">{escape(text)}</td></tr>'
            for name, text in rows.items()
        )
        return f"<div><b>{escape(head)}</b><table>{cells}</table>{self._picture_html()}</div>"

    @staticmethod
    def quoted(name: str | None, *more: str) -> str:
        """Return a statement, after a name in quotation marks if there is one: ``"mug": optimal``."""
        head = f'"{name}"' if name else ""
        rest = ", ".join(part for part in more if part)
        return f"{head}: {rest}" if head and rest else head or rest

    @staticmethod
    def listed(head: str, rows: Mapping[str, str]) -> str:
        """Return names and values below a line, up to a number of rows."""
        lines = [clipped(f"  {line}") for line in Summarized.aligned(list(rows.items()), (0, 1))]
        return "\n".join([head, *lines[:_ROWS], *(["  ..."] if len(lines) > _ROWS else [])])

    @staticmethod
    def aligned(rows: Sequence[Sequence[str]], left: Collection[int] = (0,)) -> list[str]:
        """Return the lines of a table, with right-aligned columns two spaces apart, except those to the ``left``."""
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        formats = [f"{{:{'<' if k in left else '>'}{width}}}" for k, width in enumerate(widths)]
        return ["  ".join(each.format(cell) for each, cell in zip(formats, row, strict=True)).rstrip() for row in rows]

    def _shown_pairs(self) -> Mapping[str, str]:
        return self.pairs()

    def _picture_html(self) -> str:
        return ""

    def _summary(self) -> tuple[str, dict[str, str]]:
        """Return the first line, and values by name, or the reason why they are missing: debuggers show them too."""
        kind = type(self).__name__
        try:
            head, rows = self.headline(), dict(self._shown_pairs())
        except Exception as error:
            return kind, {"no summary": clipped(f"{type(error).__name__}: {error}")}
        # 600: characters of a value on a page, which breaks lines: a warning with its advice fits
        return clipped(f"{kind} {head}".strip()), {name: clipped(text, 600) for name, text in rows.items()}


def clipped(text: str, most: int = _LINE) -> str:
    """Return a text in one line with a limited number of characters."""
    line = " ".join(text.splitlines())
    return line if len(line) <= most else line[: most - 3] + "..."


def nearest(word: str, allowed: Iterable[str], *, say_all: bool = True, cutoff: float = 0.6) -> str:
    """``; did you mean 'x'?`` where one is near, otherwise the allowed names."""
    from difflib import get_close_matches

    known = {name.lower(): name for name in allowed}
    # 0.6, the default of difflib, finds swapped and missing letters and few other words.
    if close := get_close_matches(word.lower(), known, n=1, cutoff=cutoff):
        return f"; did you mean {known[close[0]]!r}?"
    return f"; expected one of {', '.join(known.values())}" if known and say_all else ""
