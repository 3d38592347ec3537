"""Whole-horizon plans by IPOPT."""

from __future__ import annotations

import os
import time
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from continuum_grasp.addons.planning.diagnosis import does_not_press, lever, missed_goals
from continuum_grasp.addons.planning.fine import checked
from continuum_grasp.addons.planning.guess import closing
from continuum_grasp.addons.planning.result import MotionPlan, PlanStatus, qualified
from continuum_grasp.addons.planning.scene import PlanScene
from continuum_grasp.addons.planning.search import PlanSearch
from continuum_grasp.base import Array, Interrupted, SolverError, check_arguments, interruptible
from continuum_grasp.nlp import Attempt
from continuum_grasp.scene import scene_of

if TYPE_CHECKING:
    from continuum_grasp.grasp import GraspResult


@interruptible()
@check_arguments
def plan(
    scene: PlanScene | str | os.PathLike[str],
    *,
    warm: MotionPlan | str | os.PathLike[str] | None = None,
    grasp: GraspResult | str | os.PathLike[str] | None = None,
    raise_on_failure: bool = True,
) -> MotionPlan:
    """Plan a motion as a whole.

    The motion is transcribed by collocation or single shooting (Runge-Kutta steps) into one nonlinear problem,
    which is solved from smooth paths to a posture that meets the goal (J. T. Betts, Practical Methods for Optimal
    Control and Estimation Using Nonlinear Programming, SIAM 2010, doi:10.1137/1.9780898718577). The inputs found are
    then played to a finely integrated model.

    Parameters
    ----------
    scene : PlanScene or path-like
        The scene to plan, or its YAML file.
    warm : Plan or path-like, optional
        A plan of a similar scene, or its run folder, from which the search begins.
    grasp : GraspResult or path-like, optional
        The grasp that the scene names, or its run folder, if you have it already.
    raise_on_failure : bool
        Raise where there is no plan; False: return the result with its ``status``.

    Returns
    -------
    Plan

    Raises
    ------
    InputError
        The scene is wrong, or ``warm`` does not fit.
    SolverError
        There is no plan; it names the violated constraints and what stops the plan, and ``result`` comes nearest.
    Interrupted
        Ctrl-C; ``result`` is the best plan so far, or the last iterate.

    Examples
    --------
    >>> import continuum_grasp as cg
    >>> found = cg.plan("configs/plan/tip_to_point.yaml")
    >>> found.status.value, found.u.shape == (len(found.t), 2)  # tensions of two tendons [N] per node
    ('optimal', True)
    """
    began = time.perf_counter()
    asked, near = closing(scene_of(scene, PlanScene), grasp)
    earlier = MotionPlan.load(warm) if isinstance(warm, (str, os.PathLike)) else warm
    search = PlanSearch(asked, earlier, near)
    built = time.perf_counter()
    try:
        search.run()
        searched = time.perf_counter()
        result = _result(search)
        if result.solved and not search.interrupted:
            result = checked(result, search.motion, search.problem.goal)
    except KeyboardInterrupt:  # outside the solver, which keeps it until it has ended
        search.interrupted = True
        searched = time.perf_counter()
        if not (search.attempts or search.relaxed):
            raise Interrupted("interrupted before a plan was found") from None
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


def _result(search: PlanSearch) -> MotionPlan:
    """The best plan, or what comes nearest."""
    problem = search.problem
    attempt = search.best
    scene = search.scene
    motion = search.motion
    if attempt is None:
        status, message, advice, violated = _failure(search)
        attempt = (search.attempts or search.relaxed)[-1][1]
        if search.diagnosis is not None and not search.budget.stopped:
            problem, attempt = search.nearest
    else:
        status, message = _success(search, attempt)
        advice = ""
        violated = ()
    path = problem.path(attempt.x)
    multipliers = attempt.multipliers
    lead = "" if violated else _lead(scene, path.u, path.duration, motion.input_unit)
    warnings = [lead] if lead else []
    if search.interrupted:
        warnings.append("the search was interrupted")
    if search.best is not None:
        missed, _ = missed_goals(problem, attempt.x, weighted=True)
        missed += motion.missed_setpoints(path.x, path.u, path.duration)
        if missed and (search.budget.cut or not attempt.converged):
            # Nothing is known of what more iterations would have reached.
            status, _, advice, _ = _unfinished(search)
            message = f"no plan was found: {_stopped(search, attempt)}; the motion there misses {' and '.join(missed)}"
            violated = tuple(missed)
        elif missed and search.pressing.can_press and does_not_press(problem, attempt):
            # The solver left the object, where a weight has no slope: the goal is not what cannot be met.
            status, _, advice, _ = _unfinished(search)
            message = "no plan was found: the solver came to a motion that does not press, and slow inputs do press"
            violated = tuple(missed)
        elif missed:
            status = PlanStatus.GOAL_MISSED
            message = qualified(message, "a goal is missed")
            advice = lever(problem, attempt)
            warnings += [f"{goal}: {advice}" for goal in missed]
    tried = [*search.attempts, *((f"{name}, distance from the goal", a) for name, a in search.relaxed)]
    return MotionPlan(
        scene=scene,
        status=status,
        message=f"{message}; on a drive without jumps up to one interval longer" if lead else message,
        t=np.linspace(0.0, path.duration, len(path.x)),
        x=path.x,
        u=path.u,
        objective=problem.objective(attempt.x),
        constraints=problem.constraints(attempt),
        iterations=attempt.iterations,
        violated=violated,
        advice=advice,
        warnings=tuple(warnings),
        statistics={
            "starts": [f"{name}: {a.outcome} after {a.iterations} iterations, {a.seconds:.2f} s" for name, a in tried],
            "unknowns": search.problem.assembly.size,
            "constraints": search.problem.assembly.count,
            "steps": motion.steps if scene.transcription == "single_shooting" else (),
            "cut_short": search.budget.cut,
        },
        solver_state={
            "w": attempt.x,
            "bounds": multipliers.bounds,
            "constraints": multipliers.constraints,
            "units": motion.units,
        },
    )


def _success(search: PlanSearch, attempt: Attempt) -> tuple[PlanStatus, str]:
    """Status of a plan that satisfies all constraints, and why it is not known to be the best."""
    motion = search.motion
    if not attempt.converged:
        left = f"{_stopped(search, attempt)} before the optimum was reached"
        return PlanStatus.FEASIBLE, qualified("all constraints are satisfied", left)
    if search.budget.cut:
        left = f"{_cut(search)} before the search was complete"
        return PlanStatus.FEASIBLE, qualified("all constraints are satisfied at the nodes", left)
    if search.problem.presses:
        return PlanStatus.FEASIBLE, "all constraints are satisfied; the finger comes into balance after the end"
    if motion.friction_states:
        # Slopes do not know how friction would change with the motion.
        whose = "tendon friction" if motion.tendon_friction else "friction of motors"
        left = f"inputs are optimal for {whose} as it acts in this motion"
        return PlanStatus.FEASIBLE, f"all constraints are satisfied; {left}"
    return PlanStatus.OPTIMAL, "solved"


def _lead(scene: PlanScene, u: Array, duration: float, unit: str) -> str:
    """By how much held inputs shorten the least time of a drive whose rate is limited; empty where they do not.

    The input may jump at the nodes by what the rate limit allows in an interval, at the first node (from
    ``input.initial``) and at the last one too: a drive that takes an interval for each jump ends up to one later.
    """
    rate_max = scene.input.rate_max
    # Only least time gains by jumps, and inputs that are linear over an interval have none.
    if scene.objective != "least_time" or scene.input.form == "linear" or rate_max is None:
        return ""
    first, last = (float(np.abs(jump).max()) for jump in (u[0] - np.array(scene.initial_input), u[-1] - u[-2]))
    return (
        f"held inputs jump ({first:.3g} {unit} at the start, {last:.3g} {unit} at the end): a drive that keeps "
        f"input.rate_max = {rate_max:g} {unit}/s needs up to one interval ({1e3 * duration / scene.intervals:.3g} ms) "
        f"more than these {duration:.4g} s; take input.form: linear, which has no jumps, or more intervals"
    )


def _failure(search: PlanSearch) -> tuple[PlanStatus, str, str, tuple[str, ...]]:
    """Status, message, advice and violated constraints."""
    diagnosis = search.diagnosis
    if diagnosis is not None and not search.budget.stopped:
        if search.scene.object is None:
            return PlanStatus.INFEASIBLE, diagnosis.message, diagnosis.advice, diagnosis.violated
        # With contact there are many least distances from the goal: a finger that touches nothing is pushed nowhere.
        return (
            PlanStatus.NOT_SOLVED,
            f"no plan was found; at the nearest motion {diagnosis.message}",
            diagnosis.advice,
            diagnosis.violated,
        )
    return _unfinished(search)


def _unfinished(search: PlanSearch) -> tuple[PlanStatus, str, str, tuple[str, ...]]:
    """Status, message, advice and violated constraints of a search that ended before anything was known."""
    last = search.attempts[-1][1]
    broken = [v for v in search.problem.violations(last) if v.scaled > search.feasible]
    violated = tuple(str(v) for v in sorted(broken, key=lambda v: -v.scaled))
    advice = "give the solver more iterations, more intervals, another initial duration, or a warm start"
    if search.scene.object is not None:
        advice += (
            "; plan with a softer contact first (contact_law: stiffness, rounding, slip_speed), and start from that"
        )
    status = PlanStatus.STOPPED if search.budget.stopped else PlanStatus.NOT_SOLVED
    return status, f"no plan was found: {_stopped(search, last)}", advice, violated


def _cut(search: PlanSearch) -> str:
    """Cause that cut the search short, in words."""
    options = search.scene.solver
    if search.budget.stopped:
        return f"the clock stopped the search after {options.time_limit:g} s (solver.time_limit)"
    return f"all {search.allowed} iterations were used up (solver.max_total_iterations)"


def _stopped(search: PlanSearch, attempt: Attempt) -> str:
    """Why the solver stopped."""
    if search.budget.cut:
        return _cut(search)
    return attempt.why_it_ended
