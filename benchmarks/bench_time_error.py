"""What controlling the time error costs: steps of the automatic method against fixed steps of the same true error."""

from __future__ import annotations

import numpy as np

from benchmarks.report import Report, arguments
from continuum_grasp.core import Core
from continuum_grasp.errors import NumericalError
from continuum_grasp.scene import Scene
from continuum_grasp.simulation import Trajectory, simulate
from tests.rods import NITINOL, force, integrated, rod_scene

CASES = (("arc", 4, 1e-3), ("matched_clothoid", 2, 1e-3), ("matched_clothoid", 2, 1e-2), ("clothoid", 4, 1e-3))
TOLERANCES = (1e-3, 1e-4, 1e-6)
_MOST = 2_000


def released(family: str, elements: int, step: float, tolerance: float) -> Scene:
    """The paper's rod, lifted by a tip force of 0.8 N and let go, undamped."""
    initial = {"pose": "equilibrium", "held_by": [force(0.6, [0.0, 0.8])]}
    time = {"duration": 1.0, "step": step, "tolerance": tolerance}
    return rod_scene(NITINOL, family, elements, initial=initial, time=time)


def error(core: Core, states: np.ndarray, exact: np.ndarray, length: float) -> float:
    """Greatest error of the elements' ends per length."""
    n = core.model.n
    ends = [core.batch("joints", x[:, :n], np.zeros((len(x), core.model.nu)), None)[0] for x in (states, exact)]
    return float(np.hypot(*(ends[0] - ends[1]).transpose(1, 0, 2)).max() / length)


def as_exact(found: Trajectory, exact: np.ndarray, size: float) -> int:
    """Fixed sub-steps per output step whose error is no greater."""
    for substeps in range(1, _MOST):
        try:
            states = found.core.rollout(
                found.x[0], len(found.t) - 1, found.t[1], substeps=substeps, method=found.statistics["method"]
            )
        except NumericalError:
            continue
        if error(found.core, states, exact, found.length) <= size:
            return substeps
    return _MOST


def main() -> None:
    """Run every case, and write the report."""
    arguments(__doc__)
    report, rows, ratios, covered = Report("time_error", 0), [], [], []
    for family, elements, step in CASES:
        exact = None
        for tolerance in TOLERANCES:
            found = simulate(released(family, elements, step, tolerance))
            exact = integrated(found.scene) if exact is None else exact
            true = error(found.core, found.x, exact, found.length)
            fixed = as_exact(found, exact, true) * (len(found.t) - 1)
            taken = int(found.statistics["steps_taken"])
            ratios.append(taken / fixed)
            covered.append(true / found.time_error)
            rows.append(
                [
                    *(f"{elements} {family}", f"{1e3 * step:g} ms", f"{tolerance:g}", found.statistics["substeps"]),
                    *(f"{found.time_error:.1e}", f"{true:.1e}", taken, fixed, f"{ratios[-1]:.2f}"),
                ]
            )
    report.claim("greatest true error per estimate", max(covered), "<=", 1.0)
    what = "steps, with those of comparison and all that is given up, per fixed steps of the same true error"
    report.claim(f"{what}, median", float(np.median(ratios)), "<=", 1.25)
    report.claim(f"{what}, greatest", max(ratios), "<=", 2.0)
    columns = ["model", "output step", "tolerance", "sub-steps", "estimate / L", "true error / L"]
    columns += ["steps taken", "fixed steps of that error", "ratio"]
    report.table("Undamped release, one second, against DOP853", columns, rows, "")
    report.finish()


if __name__ == "__main__":
    main()
