"""HPIPM on the QPs of a closed loop by the package's solver; its sources are named in ``CONTINUUM_GRASP_HPIPM``.

The folder has ``hpipm`` and ``blasfeo``, as cloned from github.com/giaf; both are built there once, with CMake.
"""

from __future__ import annotations

import ctypes
import os
import subprocess
import tempfile
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.machine import one_core
from benchmarks.mpc_cases import Case
from benchmarks.mpc_loop import FLAGS, LoopRun
from benchmarks.real_time_iteration import RealTimeIteration

Array = NDArray[np.float64]

VARIABLE = "CONTINUUM_GRASP_HPIPM"
MODES = {"speed": 1, "balance": 2}
"""HPIPM's settings by name, as numbers of its ``hpipm_mode``."""
_SOURCE = Path(__file__).with_name("hpipm_qp.c")


@dataclass(frozen=True)
class Qps:
    """QPs of a closed loop, with the package's solutions of them."""

    case: Case
    x0: Array
    found: list[dict[str, Array]]
    """As ``RealTimeIteration.qp`` gives them."""
    ours: Array
    """Changes of the plan (steps, N + 1, nx + nu)."""


@dataclass(frozen=True)
class Answers:
    """Of one solver: time of each QP [s], iterations, whether solved, and greatest difference from ours."""

    seconds: Array
    iterations: Array
    good: NDArray[np.bool_]
    apart: Array
    """Greatest difference of an input from ours, per range of the input."""


def qps_of(case: Case, run: LoopRun) -> Qps:
    """The QPs of a loop that retained its guesses and plans."""
    s, rti = case.stages, RealTimeIteration(case.stages)
    found, ours = [], []
    states = (s.stages + 1) * s.nx
    for k in range(case.steps):
        rti.plan[0][:], rti.plan[1][:] = (
            run.guess[k, :states].reshape(-1, s.nx),
            run.guess[k, states:].reshape(-1, s.nu),
        )
        rti.prepare(case.references[k], case.p)
        qp = rti.qp()
        found.append(qp)
        change = np.zeros((s.stages + 1, s.nx + s.nu))
        change[:, : s.nx] = run.plan[k, :states].reshape(-1, s.nx) - qp["x"]
        change[:-1, s.nx :] = run.plan[k, states:].reshape(-1, s.nu) - qp["u"]
        ours.append(change)
    return Qps(case, run.x[:-1], found, np.array(ours))


@lru_cache
def _installed(folder: Path) -> Path:
    """Build both libraries where they are not built yet."""
    target = folder / "build" / "installed"
    if (target / "lib" / "libhpipm.a").exists():
        return target
    target_of = {"blasfeo": "X64_INTEL_HASWELL", "hpipm": "AVX"}
    for name, machine in target_of.items():
        build = folder / "build" / name
        off = [f"-D{name.upper()}_{what}=OFF" for what in ("TESTING", "EXAMPLES", "BENCHMARKS")]
        given = [f"-DTARGET={machine}", "-DCMAKE_BUILD_TYPE=Release", f"-DCMAKE_INSTALL_PREFIX={target}"]
        given += [f"-DBLASFEO_PATH={target}"] if name == "hpipm" else []
        _run(["cmake", "-S", str(folder / name), "-B", str(build), *given, *off])
        _run(["cmake", "--build", str(build)])
        _run(["cmake", "--install", str(build)])
    return target


def _run(command: list[str]) -> None:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise RuntimeError(f"HPIPM: {' '.join(command)} failed: {done.stderr[-500:]}")


def hpipm(qps: Qps, mode: str = "speed", *, warm: bool = False, tolerance: float = 1e-8) -> Answers:
    """Solve all by HPIPM, one after the other; RuntimeError with the reason where it cannot be had."""
    if not os.environ.get(VARIABLE):
        raise RuntimeError(f"HPIPM: no sources given: set {VARIABLE}")
    installed = _installed(Path(os.environ[VARIABLE]))
    s = qps.case.stages
    with tempfile.TemporaryDirectory(prefix="continuum-grasp-benchmark-") as name:
        built = str(Path(name) / "hpipm_qp.so")
        libraries = [str(installed / "lib" / f"lib{lib}.a") for lib in ("hpipm", "blasfeo")]
        include = f"-I{installed / 'include'}"
        _run(["cc", *FLAGS, include, "-shared", "-fPIC", str(_SOURCE), *libraries, "-lm", "-o", built])
        library = ctypes.CDLL(built)
    sizes = (s.stages, s.nx, s.nu, s.nc, s.ns, MODES[mode])
    library.hpipm_create(*sizes, ctypes.c_double(tolerance), int(warm))
    limits = [np.ascontiguousarray(getattr(s, key), float) for key in ("u_min", "u_max", "c_min", "c_max")]
    limits += [np.ascontiguousarray(s.linear), np.ascontiguousarray(s.quadratic)]
    count, nz = qps.case.steps, s.nx + s.nu
    seconds, iterations = np.zeros(count), np.zeros(count)
    good, apart = np.zeros(count, bool), np.zeros(count)
    span = np.where(s.u_max - s.u_min < 1e30, s.u_max - s.u_min, 1.0)
    with one_core():
        for k, qp in enumerate(qps.found):
            given = [np.ascontiguousarray(qp[key]) for key in ("x", "u", "A", "B", "defect", "g", "H", "c", "C")]
            dz, took, rounds = np.zeros((s.stages + 1, nz)), ctypes.c_double(), ctypes.c_int()
            arrays: list[Any] = [np.ascontiguousarray(qps.x0[k]), *given, *limits, dz]
            pointers = [ctypes.c_void_p(array.ctypes.data) for array in arrays]
            good[k] = library.hpipm_solve(*pointers, ctypes.byref(took), ctypes.byref(rounds)) == 0
            seconds[k], iterations[k] = took.value, rounds.value
            apart[k] = (np.abs(dz - qps.ours[k])[:-1, s.nx :] / span).max()
    return Answers(seconds, iterations, good, apart)
