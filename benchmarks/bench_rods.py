"""Grasps as exact rods against the search of few elements, and against their mirrored, turned and scaled images.

python -m benchmarks.bench_rods one 0 20 --search
"""

from __future__ import annotations

import argparse
import math
import time
from typing import Any

import numpy as np

from benchmarks.grasp_images import STRONGER, drawn, mirrored, moved, rolled, scaled, scene_of
from continuum_grasp.base import Array
from continuum_grasp.grasp.rods.search import RodSearch
from continuum_grasp.grasp.rods.verdict import verdict_of
from continuum_grasp.grasp.search import GraspSearch
from continuum_grasp.grasp.values import GraspStatus, tension_of
from continuum_grasp.nlp import Budget
from continuum_grasp.scene import GraspScene


def by_rods(scene: GraspScene) -> tuple[float, float, RodSearch]:
    """Least tension [N], NaN if there is none; CPU time [s]; and the search."""
    began = time.process_time()
    search = RodSearch(scene, Budget())
    search.run()
    best = search.best
    return math.nan if best is None else best.tension, time.process_time() - began, search


def by_elements(scene: GraspScene) -> tuple[float, float]:
    """Least tension [N] and CPU time [s] of the search of few elements."""
    began = time.process_time()
    search = GraspSearch(scene, Budget.of(scene.solver))
    search.run()
    best = search.best
    return math.nan if best is None else tension_of(scene, best.arrays), time.process_time() - began


def image_of(data: dict[str, Any]) -> dict[str, Any]:
    """The mirrored, turned, shifted and scaled image."""
    data = rolled(data) if "vertices" in data["object"] else data
    return mirrored(moved(scaled(data)))


def main() -> None:
    """Print a row per scene, then counts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("kind")
    parser.add_argument("first", type=int)
    parser.add_argument("last", type=int)
    parser.add_argument("--search", action="store_true", help="also search with eight elements per finger")
    options = parser.parse_args()
    rows, optimal = [], []
    for seed in range(options.first, options.last):
        data = drawn(options.kind, seed)
        scene, image = (scene_of(each, 8).replaced(stability="ignore") for each in (data, image_of(data)))
        try:
            own, seconds, search = by_rods(scene)
            other, _, of_image = by_rods(image)
            other /= STRONGER
            statuses = [verdict_of(each).status for each in (search, of_image)]
            few, few_seconds = by_elements(scene) if options.search else (math.nan, 0.0)
        except Exception as error:
            print(f"{options.kind} {seed:3d} {type(error).__name__}: {str(error)[:100]}", flush=True)
            continue
        rows.append((own, other, few, seconds, few_seconds))
        optimal.append([status is GraspStatus.OPTIMAL for status in statuses])
        ends = [f"{g.tension:.3f}{'' if g.holds else '!'}/{g.attempt.iterations}" for g in search.tried]
        print(
            f"{options.kind} {seed:3d} rods {own:9.4f} N, image {other:9.4f} N, elements {few:9.4f} N, "
            f"{seconds:.2f} and {few_seconds:.2f} s, {', '.join(statuses)}; {' '.join(ends)}",
            flush=True,
        )
    _summary(np.array(rows).T, np.array(optimal))


def _summary(rows: Array, optimal: Array) -> None:
    """Print counts, and the CPU time of scenes that hold and of scenes that do not."""
    own, other, few, seconds, few_seconds = rows
    least = np.fmin(np.fmin(own, few), other)
    over = [~(each <= 1.01 * least + 1e-6) & np.isfinite(least) for each in (own, few, other)]
    wrong = [int(np.sum(each & of)) for each, of in zip((over[0], over[2]), optimal.T, strict=True)]
    # 1e-4: share of a tension by which an image may differ
    differ = (np.isfinite(own) != np.isfinite(other)) | (np.abs(own - other) > 1e-4 * own + 1e-6)
    held = [int(np.isfinite(each).sum()) for each in (own, few)]
    print(
        f"{len(own)} scenes; held by rods and elements {held}, over by more than 1 % {[int(o.sum()) for o in over[:2]]}"
    )
    print(f"optimal {optimal.sum(axis=0).tolist()}, of these over by more than 1 % {wrong}")
    print(f"images differ {int(differ.sum())}, where both are optimal {int((differ & optimal.all(axis=1)).sum())}")
    for words, some in (("that hold", np.isfinite(own)), ("that do not", ~np.isfinite(own))):
        if some.any():
            ours, theirs = (np.quantile(each[some], (0.5, 0.95)).round(2) for each in (seconds, few_seconds))
            print(f"CPU of scenes {words}, median and 95 %: {ours} and {theirs} s")


if __name__ == "__main__":
    main()
