"""acados's real-time iterations in a closed loop; its sources are named in ``CONTINUUM_GRASP_ACADOS``.

The folder is a clone of github.com/acados/acados with ``external/blasfeo`` and ``external/hpipm``; it is built there
once, with CMake. The interpreter named in ``CONTINUUM_GRASP_PEERS_PYTHON`` has CasADi, jinja2 and what acados's own
Python package needs (scipy, matplotlib, cython, Deprecated).
"""

from __future__ import annotations

import json
import math
import os
import subprocess
import tempfile
from functools import lru_cache
from pathlib import Path
from typing import Any

from benchmarks.baselines import VARIABLE as INTERPRETER
from benchmarks.mpc_cases import Case
from benchmarks.mpc_loop import FLAGS, CLoop
from benchmarks.mpc_nlp import Nlp

VARIABLE = "CONTINUUM_GRASP_ACADOS"
FORMS: dict[str, tuple[str, int]] = {
    "HPIPM": ("PARTIAL_CONDENSING_HPIPM", 0),
    "HPIPM, condensed to 5 blocks": ("PARTIAL_CONDENSING_HPIPM", 5),
    "HPIPM, condensed": ("FULL_CONDENSING_HPIPM", 0),
}
"""acados's QP solvers, and how many blocks the QP is condensed to (0: none)."""
_RUNNER = Path(__file__).with_name("mpc_acados_runner.py")
_HOOKS = Path(__file__).with_name("mpc_acados.c")


def acados_loops(case: Case, missing: list[str]) -> dict[str, CLoop]:
    """The loop by all ``FORMS``; where it cannot be had, the reason is added to ``missing``."""
    try:
        return {f"acados, {form}": acados_loop(case, form) for form in FORMS}
    except RuntimeError as error:
        missing.append(f"{case.name}: {error}")
        return {}


def acados_loop(case: Case, form: str) -> CLoop:
    """One iteration of acados per step, prepared before the state is known, as generated C in a closed loop.

    Raises
    ------
    RuntimeError
        With the reason why there is none.
    """
    if case.stages.nd < case.stages.nx:
        raise RuntimeError("acados: its continuous model has no state that remembers the input")
    with tempfile.TemporaryDirectory(prefix="continuum-grasp-benchmark-") as folder:
        return _compiled(case, form, _installed(), Path(folder))


def _compiled(case: Case, form: str, root: Path, folder: Path) -> CLoop:
    s = case.stages
    for label, function in (("dynamics", s.dynamics), ("outputs", s.outputs), ("rows", s.rows)):
        function.save(str(folder / f"{label}.casadi"))
    (folder / "case.json").write_text(json.dumps(_numbers(case, *FORMS[form])), encoding="utf-8")
    package = root / "interfaces" / "acados_template"
    environment = {**os.environ, "ACADOS_SOURCE_DIR": str(root), "PYTHONPATH": str(package)}
    _run([os.environ[INTERPRETER], str(_RUNNER), str(folder)], environment)
    solver = folder / "solver"
    sources = [str(path) for path in solver.rglob("*.c") if "sim_solver" not in path.name]
    include = [
        f"-I{root / part}" for part in ("include", "include/acados", "include/blasfeo/include", "include/hpipm/include")
    ]
    # By RPATH, which acados finds its own libraries by, too.
    libraries = [f"-L{root / 'lib'}", f"-Wl,--disable-new-dtags,-rpath,{root / 'lib'}"]
    libraries += ["-lacados", "-lhpipm", "-lblasfeo", "-lm"]
    shared = folder / "libsolver.so"
    _run(["cc", *FLAGS, *include, f"-I{solver}", "-shared", *sources, *libraries, "-o", str(shared)])
    text = ""
    for name, values in (("u_min", s.u_min), ("u_max", s.u_max)):
        text += f"static const double {name}[] = {{{', '.join(repr(float(v)) for v in values)}}};\n"
    flags = [*include, f"-I{solver}", str(shared), f"-Wl,-rpath,{folder}", *libraries]
    loop = CLoop(case, text + _HOOKS.read_text(encoding="utf-8"), flags=flags)
    loop.code_bytes = math.nan  # in libraries
    return loop


def _numbers(case: Case, qp_solver: str, blocks: int) -> dict[str, Any]:
    """What the runner needs beside functions; rows of a single state are its bounds."""
    s = case.stages
    nlp = Nlp(s, soft=False)
    single, boxes, rows = nlp.single_rows, [], []
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
        "stages": s.stages,
        "stage": s.stage,
        "substeps": s.substeps,
        "nt": s.nt,
        "boxes": boxes,
        "rows": rows,
        "qp_solver": qp_solver,
        "blocks": blocks or s.stages,
        **{name: getattr(case, name).tolist() for name in ("x0", "p")},
        **{name: getattr(s, name).tolist() for name in ("weights", "terminal_weights", "u_min", "u_max")},
    }


@lru_cache
def _installed() -> Path:
    """Where acados is, built where it is not built yet."""
    for variable in (VARIABLE, INTERPRETER):
        if not os.environ.get(variable):
            raise RuntimeError(f"acados: set {variable}")
    root = Path(os.environ[VARIABLE])
    if not (root / "lib" / "libacados.so").exists():
        given = [f"-DACADOS_INSTALL_DIR={root}", "-DCMAKE_BUILD_TYPE=Release", "-DACADOS_WITH_QPOASES=OFF"]
        given += ["-DBLASFEO_TARGET=X64_INTEL_HASWELL", "-DHPIPM_TARGET=AVX"]
        _run(["cmake", "-S", str(root), "-B", str(root / "build"), *given])
        _run(["cmake", "--build", str(root / "build"), "--target", "install"])
    return root


def _run(command: list[str], environment: dict[str, str] | None = None) -> None:
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    if done.returncode != 0:
        raise RuntimeError(f"acados: {' '.join(command)} failed: {(done.stderr or done.stdout)[-1000:]}")
