"""Charts of benchmark tables, drawn into their pages at build time; styles of the site draw them."""

from __future__ import annotations

import html
import json
import math
from pathlib import Path
from typing import Any

CHARTED = ("median [ns]", "median [us]", "median [ms]", "mode 1", "total", "mean", "factor", "ns")
"""Columns that tell most of a table: the first of these that it has is drawn."""
MOST = 30
"""Rows; a longer chart is not read."""


def with_charts(text: str, data: Path) -> str:
    """The page of a benchmark, with a chart below the heading of each table that has a column to be drawn."""
    for table in json.loads(data.read_text(encoding="utf-8"))["tables"]:
        drawn = chart(table)
        heading = f"## {table['title']}\n"
        if drawn and text.count(heading) == 1:
            text = text.replace(heading, f"{heading}\n{drawn}\n")
    return text


def chart(table: dict[str, Any]) -> str | None:
    """Dots on a logarithmic axis, or bars from zero where values are alike; None where there is nothing to compare."""
    column = next((k for name in CHARTED for k, own in enumerate(table["columns"]) if own == name), None)
    if column is None:
        return None
    rows = [(label(row, column), row[column]) for row in table["rows"]]
    rows = [(name, float(value)) for name, value in rows if isinstance(value, int | float) and value > 0]
    if not 2 <= len(rows) <= MOST or len({name for name, _ in rows}) < len(rows):
        return None
    values = [value for _, value in rows]
    logarithmic = max(values) > 10 * min(values)
    low = 10 ** math.floor(math.log10(min(values))) if logarithmic else 0.0
    high = 10 ** math.ceil(math.log10(max(values)) - 1e-9) if logarithmic else max(values)
    parts = ['<figure class="chart">']
    for name, value in rows:
        share = math.log(value / low) / math.log(high / low) if logarithmic else value / high
        mark = f'<i style="{"left" if logarithmic else "width"}: {100 * share:.2f}%"></i>'
        parts.append(
            f'<div><span>{html.escape(name)}</span><span class="{"dot" if logarithmic else "bar"}">{mark}</span>'
            f"<span>{readable(value)}</span></div>"
        )
    axis = f", logarithmic from {readable(low)} to {readable(high)}" if logarithmic else ""
    parts.append(f"<figcaption>{html.escape(table['columns'][column])}{axis}</figcaption></figure>")
    return "".join(parts) + "\n"


def label(row: list[Any], column: int) -> str:
    """What names a row: its first column, with those beside it that count elements or unknowns."""
    words = [str(row[0])]
    if column > 1 and isinstance(row[1], int):
        words.append(str(row[1]))
    return ", ".join(words)


def readable(value: float) -> str:
    """Three digits, without exponents for what people count."""
    return f"{value:,.0f}" if 1000 <= value < 1e9 else f"{value:.3g}"
