"""The plant of a closed loop: finger, drives, surroundings and late sensors, as ``run_closed_loop`` has them."""

from __future__ import annotations

import math

import casadi as ca

from continuum_grasp.closed_loop.plant import Sensors, choose_method
from continuum_grasp.closed_loop.plant_model import PlantModel
from continuum_grasp.control.prediction import Prediction
from continuum_grasp.core.integrators import step_function
from continuum_grasp.export.fmu.moved import labeled, moved_unit, shown
from continuum_grasp.export.fmu.variable import Group, Unit
from continuum_grasp.export.source import names_of
from continuum_grasp.scene.consumer import LIMITS_OF_BENDING, Consumer
from continuum_grasp.scene.control import ControlScene

_START = "an input, which begins with what the scene has at time zero"
_UNIT = Consumer(
    "export-fmu",
    refused={"plant.guides": "a plant with guides decides its contacts in Python: leave them out"},
    unneeded={
        **LIMITS_OF_BENDING,
        **{f"actuation.tensions.{key}": _START for key in ("times", "interpolation")},
        **dict.fromkeys(("loads.force.times", "reference", "plant.seed"), _START),
        "time.space_error": "of simulate",
        "finger.tendons.min_tension": "a limit of commands: tensions from zero on are taken",
        "controller.deadline": "the caller has the clock, and says whether the last command was late",
    },
)


def loop_plant_unit(scene: ControlScene, identifier: str) -> Unit:
    """The plant of a closed loop, with the integrator and the sub-steps that a run of the scene takes."""
    _UNIT.check(scene)
    model, period = PlantModel(scene), scene.controller.step
    method = choose_method(model, period)
    sensors = Sensors(scene, model, Prediction(scene), None)
    step = period / method.substeps
    late = sensors.delay / step
    whole = round(late) if abs(late - round(late)) < 1e-6 else math.floor(late)
    noisy, rest, measured = scene.estimator is not None, model.rest_input, sensors.names
    position, angle = model.sections((scene.finger.rod.length,))
    x, u, w, p = (ca.MX.sym(name, size) for name, size in (("x", model.nx), ("u", model.nu), ("w", model.nw), ("p", 0)))
    ahead = step_function(model, method.name)(x, u, u, u, w, w, w, ca.DM(model.p), step)
    values = {
        "plant_step": ahead,
        "shown": model.function("shown", seen=shown(position, angle, model.touch))(x, u, w),
        "measured": sensors.value(x, u, w),
    }
    command = labeled("command", "input", model.u_names, rest)
    return moved_unit(
        identifier=identifier,
        title=names_of(scene)[0],
        what="the plant of its closed loop",
        step=step,
        stop=scene.duration or 1.0,
        functions={name: ca.Function(name, [x, u, w, p], [value]) for name, value in values.items()},
        groups=(
            Group("FMU_INPUTS", command.variables),
            labeled("forces", "input", model.w_names, model.forces(0.0)[0]),
            Group("FMU_PARAMETERS", ()),
            labeled("noise", "input", measured if noisy else (), [0.0] * (len(measured) if noisy else 0)),
            labeled("state", "state", model.x_names, model.start),
        ),
        touching=model.system.touch_names,
        results=(labeled("measurement", "output", measured, [0.0] * len(measured)),),
        words={
            "substeps": 1,
            "past": whole + 2,
            "part": repr(late - whole if abs(late - round(late)) >= 1e-6 else 0.0),
            "ny": len(measured),
            "rest": ", ".join(repr(float(each)) for each in rest),
            "noise": " + values[FMU_NOISE + k]" if noisy else "",
        },
        manifest={"integrator": method.name, "configuration": scene.model_dump(mode="json")},
    )
