"""Tables of figures, for reading and for programs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

__all__ = ["Table"]


@dataclass(frozen=True)
class Table:
    """Rows of figures under named columns.

    Attributes
    ----------
    title : str
    columns : tuple of str
    rows : tuple of tuple
        Texts and numbers; None and NaN where something does not apply.
    note : str
    """

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Any, ...], ...]
    note: str = ""

    def column(self, name: str) -> list[Any]:
        """All entries under one name."""
        k = self.columns.index(name)
        return [row[k] for row in self.rows]

    def markdown(self) -> str:
        """The table as Markdown, numbers to the right."""
        texts = [[_text(value) for value in row] for row in self.rows]
        number = [all(not isinstance(row[k], str) for row in self.rows) for k in range(len(self.columns))]
        lines = [f"## {self.title}", "", _line(self.columns), _line(["---:" if right else "---" for right in number])]
        lines += [_line(row) for row in texts]
        return "\n".join([*lines, "", *([self.note, ""] if self.note else [])])

    def as_dict(self) -> dict[str, Any]:
        """Plain values, for JSON; what is not finite is None."""
        rows = [[_plain(value) for value in row] for row in self.rows]
        return {"title": self.title, "columns": list(self.columns), "rows": rows, "note": self.note}


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _plain(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _text(value: Any) -> str:
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "-"
    if isinstance(value, int) and not isinstance(value, bool):
        return f"{value:,}"
    if isinstance(value, float):
        return f"{value:,.0f}" if 1000.0 <= abs(value) < 1e9 else f"{value:.3g}"
    return str(value)
