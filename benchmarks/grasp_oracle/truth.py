"""What the oracles say of the random scenes, stored in files beside this one.

Run ``python -m benchmarks.grasp_oracle.truth one`` (or ``none``, ``both``) in the root of the repository to add what is
missing; it resumes after an interruption. Scenes are drawn anew from their seeds, so that only seeds and answers are
stored; the first line of a file has a digest of the scenes, and answers to other scenes are refused.

An answer of ``one``, ``two`` and ``three`` is a shape of every finger: ``truth two`` shows that each touches and holds
with its tension, by linear programming. Those of several fingers were found by SQP from tables of shapes, once.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.grasp_oracle.causes import tighten, tighten_two
from benchmarks.grasp_oracle.forces import Balance, Forces
from benchmarks.grasp_oracle.geometry import Fingers, Posture
from benchmarks.grasp_oracle.numbers import numbers
from benchmarks.grasp_oracle.rod import trace
from benchmarks.grasp_oracle.scenes import digest, scene_of
from benchmarks.grasp_oracle.search import Search
from benchmarks.report import arguments
from continuum_grasp.base import ProcessPool

FOLDER = Path(__file__).with_name("answers")
SAVED = 20.0
"""Time between two writings of a file [s]."""
AHEAD = 4
"""Scenes asked about at a time, per process: those beyond the last answer that is wanted are few."""
LOOSE = 1e-6
"""Residual of the equations that ten digits of a shape leave, per the scale of forces."""
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


def shown(kind: str, row: Row) -> dict[str, float]:
    """How well an answer holds: greatest gap of its contacts and depth of its fingers, per its length, and by
    how much the least tension with which its shapes hold differs, per the greatest tensions (NaN: with none).
    """
    said = numbers(scene_of(kind, row["seed"]))
    several = row["ends"] if kind != "one" else [row["ends"]]
    halves = [np.full(2, 0.5 * hand.length) for hand in said.hands]
    lengths = [np.array(row["lengths"])] if kind == "one" else halves
    shapes = [Posture(0.0, 1, np.reshape(e, (2, 2)), h) for e, h in zip(several, lengths, strict=True)]
    gap = depth = 0.0
    for hand, shape in zip(said.hands, shapes, strict=True):
        points, _ = trace(hand.base, hand.angle, shape.ends, shape.lengths)
        touching = points[[k for k, on in enumerate((hand.middle, hand.tip)) if on], -1]
        gap = max(gap, float(np.abs(said.outline(hand.thickness).gap(touching)).max()) / hand.length)
        depth = max(depth, float(Fingers(said, hand).depth([shape])[0]) / hand.length)
    held = Forces(said).least(Balance(said, shapes), loose=LOOSE)
    off = math.nan if held is None else (held[0] - row["tension"]) / sum(map(said.most_tension, said.hands))
    return {"gap": gap, "depth": depth, "tension": off}


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
    "none": (none, 200),
    "both": (both, 60),
}
"""How each kind is searched, and how many answers there are."""
SHAPES = ("one", "two", "three")
"""Kinds whose answers are shapes."""


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
    """Add answers until there are enough, and show that those that are shapes hold."""
    asked = arguments(
        __doc__,
        kind=(..., "", sorted({*KINDS, *SHAPES})),
        count=(int, "answers of the kind; what is stored"),
        jobs=(ProcessPool.cores(), "processes"),
    )
    if asked.kind in KINDS:
        add(asked.kind, asked.count or KINDS[asked.kind][1], asked.jobs)
    if asked.kind in SHAPES:
        found = [shown(asked.kind, row) for row in answers(asked.kind)[: asked.count] if "ends" in row]
        for name in ("gap", "depth", "tension"):
            worst = sorted((abs(one[name]) for one in found), key=lambda off: (math.isnan(off), off))
            print(f"{name}: {worst[len(worst) // 2]:.2g} in the median of {len(worst)}, {worst[-1]:.2g} at most")


def add(kind: str, count: int, jobs: int) -> None:
    """Ask about further scenes until there are so many answers."""
    ask = KINDS[kind][0]
    file = FOLDER / f"{kind}.jsonl"
    answers(kind)  # refuses those of other scenes
    head, rows = _read(file)
    pool = ProcessPool(jobs)
    began = saved = time.monotonic()
    try:
        while len(rows) < count:
            seeds = list(range(head["asked"], head["asked"] + AHEAD * jobs))
            found = [future.result() for _, future in pool.as_completed(ask, seeds)]
            rows += [row for row in found if row is not None]
            head["asked"] = seeds[-1] + 1
            if time.monotonic() - saved > SAVED or len(rows) >= count:
                _write(file, kind, head["asked"], rows)
                saved = time.monotonic()
                print(f"{len(rows)} of {head['asked']}, {saved - began:.0f} s", flush=True)
    finally:
        pool.close(True)


if __name__ == "__main__":
    main()
