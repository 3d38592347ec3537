"""Implicit steps of 1 to 5 ms of fingers on stiff cables: errors against fine steps, and CPU time.

Run ``OPENBLAS_NUM_THREADS=1 python -m benchmarks.bench_implicit_steps`` in the root of the repository (2 min). Two
winches bend the hand's finger (two clothoids, two friction cells each) by 10 mm of cable in 200 ms, and back. rodas is
that of ``time.method``, in compiled rollouts; implicit_step is that of exported packages, called from Python, whose
command is constant over a step.
"""

from __future__ import annotations

import tempfile
import time
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import continuum_grasp as cg
from benchmarks.machine import one_core
from benchmarks.report import Report, Table
from continuum_grasp.core import Core
from continuum_grasp.export import export_c
from tests.export_cases import shared_library
from tests.tendon_cases import LENGTH, finger

Array = NDArray[np.float64]

CABLES, FRICTIONS, STEPS = (1e4, 1e5), (0.0, 0.15), (1e-3, 2.5e-3, 5e-3)
SERVO = {"kind": "length", "time_constant": 0.02, "pretension": 2.0}
TIMES, WOUND = (0.0, 0.2, 0.4), ((0.0, 0.01, 0.0), (0.0, -0.0105, 0.0))
SPAN = 0.5
FINE = 2e-5
"""Step of the motion that others are compared with [s]: rodas, of order 4."""
ROUNDS = 11


def commands(t: Array) -> Array:
    """Of both winches at instants (T, 2) [m]."""
    return np.column_stack([np.interp(t, TIMES, values) for values in WOUND])


class Case:
    """One finger, and its motion in fine steps."""

    def __init__(self, cable: float, friction: float, folder: Path) -> None:
        tendons = {"axial_stiffness": 1e5, "series_stiffness": cable, "drive": SERVO}
        self.model = cg.FingerModel(
            finger(friction, **tendons), family="clothoid", elements=2, gravity=(0.0, 0.0), tip_force=False
        )
        self.core = Core(self.model)
        export_c(self.model, folder, real="double", what=["implicit_step"])
        self.package, self.library = shared_library(folder, folder)
        self.exact = self.rodas(FINE)

    def rodas(self, step: float) -> Array:
        """States of a rollout."""
        steps = round(SPAN / step)
        u = commands(np.arange(2 * steps + 1) * (0.5 * step))
        found: Array = self.core.rollout(np.zeros(self.model.nx), steps, step, u=u, method="rodas")
        return found

    def exported(self, step: float) -> Array:
        """States of the package's steps."""
        package, library, state = self.package, self.library, self.package.State()
        names = [name for name, _ in state._fields_]
        found = [np.zeros(self.model.nx)]
        inputs = [package.Input(*row) for row in commands((np.arange(round(SPAN / step)) + 0.5) * step)]
        for given in inputs:
            state = library.implicit_step(state, given, step)
            found.append(np.array([getattr(state, name) for name in names]))
        return np.array(found)

    def errors(self, states: Array, step: float) -> tuple[float, float]:
        """Of the tip, greatest per length [1], and of the tensions, r.m.s. [N]."""
        n, p = self.model.n, self.model.p_nominal
        exact = self.exact[:: round(step / FINE)]
        tips, tensions = [], []
        for one in (states, exact):
            u = np.zeros((len(one), self.model.nu))
            tips.append(np.asarray(self.core.batch("tip", one[:, :n], u, None)))
            columns = one.T, u.T, np.tile(np.reshape(p, (-1, 1)), len(one))
            tensions.append(np.array(self.model.tensions()(*columns)[0]).T)
        tip = float(np.linalg.norm(tips[0] - tips[1], axis=1).max()) / LENGTH
        return tip, float(np.sqrt(np.mean((tensions[0] - tensions[1]) ** 2)))


def main() -> None:
    report = Report("implicit_steps", 0)
    rows: list[list[Any]] = []
    with tempfile.TemporaryDirectory() as folder, one_core():
        for cable, friction in product(CABLES, FRICTIONS):
            case = Case(cable, friction, Path(folder) / f"{cable:g}_{friction:g}")
            for method, step in product(("rodas", "implicit_step"), STEPS):
                run = case.rodas if method == "rodas" else case.exported
                tip, tension = case.errors(run(step), step)
                taken = []
                for _ in range(ROUNDS):
                    began = time.process_time()
                    run(step)
                    taken.append(time.process_time() - began)
                per_second = 1e3 * float(np.median(taken)) / SPAN
                rows.append([f"{cable:g}", friction, method, 1e3 * step, tip, tension, per_second])
                print(rows[-1], flush=True)
                limit = {1e-3: 5e-4, 2.5e-3: 2e-3, 5e-3: 5e-3}[step]
                report.claim(f"{cable:g} N/m, friction {friction}, {method}, {1e3 * step:g} ms: tip", tip, "<=", limit)
    columns = ["cable [N/m]", "friction", "method", "step [ms]", "tip / L", "tensions, r.m.s. [N]", "CPU [ms per s]"]
    note = "CPU time per simulated second: medians of 11 runs; of implicit_step with the calls from Python."
    report.tables.append(Table("Implicit steps of stiff cables", columns, rows, note))
    report.finish()


if __name__ == "__main__":
    main()
