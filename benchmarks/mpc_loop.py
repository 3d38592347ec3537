"""Closed loops in C: compiles a solver with the loop around it and runs it."""

from __future__ import annotations

import ctypes
import math
import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from benchmarks.machine import compiler, one_core
from benchmarks.mpc_cases import Case
from benchmarks.real_time_iteration import Settings
from continuum_grasp.control.ocp.stages import Stages
from continuum_grasp.control.rti.source import iteration_source

Array = NDArray[np.float64]

FLAGS = ("-O3", "-march=native", "-ffast-math", "-fPIC", "-w")
"""Of every contestant."""
WARM = 20
"""Iterations on the first problem before the loop begins."""
_LOOP = Path(__file__).with_name("mpc_loop.c")


@dataclass
class LoopRun:
    """One closed loop."""

    x: Array
    """(steps + 1, nx)"""
    u: Array
    """(steps, nu)"""
    seconds: Array
    """Processor time of shift and preparation, and of feedback, (steps, 2)."""
    cold: float
    """Of the first iteration [s]."""
    good: NDArray[np.bool_]
    """Whether the step's problem was solved, (steps)."""
    guess: Array = field(default_factory=lambda: np.zeros((0, 0)))
    """Point of linearization, (steps, plan)."""
    plan: Array = field(default_factory=lambda: np.zeros((0, 0)))
    """Solution, (steps, plan)."""

    @property
    def step_seconds(self) -> Array:
        """Time of whole steps, (steps)."""
        found: Array = self.seconds.sum(axis=1)
        return found


class CLoop:
    """A compiled closed loop.

    Parameters
    ----------
    case : Case
        Problem, references and plant.
    source : str
        C of the hooks named in ``mpc_loop.c`` and of all they need.
    functions : sequence of casadi.Function
        Generated apart and linked to it.
    late : bool
        Whether it linearizes once the state is known, with that state in its guess.
    primal : float
        Largest violation of the problem's equations and input limits that counts as solved.
    flags : sequence of str
        More of them for the compiler, to find headers and libraries.
    """

    def __init__(
        self,
        case: Case,
        source: str,
        *functions: ca.Function,
        late: bool = False,
        primal: float = 1e-6,
        flags: Sequence[str] = (),
    ) -> None:
        self.case, self._late, self._primal = case, late, primal
        self._folder = tempfile.TemporaryDirectory(prefix="continuum-grasp-benchmark-")
        folder = Path(self._folder.name)
        plant = case.plant()
        stages = case.stages
        self._plan = (stages.stages + 1) * stages.nx + stages.stages * stages.nu
        sizes = {
            "NX": stages.nx,
            "NU": stages.nu,
            "NP": stages.np,
            "PLAN": self._plan,
            "REFS": (stages.stages + 1) * stages.nr,
            "PLANT_ARG": plant.sz_arg(),
            "PLANT_RES": plant.sz_res(),
            "PLANT_IW": plant.sz_iw(),
            "PLANT_W": plant.sz_w(),
        }
        defined = "".join(f"#define {name} {value}\n" for name, value in sizes.items())
        (folder / "solver.c").write_text(source, encoding="utf-8")
        (folder / "loop.c").write_text(defined + _LOOP.read_text(encoding="utf-8"), encoding="utf-8")
        names = ["solver", "loop"]
        for function in (plant, *functions):
            (folder / f"{function.name()}_.c").write_text(generated(function), encoding="utf-8")
            names.append(f"{function.name()}_")
        for name in names:
            _run([compiler(), *FLAGS, *flags, "-c", f"{folder}/{name}.c", "-o", f"{folder}/{name}.o"])
        library = folder / "loop.so"
        objects = [f"{folder}/{name}.o" for name in names]
        _run([compiler(), "-shared", "-Wl,-Bsymbolic", *objects, "-o", str(library), *flags, "-lm"])
        self.code_bytes: float = _text_size(folder / f"{names[-1] if functions else 'solver'}.o")
        self._library = ctypes.CDLL(str(library))
        self._library.timer_cost.restype = ctypes.c_double

    def timer_cost(self) -> float:
        """Seconds of one reading of the clock."""
        return float(self._library.timer_cost())

    def __call__(self, *, keep: bool = False) -> LoopRun:
        """Run it; ``keep`` the guesses and plans, which no timing should."""
        case, stages, steps = self.case, self.case.stages, self.case.steps
        x, u = np.zeros((steps + 1, stages.nx)), np.zeros((steps, stages.nu))
        seconds, status, cold = np.zeros((steps, 2)), np.zeros(steps, np.int32), np.zeros(1)
        retained = [np.zeros((steps, self._plan)) for _ in range(2)] if keep else [None, None]
        given = [np.ascontiguousarray(v, float) for v in (case.x0, case.u0, case.p, case.plant_p, case.references)]
        arrays = [*given, x, u, seconds, cold, status, *retained]
        with one_core():
            pointers = [None if a is None else ctypes.c_void_p(a.ctypes.data) for a in arrays]
            self._library.closed_loop(ctypes.c_longlong(steps), WARM, *pointers)
        finite = np.isfinite(u).all(axis=1) & np.isfinite(x[1:]).all(axis=1)
        run = LoopRun(x, u, seconds, float(cold[0]), (status >= 0) & finite)
        if retained[0] is not None and retained[1] is not None:
            run.guess, run.plan = retained
            if self._late:
                run.guess[:, : stages.nx] = x[:-1]
            run.good &= primal_residuals(case, run) <= self._primal
        return run


def primal_residuals(case: Case, run: LoopRun) -> Array:
    """By how much each step's solution misses the linearized dynamics, its initial state, and the input limits."""
    stages, n = case.stages, case.stages.stages
    step, slope = stages.step, stages.stage / stages.substeps
    found = np.zeros(len(run.plan))
    advance = step.map(n)
    for k, (guess, plan) in enumerate(zip(run.guess, run.plan, strict=True)):
        (x0, u0), (x, u) = _parts(stages, guess), _parts(stages, plan)
        start, dx, du = x0[:-1].T, (x - x0)[:-1].T, (u - u0).T
        for _ in range(stages.substeps):
            following, a, b = (np.array(v) for v in advance(start, u0.T, case.p, slope))
            by_x, by_u = a.reshape(-1, n, stages.nx), b.reshape(-1, n, stages.nu)
            dx = np.einsum("ikj,jk->ik", by_x, dx) + np.einsum("ikj,jk->ik", by_u, du)
            start = following
        gaps = np.abs(start + dx - x[1:].T).max()
        limits = np.maximum(stages.u_min - u, u - stages.u_max).max()
        found[k] = max(gaps, np.abs(x[0] - run.x[k]).max(), limits)
    return np.where(np.isfinite(found), found, np.inf)


def _parts(stages: Stages, plan: Array) -> tuple[Array, Array]:
    states = (stages.stages + 1) * stages.nx
    return plan[:states].reshape(-1, stages.nx), plan[states:].reshape(-1, stages.nu)


def generated(function: ca.Function) -> str:
    """CasADi's C of a function.

    Raises
    ------
    RuntimeError
        If CasADi could not generate it: it only warns, and writes an #error.
    """
    options = {"with_header": False, "casadi_int": "long long int", "with_mem": False, "static_aux": True}
    generator = ca.CodeGenerator(f"{function.name()}.c", options)
    generator.add(function)
    text = str(generator.dump())
    if "#error" in text:
        raise RuntimeError(f"CasADi generates no code of {function.name()}")
    return text


def _text_size(path: Path) -> int:
    said = subprocess.run(["size", str(path)], capture_output=True, text=True, check=False).stdout
    return int(said.splitlines()[1].split()[0]) if said.count("\n") > 1 else 0


def _run(command: list[str]) -> None:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise RuntimeError(f"{' '.join(command)} failed:\n{done.stderr[-3000:]}")


# The package's real-time iteration as the solver in the loop.

_HOOKS = """
static rti_plan plan;
static rti_work work;
static rti_settings settings;
static const unsigned char nominal[sizeof(rti_settings)] = {{{settings}}};
static double input[RTI_NU];
static const double *last_p, *last_refs;

void solver_start(const double *x0, const double *u0)
{{
  real x[RTI_NX], u[RTI_NU];
  for (int i = 0; i < RTI_NX; ++i) x[i] = (real)x0[i];
  for (int i = 0; i < RTI_NU; ++i) u[i] = (real)u0[i];
  memcpy(&settings, nominal, sizeof settings);
  rti_start(&plan, x, u);
}}
void solver_shift(void) {{ rti_shift(&plan, &settings, 1); }}
void solver_prepare(const double *p, const double *refs)
{{
  {convert}
  last_p = p;
  last_refs = refs;
  rti_prepare(&work, &plan, &settings, {p}, {refs});
}}
int solver_feedback(const double *x0)
{{
  rti_report report;
  real x[RTI_NX];
  for (int i = 0; i < RTI_NX; ++i) x[i] = (real)x0[i];
  int status = rti_feedback(&work, &plan, &settings, x, &report);
  for (int k = 1; k < {iterations} && status >= 0; ++k) {{
    solver_prepare(last_p, last_refs);
    status = rti_feedback(&work, &plan, &settings, x, &report);
  }}
  for (int i = 0; i < RTI_NU; ++i) input[i] = (double)plan.u[0][i];
  return status == RTI_ITERATION_LIMIT ? -100 : status;
}}
const double *solver_input(void) {{ return input; }}
void solver_plan(double *to)
{{
  for (int k = 0; k <= RTI_N; ++k)
    for (int i = 0; i < RTI_NX; ++i) *to++ = (double)plan.x[k][i];
  for (int k = 0; k < RTI_N; ++k)
    for (int i = 0; i < RTI_NU; ++i) *to++ = (double)plan.u[k][i];
}}
"""
_NARROW = """static real given_p[RTI_SIZE(RTI_NP)], given_refs[(RTI_N + 1) * RTI_SIZE(RTI_NR)];
  for (int i = 0; i < RTI_NP; ++i) given_p[i] = (real)p[i];
  for (int i = 0; i < (RTI_N + 1) * RTI_NR; ++i) given_refs[i] = (real)refs[i];"""


def rti_loop(case: Case, *, lanes: bool = True, real: str = "double", iterations: int = 1) -> CLoop:
    """The real-time iteration in a closed loop in C; a step that stops at its iteration limit counts as failed."""
    number: Any = np.float64 if real == "double" else np.float32
    settings = Settings(case.stages, number)
    data = ctypes.string_at(settings.address, settings.size)
    narrow = real != "double"
    hooks = _HOOKS.format(
        settings=", ".join(map(str, data)),
        iterations=iterations,
        convert=_NARROW if narrow else "",
        p="given_p" if narrow else "p",
        refs="given_refs" if narrow else "refs",
    )
    primal = math.inf if iterations > 1 else 1e-3 if narrow else 1e-6  # of one problem, linearized at the guess
    return CLoop(case, iteration_source(case.stages, real=real, lanes=lanes) + hooks, primal=primal)
