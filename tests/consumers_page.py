"""The lists in docs/consumers.md, as consumers declare them; ``python -m tests.consumers_page`` writes them there."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

from continuum_grasp.scene import Consumer
from tests.features import FEATURES, VERBS, declared
from tests.results_page import table

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "consumers.md"
BEGIN = "<!-- What follows is written by `python -m tests.consumers_page`. -->\n"
for path in sorted((ROOT / "continuum_grasp").rglob("*.py")):
    if "scene.consumer import " in path.read_text(encoding="utf-8"):
        import_module(".".join(path.relative_to(ROOT).with_suffix("").parts))


def tables() -> str:
    """Features that verbs refuse, and the keys that consumers change or ignore, one line per reason."""
    parts = [features()]
    for heading, kind in (("Changed keys", "otherwise"), ("Ignored keys", "unneeded")):
        parts += [f"## {heading}", "", *reasons(kind)]
    return "\n".join(parts)


def features() -> str:
    """Features of scenes, by the verbs that refuse them."""
    pairs = {(one.name, verb.name): declared(one, verb) for one in FEATURES for verb in VERBS}
    tried = [why for why in pairs.values() if why is not None]
    refused: defaultdict[tuple[str, ...], list[str]] = defaultdict(list)
    for one in FEATURES:
        refused[tuple(verb.name for verb in VERBS if pairs[one.name, verb.name])].append(one.name)
    rows: list[tuple[str, ...]] = [(", ".join(names), "; ".join(verbs)) for verbs, names in refused.items() if verbs]
    return "\n".join(
        [
            "## Features that verbs refuse",
            "",
            f"Of {len(tried)} pairs of feature and verb, {sum(map(bool, tried))} are unsupported:",
            "",
            *table(("feature", "refused by"), rows),
            f"Supported by all verbs that have the key: {', '.join(refused[()])}.",
            "",
        ]
    )


def reasons(kind: str) -> Iterator[str]:
    """Lines of the keys that consumers declare, below the verbs that they are about."""
    found: defaultdict[str, tuple[dict[str, None], dict[str, None]]] = defaultdict(lambda: ({}, {}))
    for name, one in sorted(Consumer.DECLARED.items()):
        for key, why in getattr(one, kind).items():
            keys, verbs = found[why]
            keys[key.replace("=", ": ")] = verbs[re.match(r"export to \w+|[^, ]+", name)[0]] = None
    lines: defaultdict[str, list[str]] = defaultdict(list)
    for line, heading in merged({why: (tuple(keys), ", ".join(verbs)) for why, (keys, verbs) in found.items()}):
        lines[heading].append(f"- {line}")
    for heading in sorted(lines):
        yield from (f"**{heading}**", "", *lines[heading], "")


def joined(keys: tuple[str, ...]) -> Iterator[str]:
    """Keys of one parent together, as shells write them: ``table.{point,stays}``."""
    groups: defaultdict[str, list[str]] = defaultdict(list)
    for key in keys:
        parent = key[: key.rfind(": ") + 2] if ": " in key else key[: key.rfind(".") + 1]
        groups[parent].append(key.removeprefix(parent))
    for parent, names in groups.items():
        if parent and len(names) > 1:
            yield f"{parent}{{{','.join(names)}}}"
        else:
            yield from (parent + name for name in names)


def merged(found: dict[str, tuple[tuple[str, ...], str]]) -> Iterator[tuple[str, str]]:
    """Line and verbs of each reason; reasons of the same verbs that differ in one name become one line."""
    groups: defaultdict[tuple[str, str], list[str]] = defaultdict(list)
    for why, (keys, verbs) in found.items():
        texts = [", ".join(f"`{key}`" for key in joined(keys)), why]
        last = {key.rpartition(".")[2] for key in keys}
        name = last.pop() if len(last) == 1 else ""
        alike = re.search(rf"\b{re.escape(name)}\b", why) if name else None
        if alike is None:  # reasons with the same keys
            name = why.rpartition(" ")[2]
        pattern = rf"(?<![a-z_]){re.escape(name)}(?![a-z_])"
        texts[0 if alike else 1 :] = [re.sub(pattern, "NAME", text) for text in texts[0 if alike else 1 :]]
        groups[": ".join(texts), verbs].append(name)
    for (line, verbs), names in groups.items():
        yield (f"{line}, NAME being {', '.join(names)}" if len(names) > 1 else line.replace("NAME", names[0])), verbs


if __name__ == "__main__":
    written = PAGE.read_text(encoding="utf-8").split(BEGIN)[0]
    PAGE.write_text(f"{written}{BEGIN}\n{tables()}", encoding="utf-8")
    print(features().splitlines()[2])
