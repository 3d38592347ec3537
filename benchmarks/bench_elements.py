"""Forward dynamics with few and with many elements: the dense solution beside sweeps along the chain.

Run ``python -m benchmarks.bench_elements`` in the root of the repository; see README.md beside this file. The rod is
the paper's, along world +X, with a tip mass, damping, gravity and a tip moment.
"""

from __future__ import annotations

import ctypes
import math
import re
import shutil
import subprocess
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from benchmarks.harness import Timing, compiled, compiler, defines, linked, one_core, race, run
from benchmarks.report import Report, begun
from continuum_grasp.core import CSource
from continuum_grasp.core.source import symbol_of
from continuum_grasp.model import Equations, FingerModel, pattern
from continuum_grasp.scene import BasePose, Finger, PointMass
from continuum_grasp.scene.finger import Damping, Rod

FAMILIES = ("matched_clothoid", "arc")
ELEMENTS = (1, 2, 4, 8, 16, 32, 64, 128)
TARGET = 31_000
"""Most instructions of 32 matched elements."""
FEWEST = pattern.FEWEST_ELEMENTS
COUNTED = 20
"""Evaluations that are counted, as the difference of two runs."""
LENGTH = 0.6
FINGER = Finger(
    rod=Rod(
        length=LENGTH,
        linear_density=6450 * math.pi * 0.001**2,
        bending_stiffness=60e9 * math.pi * 0.002**4 / 64,
    ),
    damping=Damping(per_arc=1e-4),
    masses=(PointMass(at=LENGTH, mass=0.02),),
    base=BasePose(angle=-math.pi / 2),
)


class Compiled:
    """A function in a C loop: seconds of compiling, size of the code [kB], instructions, and time of an evaluation."""

    def __init__(self, function: ca.Function) -> None:
        source = CSource([function]).of_core(function.name())
        folder = Path(tempfile.mkdtemp(prefix="continuum-grasp-benchmark-"))
        words: dict[str, Any] = {"FUNCTION": symbol_of(function), "NX": function.nnz_in(0)}
        for name, least in (("w", 1), ("iw", 1), ("arg", 3), ("res", 1)):
            words[f"SZ_{name.upper()}"] = max(getattr(function, f"sz_{name}")(), least)
        flags, start = compiler().flags(source), time.perf_counter()
        code = compiled(folder, "code", source, flags)
        self.seconds = time.perf_counter() - start
        self.kilobytes = sum(map(int, run(["size", code]).splitlines()[1].split()[:2])) / 1000
        text = defines(**words) + Path(__file__).with_name("elements_loop.c").read_text(encoding="utf-8")
        self._library = linked(folder, [compiled(folder, "loop", text, flags), code], flags)
        self._library.loop.restype = ctypes.c_double
        self._library.main(1, None)
        self.instructions = self._counted(folder, flags)

    def __call__(self, count: int) -> None:
        self._library.loop(ctypes.c_longlong(count))

    def figures(self, timing: Timing) -> list[float]:
        """Instructions, time [ns], seconds of compiling, and size [kB]."""
        return [self.instructions, 1e9 * timing.median, self.seconds, self.kilobytes]

    def _counted(self, folder: Path, flags: Sequence[str]) -> float:
        """Instructions of an evaluation, as valgrind counts them; NaN without it."""
        if shutil.which("valgrind") is None:
            return float("nan")
        # It knows no AVX-512.
        narrow = [flag.replace("-march=native", "-march=x86-64-v3") for flag in flags]
        run([compiler().command[0], *narrow, folder / "loop.c", folder / "code.c", "-o", folder / "count", "-lm"])
        line = ["valgrind", "--tool=callgrind", "--callgrind-out-file=/dev/null", folder / "count"]
        totals = [
            int(re.findall(r"Collected : (\d+)", run([*line, count], stderr=subprocess.STDOUT))[0])
            for count in (0, COUNTED)
        ]
        return (totals[1] - totals[0]) / COUNTED


def model_of(family: str, elements: int) -> FingerModel:
    """The finger in so many elements."""
    return FingerModel(FINGER, elements=elements, family=family, tip_force=False)


def dense_of(model: FingerModel) -> ca.Function:
    """Forward dynamics by the mass matrix, as one straight program."""
    eq = Equations(model.structure)
    value = ca.cse([ca.densify(ca.vertcat(*eq.state_rate))])
    return ca.Function("dense", [eq.x, eq.u, eq.w, eq.p], value)


def agreement(model: FingerModel, dense: ca.Function) -> tuple[float, float]:
    """Greatest difference of the accelerations, relative, and what rounding leaves of a dense solution."""
    rng, n = np.random.default_rng(0), model.n
    limits = np.array(model.structure.coordinate_limits())
    worst, condition = 0.0, 0.0
    for _ in range(5):
        x = np.concatenate([0.3 * limits, limits]) * rng.uniform(-1.0, 1.0, model.nx)
        found, true = (np.array(f(x, [0.1], [], [])).ravel()[n:] for f in (model.forward_dynamics, dense))
        worst = max(worst, float(np.abs(found - true).max() / np.abs(true).max()))
        mass = np.array(model.mass_matrix(x[:n], [0.1], []))
        condition = max(condition, float(np.linalg.cond(mass)))
    return worst, condition * float(np.finfo(float).eps)


def growth(report: Report, family: str, most: int, most_dense: int) -> None:
    """Dense against sweep over the number of elements."""
    columns = ["elements"]
    columns += [f"{word} {name}" for name in ("dense", "sweep") for word in ("instructions", "ns", "compile s", "kB")]
    note = (
        "Instructions of x86-64 with AVX2 and FMA, counted by valgrind; ns with all that the processor has. The "
        f"package takes the dense program below {FEWEST} elements."
    )
    columns += ["build s", "difference", "condition x rounding"]
    table, nothing = report.table(f"Forward dynamics, {family}", columns, note=note), float("nan")
    for count in [c for c in ELEMENTS if c <= most]:
        model = model_of(family, count)
        found: dict[str, Compiled] = {}
        error = rounding = built = nothing
        if count <= most_dense:
            dense = dense_of(model)
            found["dense"] = Compiled(dense)
        start = time.perf_counter()
        if model.sweeps:
            swept = model_of(family, count).forward_dynamics
            built = time.perf_counter() - start
            found["sweep"] = Compiled(swept)
            if "dense" in found:
                error, rounding = agreement(model, dense)
        with one_core():
            timings = race(dict(found), repeats=15, seed=report.seed)
        cells: list[Any] = []
        for name in ("dense", "sweep"):
            own = found.get(name)
            cells += [nothing] * 4 if own is None else own.figures(timings[name])
        table.add(count, *cells, built, error, rounding)
        if family == FAMILIES[0] and count == 32:
            report.claim("instructions of 32 matched elements", cells[4], "<=", TARGET)
            report.claim("seconds to compile 32 matched elements", cells[6], "<=", 1.0)
            report.claim("agreement of 32 matched elements per condition times rounding", error / rounding, "<=", 1.0)
    cost = {row[0]: row[5] for row in table.rows}
    if family == FAMILIES[0] and {32, 128} <= cost.keys():
        report.claim("128 elements take so many times the instructions of 32", cost[128] / cost[32], "<=", 6.0)


def main() -> None:
    """Run what is asked for and write the report."""
    most, dense = (max(ELEMENTS), "most elements"), (32, "most elements of the dense program")
    asked, report = begun(__doc__, "elements", elements=most, dense=dense, seed=0)
    pattern.FEWEST_ELEMENTS = 2  # sweeps of few elements too, to compare
    for family in FAMILIES:
        growth(report, family, asked.elements, asked.dense)
    report.finish()


if __name__ == "__main__":
    main()
