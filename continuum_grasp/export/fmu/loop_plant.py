"""The plant of a closed loop: finger, drives, surroundings and late sensors, as ``run_closed_loop`` has them.

Its C is CasADi's, from the same expressions as in Python, with the mathematical library of the machine: it agrees to
rounding, not to the last bit.
"""

from __future__ import annotations

import hashlib
import math

import casadi as ca

from continuum_grasp.closed_loop.plant import Sensors, choose_method
from continuum_grasp.closed_loop.plant_model import PlantModel
from continuum_grasp.control.prediction import Prediction
from continuum_grasp.core.integrators import step_function
from continuum_grasp.export.casadi_source import generated_c
from continuum_grasp.export.fmu.variable import TIP, Unit, contact_variables, count, labeled
from continuum_grasp.export.part import Code
from continuum_grasp.export.parts.seen import by_component
from continuum_grasp.export.source import names_of
from continuum_grasp.export.template import fill
from continuum_grasp.scene.consumer import LEAST_COMMANDS, LIMITS_OF_BENDING, Consumer
from continuum_grasp.scene.control import ControlScene

_CODES = (Code.OK, Code.ERR_NON_FINITE, Code.ERR_RANGE, Code.ERR_RESULT)
_START = "an input, which begins with what the scene has at time zero"
_UNIT = Consumer(
    "export-fmu",
    refused={"plant.guides": "a plant with guides decides its contacts in Python: leave them out"},
    unneeded={
        **LIMITS_OF_BENDING,
        **{f"actuation.tensions.{key}": _START for key in ("times", "interpolation")},
        **dict.fromkeys(("loads.force.times", "reference", "plant.seed"), _START),
        **dict.fromkeys(("time.space_error", "time.method", "time.tolerance"), "of simulate"),
        **LEAST_COMMANDS,
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
        "shown": model.function("shown", seen=ca.vertcat(ca.vec(position), angle, *by_component(model.touch).values()))(
            x, u, w
        ),
        "measured": sensors.value(x, u, w),
    }
    named = [
        ca.Function(f"{identifier}_{name}", [x, u, w, p], [value], list("xuwp"), ["to"])
        for name, value in values.items()
    ]
    source, header = generated_c(f"{identifier}_plant", named)
    seen = (*TIP, *contact_variables(model.system.touch_names))
    return Unit(
        identifier=identifier,
        title=names_of(scene)[0],
        what="the plant of its closed loop",
        step=step,
        stop=scene.duration or 1.0,
        groups={
            "FMU_INPUTS": labeled("command", "input", model.u_names, rest),
            "FMU_FORCES": labeled("forces", "input", model.w_names, model.forces(0.0)[0]),
            "FMU_PARAMETERS": (),
            "FMU_NOISE": labeled("noise", "input", measured if noisy else ()),
            "FMU_STATE": labeled("state", "state", model.x_names, model.start),
            "FMU_TIP": seen,
            "FMU_MEASUREMENT": labeled("measurement", "output", measured),
        },
        counts=(count("code", "of the last step: 0 done, below what was refused"),),
        continuous=True,
        linear=False,
        feedthrough=any(named[1].jac_sparsity(0, k).nnz() for k in (1, 2)),
        glue=("loop_plant_types.c", "loop_plant.c"),
        words={
            "model": model,
            "shown": len(seen),
            "given": max(4, *(f.sz_arg() for f in named)),
            "found": max(1, *(f.sz_res() for f in named)),
            "work": max(1, *(f.sz_w() for f in named)),
            "whole_work": max(1, *(f.sz_iw() for f in named)),
            "past": whole + 2,
            "part": repr(late - whole if abs(late - round(late)) >= 1e-6 else 0.0),
            "ny": len(measured),
            "rest": ", ".join(repr(float(each)) for each in rest),
            "noisy": noisy,
        },
        sources={
            f"{identifier}.h": fill("fmu/plant.h", {"p": identifier, "codes": _CODES}),
            f"{identifier}_plant.h": header,
            f"{identifier}_plant.c": source,
        },
        flags=("-std=c99",),
        manifest={
            "configuration_hash": hashlib.sha256(source.encode()).hexdigest()[:16],
            "integrator": method.name,
            "configuration": scene.model_dump(mode="json"),
        },
    )
