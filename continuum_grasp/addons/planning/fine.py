"""A plan on a finely integrated model and on a finer one, and after its end."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace

import casadi as ca
import numpy as np

from continuum_grasp.addons.planning.goal import GoalPart
from continuum_grasp.addons.planning.grid import BOUNDED, MOST_ELEMENTS
from continuum_grasp.addons.planning.guess import Path, first_state_of_plan
from continuum_grasp.addons.planning.motion import PlannedMotion, parameters_over_time, reach_of, state_scales
from continuum_grasp.addons.planning.result import Deviation, MotionPlan, PlanStatus, qualified
from continuum_grasp.addons.planning.scene import PlanScene
from continuum_grasp.base import Array, NumericalError
from continuum_grasp.control import Prediction
from continuum_grasp.core import Rollouts

PARTS = MOST_ELEMENTS * BOUNDED
"""Parts of an interval at which bounds are looked at: as many as those at which the finest problem bounds the state. A
cheap plan rushes through a zone between the places of a problem, the faster the more there are."""
LEFT = 1e-3
"""Share of a bound's scale by which a plan may leave it between the places where the problem has it."""
_FINER_OFF = 0.01
"""Deviation of tip or object on a finer model, per finger length, from which on there is a warning."""
_STAYS = 1.3
"""Natural times of the finger after the end in which one that is held must stay where it is [1]: ten times as long as
it settles."""


def simulated(
    scene: PlanScene,
    model: Prediction,
    path: Path,
    x0: Array,
    parts: int = PARTS,
    *,
    afresh: bool = False,
    finer: int = 1,
) -> Array:
    """States (N * parts + 1, nx) of a model under the inputs of a path, at ``parts`` equal parts of every interval.

    ``afresh``: every interval begins at the state that the path has there. Implicit steps are ``finer`` by that factor.
    A state that is not finite raises a NumericalError, whose ``result`` holds the states before.
    """
    intervals = len(path.u) - 1
    interval = path.duration / intervals
    h = interval / parts
    rate = model.fastest_rate(*(np.array(limit) for limit in scene.input_limits))
    # Parts shorter than an eighth of an interval have no more steps than that.
    share = min(1.0, 8.0 / parts)
    # 0.1: product of step and fastest rate of the explicit method: 1/27 of its stability limit
    method = "rk4"
    substeps = max(2, math.ceil(rate * h / 0.1))
    # 200: sub-steps per part up to which the explicit method is taken
    if substeps > 200 * share:
        # Stiff contacts: an L-stable method may step over what has died out long before.
        method = model.system.structure.stiff_method()
        # 5: longest step of the implicit method, for what is too stiff, per that of one that is so in part
        step = model.system.structure.partial_step * (5.0 if method == "rodas" else 1.0)
        substeps = finer * max(math.ceil(4 * share), math.ceil(h / step))
    units = _units(model, path.duration)
    run = _rollout(model, method, intervals * parts * substeps)
    at = np.linspace(0.0, 1.0, 2 * substeps * parts + 1)  # half steps, at which the methods evaluate their slopes
    states = [x0[None]]
    # Interval by interval: at a node a held input has two values.
    for k in range(intervals):
        last = path.u[k + 1] if scene.input.form == "linear" else path.u[k]
        u = path.u[k] + (last - path.u[k]) * at[:, None]
        w = parameters_over_time(scene, model, (k + at) * interval)
        begin = np.ascontiguousarray((path.x[k : k + 1] if afresh else states[-1][-1:]) / units)
        interval_states, count = run(begin, parts, substeps, h / substeps, u, w, units)
        states.append(interval_states[0, 1 : count[0] + 1] * units)
        if count[0] < parts:
            # A linearly implicit step does not see what it meets within it, such as a tension that rises at once.
            if method != "rk4" and finer < 16:
                return simulated(scene, model, path, x0, parts, afresh=afresh, finer=4 * finer)
            time = float(k * interval + count[0] * h)
            message = f"the simulated state is not finite after t = {time:g} s"
            raise NumericalError(message, time=time, result=np.concatenate(states))
    return np.concatenate(states)


def _units(model: Prediction, time: float) -> Array:
    """Units of the states (nx) of a motion over a time [s].

    Powers of two round nothing: linear systems of steps are then the same in all units of length, mass and time.
    """
    return np.asarray(np.exp2(np.frexp(state_scales(model, reach_of(model), time))[1]))


def _rollout(model: Prediction, method: str, steps: int) -> Rollouts:
    """Rollouts in which parameters take the place of forces, since they may vary over time, and units of the states
    (nx) the place of parameters: the code of all units is one, and rounds alike.
    """
    units = ca.SX.sym("units", model.nx)
    part = ca.SX.sym("part")
    inputs = [model.x, model.u, model.p, units]
    names = ["x", "u", "w", "p"]
    rate = model.dynamics(model.x * units, model.u, model.p) / units
    dynamics = ca.Function("forward_dynamics", inputs, [rate], names, ["xd"])
    functions = SimpleNamespace(forward_dynamics=dynamics)
    if method == "rodas":
        slopes = [ca.densify(ca.jacobian(rate, v)) for v in (model.x, model.u)]
        functions.linearization = ca.Function("linearization", inputs, slopes, names, ["A", "B"])
    elif method != "rk4":
        slowed = ca.Function("slowed", [*inputs, part], [model.rates(model.system.implicit()(*model.arguments, part))])
        scaled = slowed(model.x * units, *inputs[1:], part) / units
        implicit = ca.Function("implicit", [*inputs, part], [ca.cse(scaled)], [*names, "part"], ["k"])
        functions.implicit = lambda: implicit
    rollouts = Rollouts.by(method, functions)
    rollouts.code.expect(steps)
    return rollouts


def places(model: Prediction, x: Array, u: Array) -> Array:
    """Positions of the tip, and of four points as far from the center of an object that moves as it reaches [m].

    Of states x (count, nx) under inputs u (count, nu): (count, points, 2).
    """
    tips = np.array(model.tip.map(len(x))(x.T, u.T, np.tile(model.p_nominal, (len(x), 1)).T)).T[:, None]
    pose = x[:, model.system.object_states]
    around = model.system.surroundings
    if around is None or around.object is None or not pose.size:
        return tips
    reach = max(part.extent for part in around.object.parts)
    angles = pose[:, 2:3] + 0.5 * np.pi * np.arange(4)
    points = pose[:, None, :2] + reach * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    return np.concatenate([tips, points], axis=1)


def distances(one: Array, other: Array) -> Array:
    """Distances (count, 2) of tips and of objects at `places` [m]; zero without an object that moves."""
    apart = np.linalg.norm(one - other, axis=2)
    return np.stack([apart[:, 0], apart[:, 1:].max(axis=1, initial=0.0)], axis=1)


def excess_over_intervals(motion: PlannedMotion, states: Array, parts: int = PARTS) -> Array:
    """Largest amounts (N, ns) by which the state's bounds are left at the parts of each interval, as shares of their
    scales.
    """
    bounded, model = motion.bounded, motion.prediction
    count = len(states)
    # As in the problem, bounds are of the state alone, whatever the input and the loads.
    fixed = (np.zeros(model.nu), parameters_over_time(motion.scene, model, [0.0])[0])
    every = motion.rows.map(count)(states.T, *(np.tile(v, (count, 1)).T for v in fixed))
    rows = np.array(every).T
    excess = np.maximum(np.maximum(bounded.least - rows, rows - bounded.most), 0.0)
    inner = excess[1:].reshape((count - 1) // parts, parts, rows.shape[1])
    return np.asarray(inner.max(axis=1))


def missed_when_played(motion: PlannedMotion, goal: Sequence[GoalPart], x: Array, u: Array) -> list[str]:
    """Goals that the end of a simulation misses, with their amounts: a state x (nx) under an input u (nu)."""
    z = np.concatenate([motion.scaled_state(x, u), u / motion.scales.u])
    # Rest with a weight is a means of the search, not an aim.
    aims = [part for part in goal if part.weight is None or not part.at_rest]
    return [str(violation) for part in aims if (violation := part.missed(motion, z, part.played)[0]) is not None]


def checked(plan: MotionPlan, motion: PlannedMotion, goal: Sequence[GoalPart]) -> MotionPlan:
    """A copy of the plan with the results of a fine simulation of its inputs, in which its goal has to be met too."""
    scene = plan.scene
    model = motion.prediction
    warnings = list(plan.warnings)
    path = Path(plan.x, plan.u, plan.duration)
    try:
        states = simulated(scene, model, path, plan.x[0])
    except NumericalError as error:
        if scene.transcription == "single_shooting":
            return replace(plan, status=PlanStatus.NOT_SOLVED, message=f"no plan: {error}")
        warnings.append(f"{error}: take more intervals, or a higher solver.degree")
        return replace(_departed(plan, str(error)), warnings=tuple(warnings))
    planned = places(model, plan.x, plan.u)
    deviation = _deviation("the plan's model, finely integrated", model, plan, planned, states)
    of_object = deviation.object, deviation.final_object, "of the object; "
    most, final, what = max((deviation.tip, deviation.final_tip, ""), of_object)
    if most > scene.check.tolerance * plan.length:
        off = f"a fine simulation is up to {1e3 * most:.3g} mm off the plan ({what}{1e3 * final:.3g} mm at the end)"
        finer_steps = "more solver.substeps" if scene.transcription == "single_shooting" else "a higher solver.degree"
        warnings.append(f"{off}: take more intervals, or {finer_steps}")
        plan = _departed(plan, off)
    reason = _not_reproduced(plan, model, states, deviation)
    if reason:
        advice = "take more solver.substeps, or more intervals"
        return replace(plan, status=PlanStatus.NOT_SOLVED, message=reason, advice=advice, deviation=deviation)
    missed = _missed(plan, motion, goal, states)
    if missed and plan.status != PlanStatus.GOAL_MISSED:
        plan = replace(plan, status=PlanStatus.GOAL_MISSED, message=qualified(plan.message, missed))
        plan = replace(plan, advice="take more intervals, a higher solver.degree, or a softer contact")
        warnings.append(f"{missed}: {plan.advice}")
    left = _left(motion, states)
    after = _left_after_the_end(motion, plan, states[-1])
    if left:
        warnings.append(f"between the nodes {left}: take more intervals")
        plan = _departed(plan, f"between the nodes {left}")
    if after:
        warnings.append(after)
        plan = replace(plan, message=f"{plan.message}; {after}")
    finer = None
    if scene.check.finer is not None:
        finer, off = _on_finer(scene, plan, planned, path)
        if off:
            warnings.append(f"{off}: raise fidelity.elements")
            plan = replace(plan, message=f"{plan.message}; {off}")
    return replace(plan, deviation=deviation, finer=finer, warnings=tuple(warnings))


def _departed(plan: MotionPlan, how: str) -> MotionPlan:
    """A plan of its grid alone, which its motion does not keep."""
    status = PlanStatus.FEASIBLE if plan.status == PlanStatus.OPTIMAL else plan.status
    return replace(plan, status=status, message=qualified(plan.message, how))


def _missed(plan: MotionPlan, motion: PlannedMotion, goal: Sequence[GoalPart], states: Array) -> str:
    """The goal that a fine simulation misses at the end, or after it where the finger is held; empty where none."""
    u = plan.u[-1]
    end = "a fine simulation misses "
    missed = missed_when_played(motion, goal, states[-1], u)
    missed += motion.missed_setpoints(states[:: (len(states) - 1) // (len(plan.t) - 1)], plan.u, plan.duration)
    if not missed and plan.scene.goal.end == "held" and not plan.scene.load_varies:
        rest = _stayed(plan, motion.prediction, states[-1])
        end = f"{_STAYS * plan.scene.finger.rod.natural_time:.2g} s after its end a fine simulation misses "
        missed = missed_when_played(motion, [part for part in goal if not part.at_rest], rest, u)
    return f"{end}{' and '.join(missed)}" if missed else ""


def _stayed(plan: MotionPlan, model: Prediction, last: Array) -> Array:
    """State (nx) some time after the end, under the last input."""
    u = np.tile(plan.u[-1], (2, 1))
    path = Path(np.zeros((2, 0)), u, _STAYS * plan.scene.finger.rod.natural_time)
    states = simulated(plan.scene, model, path, last, 1)
    return np.asarray(states[-1])


def _not_reproduced(plan: MotionPlan, model: Prediction, states: Array, deviation: Deviation) -> str:
    """Why a plan in the inputs alone is none on the finely integrated model; empty where it is one."""
    scene = plan.scene
    tolerance = plan.scene.check.tolerance * plan.length
    if scene.transcription != "single_shooting":
        return ""
    if deviation.tip > tolerance:
        return f"no plan: a fine simulation of its inputs is up to {1e3 * deviation.tip:.3g} mm off"
    if scene.goal.end != "held" or not any("friction_" in name for name in model.x_names):
        return ""
    # Rest may be asked of the drives alone, and friction may let go: the finger has to stay.
    after = np.stack([states[-1], _stayed(plan, model, states[-1])])
    first, last = places(model, after, np.tile(plan.u[-1], (2, 1)))[:, 0]
    drift = float(np.hypot(*(last - first)))
    return f"no plan: the tip moves on by {1e3 * drift:.3g} mm after its end" if drift > tolerance else ""


def _left(motion: PlannedMotion, states: Array) -> str:
    """The hard bound that states leave most, and by how much; empty where they leave none."""
    hard = excess_over_intervals(motion, states)[:, motion.bounded.hard]
    if hard.max(initial=0.0) <= LEFT:
        return ""
    name = np.array(motion.bounded.names)[motion.bounded.hard][int(hard.max(axis=0).argmax())]
    return f"{name} is left by {100 * hard.max():.2g} % of its limit (of zones: of the finger's length)"


def _left_after_the_end(motion: PlannedMotion, plan: MotionPlan, last: Array) -> str:
    """The hard bound that a finger, which need not stay where it ends, leaves most under its last input."""
    scene = plan.scene
    if scene.goal.end == "held" or scene.load_varies:
        return ""
    interval = plan.duration / (len(plan.t) - 1)
    after = scene.finger.rod.slow_time
    u = np.tile(plan.u[-1], (math.ceil(after / interval) + 1, 1))
    path = Path(np.zeros((len(u), 0)), u, (len(u) - 1) * interval)
    try:
        left = _left(motion, simulated(scene, motion.prediction, path, last))
    except NumericalError:
        return ""
    keeps = f"end: {scene.goal.end} keeps bounds up to the end alone, end: held stays there"
    return left and f"within {after:.2g} s after the end, under its last input, {left}: {keeps}"


def _deviation(name: str, model: Prediction, plan: MotionPlan, planned: Array, states: Array) -> Deviation:
    at_nodes = states[:: (len(states) - 1) // (len(plan.t) - 1)]
    p = np.array(model.p_nominal)
    off = distances(places(model, at_nodes, plan.u), planned)
    rates = np.array(model.bending_rate(states[-1], plan.u[-1], p)).ravel()
    force = np.array(model.contact_force(states[-1], plan.u[-1], p)).ravel() if model.contact_names else ()
    tip, body = off.max(axis=0).tolist()
    final_tip, final_body = off[-1].tolist()
    return Deviation(name, tip, final_tip, float(np.abs(rates).max()), tuple(map(float, force)), body, final_body)


def _on_finer(scene: PlanScene, plan: MotionPlan, planned: Array, path: Path) -> tuple[Deviation | None, str]:
    """Deviation on the finer model, and how it departs from the plan; empty where it does not."""
    law = scene.check.contact_law or scene.contact_law
    # Not validated again: this law may have dry friction, which plans themselves cannot have.
    fine = scene.model_copy(update={"fidelity": scene.check.finer, "contact_law": law})
    model = Prediction(fine)
    name = f"{len(model.system.finger_model.lengths)} elements ({model.system.finger_model.family})"
    try:
        states = simulated(fine, model, path, first_state_of_plan(fine, model)[0], 1)
    except NumericalError as error:
        return None, f"on {name} {error}"
    deviation = _deviation(name, model, plan, planned, states)
    ends = {"tip": deviation.final_tip, "object": deviation.final_object}
    far = [f"the {what} ends {1e3 * off:.3g} mm" for what, off in ends.items() if off > _FINER_OFF * plan.length]
    return deviation, f"on {name} {' and '.join(far)} from the plan" if far else ""
