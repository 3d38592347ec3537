"""What tendon friction costs a controller: preparation of a step with two cells per element, beside the same without.

Run ``python -m benchmarks.bench_friction_step`` in the root of the repository (a minute to compile, seconds to run).
N = 30; CPU time of the thread, one preparation of each scene after the other.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from benchmarks.machine import one_core
from benchmarks.real_time_iteration import RealTimeIteration
from benchmarks.report import Report, Table
from continuum_grasp.control import stages_of
from continuum_grasp.scene.control import ControlScene
from tests.control_cases import CABLE, DRIVES, HAND

ROUNDS = 400
FRICTIONS = (0.0, 0.15)
MOST = 2.0
"""Times that of the same scene without friction, at most."""
KINDS = ("tension", "winches", "servo")
_FORCE = 60.0
"""Greatest tension [N]; inputs of the drives weigh what as large a share of their range does."""


def scene(kind: str, friction: float) -> ControlScene:
    """The hand finger follows a circle with commanded tensions, winches, or one motor with a position servo."""
    if kind == "tension":
        keys: dict[str, Any] = {"offset": 0.005, "min_tension": 1.0, "max_tension": _FORCE, "time_constant": 0.02}
        limits, largest = {}, _FORCE
    else:
        drive, limits = DRIVES[kind]
        keys, largest = {**CABLE, "drive": drive}, max(max(limit) for limit in limits.values())
    tendons = type(HAND.tendons)(**{**keys, "friction": friction})
    cost = {"tip": {"running": 2e4, "terminal": 2e3}, "speed": 0.02}
    share = (_FORCE / largest) ** 2
    cost |= {"effort": 1e-3 * share, "input_rate": 5e-4 * share}
    return ControlScene(
        finger=HAND.replaced(tendons=tendons),
        gravity=(0.0, 0.0),
        fidelity={"family": "clothoid", "elements": 2},
        controller={
            "horizon": {"stages": 30, "stage": 0.01},
            "cost": cost,
            "input": {**limits, "rate_max": 10.0 * largest},
        },
        reference={"tip": {"center": (-0.0827, 0.1515), "radius": 0.02, "frequency": 1.0, "phase": 0.6}},
    )


def prepared(of: ControlScene) -> RealTimeIteration:
    """The iterations, with a plan at rest."""
    stages = stages_of(of)
    found = RealTimeIteration(stages)
    found.reset([0.0] * stages.nx, of.rest_input)
    return found


def main() -> None:
    report = Report("friction_step", 0)
    ours = {(kind, friction): prepared(scene(kind, friction)) for kind in KINDS for friction in FRICTIONS}
    taken = {key: np.zeros(ROUNDS) for key in ours}
    with one_core():
        for k in range(ROUNDS):
            for key, one in ours.items():
                began = time.thread_time_ns()
                one.prepare()
                taken[key][k] = 1e-3 * (time.thread_time_ns() - began)
    rows: list[list[Any]] = []
    for kind in KINDS:
        without, with_friction = (taken[kind, friction] for friction in FRICTIONS)
        states = [ours[kind, friction].stages.nx for friction in FRICTIONS]
        ratio = float(np.median(with_friction / without))
        rows.append([kind, *states, float(np.median(without)), float(np.median(with_friction)), ratio])
        report.claim(f"{kind}: times the preparation without friction", ratio, "<=", MOST)
        print(rows[-1], flush=True)
    columns = ["drive", "states without", "states with", "without [us]", "with friction [us]", "ratio"]
    report.tables.append(Table("Preparation of a step", columns, rows, f"CPU time, medians of {ROUNDS} rounds."))
    for file in report.write():
        print(file)
    print(report.status)


if __name__ == "__main__":
    main()
