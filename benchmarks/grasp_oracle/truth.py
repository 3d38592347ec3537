"""What the oracles say of the random scenes, stored in files beside this one.

Run ``python -m benchmarks.grasp_oracle.truth one`` (or ``two``, ``three``, ``none``, ``both``) in the root of the
repository; it resumes after an interruption. Scenes are drawn anew from their seeds, so that only seeds and answers are
stored; the first line of a file has a digest of the scenes, and answers to other scenes are refused.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks.grasp_oracle.causes import tighten, tighten_two
from benchmarks.grasp_oracle.numbers import numbers
from benchmarks.grasp_oracle.pinches import Pinches
from benchmarks.grasp_oracle.scenes import digest, scene_of
from benchmarks.grasp_oracle.search import Search
from continuum_grasp.workers import ProcessPool, cores

FOLDER = Path(__file__).with_name("answers")
SAVED = 20.0
"""Time between two writings of a file [s]."""
AHEAD = 4
"""Scenes asked about at a time, per process: those beyond the last answer that is wanted are few."""
SLACK = 1e-3
"""Sum of tensions, per sum of the greatest ones, up to which the bases press: not a pinch that is asked for."""
TWICE = 999
"""The answer of ``one`` whose scene is the first with two tightened limits; earlier ones follow."""
Row = dict[str, Any]


def one(seed: int) -> Row | None:
    """The least sum of tensions of one finger, and the shape that has it."""
    best = Search(numbers(scene_of("one", seed))).best()
    if best is None:
        return None
    shape = {"u": best.posture.u, "side": best.posture.side, "ends": best.posture.ends.ravel().tolist()}
    return {"seed": seed, "tension": best.value, **shape, "lengths": best.posture.lengths.tolist()}


def two(seed: int) -> Row | None:
    """A sum of tensions with which two fingers pinch, and their shapes."""
    return _pinched("two", seed)


def three(seed: int) -> Row | None:
    """The same of three fingers."""
    return _pinched("three", seed)


def _pinched(kind: str, seed: int) -> Row | None:
    said = numbers(scene_of(kind, seed))
    best = Pinches(said).best()
    if best is None or best.value <= SLACK * sum(map(said.most_tension, said.hands)):
        return None
    return {"seed": seed, "tension": best.value, "ends": [p.ends.ravel().tolist() for p in best.postures]}


def none(number: int) -> Row | None:
    """What makes the scene of the so manieth answer of ``one`` infeasible."""
    seed = answers("one")[number]["seed"]
    row = tighten(seed, number)
    return None if row is None else {"scene": seed, "seed": number, **row}


def both(number: int) -> Row | None:
    """The same by two limits, each of which is too tight whatever the other is."""
    seed = answers("one")[TWICE - number]["seed"]
    row = tighten_two(seed, number)
    return None if row is None else {"scene": seed, "seed": number, **row}


KINDS: dict[str, tuple[Callable[[int], Row | None], int]] = {
    "one": (one, 1100),
    "two": (two, 300),
    "three": (three, 100),
    "none": (none, 200),
    "both": (both, 60),
}
"""How each kind is answered, and how many answers there are."""


def answers(kind: str, folder: Path = FOLDER) -> list[Row]:
    """The answers of one kind, by increasing seed; empty where none were asked for."""
    head, rows = _read(folder / f"{kind}.jsonl")
    if rows and head["scenes"] != _digest(kind, rows):
        raise RuntimeError(f"answers/{kind}.jsonl answers other scenes than are drawn now: remove it, and ask anew")
    return rows


def _digest(kind: str, rows: list[Row]) -> str:
    of_one = kind in ("none", "both")
    return digest("one" if of_one else kind, [row["scene" if of_one else "seed"] for row in rows])


def _read(file: Path) -> tuple[Row, list[Row]]:
    if not file.exists():
        return {"asked": 0, "scenes": ""}, []
    head, *rows = (json.loads(line) for line in file.read_text(encoding="utf-8").splitlines())
    return head, rows


def _write(file: Path, kind: str, asked: int, rows: list[Row]) -> None:
    rows.sort(key=lambda row: row["seed"])
    lines = [json.dumps({"asked": asked, "scenes": _digest(kind, rows)})]
    lines += [json.dumps({k: _short(v) for k, v in row.items()}) for row in rows]
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _short(value: Any) -> Any:
    if isinstance(value, float):
        return float(f"{value:.10g}")
    return [_short(v) for v in value] if isinstance(value, list) else value


def main() -> None:
    """Add answers until there are enough."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("kind", choices=sorted(KINDS))
    parser.add_argument("--count", type=int)
    parser.add_argument("--jobs", type=int, default=cores())
    asked = parser.parse_args()
    ask, count = KINDS[asked.kind]
    count = asked.count or count
    file = FOLDER / f"{asked.kind}.jsonl"
    answers(asked.kind)  # refuses those of other scenes
    head, rows = _read(file)
    pool = ProcessPool(asked.jobs)
    began = saved = time.monotonic()
    try:
        while len(rows) < count:
            seeds = list(range(head["asked"], head["asked"] + AHEAD * asked.jobs))
            found = [future.result() for _, future in pool.as_completed(ask, seeds)]
            rows += [row for row in found if row is not None]
            head["asked"] = seeds[-1] + 1
            if time.monotonic() - saved > SAVED or len(rows) >= count:
                _write(file, asked.kind, head["asked"], rows)
                saved = time.monotonic()
                print(f"{len(rows)} of {head['asked']}, {saved - began:.0f} s", flush=True)
    finally:
        pool.close(True)


if __name__ == "__main__":
    main()
