"""Whole-horizon plans by IPOPT."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path as FilePath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.errors import InputError, Interrupted, SolverError
from continuum_grasp.mpc.plan.diagnosis import Diagnosis, diagnose
from continuum_grasp.mpc.plan.files import load_plan
from continuum_grasp.mpc.plan.fine import checked
from continuum_grasp.mpc.plan.guess import Path, detours, final_posture, smooth_path
from continuum_grasp.mpc.plan.initial import first_state_of_plan
from continuum_grasp.mpc.plan.ipopt import Attempt, Multipliers, ProgrammeSolver
from continuum_grasp.mpc.plan.motion import Motion
from continuum_grasp.mpc.plan.outcome import constraints_of, objective_of
from continuum_grasp.mpc.plan.problem import PlanProblem
from continuum_grasp.mpc.plan.result import Plan, PlanStatus
from continuum_grasp.scene.load import load
from continuum_grasp.scene.plan import PlanScene

__all__ = ["plan"]

Array = NDArray[np.float64]

_KEPT = 1e-6
"""Violation in units of the programme below which constraints count as kept."""
_STARTS_WITH_ZONES = 5


def plan(
    scene: PlanScene | str | os.PathLike[str],
    *,
    warm: Plan | str | os.PathLike[str] | None = None,
    raise_on_failure: bool = True,
) -> Plan:
    """Plan a motion as a whole.

    The motion is transcribed by multiple shooting (Runge-Kutta steps) or collocation into one nonlinear programme,
    which IPOPT solves from smooth paths to a posture that meets the goal (J. T. Betts, Practical Methods for Optimal
    Control and Estimation Using Nonlinear Programming, SIAM 2010, doi:10.1137/1.9780898718577). The inputs found are
    then played to a finely integrated model.

    Parameters
    ----------
    scene : PlanScene or path-like
        What is to be planned, or its YAML file.
    warm : Plan or path-like, optional
        A plan of a similar scene, or its run folder, from which the search begins.
    raise_on_failure : bool
        Whether to raise where there is no plan; where not, its ``status`` says so.

    Returns
    -------
    Plan

    Raises
    ------
    InputError
        The scene is wrong, or ``warm`` does not fit.
    SolverError
        There is no plan; it names what is violated and what stops it, and ``result`` comes nearest.
    Interrupted
        Ctrl-C; ``result`` is the best plan so far, or the last iterate.
    """
    began = time.perf_counter()
    asked = _scene(scene)
    earlier = load_plan(warm) if isinstance(warm, (str, os.PathLike)) else warm
    search = _Search(asked, earlier, began)
    search.run()
    result = search.plan()
    if search.interrupted:
        raise Interrupted("interrupted while planning", result=result)
    if raise_on_failure and not result.solved:
        raise SolverError(
            result.message, status=result.status.value, violated=result.violated, advice=result.advice, result=result
        )
    return result


def _scene(given: PlanScene | str | os.PathLike[str]) -> PlanScene:
    if isinstance(given, PlanScene):
        return given
    if not isinstance(given, (str, os.PathLike)):
        raise InputError(f"expected a PlanScene or the path of its file, got {given!r:.80}")
    loaded = load(FilePath(given))
    if not isinstance(loaded, PlanScene):
        raise InputError(f"expected a plan (finger, goal, ...), got a {type(loaded).__name__}", file=os.fspath(given))
    return loaded


@dataclass
class _Search:
    """Starts of the solver, and the best of what they gave."""

    scene: PlanScene
    warm: Plan | None
    began: float
    attempts: list[tuple[str, Attempt]] = field(default_factory=list)
    best: Attempt | None = None
    nearest: Attempt | None = None
    diagnosis: Diagnosis | None = None
    interrupted: bool = False

    def __post_init__(self) -> None:
        scene = self.scene
        self.until = time.monotonic() + scene.solver.time_limit
        self.motion = Motion(scene)
        self.x0, self.first = first_state_of_plan(scene, self.motion.prediction)
        self.problem = PlanProblem(self.motion, self.x0)
        self.solver = ProgrammeSolver(self.problem.programme, scene.solver, self.until)
        self.built = time.perf_counter() - self.began

    def run(self) -> None:
        """Try all starts; where none gives a plan, see how near the goal can be reached, and start from there."""
        last: Attempt | None = None
        for name, w, multipliers in self._starts():
            last = self._try(name, w, multipliers)
            if self._over:
                break
        if self.best is None and not self._over and last is not None:
            self._relax(last)

    @property
    def _over(self) -> bool:
        return self.interrupted or time.monotonic() > self.until

    def _starts(self) -> Iterator[tuple[str, Array, Multipliers | None]]:
        scene = self.scene
        if self.warm is not None:
            w = self.problem.start(self._resampled(self.warm))
            state = self.warm.solver_state
            same = state and len(state["w"]) == len(w) and len(state["constraints"]) == self.problem.programme.count
            known = Multipliers(state["bounds"], state["constraints"]) if same else None
            yield "warm", np.array(state["w"]) if same else w, known
            if self.best is not None:
                return
        count = scene.solver.starts or (_STARTS_WITH_ZONES if scene.bounds.keep_out else 1)
        last = final_posture(self.motion, self.problem.goal, self.first)
        for side in detours(count):
            path = smooth_path(self.motion, self.x0, self.first, last, side)
            yield f"detour {side:g}", self.problem.start(path), None

    def _resampled(self, earlier: Plan) -> Path:
        """An earlier plan on this grid."""
        if earlier.x.shape[1] != self.motion.nx or earlier.u.shape[1] != self.motion.nu:
            raise InputError("the plan has another number of states or inputs than this model", key="warm")
        least, most = self.scene.duration_range
        t = np.linspace(0.0, earlier.duration, self.scene.intervals + 1)
        return Path(earlier.states_at(t), earlier.inputs_at(t), float(np.clip(earlier.duration, least, most)))

    def _try(self, name: str, w: Array, multipliers: Multipliers | None = None) -> Attempt:
        attempt = self.solver.run(w, multipliers)
        self.attempts.append((name, attempt))
        self.interrupted |= self.solver.watch.interrupted
        if attempt.violation < _KEPT and (self.best is None or _rank(attempt) < _rank(self.best)):
            self.best = attempt
        return attempt

    def _relax(self, last: Attempt) -> None:
        """How near the goal can be reached; if it can, the search goes on from there."""
        relaxed = PlanProblem(self.motion, self.x0, relaxed=True)
        solver = ProgrammeSolver(relaxed.programme, self.scene.solver, self.until)
        begin = self.problem.path(last.w)
        if not np.all(np.isfinite(begin.x)):
            begin = smooth_path(self.motion, self.x0, self.first, self.first, 0.0)
        attempt = solver.run(relaxed.start(begin))
        self.interrupted |= solver.watch.interrupted
        self.attempts.append(("relaxed", attempt))
        if not np.isfinite(attempt.violation) or attempt.violation > _KEPT:
            return
        self.nearest, self.nearest_problem = attempt, relaxed
        self.diagnosis = diagnose(relaxed, attempt)
        if self.diagnosis.met and not self._over:
            self._try("from the nearest", self.problem.start(relaxed.path(attempt.w)))

    # -- the result ---------------------------------------------------------------------------------------------------

    def plan(self) -> Plan:
        """The best plan, or what comes nearest."""
        problem, attempt = self.problem, self.best
        status, message, advice = PlanStatus.OPTIMAL, "solved", ""
        violated: tuple[str, ...] = ()
        if attempt is not None and not attempt.converged:
            status = PlanStatus.FEASIBLE
            message = f"all constraints are kept, but {_stopped(attempt)} before the optimum was reached"
        if attempt is None:
            status, message, advice, violated = self._failure()
            attempt = self.attempts[-1][1]
            if status is PlanStatus.INFEASIBLE and self.nearest is not None:
                problem, attempt = self.nearest_problem, self.nearest
        path = problem.path(attempt.w)
        result = Plan(
            scene=self.scene,
            status=status,
            message=message,
            t=np.linspace(0.0, path.duration, self.scene.intervals + 1),
            x=path.x,
            u=path.u,
            objective=objective_of(problem, attempt),
            constraints=constraints_of(problem, attempt),
            iterations=attempt.iterations,
            violated=violated,
            advice=advice,
            statistics=self._statistics(),
            solver_state={
                "w": attempt.w,
                "bounds": attempt.multipliers.bounds,
                "constraints": attempt.multipliers.constraints,
            },
            warnings=self._warnings(),
        )
        searched = time.perf_counter() - self.began
        if result.solved and not self.interrupted:
            result = checked(result, problem)
        total = time.perf_counter() - self.began
        times = {"build": self.built, "search": searched - self.built, "check": total - searched, "total": total}
        return replace(result, times=times)

    def _failure(self) -> tuple[PlanStatus, str, str, tuple[str, ...]]:
        found = self.diagnosis
        if found is not None and not found.met:
            return PlanStatus.INFEASIBLE, found.message, found.advice, found.violated
        last = self.attempts[-1][1]
        broken = (
            [c for c in constraints_of(self.problem, last).values() if c.excess > _KEPT] if self._is_own(last) else []
        )
        violated = tuple(str(c) for c in sorted(broken, key=lambda c: -c.excess))
        advice = "give the solver more iterations or time, more intervals, another initial duration, or a warm start"
        return PlanStatus.NOT_SOLVED, f"no plan was found: {_stopped(last)}", advice, violated

    def _is_own(self, attempt: Attempt) -> bool:
        return len(attempt.w) == self.problem.programme.size

    def _warnings(self) -> tuple[str, ...]:
        return ("the search was interrupted",) if self.interrupted else ()

    def _statistics(self) -> dict[str, Any]:
        programme = self.problem.programme
        return {
            "starts": [
                f"{name}: {a.outcome} after {a.iterations} iterations, {a.seconds:.2f} s" for name, a in self.attempts
            ],
            "unknowns": programme.size,
            "constraints": programme.count,
            "substeps": self.problem.substeps,
        }


def _rank(attempt: Attempt) -> tuple[bool, float]:
    return not attempt.converged, attempt.objective


def _stopped(attempt: Attempt) -> str:
    """Why the solver stopped."""
    return {
        "User_Requested_Stop": "the time was up",
        "Maximum_Iterations_Exceeded": "the iterations were used up",
        "Infeasible_Problem_Detected": "the solver ended where constraints cannot be met nearby",
    }.get(attempt.outcome, f"the solver ended with {attempt.outcome}")
