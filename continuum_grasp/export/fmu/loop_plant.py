"""The plant of a closed loop: finger, drives, surroundings and late sensors, as ``run_closed_loop`` has them.

Its C is CasADi's, from the same expressions as in Python, with the mathematical library of the machine: it agrees to
rounding, not to the last bit.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence

import casadi as ca
import numpy as np

from continuum_grasp.closed_loop.plant import Method, Sensors, choose_method
from continuum_grasp.closed_loop.plant_model import PlantModel
from continuum_grasp.control.prediction import Prediction
from continuum_grasp.core.integrators import step_function
from continuum_grasp.export.casadi_source import generated_c
from continuum_grasp.export.control.loop import identifiers, unit_of
from continuum_grasp.export.fmu.finger import tip_variables
from continuum_grasp.export.fmu.variable import Count, Group, Unit, Variable
from continuum_grasp.export.part import Code
from continuum_grasp.export.source import names_of
from continuum_grasp.export.template import fill
from continuum_grasp.scene.consumer import Consumer
from continuum_grasp.scene.control import ControlScene

_CODES = (Code.OK, Code.ERR_NON_FINITE, Code.ERR_RESULT)


_UNIT = Consumer(
    "export-fmu", refused={"plant.guides": "a plant with guides decides its contacts in Python: leave them out"}
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
    functions = _functions(model, method, sensors, identifier, step)
    source, header = generated_c(f"{identifier}_plant", functions)
    names = dict(zip("xuyw", (model.x_names, model.u_names, sensors.names, model.w_names), strict=True))
    noisy = scene.estimator is not None
    rest = model.rest_input
    groups = (
        Group("FMU_COMMAND", _variables("command", "input", names["u"], rest)),
        Group("FMU_FORCES", _variables("forces", "input", names["w"], model.forces(0.0)[0])),
        Group("FMU_NOISE", _variables("noise", "input", names["y"] if noisy else (), None)),
        Group("FMU_STATE", _variables("state", "state", names["x"], model.start)),
        Group("FMU_MEASUREMENT", _variables("measurement", "output", names["y"], None)),
        Group("FMU_TIP", tip_variables()),
    )
    words = {
        "past": whole + 2,
        "part": repr(late - whole if abs(late - round(late)) >= 1e-6 else 0.0),
        "nx": model.nx,
        "nu": model.nu,
        "ny": len(sensors.names),
        "nw": model.nw,
        "given": max(3, *(f.sz_arg() for f in functions)),
        "found": max(2, *(f.sz_res() for f in functions)),
        "work": max(1, *(f.sz_w() for f in functions)),
        "whole_work": max(1, *(f.sz_iw() for f in functions)),
        "rest": ", ".join(repr(float(u)) for u in rest),
        "forces": model.nw > 0,
        "noise": noisy,
    }
    texts = "".join(f'    case {identifier.upper()}_{c.name}: return "{c.text}";\n' for c in _CODES)
    codes = ", ".join(f"{identifier.upper()}_{c.name} = {int(c)}" for c in _CODES)
    small = fill("fmu/plant.h", {"p": identifier, "P": identifier.upper(), "codes": codes, "texts": texts})
    return Unit(
        identifier=identifier,
        title=names_of(scene)[0],
        what="the plant of its closed loop",
        step=step,
        stop=scene.duration or 1.0,
        groups=groups,
        counts=(Count("code", "of the last step: 0 done, below what was refused"),),
        continuous=True,
        linear=False,
        feedthrough=False,
        glue=("loop_plant_types.c", "loop_plant.c"),
        words=words,
        sources={
            f"{identifier}.h": small,
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


def _functions(model: PlantModel, method: Method, sensors: Sensors, identifier: str, step: float) -> list[ca.Function]:
    """(x, u, w) -> the state after a step; -> what is measured; -> x, y and angle of the tip."""
    advance = step_function(model, method.name)
    x, u, w = ca.MX.sym("x", model.nx), ca.MX.sym("u", model.nu), ca.MX.sym("w", model.nw)
    ahead = advance(x, u, u, u, w, w, w, ca.DM(model.p), step)
    length = model.scene.finger.rod.length
    position, angle = model.sections((length,))
    seen = model.function("tip", tip=ca.vertcat(ca.vec(position), angle))
    given = ["x", "u", "w"]
    return [
        ca.Function(f"{identifier}_plant_step", [x, u, w], [ahead], given, ["next"]),
        ca.Function(f"{identifier}_measured", [x, u, w], [sensors.value(x, u, w)], given, ["y"]),
        ca.Function(f"{identifier}_seen_tip", [x, u, w], [seen(x, u, w)], given, ["tip"]),
    ]


def _variables(group: str, kind: str, labels: Sequence[str], starts: np.ndarray | None) -> tuple[Variable, ...]:
    """Variables of labels ``name [unit]``."""
    values = np.zeros(len(labels)) if starts is None else starts
    return tuple(
        Variable(f"{group}.{name}", unit_of(label), "", kind, float(start))  # type: ignore[arg-type]
        for name, label, start in zip(identifiers(labels), labels, values, strict=True)
    )
