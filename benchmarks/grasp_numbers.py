"""What each tuned number of the grasp search decides: scenes held, their tensions, and time, with half and twice of it.

    python -m benchmarks.grasp_numbers
    python -m benchmarks.grasp_numbers --numbers FLAT PICKED --count 10

Numbers are those that modules of the search name in capitals; the scenes are of ``benchmarks.grasp_populations``. A
number with which nothing changes, either way, decides nothing there.
"""

from __future__ import annotations

import ast
import importlib
import pkgutil
import statistics
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import yaml

import continuum_grasp as cg
from benchmarks.grasp_populations import EQUAL, HELD, LITTLE, document
from benchmarks.report import begun

PACKAGES = "finger_map", "rods"
"""Of the package of grasps, those whose numbers decide on what is tried."""
FACTORS = 0.5, 2.0
SHARED = "FORCE", "MOST_MIDDLES", "WIDE"
"""Numbers that the kernels in C share."""


@dataclass(frozen=True)
class Number:
    """A number, or several, that a module names."""

    module: ModuleType
    name: str

    @property
    def value(self) -> Any:
        return getattr(self.module, self.name)

    @contextmanager
    def times(self, factor: float) -> Iterator[Any]:
        """Give it a multiple of its value, wherever it was imported."""
        value = self.value
        users = [each for each in map(sys.modules.get, sorted(sys.modules)) if _names(each, self.name, value)]
        changed = scaled(value, factor)
        for user in users:
            setattr(user, self.name, changed)
        try:
            yield changed
        finally:
            for user in users:
                setattr(user, self.name, value)


def _names(module: ModuleType | None, name: str, value: Any) -> bool:
    inside = module is not None and module.__name__.startswith("continuum_grasp.grasp")
    return inside and vars(module).get(name) is value


def scaled(value: Any, factor: float) -> Any:
    """A number times a factor, a count being one at least; or each of several."""
    if isinstance(value, dict):
        return {key: scaled(each, factor) for key, each in value.items()}
    if isinstance(value, tuple):
        return tuple(scaled(each, factor) for each in value)
    return max(round(factor * value), 1) if isinstance(value, int) else factor * value


def numbers() -> list[Number]:
    """All numbers of the search."""
    found = []
    for package in PACKAGES:
        first = importlib.import_module(f"continuum_grasp.grasp.{package}")
        inside = pkgutil.iter_modules(getattr(first, "__path__", []), f"{first.__name__}.")
        for module in (first, *(importlib.import_module(each.name) for each in inside)):
            tree = ast.parse(Path(str(module.__file__)).read_text(encoding="utf-8"))
            names = [name for node in tree.body if isinstance(node, ast.Assign) for name in _assigned(node)]
            found += [Number(module, name) for name in names if _numeric(getattr(module, name))]
    return found


def _assigned(node: ast.Assign) -> list[str]:
    """Names in capitals that a statement assigns."""
    targets = [name for target in node.targets for name in ast.walk(target) if isinstance(name, ast.Name)]
    return [name.id for name in targets if name.id.isupper() and name.id not in SHARED]


def _numeric(value: Any) -> bool:
    if isinstance(value, (dict, tuple)):
        parts = value.values() if isinstance(value, dict) else value
        return bool(value) and all(map(_numeric, parts))
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def outcome(scene: Any) -> tuple[str, float, float]:
    """Status of a search, sum of the tensions [N], processor time [s]."""
    began = time.process_time()
    try:
        result = cg.optimize_grasp(scene, raise_on_failure=False)
    except Exception as error:  # is an outcome, too: a number may be beyond what the search bears
        return type(error).__name__, float("nan"), time.process_time() - began
    total = sum(sum(finger.tensions) for finger in result.fingers.values())
    return result.status.value, total, time.process_time() - began


def compared(before: list[tuple[str, float, float]], after: list[tuple[str, float, float]], most: list[float]) -> str:
    """Scenes found and lost, held with less and with more, other words where nothing holds; and the time per usual."""
    counts = {"found": 0, "lost": 0, "less": 0, "more": 0, "other": 0}
    for (status, total, _), (now, by, _), greatest in zip(before, after, most, strict=True):
        held, holds = status in HELD, now in HELD
        little = LITTLE * greatest
        if held != holds:
            counts["found" if holds else "lost"] += 1
        elif held and abs(by - total) > EQUAL * (total + little) + little:
            counts["less" if by < total else "more"] += 1
        elif status != now:
            counts["other"] += 1
    shown = [f"{count} {word}" for word, count in counts.items() if count]
    share = statistics.median(now[2] / max(was[2], 1e-3) for was, now in zip(before, after, strict=True))
    return f"{', '.join(shown) or 'same'}; {share:.2f}"


def main() -> None:
    asked, report = begun(
        __doc__,
        "grasp_numbers",
        population=(("one", "one_tip", "one_outline", "two", "two_middle", "three"), "whose scenes are solved"),
        count=(4, "scenes of each"),
        elements=(8, "per finger"),
        numbers=([str], "names of those that are changed; all by default"),
    )
    scenes, most = [], []
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "scene.yaml"
        for population in asked.population:
            for k in range(asked.count):
                file.write_text(yaml.safe_dump(document(population, k, elements=asked.elements)), encoding="utf-8")
                scenes.append(cg.load(file))
                most.append(sum(2.0 * setup.tendons.max_tension for setup in scenes[-1].setups))
    for scene in scenes:  # builds what the process remembers
        outcome(scene)
    before = [outcome(scene) for scene in scenes]
    note = "What half and twice of each number change, and the median of the processor time per usual time."
    table = report.table(f"{len(scenes)} scenes", ["module", "number", "value", "half", "twice"], note=note)
    for number in numbers():
        if asked.numbers and number.name not in asked.numbers:
            continue
        cells = []
        for factor in FACTORS:
            with number.times(factor):
                cells.append(compared(before, [outcome(scene) for scene in scenes], most))
        where = number.module.__name__.removeprefix("continuum_grasp.grasp.")
        table.add(where, number.name, str(number.value), *cells)
    report.finish()


if __name__ == "__main__":
    main()
