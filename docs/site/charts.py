"""Charts of benchmark tables, drawn as SVG into their pages at build time; they follow the page's colors."""

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
LABELS, PLOT, ROW = 330, 330, 22
"""Widths of labels and plot, height of a row, in pixels of the drawing."""


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
    high = 10 ** math.ceil(math.log10(max(values)) - 1e-9) if logarithmic else 1.05 * max(values)

    def place(value: float) -> float:
        share = math.log(value / low) / math.log(high / low) if logarithmic else value / high
        return LABELS + PLOT * share

    title = table["columns"][column]
    height = ROW * len(rows) + 30
    parts = [
        f'<figure class="chart"><svg viewBox="0 0 {LABELS + PLOT + 80} {height}" role="img" '
        f'aria-label="{html.escape(title)} of each row of the table below">'
    ]
    for tick in ticks(low, high, logarithmic):
        x = place(tick)
        parts.append(f'<line class="tick" x1="{x:.1f}" x2="{x:.1f}" y1="0" y2="{height - 26}"/>')
        parts.append(f'<text class="unit" x="{x:.1f}" y="{height - 12}" text-anchor="middle">{tick:g}</text>')
    for k, (name, value) in enumerate(rows):
        y, x = ROW * (k + 0.5), place(value)
        parts.append(f'<text x="{LABELS - 8}" y="{y + 4:.1f}" text-anchor="end">{html.escape(name)}</text>')
        if logarithmic:
            parts.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="5"/>')
        else:
            parts.append(f'<rect x="{LABELS}" y="{y - 6:.1f}" width="{x - LABELS:.1f}" height="12"/>')
        parts.append(f'<text class="unit" x="{x + 9:.1f}" y="{y + 4:.1f}">{value:.3g}</text>')
    scale = ", logarithmic axis" if logarithmic else ""
    parts.append(f"</svg><figcaption>{html.escape(title)}{scale}</figcaption></figure>")
    return "".join(parts) + "\n"


def label(row: list[Any], column: int) -> str:
    """What names a row: its first column, with those beside it that count elements or unknowns."""
    words = [str(row[0])]
    if column > 1 and isinstance(row[1], int):
        words.append(str(row[1]))
    text = ", ".join(words)
    return text if len(text) <= 46 else text[:45] + "…"


def ticks(low: float, high: float, logarithmic: bool) -> list[float]:
    """Places of an axis that are marked."""
    if logarithmic:
        return [low * 10**k for k in range(round(math.log10(high / low)) + 1)]
    step = 10 ** math.floor(math.log10(high / 2))
    step = next(step * k for k in (1, 2, 5, 10) if high / (step * k) <= 6)
    return [k * step for k in range(int(high / step) + 1)]
