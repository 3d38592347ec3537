"""The tables in docs/consumers.md, as consumers declare them; ``python -m tests.consumers_page`` writes them there."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from pathlib import Path

from continuum_grasp.scene.consumer import CONSUMERS, Consumer
from tests.results_page import table

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "consumers.md"
BEGIN = "<!-- What follows is written by `python -m tests.consumers_page`. -->\n"

for path in sorted((ROOT / "continuum_grasp").rglob("*.py")):
    if "scene.consumer import " in path.read_text(encoding="utf-8"):
        import_module(".".join(path.relative_to(ROOT).with_suffix("").parts))


def tables() -> str:
    """The keys of all consumers, by name."""
    return "\n".join(section(one) for _, one in sorted(CONSUMERS.items()))


def section(one: Consumer) -> str:
    """One consumer."""
    kinds: tuple[tuple[str, Mapping[str, str]], ...] = (
        ("refused", one.refused),
        ("otherwise", one.otherwise),
        ("not needed", one.unneeded),
    )
    rows = [(f"`{key.replace('=', ': ')}`", kind, text) for kind, given in kinds for key, text in given.items()]
    return "\n".join([f"### {one.name}", "", *table(("key", "it is", "why, or what becomes of it"), rows)])


if __name__ == "__main__":
    written = PAGE.read_text(encoding="utf-8").split(BEGIN)[0]
    PAGE.write_text(f"{written}{BEGIN}\n{tables()}", encoding="utf-8")
