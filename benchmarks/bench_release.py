"""Real-time factor of the paper's release: how much faster than time a simulation runs at a given accuracy.

Run ``python -m benchmarks.bench_release`` in the root of the repository. The classical Runge-Kutta method in
C, one core; the least number of steps per second is taken whose tip stays within 1e-4 of the finger's length
of the same model integrated at 12,800 steps per second, at 50 instants in one second.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any, cast

import casadi as ca
import numpy as np

from benchmarks.c_loop import CLoop
from benchmarks.harness import race
from benchmarks.machine import one_core
from benchmarks.report import Report, Table
from continuum_grasp.model import FingerModel
from continuum_grasp.scene.load import load
from continuum_grasp.scene.simulate import Scene

CONFIGS = Path(__file__).parents[1] / "configs" / "simulate"
RELEASES = tuple(f"nitinol_release_{grams:03d}g.yaml" for grams in (0, 10, 20, 50))
FAMILIES = ("arc", "matched_clothoid")
TOLERANCE = 1e-4
INSTANTS = 50
FINEST = 256
SUBSTEPS = (1, 2, 3, 4, 5, 6, 8, 10, 12, 16, 20, 24, 32, 48, 64)


def read(name: str) -> Scene:
    """A release as it is shipped."""
    return cast(Scene, load(CONFIGS / name))


def start(scene: Scene, family: str) -> np.ndarray:
    """State at rest under the weight and what holds the tip, by Newton's method from the straight finger."""
    model = FingerModel(scene, family=family, elements=2, tip_force=True)
    held = np.sum([load.force for load in scene.initial.held_by], axis=0)
    q = ca.SX.sym("q", model.n)
    rest = ca.SX.zeros(model.n)
    missing = model.inverse_dynamics(q, rest, rest, ca.SX.zeros(model.nu), ca.DM(held), ca.DM(model.p_nominal))
    newton = ca.Function("newton", [q], [q - ca.solve(ca.jacobian(missing, q), missing), missing])
    value = np.zeros(model.n)
    for _ in range(50):
        value, residual = (np.asarray(ca.DM(v)).ravel() for v in newton(value))
    if not np.abs(residual).max() < 1e-12:
        raise RuntimeError(f"no equilibrium of the held finger: residual {residual}")
    return np.concatenate([value, np.zeros(model.n)])


def step(model: FingerModel, h: float, inlined: bool = True) -> ca.Function:
    """One Runge-Kutta step x -> x of a passive finger; inlined or calling the dynamics."""
    kind = ca.SX if inlined else ca.MX
    x = kind.sym("x", model.nx)
    u, w, p = kind.zeros(model.nu), kind.zeros(model.nw), ca.DM(model.p_nominal)

    def rate(value: Any) -> Any:
        return model.forward_dynamics(value, u, w, p)

    k1 = rate(x)
    k2 = rate(x + h / 2 * k1)
    k3 = rate(x + h / 2 * k2)
    k4 = rate(x + h * k3)
    return ca.Function("step", [x], [x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)], ["x"], ["next"])


def tips(model: FingerModel, x0: np.ndarray, substeps: int) -> np.ndarray:
    """Tip positions (INSTANTS, 2) over one second [m]."""
    one = step(model, 1.0 / (INSTANTS * substeps), inlined=False)
    states = one.mapaccum(INSTANTS * substeps)(x0)[:, substeps - 1 :: substeps]
    q = states[: model.n, :]
    u, p = ca.DM.zeros(model.nu), ca.DM(model.p_nominal)
    return np.asarray(ca.DM(model.tip.map(INSTANTS)(q, ca.repmat(u, 1, INSTANTS), ca.repmat(p, 1, INSTANTS)))).T


def main() -> None:
    """Measure every release with both families and write the report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    report = Report("release", arguments.seed)
    rows = []
    for name in RELEASES:
        scene = read(name)
        length = scene.finger.rod.length
        for family in FAMILIES:
            model = FingerModel(scene, family=family, elements=2, tip_force=False)
            x0 = start(scene, family)
            reference = tips(model, x0, FINEST)
            for substeps in SUBSTEPS:
                error = np.hypot(*(tips(model, x0, substeps) - reference).T) / length
                worst = float(error.max()) if np.isfinite(error).all() else math.inf
                if worst <= TOLERANCE:
                    break
            else:
                report.missing.append(f"{name}, {family}: {TOLERANCE:g} of the length not reached")
                continue
            count = INSTANTS * substeps
            loop = CLoop(step(model, 1.0 / count), [x0], feedback=True, restart=count)
            with one_core():
                timing = race({family: loop}, seed=arguments.seed)[family]
            factor = 1.0 / (timing.median * count)
            rows.append([name, family, count, worst, float(np.sqrt(np.mean(error**2))), 1e9 * timing.median, factor])
            grams = int(name.removesuffix("g.yaml")[-3:])
            report.claim(f"real-time factor, two elements, {family}, {grams} g", factor, ">=", 15000)
    columns = [
        "release",
        "family",
        "steps per s",
        "worst error / L",
        "r.m.s. error / L",
        "step [ns]",
        "factor",
    ]
    note = "Two elements, no contact; times of a step with the dynamics inlined four times."
    report.tables.append(Table("Real-time factor of the release", columns, rows, note))
    for file in report.write():
        print(file)
    print(report.status)


if __name__ == "__main__":
    main()
