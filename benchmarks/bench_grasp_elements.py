"""Whether a grasp scene and its images have the same grasp, with fingers of several elements, and how long that takes.

Scenes are random (``benchmarks.grasp_images``); the best of all images of a scene is the oracle. Grasps of uniform
fingers are checked by equations that share nothing with the package, and outlines that two elements do not hold are
searched by brute force (``benchmarks.grasp_oracle``). Times are processor time after the build.

Every outcome is a line of the record ``--rows``, to which a further run adds what it lacks: ``--population 1`` is the
whole list of scenes, ``--population 0.1`` a tenth of every kind, ``--count 0`` writes the report alone.
"""

from __future__ import annotations

import json
import math
import re
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.grasp_images import IMAGES, drawn, force_unit, images, scene_of
from benchmarks.grasp_oracle.check import LIMITS, residuals
from benchmarks.grasp_oracle.numbers import numbers
from benchmarks.grasp_oracle.search import Search
from benchmarks.grasp_outcomes import solved
from benchmarks.harness import spread
from benchmarks.report import Report, begun
from continuum_grasp.base import ProcessPool
from continuum_grasp.scene import GraspScene

EQUAL, LITTLE, WORSE = 1e-6, 1e-6, 1e-2
"""Relative difference of equal tensions; tension that is none, per the greatest; part by which one is worse."""
SLACK = 0.03
"""Part of every limit that a grasp of the brute force keeps free before it counts."""
POPULATION = {"one": 1000, "two": 300, "three": 100, "tapered": 200, "outline": 200, "infeasible": 300}
"""Scenes of each kind in the whole list."""
Row = dict[str, Any]


def outcome(task: tuple[str, str, str, Row, int, str]) -> Row:
    """What becomes of an image: status, tension in its unit of force, processor time, iterations; the greatest residual
    of a grasp per its limit, and whether the brute force has one where the package has none.
    """
    kind, name, image, data, elements, effort = task
    scene = scene_of(data, elements).changed({"solver.effort": effort})
    most = sum(setup.max_tension for setup in scene.setups)
    row: Row = {"kind": kind, "scene": name, "image": image, "effort": effort, "most": most / force_unit(image)}
    result, seconds, note = solved(scene)
    if result is None:
        return row | {"status": "error", "tension": None, "ms": None, "iterations": 0, "note": note}
    row |= {
        "status": str(result.status),
        "tension": float(result.tension) / force_unit(image) if result.solved else None,
        "ms": round(1e3 * (seconds["all_seconds"] - seconds["build_seconds"]), 1),
        "iterations": result.statistics["total_iterations"],
    }
    if result.solved and kind != "tapered":
        row["residual"] = max(value / LIMITS[key] for key, value in residuals(scene, result.arrays).items())
    elif not result.solved and kind == "outline" and elements == 2:
        row["held"] = held(scene)
    return row


def held(scene: GraspScene) -> float | None:
    """The tension of a grasp by brute force that keeps clear of every limit [N]; None where it has none."""
    given = numbers(scene)
    limits, (hand,) = given.limits, given.hands
    slack = {name: (1.0 - SLACK) * getattr(limits, name) for name in ("friction", "normal", "strain", "bend")}
    tight = given.limited(**slack, mass=limits.mass * (1.0 + SLACK), tension=(1.0 - SLACK) * hand.most)
    best = Search(tight).best()
    return None if best is None else best.value


def judged(rows: list[Row], known: dict[str, float]) -> dict[str, list[str]]:
    """What is wrong with the images of some scenes, of each of which the least known tension is the oracle."""
    scenes: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        scenes.setdefault((row["scene"], row["effort"]), []).append(row)
    wrong: dict[str, list[str]] = {}
    names = ("status differs", "tension differs", "worse", "missed", "false certificate", "false infeasible")
    status, tension, worse, missed, false, infeasible = (wrong.setdefault(name, []) for name in names)
    for (name, effort), some in scenes.items():
        tensions = [row["tension"] for row in some if row["tension"] is not None]
        least, little = known.get(name, math.inf), LITTLE * some[0]["most"]
        if len({row["status"] for row in some}) > 1:
            status.append(f"{name} {effort}: {', '.join(row['status'] for row in some)}")
        if tensions and max(tensions) - min(tensions) > EQUAL * abs(min(tensions)) + little:
            tension.append(f"{name} {effort}: {', '.join(f'{t:.7g}' for t in tensions)}")
        for row in some:
            what = f"{name} {effort} {row['image']}: {row['status']}"
            if row["tension"] is None and math.isfinite(least):
                missed.append(f"{what} for {least:.5g}")
            elif row["tension"] is not None and row["tension"] > (1.0 + WORSE) * least + little:
                worse.append(f"{what} {row['tension']} for {least:.5g}")
            if row.get("residual", 0.0) > 1.0:
                false.append(f"{what} {row['residual']:.3g}")
            if row.get("held") is not None:
                (infeasible if row["status"] == "infeasible" else missed).append(f"{what} for {row['held']:.5g}")
    return wrong


def add(report: Report, rows: list[Row]) -> None:
    """Claims and tables of some rows."""
    known: dict[str, float] = {}
    for row in rows:
        if row["tension"] is not None:
            known[row["scene"]] = min(known.get(row["scene"], math.inf), row["tension"])
    wrong = judged(rows, known)
    for what, found in wrong.items():
        report.claim(what, len(found), "<=", 0)
    groups: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        groups.setdefault((row["kind"], row["effort"]), []).append(row)
    columns = ["kind", "effort", "status", "images", "median [ms]", "95 % [ms]", "iterations, median", "95 %"]
    times = report.table("By kind and status", columns, note="Processor time after the build.")
    table = report.table("By kind", ["kind", "effort", "scenes", "images", *wrong])
    for (kind, effort), group in groups.items():
        found = [len(each) for each in judged(group, known).values()]
        table.add(kind, effort, len({row["scene"] for row in group}), len(group), *found)
        for status in sorted({row["status"] for row in group}):
            some = [row for row in group if row["status"] == status]
            spent = [np.percentile([row[key] or 0.0 for row in some], (50, 95)) for key in ("ms", "iterations")]
            times.add(kind, effort, status, len(some), *np.concatenate(spent).tolist())
    for what, found in wrong.items():
        if found:
            report.table(what, ["scene"], [[each] for each in found])


def read(file: Path) -> list[Row]:
    """The rows of a record; a line that an interruption tore is left out."""
    lines = file.read_text(encoding="utf-8").splitlines() if file.exists() else []
    return [json.loads(line) for line in lines if line.endswith("}")]


def main() -> None:
    """Run the scenes asked for and write the report."""
    asked, report = begun(
        __doc__,
        "grasp_elements",
        kind=(["one"], "one, union, two, three, wrap, tapered, outline, infeasible"),
        first=(0, "the first seed"),
        count=(40, "seeds per kind"),
        population=(float, "this part of the whole list in place of --kind and --count"),
        elements=[4, 8],
        effort=(["normal"], "quick, normal, thorough"),
        images=(tuple(IMAGES), ""),
        rows=(Path, "record to go on with; by default one in the folder"),
        jobs=(ProcessPool.cores(), "processes"),
    )
    counts = dict.fromkeys(asked.kind, asked.count)
    if asked.population is not None:
        counts = {kind: math.ceil(asked.population * count) for kind, count in POPULATION.items()}
    asked.folder.mkdir(parents=True, exist_ok=True)
    record = asked.rows or asked.folder / "grasp_elements_rows.jsonl"
    rows = read(record)
    done = {(row["scene"], row["image"], row["effort"]) for row in rows}
    tasks = [
        (kind, name, image, shown, n, effort)
        for effort, n, (kind, count) in product(asked.effort, asked.elements, counts.items())
        for seed in range(asked.first, asked.first + count)
        for image, shown in images(drawn(kind, seed), asked.images).items()
        if ((name := f"{kind} {seed}, {n}"), image, effort) not in done
    ]
    # Scenes that differ in numbers alone share their equations.
    tasks.sort(key=lambda task: (task[0], task[4], re.sub(r"-?\d+(\.\d+)?(e-?\d+)?", "", json.dumps(task[3]))))
    with record.open("a", encoding="utf-8") as lines:
        for _, row, error in spread(outcome, tasks, asked.jobs):
            if error is not None:
                raise error
            rows.append(row)
            # A new line first: an interruption may have torn the last one.
            lines.write("\n" + json.dumps(row))
            lines.flush()
    add(report, rows)
    report.finish()


if __name__ == "__main__":
    main()
