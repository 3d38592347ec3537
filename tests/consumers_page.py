"""The tables in docs/consumers.md, as consumers declare them; ``python -m tests.consumers_page`` writes them there."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

from continuum_grasp.scene.consumer import CONSUMERS, Consumer
from tests.features import FEATURES, VERBS, declared
from tests.results_page import table

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "consumers.md"
BEGIN = "<!-- What follows is written by `python -m tests.consumers_page`. -->\n"

for path in sorted((ROOT / "continuum_grasp").rglob("*.py")):
    if "scene.consumer import " in path.read_text(encoding="utf-8"):
        import_module(".".join(path.relative_to(ROOT).with_suffix("").parts))


def tables() -> str:
    """All features by verb, and the keys of all consumers, those of one verb together."""
    of = defaultdict(list)
    for name, one in sorted(CONSUMERS.items()):
        of[re.split(r"[, ]", name)[0]].append(one)
    return "\n".join([features(), *(section(whose, found) for whose, found in sorted(of.items()))])


def features() -> str:
    """Which verb takes which feature, and why not."""
    reasons: dict[str, int] = {}

    def entry(why: str | None) -> str:
        return "–" if why is None else f"no ({reasons.setdefault(why, len(reasons) + 1)})" if why else "yes"

    rows = [(one.name, *(entry(declared(one, verb)) for verb in VERBS)) for one in FEATURES]
    entries = [text for row in rows for text in row[1:] if text != "–"]
    refused = [text for text in entries if text != "yes"]
    beside = sum(len(one.refused) for one in CONSUMERS.values())
    return "\n".join(
        [
            "### Features and verbs",
            "",
            f"Of {len(entries)} pairs {len(refused)} are refused, for {len(reasons)} reasons. Declarations refuse "
            f"{beside} keys, most of them beside or without another key of the same scene.",
            "",
            *table(("", *(one.name for one in VERBS)), rows),
            *(f"{number}. {why}" for why, number in reasons.items()),
            "",
        ]
    )


def section(whose: str, consumers: list[Consumer]) -> str:
    """The keys of one verb."""
    return "\n".join(
        [f"### {whose}", "", *table(("scenes", "key", "it is", "why, or what becomes of it"), [*rows(consumers)])]
    )


def rows(consumers: list[Consumer]) -> Iterator[tuple[str, ...]]:
    """Keys with one reason together."""
    for one in consumers:
        for kind, given in (("refused", one.refused), ("otherwise", one.otherwise), ("not needed", one.unneeded)):
            of = defaultdict(list)
            for key, text in given.items():
                of[text].append(f"`{key.replace('=', ': ')}`")
            yield from ((one.name, ", ".join(keys), kind, text) for text, keys in of.items())


if __name__ == "__main__":
    written = PAGE.read_text(encoding="utf-8").split(BEGIN)[0]
    PAGE.write_text(f"{written}{BEGIN}\n{tables()}", encoding="utf-8")
    print(features().splitlines()[2])
