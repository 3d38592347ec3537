"""Constants with units of the packages that compute: ``python -m tests.similarity.constants`` lists them.

As this project writes them: a constant has its unit in the text below it, a number within a function
in the comment above it, and a macro in the comment behind it.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from itertools import pairwise

from tests.rods import ROOT

PACKAGES = ("model", "simulation", "control", "closed_loop", "grasp", "core", "planning")
UNIT = r"\[(?:1/|[1mNs]|kg|Pa|W|J|Hz|rad)(?: ?[mNs]|/[ms]2?|[2-4])*\]"
COMMENT = re.compile(rf"# (-?[0-9][0-9.e-]*): [^\n]*?({UNIT})")
MACRO = re.compile(rf"#define ([A-Z_]+) +[0-9.e-]+ +/\*[^\n]*?({UNIT})")
NONE = {"[1]", "[rad]"}


def constants() -> Iterator[tuple[str, str, str]]:
    """File, name or number, and unit of each."""
    for package in PACKAGES:
        folder = ROOT / "continuum_grasp" / package
        for path in sorted([*folder.rglob("*.py"), *folder.rglob("*.h"), *folder.rglob("*.c")]):
            file, text = str(path.relative_to(ROOT / "continuum_grasp")), path.read_text()
            found = [*_assigned(text), *COMMENT.findall(text)] if path.suffix == ".py" else MACRO.findall(text)
            yield from ((file, name, unit) for name, unit in found if unit not in NONE)


def _assigned(text: str) -> Iterator[tuple[str, str]]:
    for assigned, described in pairwise(ast.parse(text).body):
        words = described.value if isinstance(described, ast.Expr) else None
        if not (isinstance(assigned, ast.Assign) and isinstance(words, ast.Constant) and isinstance(words.value, str)):
            continue
        unit = re.search(UNIT, words.value)
        if unit and re.search(r"\d", ast.unparse(assigned.value)):
            yield ast.unparse(assigned.targets[0]), unit[0]


if __name__ == "__main__":
    for line in constants():
        print(*line)
