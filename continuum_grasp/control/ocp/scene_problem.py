"""The optimal control problem of a scene: its model, cost, bounds and horizon as a ``ControlProblem``."""

from __future__ import annotations

import math
from dataclasses import replace

import casadi as ca
import numpy as np

from continuum_grasp.base import Array, check_arguments
from continuum_grasp.control.ocp.bounds import HARD, Row, state_bounds
from continuum_grasp.control.ocp.control_problem import ControlProblem
from continuum_grasp.control.ocp.cost_terms import Outputs
from continuum_grasp.control.ocp.stages import Scenarios, Stages
from continuum_grasp.control.prediction import Prediction
from continuum_grasp.scene import INTEGRATORS, ControlScene

_TARGET = 1.5
"""Product of substep and fastest rate [1]: RK4 is stable up to 2.6 to 2.8, and the rate belongs to sampled shapes
only."""
_EXPLICIT_UP_TO = 4
"""Greatest number of RK4 steps per stage [1]: an implicit step evaluates the slope as often, but is of order 2. In
modes that it does not resolve, its error is a tenth or more, and without other damping in the loop, commands
oscillate."""
_IMPLICIT_STAGE = 0.29
"""Length of the stages of sdirk2, as a share of the step [1]."""
_APPROACH = 1.0 / 60.0
"""Finger lengths per control period at which surfaces meet [1]: 0.3 m/s in configs/mission/mug.yaml, whose setpoints
end 3 mm before the touch, with what a plan of a few iterations overshoots. Of its plants with contacts of 20 kN/m 5 of
20 held the mug with one step of 10 ms, 16 with what follows from this."""


@check_arguments
def stages_of(scene: ControlScene, prediction: Prediction | None = None) -> Stages:
    """Transcribe the problem of a scene into functions of a stage.

    Parameters
    ----------
    scene : ControlScene
        The scene.
    prediction : Prediction, optional
        Its model, if it exists already.

    Returns
    -------
    Stages

    Raises
    ------
    InputError
        If the pieces do not fit together.

    Examples
    --------
    >>> import continuum_grasp as cg
    >>> from continuum_grasp.control import stages_of
    >>> stages = stages_of(cg.load("configs/mpc/steady_tip.yaml"))
    >>> stages.nx, stages.nu, stages.r_names[:2]
    (8, 2, ('tip_x [m]', 'tip_y [m]'))
    """
    model = Prediction(scene) if prediction is None else prediction
    touches = scene.object is not None
    return replace(problem_of(scene, model).stages, scenarios=scenarios_of(scene, model), checks_gaps=touches)


def scenarios_of(scene: ControlScene, model: Prediction) -> Scenarios | None:
    """Scale and shift the parameters of a scene's model by what each scenario differs in; None without scenarios."""
    asked = scene.controller.scenarios
    if not asked:
        return None
    weights = np.array([scenario.weight for scenario in asked])
    scale, shift = np.ones((len(asked), model.np)), np.zeros((len(asked), model.np))
    names = [name.split(" ")[0] for name in model.p_names]
    for k, scenario in enumerate(asked):
        for key, value in scenario.changes.items():
            at = [names.index(name) for name in scene.scenario_parameters(key)]
            if key == "tip_mass":
                shift[k, at] = value
            elif key in ("stiffness", "damping"):
                # Quantities that are known or estimated at run time.
                scale[k, at] = value
            else:
                scale[k, at], shift[k, at] = 0.0, value
    return Scenarios(weights * (len(asked) / weights.sum()), scale, shift)


def problem_of(scene: ControlScene, model: Prediction) -> ControlProblem:
    """Write the problem of a scene, whose model exists already, as one of any model."""
    horizon, limits, cost = scene.controller.horizon, scene.controller.input, scene.controller.cost
    outputs = Outputs.of(cost, model)
    # The input before is needed where its change has a weight or a limit, and where what is tracked follows the input
    # at once: at the end it is the one before.
    remembers = limits.rate_max is not None or bool(cost.input_rate)
    remembers = remembers or ca.depends_on(outputs.value()[: outputs.of_state], model.u)
    held = ca.vertcat(*[ca.SX.sym(f"held_{name}") for name in model.u_names if remembers])
    # Over a stage, which is how long the plan holds an input; a command that is held shorter is limited in the C.
    change = (model.u - held) / horizon.stage if remembers else None
    rows = {" ".join(row.names): row for row in state_bounds(scene.controller.bounds, model)}
    if limits.rate_max is not None and change is not None:
        # As soft rows with the penalties of hard constraints: the QP stays feasible from any input before.
        names = tuple(f"{name.split(' ')[0]}_rate" for name in model.u_names)
        rows["rate"] = Row(change / limits.rate_max, -1.0, 1.0, HARD, names)
    # A servo that saturates moves within milliseconds, which a stage does not resolve: plans do without.
    torque = model.servo_torques
    if torque.numel():
        names = tuple(f"torque_{k + 1}" for k in range(torque.numel()))
        rows["torque"] = Row(torque, -1.0, 1.0, HARD, names)
    least, greatest = (np.array(limit) for limit in scene.input_limits)
    plants = scenarios_of(scene, model)
    nominal = np.array(model.p_nominal)
    parameters = [nominal] if plants is None else list(plants.scale * nominal + plants.shift)
    method, substeps = _integration(scene, model, least, greatest, parameters)
    return ControlProblem(
        states=model.x,
        inputs=model.u,
        parameters=model.p,
        previous=held,
        dynamics=model.dynamics(model.x, model.u, model.p),
        cost=outputs.residuals(change),
        rows=rows,
        bounds={name.split(" ")[0]: pair for name, *pair in zip(model.u_names, least, greatest, strict=True)},
        nominal={name.split(" ")[0]: value for name, value in zip(model.p_names, model.p_nominal, strict=True)},
        stages=horizon.stages,
        stage=horizon.stage,
        method=method,
        substeps=substeps,
        name=scene.name or "",
    )


def _integration(
    scene: ControlScene, model: Prediction, u_min: Array, u_max: Array, parameters: list[Array]
) -> tuple[str, int]:
    """Choose method and steps per stage; where the scene has ``auto`` from the stiffness, the greatest of all
    parameters (np). Rounding adds no step.
    """
    asked = scene.controller
    horizon = scene.controller.horizon
    # One implicit step per control period, which the user considers short compared with the finger's motion.
    per_stage = math.ceil(horizon.stage / asked.step - 1e-9)
    # Longest implicit step that is short enough for the closing of a contact, from touching to a firm press.
    longest = math.inf
    touch_law = model.system.touch_law
    if touch_law is not None:
        approach = _APPROACH * touch_law.rod.length / asked.step
        pressed = touch_law.rounding + model.system.greatest_press / touch_law.law.stiffness
        longest = pressed / (_IMPLICIT_STAGE * approach)
    closes_within = horizon.stage / per_stage > longest
    implicit = math.ceil(horizon.stage / longest) if closes_within else per_stage
    if horizon.method.startswith("sdirk2"):
        return horizon.method, horizon.substeps or implicit
    stiff = "sdirk2_contact" if closes_within else "sdirk2"
    if horizon.method == "rk4" and horizon.substeps is not None:
        return "rk4", horizon.substeps
    rate = horizon.stage * max(model.fastest_rate(u_min, u_max, p) for p in parameters)
    if horizon.substeps is not None:
        is_stable = rate / horizon.substeps <= (INTEGRATORS["rk4"].stable or 0.0)
        return "rk4" if is_stable else stiff, horizon.substeps
    wanted = max(1, math.ceil(rate / _TARGET))
    if horizon.method == "rk4" or wanted <= _EXPLICIT_UP_TO:
        return "rk4", wanted
    return stiff, implicit
