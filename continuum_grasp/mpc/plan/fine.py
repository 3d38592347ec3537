"""How a plan fares in a fine simulation, and on a finer model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.errors import NumericalError
from continuum_grasp.mpc.plan.check import Deviation, Player
from continuum_grasp.mpc.plan.control import control_scene, parameters_over_time
from continuum_grasp.mpc.plan.initial import first_state_of_plan
from continuum_grasp.mpc.plan.problem import PlanProblem
from continuum_grasp.mpc.plan.result import Plan
from continuum_grasp.mpc.prediction import Prediction
from continuum_grasp.mpc.stiffness import fastest_rate
from continuum_grasp.scene.plan import PlanScene

__all__ = ["checked"]

Array = NDArray[np.float64]

_KEPT = 4
"""Parts of an interval at which bounds are looked at."""
_OUTSIDE = 1e-3
"""Share of a bound, or of the finger's length, from which on there is a warning."""


def checked(plan: Plan, problem: PlanProblem) -> Plan:
    """The same plan with what a fine simulation of its inputs says."""
    scene = plan.scene
    model = problem.motion.prediction
    warnings = list(plan.warnings)
    x0 = plan.x[0]
    try:
        states = _played(scene, model, plan, x0, _KEPT)
    except NumericalError as error:
        return replace(plan, warnings=(*warnings, f"{error}: take more intervals or sub-steps, or collocation"))
    text, worst = _outside(problem, states)
    found = _deviation("the plan's model, finely integrated", model, plan, states, text)
    most = scene.check.tolerance * plan.length
    if found.tip > most:
        warnings.append(
            f"a fine simulation is up to {1e3 * found.tip:.3g} mm off the plan ({1e3 * found.final_tip:.3g} mm at the "
            "end): take more intervals, or more solver.substeps"
        )
    if worst > _OUTSIDE:
        warnings.append(f"between the nodes {text}: take more intervals")
    finer = None
    if scene.check.finer is not None:
        finer, told = _on_finer(scene, plan)
        warnings += told
    return replace(plan, deviation=found, finer=finer, warnings=tuple(warnings))


def _played(scene: PlanScene, model: Prediction, plan: Plan, x0: Array, kept: int) -> Array:
    least, most = scene.input_limits
    rate = fastest_rate(model, np.full(len(plan.u[0]), least), np.full(len(plan.u[0]), most))
    times = np.linspace(0.0, plan.duration, 2 * (len(plan.t) - 1) * kept + 1) if scene.runs_in_time else [0.0]
    p = parameters_over_time(scene, model, times)
    return Player(model, rate).play(x0, plan.t, plan.u, p, linear=scene.input.form == "linear", kept=kept)


def _deviation(name: str, model: Prediction, plan: Plan, states: Array, bounds: str) -> Deviation:
    at_nodes = states[:: (len(states) - 1) // (len(plan.t) - 1)]
    p = np.array(model.p_nominal)
    tips = np.array([np.array(model.tip(x, u, p)).ravel() for x, u in zip(at_nodes, plan.u, strict=True)])
    off = np.hypot(*(tips - plan.tip).T)
    rates = np.array(model.bending_rate(states[-1], plan.u[-1], p)).ravel()
    return Deviation(name, float(off.max()), float(off[-1]), float(np.abs(rates).max()), bounds)


def _outside(problem: PlanProblem, states: Array) -> tuple[str, float]:
    """The state bound that is left most between the nodes, and its share."""
    stages, model = problem.motion.stages, problem.motion.prediction
    if not stages.ns:
        return "", 0.0
    u = np.zeros(model.nu)
    rows = np.array([np.array(stages.rows(x, u, model.p_nominal)).ravel()[: stages.ns] for x in states[_KEPT:]])
    excess = np.maximum(stages.c_min[: stages.ns] - rows, rows - stages.c_max[: stages.ns]).max(axis=0)
    k = int(excess.argmax())
    if excess[k] <= 1e-6:
        return "", 0.0
    return f"{stages.c_names[k]} is left by {100 * excess[k]:.2g} % of its scale", float(excess[k])


def _on_finer(scene: PlanScene, plan: Plan) -> tuple[Deviation | None, list[str]]:
    """The same on a finer model."""
    if scene.check.finer is None:
        return None, []
    fine = scene.model_copy(update={"fidelity": scene.check.finer})
    model = Prediction(control_scene(fine))
    elements = len(model.system.finger_model.lengths)
    name = f"{elements} elements ({model.system.finger_model.family})"
    try:
        states = _played(fine, model, plan, first_state_of_plan(fine, model)[0], 1)
    except NumericalError as error:
        return None, [f"on {name} {error}"]
    found = _deviation(name, model, plan, states, "")
    if found.final_tip <= 0.01 * plan.length:
        return found, []
    return found, [f"on {name} the tip ends {1e3 * found.final_tip:.3g} mm from the plan: raise fidelity.elements"]
