"""A design by gradient against a sweep over the same three variables.

Run ``python -m benchmarks.bench_design`` in the root of the repository: the best cost of both, the grasps that each
solved, and processor time; some two minutes with 1,000 scenes.
"""

from __future__ import annotations

import math
import time
from itertools import product

import numpy as np

import continuum_grasp as cg
from benchmarks.report import begun

DESIGN = "configs/design/mug_finger.yaml"


def main() -> None:
    """Measure and write the report."""
    asked, report = begun(__doc__, "design", count=(10, "values of each variable in the sweep"))
    began = time.process_time()
    found = cg.optimize_design(DESIGN)
    designed = time.process_time()
    shares = np.linspace(0.0, 1.0, asked.count).tolist()
    axes = [[place.way.value(share) for share in shares] for place in found.space.coordinates]
    # Why there is no grasp is not asked.
    scene = cg.load(found.scene.file.parent / found.scene.scene).changed({"solver.max_total_iterations": 400})
    costs = []
    for values in product(*axes):
        grasp = cg.optimize_grasp(scene.changed(dict(zip(found.keys, values, strict=True))), raise_on_failure=False)
        costs.append(grasp.tension + 4000.0 * values[0] if grasp.solved else math.inf)
    swept = time.process_time()
    counts = [found.statistics[name] for name in ("full_searches", "solver_runs")]
    columns = ["", "cost", "full searches", "runs from nearby grasps", "processor time [s]"]
    note = f"{DESIGN}, three variables. {sum(map(math.isfinite, costs))} scenes of the sweep have a grasp."
    table = report.table("A design by gradient beside a sweep", columns, note=note)
    table.add("design", found.best.cost, *counts, designed - began)
    table.add("sweep", min(costs), len(costs), 0, swept - designed)
    report.claim("cost per that of the sweep", found.best.cost / min(costs), "<=", 1.0)
    report.claim("solutions per those of the sweep", sum(counts) / len(costs), "<=", 0.05)
    report.finish()


if __name__ == "__main__":
    main()
