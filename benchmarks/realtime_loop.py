"""A controller against the clock: jitter, latency and overruns of a loop with a simulated bench.

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

import continuum_grasp as cg
from continuum_grasp.closed_loop import RealTime, SimulatedBench, run_hardware

ROOT = Path(__file__).parents[1]


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scene", nargs="?", default=str(ROOT / "configs" / "mpc" / "tip_circle.yaml"))
    parser.add_argument("--duration", type=float, default=10.0, help="s")
    parser.add_argument("--spin", type=float, default=2e-4, help="s")
    parser.add_argument("--priority", type=int, help="of the first-in-first-out scheduler")
    parser.add_argument("--core", type=int)
    parser.add_argument("--lock-memory", action="store_true")
    parser.add_argument("--out", type=Path, help="file for the result, JSON")
    asked = parser.parse_args()
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
