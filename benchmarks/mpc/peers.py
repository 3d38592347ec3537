"""Other solvers of the same receding-horizon problem.

CasADi's SQP, generated to C, and IPOPT to convergence; acados and do-mpc in another interpreter, which is named in
``CONTINUUM_GRASP_PEERS_PYTHON``. acados also needs its sources, named in ``CONTINUUM_GRASP_ACADOS``: a clone of
github.com/acados/acados with ``external/blasfeo`` and ``external/hpipm``; it is built there once for each of
``BUILDS``, with CMake. The interpreter then has CasADi, jinja2 and what acados's own Python package needs (scipy,
matplotlib, cython, Deprecated).
"""

from __future__ import annotations

import json
import os
import tempfile
import time
from functools import lru_cache
from itertools import product
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from benchmarks.baselines import VARIABLE as INTERPRETER
from benchmarks.harness import defines, one_core, run, work_sizes
from benchmarks.mpc.cases import Case
from benchmarks.mpc.loop import FLAGS, FOLDER, CLoop, LoopRun, c_text
from benchmarks.mpc.nlp import Nlp
from continuum_grasp.base import Array

FORMS = {
    "own": "derivatives by CasADi alone",
    "custom_jacobian": "dynamics with the variational equations as their Jacobian",
    "jac_fg": "all derivatives given at once",
    "soft": "as custom_jacobian, and rows may be violated at their penalty",
}
"""How CasADi's problem is written; rows of all but the last are hard, which makes smaller problems."""

QP_ITERATIONS = 250
"""Limit of qrqp's, which has 1000 by itself and reaches it wherever its hard rows cannot be satisfied."""


def sqp_loop(case: Case, form: str) -> CLoop:
    """CasADi's ``sqpmethod`` and ``qrqp``, one Gauss-Newton iteration per step, as generated C in a closed loop.

    The guess is shifted, multipliers too, and its first state is the measured one. After a failure it starts again
    from the state. ``form`` is one of ``FORMS``.
    """
    stages = case.stages
    nlp = Nlp(stages, soft=form == "soft", variational=form in ("custom_jacobian", "soft"))
    quiet = dict.fromkeys(("print_iter", "print_header", "print_info", "error_on_fail"), False)
    quiet["max_iter"] = QP_ITERATIONS
    options: dict[str, Any] = {"qpsol": "qrqp", "qpsol_options": quiet, "max_iter": 1, "max_iter_ls": 0}
    options |= dict.fromkeys(("print_time", "print_header", "print_iteration", "print_status"), False)
    options |= {"hess_lag": nlp.hess_lag(), "calc_lam_p": False, "error_on_fail": False}
    if form == "jac_fg":
        options["jac_fg"] = nlp.jac_fg
    solver = ca.nlpsol("rti", "sqpmethod", nlp.problem, options)
    sizes = work_sizes(solver) | {"N": stages.stages, "NX": stages.nx, "NU": stages.nu}
    sizes |= {"NP": stages.np, "NZ": stages.nx + stages.nu}
    sizes |= {"COUNT": nlp.w.numel(), "ROWS": solver.size1_in("lbg"), "PARAMETERS": solver.size1_in("p")}
    numbers = {**nlp.bounds, "u_min": stages.u_min, "u_max": stages.u_max}
    shift = " ".join(
        f"memmove({name} + {start}, {name} + {start + width}, sizeof(double) * {(stages.stages - 1) * width});"
        for name, start, width in _blocks(nlp)
    )
    words = defines(**sizes, **{name.upper(): braces(values) for name, values in numbers.items()}, SHIFT=shift)
    return CLoop(case, words + c_text("sqp.c"), solver, late=True)


def _blocks(nlp: Nlp) -> list[tuple[str, int, int]]:
    """Arrays of which a part belongs to each stage: name, start, and entries per stage."""
    s, rows, count = nlp.stages, nlp.problem["g"].numel(), nlp.count
    found = [("w", 0, s.nx + s.nu), ("lam_x", 0, s.nx + s.nu)]
    if not nlp.soft:
        return [*found, ("lam_g", 0, rows // s.stages)]
    per = len(nlp.row_nodes) // s.stages
    starts = [s.stages * s.nx + k * s.stages * per for k in range(2)]
    found += [("w", count, per), ("lam_x", count, per), ("lam_g", 0, s.nx)]
    return found + [("lam_g", start, per) for start in starts]


def braces(values: Array) -> str:
    """Numbers as C initializes an array by them."""
    return "{" + ", ".join(repr(float(v)).replace("inf", "1e400") for v in values) + "}"


def converged(case: Case, *, exact: bool = False, soft: bool = True) -> LoopRun:
    """The closed loop with every problem solved by IPOPT, from the shifted solution before.

    ``exact``: the exact Hessian in place of Gauss-Newton's; ``soft``: violations at their penalty, as the real-time
    iteration has them, in place of hard rows.
    """
    nlp = Nlp(case.stages, soft=soft)
    options: dict[str, Any] = {"ipopt.print_level": 0, "ipopt.sb": "yes", "ipopt.tol": 1e-9, "ipopt.max_iter": 200}
    options |= dict.fromkeys(("print_time", "error_on_fail", "calc_lam_p"), False)
    if not exact:
        options["hess_lag"] = nlp.hess_lag(triangle=True)
    cold_solver = ca.nlpsol("cold", "ipopt", nlp.problem, options)
    warm = {"warm_start_init_point": "yes", "mu_init": 1e-6}
    warm |= {f"warm_start_{k}": 1e-9 for k in ("bound_push", "mult_bound_push", "slack_bound_push")}
    options |= {f"ipopt.{k}": v for k, v in warm.items()}
    solver = ca.nlpsol("warm", "ipopt", nlp.problem, options)
    plant, stages, bounds = case.plant(), case.stages, {k: v.copy() for k, v in nlp.bounds.items()}
    count = case.steps
    x, u = np.zeros((count + 1, stages.nx)), np.zeros((count, stages.nu))
    seconds, good, cold = np.zeros((count, 2)), np.zeros(count, bool), 0.0
    x[0] = case.x0
    planned = np.tile(case.x0, (stages.stages + 1, 1)), np.tile(case.u0, (stages.stages, 1))
    duals: dict[str, Any] = {}
    with one_core():
        for k in range(count):
            planned[0][0] = x[k]
            bounds["lbx"][: stages.nx] = bounds["ubx"][: stages.nx] = x[k]
            guess = nlp.guess(*planned, case.p)
            given = {**bounds, "p": nlp.parameters(case.p, case.references[k]), "x0": guess}
            began = time.thread_time()
            found = (solver if k else cold_solver)(**given, **duals)
            taken = time.thread_time() - began
            good[k] = (solver if k else cold_solver).stats()["success"]
            if not good[k] and k:  # warm starts do fail: count the time of both
                found = cold_solver(**given)
                taken = time.thread_time() - began
                good[k] = cold_solver.stats()["success"]
            seconds[k, 1] = taken
            cold = taken if k == 0 else cold
            duals = {"lam_x0": found["lam_x"], "lam_g0": found["lam_g"]}
            px, pu = nlp.plan(np.array(found["x"]).ravel())
            u[k] = np.clip(pu[0], stages.u_min, stages.u_max)
            x[k + 1] = np.array(plant(x[k], u[k], case.plant_p[k])).ravel()
            planned = np.vstack([px[1:], px[-1:]]), np.vstack([pu[1:], pu[-1:]])
    return LoopRun(x, u, seconds, cold, good)


# Of another interpreter.

SOURCES = "CONTINUUM_GRASP_ACADOS"
QP_SOLVERS: dict[str, tuple[str, int]] = {
    "HPIPM": ("PARTIAL_CONDENSING_HPIPM", 0),
    "HPIPM, condensed to 5 blocks": ("PARTIAL_CONDENSING_HPIPM", 5),
    "HPIPM, condensed": ("FULL_CONDENSING_HPIPM", 0),
}
"""acados's QP solvers, and how many blocks the QP is condensed to (0: none)."""
POSED = {"": False, ", hard bounds, linear least squares": True}
"""Whether acados gets the problem in its fastest form: without slacks, which this package's rows have."""
BUILDS = {
    "generic": {"BLASFEO_TARGET": "GENERIC", "HPIPM_TARGET": "GENERIC"},
    "own": {"BLASFEO_TARGET": "X64_AUTOMATIC", "HPIPM_TARGET": "AVX", "CMAKE_C_FLAGS": "-march=native"},
}
"""How acados and its linear algebra are compiled: plain C for any processor, and kernels for the machine's own."""
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
    line = [os.environ[INTERPRETER], FOLDER / "external.py", folder]
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
    """The loop by all ``BUILDS``, ``QP_SOLVERS`` and ``POSED``; why one cannot be had is added to ``missing``."""
    found = {}
    for build, form, posed in product(BUILDS, QP_SOLVERS, POSED):
        try:
            found[acados_name(build, form, posed)] = acados_loop(case, build, *QP_SOLVERS[form], plain=POSED[posed])
        except RuntimeError as error:
            reason = f"{case.name}{posed}: {str(error).splitlines()[-1]}"
            missing += [reason] if reason not in missing else []
    return found


def acados_name(build: str, form: str, posed: str) -> str:
    """Of one loop in tables."""
    return f"acados, {build} BLASFEO, {form}{posed}"


def acados_words() -> str:
    """Which acados ran, and how it was built; nothing where there is none."""
    if not os.environ.get(SOURCES):
        return ""
    commit = (_installed("generic")[0] / "lib" / "git_commit_hash").read_text(encoding="utf-8").strip()
    built = "; ".join(f"{name}: {', '.join(map('='.join, BUILDS[name].items()))}" for name in BUILDS)
    return f" acados {commit}, one thread, SQP_RTI, Gauss-Newton, ERK of order 4, Release: {built}."


def acados_loop(case: Case, build: str, qp_solver: str, blocks: int, plain: bool) -> CLoop:
    """The loop by one of ``BUILDS``, ``QP_SOLVERS`` and ``POSED``; RuntimeError with the reason why there is none."""
    source, root = _installed(build)
    if plain and not _linear(case.stages.outputs):
        raise RuntimeError("the residuals are not linear")
    with tempfile.TemporaryDirectory(prefix="continuum-grasp-benchmark-") as name:
        folder = Path(name)
        places = {"ACADOS_SOURCE_DIR": str(source), "PYTHONPATH": str(source / "interfaces" / "acados_template")}
        settings = {"qp_solver": qp_solver, "blocks": blocks or case.stages.stages, "hard": plain, "linear": plain}
        _asked("acados", case, folder, places, **settings)
        solver, shared = folder / "solver", folder / "libsolver.so"
        sources = [path for path in solver.rglob("*.c") if "sim_solver" not in path.name]
        parts = ("include", "include/acados", "include/blasfeo/include", "include/hpipm/include")
        include = [f"-I{place}" for place in (*(root / part for part in parts), solver)]
        # Static: of shared libraries with one name, a process would load those of one build for all.
        libraries = [f"-L{root / 'lib'}", "-Wl,-Bsymbolic", "-Wl,--whole-archive", "-lacados", "-Wl,--no-whole-archive"]
        libraries += ["-lhpipm", "-lblasfeo", "-lm"]
        run(["cc", *FLAGS, *include, "-shared", *sources, *libraries, "-o", shared])
        text = defines(U_MIN=braces(case.stages.u_min), U_MAX=braces(case.stages.u_max))
        flags = [*include, str(shared), f"-Wl,-rpath,{folder}"]
        loop = CLoop(case, text + c_text("acados.c"), flags=flags)
    return loop


def _linear(outputs: ca.Function) -> bool:
    """Whether outputs (x, u, p) are linear in x and u, without an offset."""
    x, u, p = outputs.sx_in()
    both = ca.vertcat(x, u)
    off = ca.substitute(outputs(x, u, p), both, ca.DM.zeros(both.shape))
    return not ca.depends_on(ca.jacobian(outputs(x, u, p), both), ca.vertcat(both, p)) and ca.simplify(off).is_zero()


@lru_cache
def _installed(build: str) -> tuple[Path, Path]:
    """Sources of acados, and where one of ``BUILDS`` is installed, which is made where it is not there yet."""
    if not os.environ.get(SOURCES):
        raise RuntimeError(f"acados: set {SOURCES}")
    source = Path(os.environ[SOURCES])
    root = source / "builds" / build
    if not (root / "lib" / "libacados.a").exists():
        given = {"ACADOS_INSTALL_DIR": root, "CMAKE_BUILD_TYPE": "Release", "ACADOS_WITH_QPOASES": "OFF"}
        given |= {"BUILD_SHARED_LIBS": "OFF", "CMAKE_POSITION_INDEPENDENT_CODE": "ON", **BUILDS[build]}
        run(["cmake", "-S", source, "-B", root / "build", *(f"-D{name}={value}" for name, value in given.items())])
        run(["cmake", "--build", root / "build", "--target", "install"])
    return source, root
