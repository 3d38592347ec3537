"""Whether a grasp scene and its images have the same grasp, with fingers of several elements, and how long that takes.

Run ``python -m benchmarks.bench_grasp_elements`` in the root of the repository. Scenes are random
(``benchmarks.grasp_images``); the best of all images of a scene, and of records named by ``--with``, is the oracle.
Times are processor time after the problems are built.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from benchmarks.grasp_images import IMAGES, drawn, force_unit, images, scene_of
from benchmarks.report import RESULTS, Report, Table
from continuum_grasp.grasp import optimize_grasp
from continuum_grasp.grasp.search import Search
from continuum_grasp.grasp.values import tension_of
from continuum_grasp.nlp import Budget
from continuum_grasp.scene.grasp import GraspScene
from continuum_grasp.workers import ProcessPool, cores

EQUAL, LITTLE, WORSE = 1e-6, 1e-6, 1e-2
"""Relative difference of equal tensions; tension that is none, per the greatest; part by which one is worse."""


def outcome(task: tuple[str, str, dict[str, Any], int, bool]) -> dict[str, Any]:
    """What becomes of an image: status, tension in its unit of force, processor time, iterations."""
    name, image, data, elements, searches = task
    scene = scene_of(data, elements)
    most = sum(setup.max_tension for setup in scene.setups)
    row: dict[str, Any] = {"scene": name, "image": image, "most": most / force_unit(image)}
    began, used = time.perf_counter(), time.process_time()
    try:
        status, tension, build, iterations = _searched(scene) if searches else _solved(scene)
    except Exception as error:  # whatever it is, it is an outcome
        return row | {"status": "error", "tension": None, "ms": math.nan, "iterations": 0, "note": repr(error)[:200]}
    used, share = time.process_time() - used, (time.process_time() - used) / (time.perf_counter() - began)
    tension = None if tension is None else tension / force_unit(image)
    ms = 1e3 * (used - build * share)
    return row | {"status": status, "tension": tension, "ms": round(ms, 1), "iterations": iterations}


def _solved(scene: GraspScene) -> tuple[str, float | None, float, int]:
    result = optimize_grasp(scene, raise_on_failure=False)
    counts = result.statistics
    tension = float(result.tension) if result.solved else None
    return str(result.status), tension, counts["build_seconds"], counts["total_iterations"]


def _searched(scene: GraspScene) -> tuple[str, float | None, float, int]:
    """The search alone, without reasons why there is no grasp."""
    search = Search(scene, budget := Budget.of(scene.solver))
    search.run()
    used = scene.solver.max_total_iterations - budget.left
    if search.best is None:
        return "none", None, search.build_seconds, used
    return (
        "open" if search.exploration.open else "found",
        tension_of(scene, search.best.arrays),
        search.build_seconds,
        used,
    )


def judged(rows: list[dict[str, Any]], known: dict[str, float]) -> dict[str, Any]:
    """Figures of all images of some scenes."""
    scenes: dict[str, list[dict[str, Any]]] = {}
    for row in rows:
        scenes.setdefault(row["scene"], []).append(row)
    other_status, other_tension, worse, worst = [], [], [], []
    for name, some in scenes.items():
        tensions = [row["tension"] for row in some if row["tension"] is not None]
        least, little = min([*tensions, known.get(name, math.inf)]), LITTLE * some[0]["most"]
        if len({row["status"] for row in some}) > 1:
            other_status.append(name)
        if tensions and max(tensions) - min(tensions) > EQUAL * abs(min(tensions)) + little:
            other_tension.append(f"{name}: {', '.join(f'{t:.7g}' for t in tensions)}")
        late = [row for row in some if row["tension"] is None or row["tension"] > (1.0 + WORSE) * least + little]
        if math.isfinite(least):
            worse += [
                f"{name} {r['image']}: {r['status']} {r['tension']} for {least:.5g}" for r in late if r["tension"]
            ]
            worst += [f"{name} {r['image']}: {r['status']} for {least:.5g}" for r in late if r["tension"] is None]
    return {"status differs": other_status, "tension differs": other_tension, "worse": worse, "missed": worst}


def main() -> None:
    """Run the scenes asked for and write the report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kind", nargs="*", default=["one"], help="one, union, two, three, wrap")
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    parser.add_argument("--count", type=int, default=40, help="seeds per kind")
    parser.add_argument("--elements", type=int, nargs="*", default=[4, 8])
    parser.add_argument("--images", nargs="*", choices=list(IMAGES), default=list(IMAGES))
    parser.add_argument("--case", type=Path, nargs="*", default=[], help="scenes of files, with their own elements")
    parser.add_argument("--search", action="store_true", help="no reasons why there is no grasp")
    parser.add_argument("--with", dest="others", type=Path, nargs="*", default=[], help="records that may know better")
    parser.add_argument("--jobs", type=int, default=cores(), help="processes")
    parser.add_argument("--folder", type=Path, default=RESULTS, help="where to write the report")
    arguments = parser.parse_args()
    known: dict[str, float] = {}
    for file in arguments.others:
        for row in json.loads(file.read_text(encoding="utf-8")):
            if row["tension"] is not None:
                known[row["scene"]] = min(known.get(row["scene"], math.inf), row["tension"])
    seeds = range(arguments.first, arguments.first + arguments.count)
    scenes = [(f"{k} {s}, {n}", drawn(k, s), n) for n in arguments.elements for k in arguments.kind for s in seeds]
    for file in arguments.case:
        data = yaml.safe_load(file.read_text(encoding="utf-8"))
        scenes.append((file.stem, data, data["fidelity"]["elements"]))
    tasks = [
        (name, image, shown, n, arguments.search)
        for name, data, n in scenes
        for image, shown in images(data, arguments.images).items()
    ]
    pool, rows = ProcessPool(arguments.jobs), [dict[str, Any]()] * len(tasks)
    try:
        for k, future in pool.as_completed(outcome, tasks):
            rows[k] = future.result()
            print(json.dumps(rows[k]), flush=True)
    finally:
        pool.close(True)
    report, wrong = Report("grasp_elements", arguments.first), judged(rows, known)
    for what, found in wrong.items():
        report.claim(what, len(found), "<=", 0)
    table = []
    for status in sorted({row["status"] for row in rows}):
        some = [row for row in rows if row["status"] == status]
        spent = [np.percentile([row[key] for row in some], p) for key in ("ms", "iterations") for p in (50, 95)]
        table.append([status, len(some), *map(float, spent)])
    columns = ["status", "images", "median [ms]", "95 % [ms]", "iterations, median", "95 %"]
    report.tables.append(Table("By status", columns, table, "Processor time after the build."))
    report.tables += [Table(what, ["scene"], [[each] for each in found]) for what, found in wrong.items() if found]
    for written in report.write(arguments.folder):
        print(written)
    (arguments.folder / "grasp_elements_rows.json").write_text(json.dumps(rows, indent=0), encoding="utf-8")
    print(report.status)


if __name__ == "__main__":
    main()
