"""A controller against the clock: jitter, latency and overruns of a loop with a simulated plant.

Run ``python -m benchmarks.realtime_loop`` in the root of the repository. The plant of the scene (eight clothoids,
another stiffness and damping, friction, noise, delay) moves on in the rest of each period, so that only reading,
computing and writing count. The period is that of the scene; ``--spin`` asks the clock instead of sleeping at the end
of the waiting.
"""

from __future__ import annotations

import argparse
import json
import math
from pathlib import Path

import numpy as np

import continuum_grasp as cg
from continuum_grasp.closed_loop.plant import Plant
from continuum_grasp.control.controller import Controller
from continuum_grasp.control.periodic import run_periodic

ROOT = Path(__file__).parents[1]


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scene", nargs="?", default=str(ROOT / "configs" / "mpc" / "tip_circle.yaml"))
    parser.add_argument("--duration", type=float, default=10.0, help="s")
    parser.add_argument("--spin", type=float, default=2e-4, help="s")
    parser.add_argument("--out", type=Path, help="file for the result, JSON")
    asked = parser.parse_args()
    scene = cg.load(asked.scene)
    controller = Controller(scene, deadline=math.inf)
    plant = Plant(scene, controller.prediction, controller.period)
    command = np.zeros(controller.stages.nu)
    plant.advance(controller.step(plant.measure()).u)  # what is compiled or read at first use is not timed
    found = run_periodic(
        controller,
        plant.measure,
        lambda u: np.copyto(command, u),
        duration=asked.duration,
        spin=asked.spin,
        idle=lambda: plant.advance(command),
    )
    text = json.dumps({**found.summary(), "controller": controller.statistics}, indent=1)
    print(text)
    if asked.out is not None:
        asked.out.write_text(text + "\n")


if __name__ == "__main__":
    main()
