"""A controller against the clock: jitter, latency and overruns of a loop with a simulated bench.

The plant of the scene (eight clothoids, another stiffness and damping, friction, noise, delay) moves on in the rest of
each period, so that only reading, computing and writing count. The period is that of the scene; ``--spin`` asks the
clock instead of sleeping at the end of the waiting.
"""

from __future__ import annotations

import json
import math
from pathlib import Path

import continuum_grasp as cg
from benchmarks.harness import CONFIGS
from benchmarks.report import arguments
from continuum_grasp.closed_loop import RealTime, SimulatedBench, run_hardware


def main() -> None:
    """Run and print."""
    asked = arguments(
        __doc__,
        scene=(str(CONFIGS / "mpc" / "tip_circle.yaml"), "of the closed loop"),
        duration=(10.0, "s"),
        spin=(2e-4, "s"),
        priority=(int, "of the first-in-first-out scheduler"),
        core=int,
        lock_memory=False,
        out=(Path, "file for the result, JSON"),
    )
    controller = cg.Controller(asked.scene, deadline=math.inf)
    bench = SimulatedBench(controller.scene)
    bench.write(controller.step(bench.read()))
    bench.idle()  # what is compiled or read at first use is not timed
    wanted = RealTime(asked.priority, asked.core, asked.lock_memory)
    found = run_hardware(controller, bench, duration=asked.duration, spin=asked.spin, realtime=wanted)
    text = json.dumps({**found.summary(), "controller": controller.statistics}, indent=1)
    print(text)
    if asked.out is not None:
        asked.out.write_text(text + "\n")


if __name__ == "__main__":
    main()
