"""What the oracles say of the random scenes, stored in files beside this one.

Run ``python -m benchmarks.grasp_oracle.truth one`` (or ``two``, ``none``) in the root of the repository; it resumes
after an interruption. Scenes are made anew from their seeds, so that only seeds and answers are stored.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from benchmarks.grasp_oracle.causes import tighten
from benchmarks.grasp_oracle.numbers import numbers
from benchmarks.grasp_oracle.pairs import Pinches
from benchmarks.grasp_oracle.scenes import one_finger, two_fingers
from benchmarks.grasp_oracle.search import Search

FOLDER = Path(__file__).with_name("answers")
Row = dict[str, Any]


def one(seed: int) -> Row:
    """The least sum of tensions of one finger, and the shape that has it."""
    search = Search(numbers(one_finger(seed)))
    best = search.best()
    if best is None:
        return {"seed": seed}
    shape = {"u": best.posture.u, "side": best.posture.side, "ends": best.posture.ends.ravel().tolist()}
    return {"seed": seed, "tension": best.value, **shape, "lengths": best.posture.lengths.tolist()}


def two(seed: int) -> Row:
    """A sum of tensions with which two fingers pinch, and their shapes."""
    best = Pinches(numbers(two_fingers(seed))).best()
    if best is None:
        return {"seed": seed}
    return {"seed": seed, "tension": best.value, "ends": [p.ends.ravel().tolist() for p in best.postures]}


def answers(kind: str) -> list[Row]:
    """The rows of one kind that have an answer."""
    return [row for row in _rows(FOLDER / f"{kind}.jsonl") if len(row) > 1]


def _rows(file: Path) -> list[Row]:
    if not file.exists():
        return []
    return [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()]


def _seeds(done: list[Row]) -> Iterator[int]:
    first = 1 + max((row["seed"] for row in done), default=-1)
    while True:
        yield first
        first += 1


def main() -> None:
    """Append answers until there are enough."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("kind", choices=sorted(KINDS))
    parser.add_argument("--count", type=int)
    arguments = parser.parse_args()
    ask, count = KINDS[arguments.kind]
    file = FOLDER / f"{arguments.kind}.jsonl"
    FOLDER.mkdir(exist_ok=True)
    done = _rows(file)
    found = sum(len(row) > 1 for row in done)
    began = time.monotonic()
    with file.open("a", encoding="utf-8") as out:
        for seed in _seeds(done):
            if found >= (arguments.count or count):
                break
            row = ask(seed)
            found += len(row) > 1
            out.write(json.dumps({k: _short(v) for k, v in row.items()}) + "\n")
            out.flush()
            if seed % 50 == 0:
                print(f"seed {seed}: {found} found, {time.monotonic() - began:.0f} s", flush=True)


def _short(value: Any) -> Any:
    if isinstance(value, float):
        return float(f"{value:.10g}")
    return [_short(v) for v in value] if isinstance(value, list) else value


def none(number: int) -> Row:
    """What makes the scene of the so manieth answer of ``one`` infeasible."""
    seed = answers("one")[number]["seed"]
    row = tighten(seed, number)
    return {"seed": number} if row is None else {"scene": row.pop("seed"), "seed": number, **row}


KINDS: dict[str, tuple[Callable[[int], Row], int]] = {"one": (one, 1000), "two": (two, 300), "none": (none, 200)}


if __name__ == "__main__":
    main()
