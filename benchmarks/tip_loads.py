"""Whether shipped loops bear the loads of the tip that their scenes state: ``python -m benchmarks.tip_loads`` (6 min).

Each loop runs with the mass at its tip, and with the force in four directions, times factors (``--factors 1 2``). Loops
that estimate one of both have none to bear. With factor 1 none may trip: exit status 1.
"""

from __future__ import annotations

import argparse
import math
import warnings

from benchmarks.harness import CONFIGS
from continuum_grasp.closed_loop import run_closed_loop
from continuum_grasp.control import Controller
from continuum_grasp.scene import ControlScene, load

LEAST = 5.0
"""Duration of a run, or that of the scene where it is longer [s]."""


def cases(scene: ControlScene, factor: float) -> dict[str, list[str]]:
    """Changes of a scene by the text of the load."""
    found = {}
    if math.isfinite(scene.borne_mass):
        mass = factor * scene.borne_mass
        found[f"{1e3 * mass:.3g} g"] = [f"plant.tip_mass={scene.plant.tip_mass + mass}"]
    if math.isfinite(scene.borne_force):
        for x, y in ((1, 0), (-1, 0), (0, 1), (0, -1)):
            force = [factor * scene.borne_force * x, factor * scene.borne_force * y]
            text = f"({force[0]:.3g}, {force[1]:.3g}) N"
            found[text] = [f"loads=[{{at: {scene.finger.rod.length}, force: {force}}}]"]
    return found


def main() -> None:
    """Run the loops and print a line per load."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--loops", nargs="*", default=sorted(path.stem for path in (CONFIGS / "mpc").glob("*.yaml")))
    parser.add_argument("--factors", nargs="*", type=float, default=[1.0])
    asked, tripped = parser.parse_args(), 0
    warnings.simplefilter("ignore")  # those of loads beyond what is borne
    for name in asked.loops:
        path = CONFIGS / "mpc" / f"{name}.yaml"
        scene = load(path)
        if scene.estimator is None:
            continue
        control = Controller(scene, deadline=math.inf)
        for factor in asked.factors:
            for text, changes in cases(scene, factor).items():
                loaded = load(path, changes).model_copy(update={"duration": max(LEAST, scene.duration)})
                control.reset()
                run = run_closed_loop(loaded, controller=control)
                trips = "tripped" in run.health
                tripped += trips and factor <= 1.0
                when = f"TRIPPED after {run.t[run.health.index('tripped')]:.2f} s" if trips else "no trip"
                print(f"{name:15s} {text:20s} {when}", flush=True)
    raise SystemExit(tripped > 0)


if __name__ == "__main__":
    main()
