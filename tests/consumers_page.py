"""The lists in docs/consumers.md, as consumers declare them; ``python -m tests.consumers_page`` writes them there."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Iterator
from importlib import import_module
from pathlib import Path

from continuum_grasp.scene.consumer import CONSUMERS
from tests.features import FEATURES, VERBS, declared
from tests.results_page import table

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "consumers.md"
BEGIN = "<!-- What follows is written by `python -m tests.consumers_page`. -->\n"
SHARED = "several"
"""Heading of the reasons that more than one verb has."""

for path in sorted((ROOT / "continuum_grasp").rglob("*.py")):
    if "scene.consumer import " in path.read_text(encoding="utf-8"):
        import_module(".".join(path.relative_to(ROOT).with_suffix("").parts))


def tables() -> str:
    """Features that verbs refuse, and the keys of all consumers, one line per reason."""
    parts = [features()]
    for heading, kind in (("Refused", "refused"), ("Taken otherwise", "otherwise"), ("Not needed", "unneeded")):
        parts += [f"## {heading}", "", *reasons(kind)]
    return "\n".join(parts)


def features() -> str:
    """Features of scenes, by the verbs that refuse them."""
    pairs = {(one.name, verb.name): declared(one, verb) for one in FEATURES for verb in VERBS}
    tried = [why for why in pairs.values() if why is not None]
    refused: defaultdict[tuple[str, ...], list[str]] = defaultdict(list)
    for one in FEATURES:
        refused[tuple(verb.name for verb in VERBS if pairs[one.name, verb.name])].append(one.name)
    rows = [(", ".join(names), "; ".join(verbs)) for verbs, names in refused.items() if verbs]
    return "\n".join(
        [
            "## Features that verbs refuse",
            "",
            f"Of {len(tried)} pairs of feature and verb, {sum(map(bool, tried))} are refused:",
            "",
            *table(("feature", "refused by"), rows),
            f"All verbs that have its key take {', '.join(refused[()])}.",
            "",
        ]
    )


def reasons(kind: str) -> Iterator[str]:
    """Lines of the keys that consumers declare, by verb and reason; reasons of several verbs come first."""
    found: defaultdict[str, tuple[dict[str, None], dict[str, None]]] = defaultdict(lambda: ({}, {}))
    for name, one in sorted(CONSUMERS.items()):
        for key, why in getattr(one, kind).items():
            keys, verbs = found[why]
            keys[f"`{key.replace('=', ': ')}`"] = verbs[re.split(r"[, ]", name)[0]] = None
    lines: defaultdict[str, list[str]] = defaultdict(list)
    for why, keys, verbs in merged(found):
        behind = f" ({', '.join(verbs)})" if len(verbs) > 1 else ""
        lines[SHARED if len(verbs) > 1 else verbs[0]].append(f"- {keys}: {why}{behind}")
    for verb in sorted(lines, key=lambda verb: (verb != SHARED, verb)):
        yield from (f"**{verb}**", "", *lines[verb], "")


def merged(found: dict[str, tuple[dict[str, None], dict[str, None]]]) -> Iterator[tuple[str, str, tuple[str, ...]]]:
    """Reason, keys and verbs; reasons of the same keys and verbs that differ in their last word become one."""
    groups: defaultdict[tuple[str, str, tuple[str, ...]], list[str]] = defaultdict(list)
    for why, (keys, verbs) in found.items():
        begin, _, end = why.rpartition(" ")
        groups[begin, ", ".join(keys), tuple(verbs)].append(end)
    for (begin, keys, verbs), ends in groups.items():
        yield f"{begin} {listed(ends)}".strip(), keys, verbs


def listed(words: Iterable[str]) -> str:
    """Words as a list with commas."""
    return ", ".join(words)


if __name__ == "__main__":
    written = PAGE.read_text(encoding="utf-8").split(BEGIN)[0]
    PAGE.write_text(f"{written}{BEGIN}\n{tables()}", encoding="utf-8")
    print(features().splitlines()[2])
