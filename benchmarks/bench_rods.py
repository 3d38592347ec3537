"""Grasps of random scenes against their mirrored, turned and scaled images.

python -m benchmarks.bench_rods one 0 20
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
from continuum_grasp.grasp.values import GraspStatus
from continuum_grasp.nlp import Budget
from continuum_grasp.scene import GraspScene


def by_rods(scene: GraspScene) -> tuple[float, float, RodSearch]:
    """Least tension [N], NaN if there is none; CPU time [s]; and the search."""
    began = time.process_time()
    search = RodSearch(scene, Budget())
    search.run()
    best = search.best
    return math.nan if best is None else best.tension, time.process_time() - began, search


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
        except Exception as error:
            print(f"{options.kind} {seed:3d} {type(error).__name__}: {str(error)[:100]}", flush=True)
            continue
        rows.append((own, other, seconds))
        optimal.append([status is GraspStatus.OPTIMAL for status in statuses])
        ends = [f"{g.tension:.3f}{'' if g.holds else '!'}/{g.attempt.iterations}" for g in search.tried]
        print(
            f"{options.kind} {seed:3d} {own:9.4f} N, image {other:9.4f} N, {seconds:.2f} s, "
            f"{', '.join(statuses)}; {' '.join(ends)}",
            flush=True,
        )
    _summary(np.array(rows).T, np.array(optimal))


def _summary(rows: Array, optimal: Array) -> None:
    """Print counts, and the CPU time of scenes that hold and of scenes that do not."""
    own, other, seconds = rows
    least = np.fmin(own, other)
    over = [~(each <= 1.01 * least + 1e-6) & np.isfinite(least) for each in (own, other)]
    wrong = [int(np.sum(each & of)) for each, of in zip(over, optimal.T, strict=True)]
    # 1e-4: share of a tension by which an image may differ
    differ = (np.isfinite(own) != np.isfinite(other)) | (np.abs(own - other) > 1e-4 * own + 1e-6)
    print(f"{len(own)} scenes; held {int(np.isfinite(own).sum())}, over by more than 1 % {int(over[0].sum())}")
    print(f"optimal {optimal.sum(axis=0).tolist()}, of these over by more than 1 % {wrong}")
    print(f"images differ {int(differ.sum())}, where both are optimal {int((differ & optimal.all(axis=1)).sum())}")
    for words, some in (("that hold", np.isfinite(own)), ("that do not", ~np.isfinite(own))):
        if some.any():
            print(f"CPU of scenes {words}, median and 95 %: {np.quantile(seconds[some], (0.5, 0.95)).round(2)} s")


if __name__ == "__main__":
    main()
