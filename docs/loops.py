"""Figures and picture of mpc.md: ``python docs/loops.py`` in the root of the repository."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import numpy as np

import continuum_grasp as cg
from continuum_grasp.closed_loop import ControlRun, run_closed_loop
from continuum_grasp.plotting import StyledAxes
from continuum_grasp.plotting.control import plot_control_path, plot_inputs
from continuum_grasp.results import save_picture

FOLDER = Path("configs/mpc")
DRAWN = ("tip_steps", "keep_out", "nitinol_moment")
ARCS = ["fidelity.family=arc", "fidelity.elements=2"]


def figures(name: str, run: ControlRun) -> str:
    """Errors of the tip, distances from bounds, cost, health."""
    found = run.metrics()
    change = np.sqrt(np.mean(np.diff(run.u, axis=0) ** 2))
    bounds = ", ".join(f"{b.name} {b.worst:.4g}" for b in found.violations if b.worst > -0.05)
    rest = f"cost {found.cost:.5g}; change {change:.3g}; {found.health}; {bounds}"
    if run.tip_reference is None:
        return f"{name:28s} no setpoint of the tip; {rest}"
    error = 1e3 * np.linalg.norm(run.tip - run.tip_reference, axis=1)
    late = math.sqrt(np.mean(error[run.t >= 0.5] ** 2))
    whole = f"r.m.s. {found.tracking[0].rms * 1e3:.2f} mm, after 0.5 s {late:.2f}"
    return f"{name:28s} {whole}, final {found.tracking[0].final * 1e3:.2f}; {rest}"


def main() -> None:
    """Run, print, draw."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", nargs="*", default=sorted(path.stem for path in FOLDER.glob("*.yaml")))
    asked = parser.parse_args()
    runs = {}
    for name in asked.scenes:
        runs[name] = run_closed_loop(FOLDER / f"{name}.yaml")
        print(figures(name, runs[name]), flush=True)
        if name in ("tip_steps", "nitinol_moment"):
            print(figures(f"{name}, two arcs", run_closed_loop(cg.load(FOLDER / f"{name}.yaml", ARCS))), flush=True)
        if name == "steady_tip":
            for seed in range(3):
                for stiffness in (0.9, 1.1):
                    changes = [f"plant.stiffness={stiffness}", f"plant.seed={seed}"]
                    print(
                        figures(" ".join(changes), run_closed_loop(cg.load(FOLDER / f"{name}.yaml", changes))),
                        flush=True,
                    )
    if set(DRAWN) <= set(runs):
        figure = StyledAxes.figure(12.0, 8.4)
        for k, name in enumerate(DRAWN):
            plot_control_path(runs[name], ax=figure.add_subplot(2, len(DRAWN), k + 1))
            plot_inputs(runs[name], ax=figure.add_subplot(2, len(DRAWN), len(DRAWN) + k + 1))
        save_picture(figure, Path("docs/pictures/mpc_loops.png"))


if __name__ == "__main__":
    main()
