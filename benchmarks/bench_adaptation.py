"""What adapted parameters gain and cost: the tip's error on plants that differ, beside estimators that adapt none.

Run ``python -m benchmarks.bench_adaptation`` in the root of the repository (5 minutes, most of it to compile a chain of
guides). The motion is that of ``configs/mpc/unknown_payload.yaml``, two noises of each plant.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.report import RESULTS, Report, Table
from continuum_grasp import load
from continuum_grasp.closed_loop.run import run_closed_loop
from continuum_grasp.control import Controller
from continuum_grasp.scene.control import ControlScene

ROOT = Path(__file__).parents[1]
SCENE = ROOT / "configs/mpc/unknown_payload.yaml"
AS_KNOWN: dict[str, Any] = {"plant": {"fidelity": {"family": "clothoid", "elements": 4}}}
CHAIN: dict[str, Any] = {"plant": {"guides": 40, "axial_stiffness": 1e4}}
SEVERAL = {"plant.stiffness": 1.3, "plant.tip_mass": 0.003, "plant.time_constant": 0.03}
PLANTS: dict[str, dict[str, Any]] = {
    "as known": AS_KNOWN,
    "stiffness x 0.7": {**AS_KNOWN, "plant.stiffness": 0.7},
    "stiffness x 1.5": {**AS_KNOWN, "plant.stiffness": 1.5},
    "payload 4 g": {**AS_KNOWN, "plant.tip_mass": 0.004},
    "lag x 0.5": {**AS_KNOWN, "plant.time_constant": 0.01},
    "lag x 2": {**AS_KNOWN, "plant.time_constant": 0.04},
    "lag of first order": {**AS_KNOWN, "plant.drive_order": 1},
    "delay + 1 period": {**AS_KNOWN, "plant.delay": 0.02},
    "delay + 2 periods": {**AS_KNOWN, "plant.delay": 0.03},
    "tendon friction 0.1": {**AS_KNOWN, "plant.tendon_friction": 0.1},
    "damping x 2": {**AS_KNOWN, "plant.damping": 2.0},
    "stiffness x 1.3, payload 3 g, lag x 1.5": {**AS_KNOWN, **SEVERAL},
    "the same, a chain of 40 guides": {**CHAIN, **SEVERAL},
}
ESTIMATORS: dict[str, dict[str, Any]] = {
    "adapted": {},
    "none": {"estimator.adapt": None, "parameters": []},
    "tip_moment": {
        "estimator.adapt": None,
        "parameters": [],
        "estimator.disturbances": {"tip_moment": 0.01},
    },
    "bending_stiffness": {
        "estimator.adapt": None,
        "parameters": ["bending_stiffness"],
        "estimator.disturbances": {"bending_stiffness": 0.1},
    },
}
ADAPTED = ("stiffness", "payload", "lag x", "the same")
"""Words in the names of plants that differ in what is adapted."""
SEEDS = 2


def scene(changes: dict[str, Any]) -> ControlScene:
    """The scene with changes."""
    found = load(SCENE, changes)
    assert isinstance(found, ControlScene)
    return found


def error(estimator: dict[str, Any], plant: dict[str, Any], controller: Controller) -> tuple[float, float, Any]:
    """R.m.s. error of the tip in the last second [mm], greatest mismatch then, and what was adapted (last seed)."""
    squares, mismatch, run = [], 0.0, None
    for seed in range(SEEDS):
        run = run_closed_loop(scene({**estimator, **plant, "plant.seed": seed}), controller=controller)
        squares.append(np.mean(np.sum((run.tracked[-100:, :2] - run.r[-100:, :2]) ** 2, axis=1)))
        mismatch = max(mismatch, float(run.mismatch[-100:].max()))
    return 1e3 * math.sqrt(float(np.mean(squares))), mismatch, run.adapted if run is not None else {}


def main() -> None:
    """Run all plants and write the report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folder", type=Path, default=RESULTS, help="where to write it")
    folder = parser.parse_args().folder
    controllers = {name: Controller(scene(c), deadline=math.inf) for name, c in ESTIMATORS.items()}
    rows: list[list[Any]] = []
    for plant, changes in PLANTS.items():
        found = {name: error(c, changes, controllers[name]) for name, c in ESTIMATORS.items()}
        values = [f"{one.value:.3g} ± {one.std:.2g}" for one in found["adapted"][2].values()]
        rows.append([plant, *[found[name][0] for name in ESTIMATORS], found["none"][1], found["adapted"][1], *values])
        print(rows[-1], flush=True)
    add(Report("adaptation", 0), rows).finish(folder)


def add(report: Report, rows: list[list[Any]]) -> Report:
    """Claims about what is adapted, and the table of all plants."""
    found = [row for row in rows if any(word in row[0] for word in ADAPTED)]
    report.claim("adapted: error where stiffness, payload or lag differ [mm]", max(row[1] for row in found), "<=", 3.0)
    report.claim("the same per error where none is adapted", max(row[1] / row[2] for row in found), "<=", 0.5)
    report.claim("adapted: greatest mismatch of all plants", max(row[6] for row in rows), "<=", 2.5)
    columns = ["plant", *(f"{name} [mm]" for name in ESTIMATORS), "mismatch, none", "mismatch, adapted"]
    note = (
        f"Root mean square distance of the tip from its setpoint in the third second, {SEEDS} noises. Nominal: EI "
        "6.11e-3 N m2, 2 g at the tip, lag 20 ms, delay 10 ms. An unknown delay is found as half of it in the lag."
    )
    report.tables.append(Table("Adapted parameters", [*columns, "EI [N m2]", "tip mass [kg]", "lag [s]"], rows, note))
    return report


if __name__ == "__main__":
    main()
