"""Reads docs/errata.md: its tables, and the formulas in them as functions."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

PAGE = Path(__file__).parent.parent / "docs" / "errata.md"
_TOKEN = re.compile(r"θ[12]'?|[A-Za-z]\w*|\d+|[-+*/()^]")


def table(heading: str, page: Path = PAGE) -> list[list[str]]:
    """Cells of the rows of the first table under a heading."""
    section = page.read_text(encoding="utf-8").split(f"\n## {heading}\n")[1].split("\n## ")[0]
    lines = [line for line in section.splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in line.strip("|").split(" | ")] for line in lines[2:]]


def spans(cell: str) -> list[str]:
    """Formulas of a cell."""
    return re.findall(r"`([^`]*)`", cell)


def formula(text: str) -> str:
    """The one formula of a cell, or the cell itself."""
    found = spans(text)
    return found[0] if found else text


def percent(cell: str) -> tuple[float, float]:
    """Number of percent in a cell, and half a unit of its last digit."""
    found = re.search(r"(\d+)(\.\d+)? %", cell)
    assert found, cell
    return float(found[1] + (found[2] or "")), 0.5 * 10.0 ** -len((found[2] or ".")[1:])


def number(cell: str) -> tuple[float, float]:
    """A number, and half a unit of its last digit."""
    digits, _, power = cell.partition("e")
    decimals = len(digits.partition(".")[2])
    return float(cell), 0.5 * 10.0 ** (int(power or 0) - decimals)


def evaluate(text: str, names: dict[str, Any], exact: Callable[[int], Any] = float) -> Any:
    """Value of a formula; ``exact`` makes its whole numbers."""
    tokens = _TOKEN.findall(text)
    assert "".join(tokens) == re.sub(r"\s", "", text), text
    words: list[str] = []
    for k, token in enumerate(tokens):
        starts = token[0].isalnum() or token == "("
        if k and starts and (tokens[k - 1][-1].isalnum() or tokens[k - 1][-1] in ")'"):
            words.append("*")
        if token.isdigit() and not (k and tokens[k - 1] == "^"):
            words.append(f"exact({token})")
        else:
            words.append({"^": "**"}.get(token, token.replace("'", "_rate")))
    return eval("".join(words), {"__builtins__": {}}, {**names, "exact": exact})
