"""Why there is no plan: how near the goal can be reached, and which limits stop it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from continuum_grasp.addons.planning.goal import MET, PRESSES
from continuum_grasp.addons.planning.guess import Path
from continuum_grasp.addons.planning.problem import PlanProblem
from continuum_grasp.base import Array
from continuum_grasp.control import Prediction
from continuum_grasp.nlp import Attempt

_TEXTS = {
    "input": ("the input limit stops it", "raise the input's limits ({0})"),
    "input rate": ("the input's rate limit stops it", "raise input.rate_max"),
    "duration": ("the duration stops it", "allow a longer duration"),
    "curvature": ("the curvature limit stops it", "allow more curvature (bounds.curvature, fidelity.bending_range)"),
    "tension": ("a limit of the tensions stops it", "raise finger.tendons.max_tension or lower bounds.least_tension"),
    "speed": ("the speed limit stops it", "raise bounds.speed"),
}
"""Texts about each limit in the message, and advice."""
_BINDS = 0.2
"""Gain by widening a limit, per that by the strongest one or per the cost of a missed goal, from which on it is named
[1]."""


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
    strongest = max(strengths.values(), default=0.0)
    levers = []
    what = [f"goal out of reach: {_nearest(problem, attempt.x)}"] if missed else []
    if outside:
        what.append(f"a bound of the state cannot be satisfied: {'; '.join(outside.values())}")
        levers.append(
            "the motion begins outside the bound, or is driven out of it: move the bound or the initial state"
        )
    # 1e-6: gain per share of a limit, in units of the squared distance, below which it does not stop anything
    if missed and strongest > 1e-6 * max(worst, 1.0):
        texts = _limit_texts(problem, _named(strengths))
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
    z = np.concatenate([w[problem.grid.s[-1]], w[problem.inputs[-1]]])
    missed = list[str]()
    greatest = 0.0
    for part in problem.goal:
        # Rest with a weight is a means of the search, not an aim.
        if (part.weight is not None) is not weighted or (weighted and part.at_rest):
            continue
        violation, worst = part.missed(problem.motion, z, part.tolerance)
        missed += [] if violation is None else [str(violation)]
        greatest = max(greatest, worst)
    return missed, greatest


def lever(problem: PlanProblem, attempt: Attempt) -> str:
    """Advice on a plan that misses a goal with a weight: the limits that bind, by their multipliers, or the weight.

    A force is not met by any weight where nothing touches, since it then has no slopes.
    """
    motion = problem.motion
    path = problem.path(attempt.x)
    force = motion.scene.goal.contact_force
    model = motion.prediction
    pressed = _pressed(model, path)
    if does_not_press(problem, attempt):
        return (
            "the finger does not press where it is to: move object or base, give the input wider limits "
            f"({motion.scene.limit_keys}) or more time, or start from a plan that touches (warm)"
        )
    z = np.concatenate([attempt.x[problem.grid.s[-1]], attempt.x[problem.inputs[-1]]])
    costs = [part.cost(motion, relaxed=False) for part in problem.goal if part.weight is not None]
    cost = sum(float(term.value(z, motion.numbers([1.0]).ravel())) for term in costs)
    strengths = _strengths(problem, attempt)
    named = _named({name: gain for name, gain in strengths.items() if gain > _BINDS * cost})
    texts = [text for _, text in _limit_texts(problem, named)] or ["raise the weight of the goal: no limit binds"]
    # A force is no way to a goal of another kind.
    blocked = force is None and bool(np.any(pressed > 0.0))
    way = ["the object is in the way, on which the finger presses: move it or the goal"] * blocked
    return "; or ".join([*way, *texts])


def does_not_press(problem: PlanProblem, attempt: Attempt) -> bool:
    """Whether contacts that are to press do not at the end, none of them."""
    force = problem.motion.scene.goal.contact_force
    path = problem.path(attempt.x)
    if force is None or not any(force.value):
        return False
    return bool(np.all(_pressed(problem.motion.prediction, path) < PRESSES * np.max(force.value)))


def _pressed(model: Prediction, path: Path) -> Array:
    """Contact forces at the end of a path [N]; none without an object."""
    if not model.contact_names:
        return np.zeros(0)
    return np.array(model.contact_force(path.x[-1], path.u[-1], model.p_nominal)).ravel()


def _named(strengths: dict[str, float]) -> list[str]:
    """Limits, the strongest first, down to a share of it."""
    ordered = sorted(strengths.items(), key=lambda item: -item[1])
    return [name for name, value in ordered if value > _BINDS * ordered[0][1]]


def _limit_texts(problem: PlanProblem, names: list[str]) -> list[list[str]]:
    """Message and advice about each limit."""
    zone = ("zone {0} stops it", "move or shrink bounds.keep_out.{0}")
    keys = {"input": problem.motion.scene.limit_keys}
    return [[text.format(keys.get(name, name)) for text in _TEXTS.get(name, zone)] for name in names]


def _outside(problem: PlanProblem, attempt: Attempt) -> dict[str, str]:
    """State bounds that are left, with their amounts, and in words when."""
    left = {}
    for block, violation in zip(problem.assembly.blocks, problem.violations(attempt), strict=True):
        if block.key.startswith("bounds.") and violation.scaled > MET:
            count, size = block.rows.shape
            time = (violation.index // size + 1) / count * problem.path(attempt.x).duration
            amount = f"{violation.amount:.3g} {violation.unit}"
            left[str(violation)] = f"{violation.name} is left by {amount} at t = {time:.3g} s"
    return left


def _strengths(problem: PlanProblem, attempt: Attempt) -> dict[str, float]:
    """Gain in units of the problem per relative widening of each limit: multiplier times limit."""
    motion = problem.motion
    duration = problem.path(attempt.x).duration
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
    assembly = problem.assembly
    time = problem.grid.time[0, 0]
    if attempt.x[time] < assembly.high[time] * (1 - 1e-6):
        return 0.0
    # Not its multiplier: a duration that is given is a fixed unknown, which IPOPT takes out of the problem.
    gradient = assembly.nlp.functions["grad_f"](attempt.x, [])[1]
    jacobian = assembly.nlp.functions["jac_g"](attempt.x, [])[1]
    return float(gradient[time]) + float(jacobian[:, int(time)].T @ attempt.multipliers.constraints)


def _nearest(problem: PlanProblem, w: Array) -> str:
    """Distance of the plan's end from its goal, in words."""
    model = problem.motion.prediction
    path = problem.path(w)
    tip = np.array(model.tip(path.x[-1], path.u[-1], model.p_nominal)).ravel()
    text = f"the nearest tip reached is ({tip[0]:.4f}, {tip[1]:.4f}) m"
    aim = problem.motion.scene.goal.tip
    if aim is not None:
        text += f", {1e3 * float(np.hypot(*(tip - np.array(aim.value)))):.3g} mm off"
    return text
