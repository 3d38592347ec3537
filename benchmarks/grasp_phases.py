"""Tension of a disc that is drawn as a polygon, by its number of corners and its phase, beside that of the disc.

    python -m benchmarks.grasp_phases [corners ...]

The mug of 80 mm of ``mug.yaml``, without a reserve of friction. Phases are those of the first corner, in corners: at 0
a corner is where the disc touches the palm, at 1/2 the middle of a face.
"""

from __future__ import annotations

import sys
import time

import numpy as np

from continuum_grasp.grasp import optimize_grasp
from continuum_grasp.scene import GraspScene, load

PHASES = (0.0, 0.25, 0.5)
CORNERS = (64, 96, 192, 384, 768)
RADIUS = 0.04
"""Of the disc [m]."""


def scene_of(corners: int, phase: float) -> GraspScene:
    """The mug as a polygon with its corners on the disc's outline; as the disc with none."""
    scene: GraspScene = load("configs/grasp/mug.yaml", ["contacts.reserve=0"])
    if not corners:
        return scene
    turns = 2.0 * np.pi * (np.arange(corners) + phase) / corners
    points = RADIUS * np.column_stack([np.cos(turns), np.sin(turns)])
    body = {"shape": "polygon", "vertices": points.tolist(), "mass": 0.3, "position": [0.04, 0.0], "against": "palm"}
    changed: GraspScene = scene.changed({"object": body})
    return changed


def main() -> None:
    """Print a line for the disc and for each polygon."""
    corners = [int(word) for word in sys.argv[1:]] or list(CORNERS)
    print("corners phase  tension [N]  off the disc  status       iterations  starts  CPU s")
    disc = None
    for count, phase in [(0, 0.0), *((count, phase) for count in corners for phase in PHASES)]:
        began = time.process_time()
        result = optimize_grasp(scene_of(count, phase))
        spent = time.process_time() - began
        disc = disc or result.tension
        tried = len(result.statistics["attempts"])
        iterations = int(result.statistics["total_iterations"])
        print(
            f"{count:7d} {phase:5.2f} {result.tension or float('nan'):12.4f}"
            f"{100.0 * ((result.tension or float('nan')) / disc - 1.0):12.2f} %  {result.status:12s}"
            f"{iterations:10d} {tried:7d} {spent:6.1f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
