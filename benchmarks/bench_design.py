"""A design by gradient against a sweep over the same three variables: ``python -m benchmarks.bench_design``.

Prints the best cost of both, and the grasps that each solved; some two minutes with the default of 1,000 scenes.
"""

from __future__ import annotations

import argparse
import math
from itertools import product

import numpy as np

import continuum_grasp as cg

DESIGN = "configs/design/mug_finger.yaml"


def main() -> None:
    """Run both and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=10, help="values of each variable in the sweep")
    count = parser.parse_args().count
    found = cg.optimize_design(DESIGN)
    axes = [
        [place.value(share) for share in np.linspace(0.0, 1.0, count).tolist()] for place in found.space.coordinates
    ]
    # Why there is no grasp is not asked.
    scene = cg.load(found.scene.file.parent / found.scene.scene).changed({"solver.max_total_iterations": 400})
    costs = []
    for values in product(*axes):
        grasp = cg.optimize_grasp(scene.changed(dict(zip(found.keys, values, strict=True))), raise_on_failure=False)
        costs.append(grasp.tension + 4000.0 * values[0] if grasp.solved else math.inf)
    effort = found.statistics
    print(f"design: cost {found.best.cost:.4f}, {effort['full_searches']} full searches, {effort['solver_runs']} runs")
    print(f"sweep:  cost {min(costs):.4f}, {len(costs)} full searches, {sum(map(math.isfinite, costs))} of them hold")


if __name__ == "__main__":
    main()
