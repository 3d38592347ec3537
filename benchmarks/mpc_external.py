"""Receding-horizon solvers of another interpreter, named in ``CONTINUUM_GRASP_PEERS_PYTHON``: acados and do-mpc.

acados also needs its sources, named in ``CONTINUUM_GRASP_ACADOS``: a clone of github.com/acados/acados with
``external/blasfeo`` and ``external/hpipm``; it is built there once, with CMake. The interpreter then has CasADi, jinja2
and what acados's own Python package needs (scipy, matplotlib, cython, Deprecated).
"""

from __future__ import annotations

import json
import os
import tempfile
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.baselines import VARIABLE as INTERPRETER
from benchmarks.harness import defines, one_core, run
from benchmarks.mpc_cases import Case
from benchmarks.mpc_loop import FLAGS, FOLDER, CLoop, LoopRun
from benchmarks.mpc_nlp import Nlp
from benchmarks.mpc_peers import braces

SOURCES = "CONTINUUM_GRASP_ACADOS"
FORMS: dict[str, tuple[str, int]] = {
    "HPIPM": ("PARTIAL_CONDENSING_HPIPM", 0),
    "HPIPM, condensed to 5 blocks": ("PARTIAL_CONDENSING_HPIPM", 5),
    "HPIPM, condensed": ("FULL_CONDENSING_HPIPM", 0),
}
"""acados's QP solvers, and how many blocks the QP is condensed to (0: none)."""
PATIENCE = 900.0
"""Time that the other interpreter has for a loop [s]."""


def _asked(solver: str, case: Case, folder: Path, environment: dict[str, str], **settings: Any) -> None:
    """Write a case to a folder, and have the other interpreter do its part there; RuntimeError with why it cannot."""
    if not os.environ.get(INTERPRETER):
        raise RuntimeError(f"{solver}: no interpreter given: set {INTERPRETER}")
    s = case.stages
    if s.nd < s.nx:
        raise RuntimeError(f"{solver}: its continuous model has no state that remembers the input")
    functions = {"dynamics": s.dynamics, "outputs": s.outputs, "rows": s.rows, "plant": case.plant()}
    for label, function in functions.items():
        function.save(str(folder / f"{label}.casadi"))
    np.savez(folder / "case.npz", references=case.references, plant_p=case.plant_p)
    numbers = {"solver": solver, **_numbers(case), **settings}
    (folder / "case.json").write_text(json.dumps(numbers), encoding="utf-8")
    line = [os.environ[INTERPRETER], FOLDER / "mpc_external_runner.py", folder]
    with one_core():
        run(line, env={**os.environ, **environment}, timeout=PATIENCE)


def _numbers(case: Case) -> dict[str, Any]:
    """What is needed beside functions; rows of a single state are its bounds."""
    s = case.stages
    single, boxes, rows = Nlp(s, soft=False).single_rows, [], []
    for i in range(s.nc):
        least, most = float(s.c_min[i]), float(s.c_max[i])
        penalty = {"linear": float(s.linear[i]), "quadratic": float(s.quadratic[i])}
        if i in single and single[i][0] < s.nx:
            state, factor, offset = single[i]
            ends = sorted([(least - offset) / factor, (most - offset) / factor])
            scaled = {"linear": penalty["linear"] * abs(factor), "quadratic": penalty["quadratic"] * factor**2}
            boxes.append({"state": state, "least": ends[0], "most": ends[1], **scaled})
        else:
            of = "state" if i < s.ns else "input"
            rows.append({"row": i, "least": least, "most": most, "of": of, **penalty})
    return {
        "boxes": boxes,
        "rows": rows,
        **{name: getattr(s, name) for name in ("stages", "stage", "substeps", "nt")},
        **{name: getattr(case, name).tolist() for name in ("x0", "u0", "p")},
        **{name: getattr(s, name).tolist() for name in ("weights", "terminal_weights", "u_min", "u_max")},
    }


# do-mpc, by its defaults.


def dompc(case: Case) -> tuple[LoopRun, dict[str, str]]:
    """The closed loop by do-mpc, and its versions; RuntimeError with the reason why there is none."""
    with tempfile.TemporaryDirectory(prefix="continuum-grasp-benchmark-") as name:
        _asked("do-mpc", case, Path(name), {f"{lib}_NUM_THREADS": "1" for lib in ("OMP", "OPENBLAS", "MKL")})
        with np.load(Path(name) / "run.npz") as found:
            done = {key: found[key] for key in found.files}
    seconds = np.column_stack([np.zeros(case.steps), done["seconds"]])
    versions = json.loads(str(done["versions"]))
    return LoopRun(done["x"], done["u"], seconds, float(seconds[0, 1]), done["good"]), versions


# acados, one iteration per step, prepared before the state is known, as generated C.


def acados_loops(case: Case, missing: list[str]) -> dict[str, CLoop]:
    """The loop by all ``FORMS``; where it cannot be had, the reason is added to ``missing``."""
    try:
        return {f"acados, {form}": acados_loop(case, *FORMS[form]) for form in FORMS}
    except RuntimeError as error:
        missing.append(f"{case.name}: {str(error).splitlines()[-1]}")
        return {}


def acados_loop(case: Case, qp_solver: str, blocks: int) -> CLoop:
    """The loop by one of ``FORMS``; RuntimeError with the reason why there is none."""
    root = _installed()
    with tempfile.TemporaryDirectory(prefix="continuum-grasp-benchmark-") as name:
        folder = Path(name)
        places = {"ACADOS_SOURCE_DIR": str(root), "PYTHONPATH": str(root / "interfaces" / "acados_template")}
        _asked("acados", case, folder, places, qp_solver=qp_solver, blocks=blocks or case.stages.stages)
        solver, shared = folder / "solver", folder / "libsolver.so"
        sources = [path for path in solver.rglob("*.c") if "sim_solver" not in path.name]
        parts = ("include", "include/acados", "include/blasfeo/include", "include/hpipm/include")
        include = [f"-I{place}" for place in (*(root / part for part in parts), solver)]
        # By RPATH, which acados finds its own libraries by, too.
        libraries = [f"-L{root / 'lib'}", f"-Wl,--disable-new-dtags,-rpath,{root / 'lib'}"]
        libraries += ["-lacados", "-lhpipm", "-lblasfeo", "-lm"]
        run(["cc", *FLAGS, *include, "-shared", *sources, *libraries, "-o", shared])
        text = defines(U_MIN=braces(case.stages.u_min), U_MAX=braces(case.stages.u_max))
        flags = [*include, str(shared), f"-Wl,-rpath,{folder}", *libraries]
        loop = CLoop(case, text + (FOLDER / "mpc_acados.c").read_text(encoding="utf-8"), flags=flags)
    return loop


@lru_cache
def _installed() -> Path:
    """Where acados is, built where it is not built yet."""
    if not os.environ.get(SOURCES):
        raise RuntimeError(f"acados: set {SOURCES}")
    root = Path(os.environ[SOURCES])
    if not (root / "lib" / "libacados.so").exists():
        given = [f"-DACADOS_INSTALL_DIR={root}", "-DCMAKE_BUILD_TYPE=Release", "-DACADOS_WITH_QPOASES=OFF"]
        given += ["-DBLASFEO_TARGET=X64_INTEL_HASWELL", "-DHPIPM_TARGET=AVX"]
        run(["cmake", "-S", root, "-B", root / "build", *given])
        run(["cmake", "--build", root / "build", "--target", "install"])
    return root
