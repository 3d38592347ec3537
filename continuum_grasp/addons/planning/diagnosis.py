"""Why there is no plan: how near the goal can be reached, and which limits stop it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from continuum_grasp.addons.planning.problem import PlanProblem
from continuum_grasp.base import Array
from continuum_grasp.nlp import Attempt, Violation

_TEXTS = {
    "input": ("the input limit stops it", "raise the input's limits ({0})"),
    "input rate": ("the input's rate limit stops it", "raise input.rate_max"),
    "duration": ("the duration stops it", "allow a longer duration"),
    "curvature": ("the curvature limit stops it", "allow more curvature (bounds.curvature, fidelity.bending_range)"),
    "tension": ("a limit of the tensions stops it", "raise finger.tendons.max_tension or lower bounds.least_tension"),
    "speed": ("the speed limit stops it", "raise bounds.speed"),
}
"""Texts about each limit in the message, and advice."""


class Diagnosis(NamedTuple):
    """Missed goals, by name and amount, and the limit that stops the plan."""

    violated: tuple[str, ...]
    message: str
    advice: str


def diagnose(problem: PlanProblem, attempt: Attempt) -> Diagnosis | None:
    """Find what stops a plan, from the solution of its relaxed problem; None if goal and bounds are met after all."""
    missed, worst = missed_goals(problem, attempt.x, weighted=False)
    outside = _outside(problem, attempt)
    if not missed and not outside:
        return None
    strengths = _strengths(problem, attempt)
    strongest, levers = max(strengths.values(), default=0.0), []
    what = [f"goal out of reach: {_nearest(problem, attempt.x)}"] if missed else []
    if outside:
        what.append(f"a bound of the state cannot be satisfied: {'; '.join(outside.values())}")
        levers.append(
            "the motion begins outside the bound, or is driven out of it: move the bound or the initial state"
        )
    # 1e-6: gain per share of a limit, in units of the squared distance, below which it does not stop anything
    if missed and strongest > 1e-6 * max(worst, 1.0):
        named = [
            # 0.2: share of the strongest limit from which on another one is named too
            name
            for name, value in sorted(strengths.items(), key=lambda item: -item[1])
            if value > 0.2 * strongest
        ]
        zone = ("zone {0} stops it", "move or shrink bounds.keep_out.{0}")
        keys = {"input": problem.motion.scene.limit_keys}
        texts = [[text.format(keys.get(name, name)) for text in _TEXTS.get(name, zone)] for name in named]
        what.append(" and ".join(text for text, _ in texts))
        levers = [text for _, text in texts]
    elif missed:
        what.append("no limit stops it")
        levers.append(
            "tendons bend the finger in few shapes: one with other bends, or a tip beside its path, cannot be held; "
            "give the goal a weight, or end: moving"
        )
    return Diagnosis((*missed, *outside), "; ".join(what), "; or ".join(levers))


def missed_goals(problem: PlanProblem, w: Array, *, weighted: bool) -> tuple[list[str], float]:
    """Goals that are missed beyond their tolerance, with their amounts, and the largest error [units of the problem].

    ``weighted`` chooses the goals that have a weight, or those that are to be reached exactly.
    """
    motion = problem.motion
    z = np.concatenate([w[problem.grid.s[-1]], w[problem.inputs[-1]]])
    numbers = motion.numbers([1.0]).ravel()
    missed, worst = [], 0.0
    for part in problem.goal:
        # Rest with a weight is a means of the search, not an aim.
        if (part.weight is not None) is not weighted or (weighted and part.at_rest):
            continue
        error = np.abs(np.array(part.rows(motion).value(z, numbers)).ravel())
        if part.unit == "m":  # points are missed by their distance, anything else by its worst entry
            error = np.repeat(np.hypot(*error.reshape(-1, 2).T), 2)
        worst = max(worst, float(error.max()))
        if np.any(error > part.tolerance):
            k = int((error / part.tolerance).argmax())
            unit = part.unit if part.unit != "state" else part.names[k]
            amount = float(error[k] * part.scale[k])
            missed.append(str(Violation(part.name, k, amount, unit, part.key, float(error[k]))))
    return missed, worst


def _outside(problem: PlanProblem, attempt: Attempt) -> dict[str, str]:
    """State bounds that are left, with their amounts, and in words when."""
    left = {}
    for block, violation in zip(problem.assembly.blocks, problem.violations(attempt), strict=True):
        # 1e-5: excess of a bound, in units of the problem, that counts as none
        if block.key.startswith("bounds.") and violation.scaled > 1e-5:
            count, size = block.rows.shape
            time = (violation.index // size + 1) / count * problem.path(attempt.x).duration
            amount = f"{violation.amount:.3g} {violation.unit}"
            left[str(violation)] = f"{violation.name} is left by {amount} at t = {time:.3g} s"
    return left


def _strengths(problem: PlanProblem, attempt: Attempt) -> dict[str, float]:
    """Gain in units of the problem per relative widening of each limit: multiplier times limit."""
    motion, duration = problem.motion, problem.path(attempt.x).duration
    changes = (motion.scene.input.rate_max or 0.0) * duration / len(problem.grid.v)
    gain = max(0.0, -_time_slope(problem, attempt) * attempt.x[problem.grid.time[0, 0]])
    strengths = {"input": 0.0, "input rate": 0.0, "duration": gain}
    for constraint in problem.constraints(attempt).values():
        name, _, way = constraint.name.partition(", ")
        # Limit of zones, which have none: the finger's length; of inputs that are held: their change in an interval.
        limit = np.where(np.isfinite(constraint.upper), np.abs(constraint.upper), 1.0)
        of_zone = constraint.key.startswith("bounds.keep_out.")
        limit = np.where(of_zone, motion.length, changes if way else limit)
        if name in ("input", "input rate") or constraint.key.startswith("bounds."):
            # What is fixed is no limit.
            free = constraint.lower < constraint.upper
            gain = float((np.abs(constraint.multipliers) * limit)[free].sum()) / motion.scales.objective
            strengths[name] = strengths.get(name, 0.0) + gain
    return strengths


def _time_slope(problem: PlanProblem, attempt: Attempt) -> float:
    """Derivative of the Lagrangian by the duration, where that is at its longest."""
    assembly, time = problem.assembly, problem.grid.time[0, 0]
    if attempt.x[time] < assembly.high[time] * (1 - 1e-6):
        return 0.0
    # Not its multiplier: a duration that is given is a fixed unknown, which IPOPT takes out of the problem.
    gradient = assembly.nlp.functions["grad_f"](attempt.x, [])[1]
    jacobian = assembly.nlp.functions["jac_g"](attempt.x, [])[1]
    return float(gradient[time]) + float(jacobian[:, int(time)].T @ attempt.multipliers.constraints)


def _nearest(problem: PlanProblem, w: Array) -> str:
    """Distance of the plan's end from its goal, in words."""
    model, path = problem.motion.prediction, problem.path(w)
    tip = np.array(model.tip(path.x[-1], path.u[-1], model.p_nominal)).ravel()
    text = f"the nearest tip reached is ({tip[0]:.4f}, {tip[1]:.4f}) m"
    aim = problem.motion.scene.goal.tip
    if aim is not None:
        text += f", {1e3 * float(np.hypot(*(tip - np.array(aim.value)))):.3g} mm off"
    return text
