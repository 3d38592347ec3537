"""Closed loops in C: compiles a solver with the loop around it and runs it."""

from __future__ import annotations

import ctypes
import math
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from benchmarks.harness import compiled, defines, generated, linked, one_core, work_sizes
from benchmarks.mpc.cases import Case
from benchmarks.real_time_iteration import Settings
from continuum_grasp.base import Array
from continuum_grasp.control import Stages
from continuum_grasp.control.iteration.source import iteration_source

FLAGS = ("-O3", "-march=native", "-ffast-math", "-fPIC", "-w")
"""Of every contestant."""
WARM = 20
"""Iterations on the first problem before the loop begins."""
FOLDER = Path(__file__).parent


def c_text(name: str) -> str:
    """C of a file beside this one."""
    return (FOLDER / name).read_text(encoding="utf-8")


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

    ``source`` is the C of the hooks named in ``loop.c`` and of all they need, to which ``functions``, generated
    apart, are linked, by compiler ``flags`` that find headers and libraries. A solver that is ``late`` linearizes once
    the state is known, with that state in its guess; its step counts as solved where it violates the problem's
    equations and input limits by ``primal`` at most.
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
        folder, plant, stages = Path(self._folder.name), case.plant(), case.stages
        self._plan = (stages.stages + 1) * stages.nx + stages.stages * stages.nu
        sizes = {"NX": stages.nx, "NU": stages.nu, "NP": stages.np, "PLAN": self._plan}
        sizes |= {"REFS": (stages.stages + 1) * stages.nr}
        units = {"solver": source, "loop": defines(**sizes, **work_sizes(plant, "PLANT")) + c_text("loop.c")}
        for function in (plant, *functions):
            units[f"{function.name()}_"] = generated(function)
        objects = [compiled(folder, name, text, (*FLAGS, *flags)) for name, text in units.items()]
        self._library = linked(folder, objects, flags)
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


def rti_loop(case: Case, *, lanes: bool = True, real: str = "double", iterations: int = 1) -> CLoop:
    """The package's real-time iteration in a closed loop in C; a step that stops at its iteration limit has failed."""
    number: Any = np.float64 if real == "double" else np.float32
    settings = Settings(case.stages, number)
    data = ctypes.string_at(settings.address, settings.size)
    words = defines(SETTINGS=", ".join(map(str, data)), ITERATIONS=iterations)
    primal = math.inf if iterations > 1 else 1e-6 if real == "double" else 1e-3  # of one problem, linearized once
    return CLoop(case, iteration_source(case.stages, real=real, lanes=lanes) + words + c_text("rti.c"), primal=primal)
