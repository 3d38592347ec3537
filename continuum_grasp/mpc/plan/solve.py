"""Whole-horizon plans by IPOPT."""

from __future__ import annotations

import os
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from continuum_grasp import interrupt
from continuum_grasp.errors import InputError, Interrupted, SolverError
from continuum_grasp.mpc.plan.closing import closing
from continuum_grasp.mpc.plan.files import load_plan
from continuum_grasp.mpc.plan.fine import checked
from continuum_grasp.mpc.plan.ipopt import Attempt
from continuum_grasp.mpc.plan.outcome import constraints_of, objective_of
from continuum_grasp.mpc.plan.result import Plan, PlanStatus
from continuum_grasp.mpc.plan.search import KEPT, Search
from continuum_grasp.scene.load import load
from continuum_grasp.scene.plan import PlanScene

if TYPE_CHECKING:
    from continuum_grasp.grasp.result import GraspResult

__all__ = ["plan"]


@interrupt.listening()
def plan(
    scene: PlanScene | str | os.PathLike[str],
    *,
    warm: Plan | str | os.PathLike[str] | None = None,
    grasp: GraspResult | str | os.PathLike[str] | None = None,
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
    grasp : GraspResult or path-like, optional
        The grasp that the scene names, or its run folder, where it was found already.
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
    asked, near = closing(_scene(scene), grasp)
    earlier = load_plan(warm) if isinstance(warm, (str, os.PathLike)) else warm
    search = Search(asked, earlier, near)
    built = time.perf_counter()
    try:
        search.run()
        searched = time.perf_counter()
        result = _result(search)
        if result.solved and not search.interrupted:
            result = checked(result, search.motion)
    except KeyboardInterrupt:  # outside the solver, which keeps it until it has ended
        search.interrupted, searched = True, time.perf_counter()
        if not search.attempts:
            raise Interrupted("interrupted before anything was found") from None
        result = _result(search)
    ended = time.perf_counter()
    times = {"build": built - began, "search": searched - built, "check": ended - searched, "total": ended - began}
    result = replace(result, times=times)
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
    loaded = load(Path(given))
    if not isinstance(loaded, PlanScene):
        raise InputError(f"expected a plan (finger, goal, ...), got a {type(loaded).__name__}", file=os.fspath(given))
    return loaded


def _result(search: Search) -> Plan:
    """The best plan, or what comes nearest."""
    problem, attempt, scene = search.problem, search.best, search.scene
    status, message, advice = PlanStatus.OPTIMAL, "solved", ""
    violated: tuple[str, ...] = ()
    if attempt is None:
        status, message, advice, violated = _failure(search)
        attempt = search.attempts[-1][1]
        if status is PlanStatus.INFEASIBLE:
            problem, attempt = search.nearest
    elif not attempt.converged:
        status = PlanStatus.FEASIBLE
        message = f"all constraints are kept, but {_stopped(attempt)} before the optimum was reached"
    path = problem.path(attempt.w)
    return Plan(
        scene=scene,
        status=status,
        message=message,
        t=np.linspace(0.0, path.duration, scene.intervals + 1),
        x=path.x,
        u=path.u,
        objective=objective_of(problem, attempt),
        constraints=constraints_of(problem, attempt),
        iterations=attempt.iterations,
        violated=violated,
        advice=advice,
        warnings=("the search was interrupted",) if search.interrupted else (),
        statistics=_statistics(search),
        solver_state={
            "w": attempt.w,
            "bounds": attempt.multipliers.bounds,
            "constraints": attempt.multipliers.constraints,
            "units": search.motion.units,
        },
    )


def _failure(search: Search) -> tuple[PlanStatus, str, str, tuple[str, ...]]:
    """Status, message, advice and what is violated."""
    found = search.diagnosis
    if found is not None and not found.met:
        return PlanStatus.INFEASIBLE, found.message, found.advice, found.violated
    last = search.attempts[-1][1]
    broken = [c for c in constraints_of(search.problem, last).values() if c.excess > KEPT]
    violated = tuple(str(c) for c in sorted(broken, key=lambda c: -c.excess))
    advice = "give the solver more iterations or time, more intervals, another initial duration, or a warm start"
    if search.scene.object is not None:
        advice += (
            "; plan with a softer contact first (contact_law: stiffness, rounding, slip_speed), and start from that"
        )
    return PlanStatus.NOT_SOLVED, f"no plan was found: {_stopped(last)}", advice, violated


def _statistics(search: Search) -> dict[str, Any]:
    programme = search.problem.programme
    tried = [*search.attempts, *((f"{name}, distance from the goal", a) for name, a in search.relaxed)]
    return {
        "starts": [f"{name}: {a.outcome} after {a.iterations} iterations, {a.seconds:.2f} s" for name, a in tried],
        "unknowns": programme.size,
        "constraints": programme.count,
        "substeps": search.problem.substeps,
        "tightened": search.tightened,
    }


def _stopped(attempt: Attempt) -> str:
    """Why the solver stopped."""
    return {
        "User_Requested_Stop": "the time was up",
        "Maximum_Iterations_Exceeded": "the iterations were used up",
        "Infeasible_Problem_Detected": "the solver ended where constraints cannot be met nearby",
    }.get(attempt.outcome, f"the solver ended with {attempt.outcome}")
