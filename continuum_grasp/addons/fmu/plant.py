"""Plants as units: the finger of a simulated scene, as the steps of its C package move it, and the plant of a closed
loop: finger, drives, surroundings and late sensors, as ``run_closed_loop`` has them.

The C of the latter is CasADi's, from the same expressions as in Python, with the mathematical library of the machine:
it agrees to rounding, not to the last bit.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np

from continuum_grasp.addons.fmu.variable import TIP, Kind, UnitContents, count, variables_of
from continuum_grasp.closed_loop import PlantModel, Sensors
from continuum_grasp.control import Prediction
from continuum_grasp.core import CSource, step_function
from continuum_grasp.export import (
    Code,
    ContactFields,
    Field,
    Kernel,
    Library,
    fill,
    title_of,
)
from continuum_grasp.scene import Consumer, ControlScene, Scene
from continuum_grasp.simulation import Signals, bends_of, initial_state

_CODES = (Code.OK, Code.ERR_NON_FINITE, Code.ERR_RANGE, Code.ERR_RESULT)
_START = "an input, which begins with what the scene has at time zero"
_UNIT = Consumer(
    "export to fmu",
    refused={
        "plant.guides": "a plant with guides decides its contacts in Python: leave them out",
        "plant.mounting": "a unit counts as the model does: leave it out",
    },
    unneeded={
        **Consumer.LIMITS_OF_BENDING,
        **{f"actuation.tensions.{key}": _START for key in ("times", "interpolation")},
        **dict.fromkeys(("loads.force.times", "reference", "plant.seed", "support_motion"), _START),
        **dict.fromkeys(("time.space_error", "time.method", "time.tolerance"), "of simulate"),
        **Consumer.LEAST_COMMANDS,
        "log": "of logs of a bench",
        "controller.deadline": "the caller has the clock, and says whether the last command was late",
    },
)


def loop_plant_unit(scene: ControlScene, identifier: str) -> UnitContents:
    """The plant of a closed loop, with the integrator and the sub-steps that a run of the scene takes."""
    _UNIT.check(scene)
    prediction = Prediction(scene)
    model = _covering(scene, prediction)
    period = scene.controller.step
    method = model.method_for(period)
    sensors = Sensors(scene, model, prediction, None)
    step = period / method.substeps
    named = _functions(model, sensors, method.name, step, identifier)
    source, header = _generated(f"{identifier}_plant", named)
    contacts = ContactFields(model.system.touch_names)
    seen = (*TIP, *variables_of("contact", "output", contacts.by_name()))
    noisy = scene.estimator is not None
    sensed = Field.named(sensors.names)
    return UnitContents(
        identifier=identifier,
        title=title_of(scene),
        what="the plant of its closed loop",
        step=step,
        any_step=False,
        stop=scene.duration or 1.0,
        groups={
            "FMU_INPUTS": variables_of("command", "input", Field.named(model.u_names), model.rest_input),
            "FMU_FORCES": variables_of("forces", "input", Field.named(model.w_names), model.forces(0.0)[0]),
            "FMU_PARAMETERS": (),
            "FMU_NOISE": variables_of("noise", "input", sensed if noisy else ()),
            "FMU_STATE": variables_of("state", "state", Field.named(model.x_names), model.start),
            "FMU_TIP": seen,
            "FMU_MEASUREMENT": variables_of("measurement", "output", sensed),
        },
        counts=(count("code", "of the last step: 0 done, below what was refused"),),
        continuous=True,
        linear=False,
        feedthrough=any(named[1].jac_sparsity(0, k).nnz() for k in (1, 2)),
        glue=("loop_plant_types.c", "loop_plant.c"),
        words={"model": model, "shown": len(seen), "noisy": noisy, **_words(model, sensors, step, named)},
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


def _covering(scene: ControlScene, prediction: Prediction) -> PlantModel:
    """Return the plant with elements that cover its shapes at rest, and the curvatures that its controller covers."""
    model = PlantModel(scene)
    plant, predicted = model.system.finger_model, prediction.system.finger_model
    curvature = max(reach / length for reach, length in zip(predicted.ranges, predicted.lengths, strict=True))
    bends = np.maximum(bends_of(model.scene, plant), curvature * np.array(plant.lengths))
    covers = plant.reaching(bends).ranges == plant.ranges
    return model if covers else PlantModel(scene, reached=bends.tolist())


def _functions(model: PlantModel, sensors: Sensors, method: str, step: float, identifier: str) -> list[ca.Function]:
    """A step of the plant, its shown values, and its measurements, each of state, input, forces, and nothing."""
    position, angle = model.sections((model.scene.finger.rod.length,))
    x, u, w, p = (ca.MX.sym(name, size) for name, size in (("x", model.nx), ("u", model.nu), ("w", model.nw), ("p", 0)))
    seen = ca.vertcat(ca.vec(position), angle, *ContactFields.components(model.touch).values())
    values = {
        "plant_step": step_function(model, method)(x, u, u, u, w, w, w, ca.DM(model.p), step),
        "shown": model.function("shown", seen=seen)(x, u, w),
        "measured": sensors.value(x, u, w),
    }
    return [
        ca.Function(f"{identifier}_{name}", [x, u, w, p], [value], list("xuwp"), ["to"])
        for name, value in values.items()
    ]


def _words(model: PlantModel, sensors: Sensors, step: float, named: Sequence[ca.Function]) -> dict[str, object]:
    """Words of the template: work space of the functions, and by how many steps sensors are late."""
    late = sensors.delay / step
    whole = round(late) if abs(late - round(late)) < 1e-6 else math.floor(late)
    return {
        "given": max(4, *(f.sz_arg() for f in named)),
        "found": max(1, *(f.sz_res() for f in named)),
        "work": max(1, *(f.sz_w() for f in named)),
        "whole_work": max(1, *(f.sz_iw() for f in named)),
        "past": whole + 2,
        "part": repr(late - whole if abs(late - round(late)) >= 1e-6 else 0.0),
        "ny": len(sensors.names),
        "rest": ", ".join(repr(float(each)) for each in model.rest_input),
    }


def _generated(name: str, functions: Sequence[ca.Function]) -> tuple[str, str]:
    """CasADi's C of functions, and its header; InputError where one is too large, OSError where the disk is full."""
    for function in functions:
        for part in (function, *function.find_functions()):
            # 100_000: instructions of one function of a plant, without loops: the 80,000 of configs/mpc/spirob.yaml
            # take 31 s and 0.8 GB to compile, once
            Kernel.check_size(part.name(), part.n_instructions() if part.is_a("SXFunction") else 0, 100_000)
    return CSource(functions).with_header(name)


def finger_unit(
    scene: Scene,
    identifier: str,
    *,
    step: float | None,
    substeps: int | None,
    ranges: Mapping[str, Sequence[float]] | None,
) -> UnitContents:
    """The finger of a scene, with its object where it has one."""
    library = Library.of(
        scene,
        what=["dynamics", "step", "kinematics"],
        if_possible=["linearization", "contact"],
        prefix=identifier,
        ranges=ranges,
        step=step,
        substeps=substeps,
    )
    subject, structs, manifest = library.subject, library.structs, library.manifest
    model, moving = subject.model, subject.moving
    touching = [] if subject.touching is None else subject.touching.touch_names
    linear = "linearization" in library.parts
    internal = subject.longest or manifest["steps"]["step"]["accurate_s"]
    # Of a model that takes the tip moment to be constant, the input is a number that is given once.
    acts: Kind = "fixed" if model.structure.moment_is_constant else "input"
    signals = Signals(scene, model, nw=moving.nw)
    state = np.asarray(initial_state(scene, moving), dtype=float)
    parameters = list(manifest["nominal_parameters"].values())
    rates = [replace(field, text=f"rate of state.{field.name}") for field in structs["rate"]]
    groups = {
        "FMU_INPUTS": variables_of("input", acts, structs["input"], signals.u(0.0)[0][: model.nu]),
        "FMU_FORCES": variables_of("forces", "input", structs.get("forces", ()), signals.w(0.0)[0]),
        "FMU_PARAMETERS": variables_of("parameters", "tunable", structs.get("parameters", ()), parameters),
        "FMU_STATE": variables_of("state", "state", structs["state"], state),
        "FMU_TIP": TIP,
        **({"FMU_CONTACTS": variables_of("contact", "output", ContactFields(touching).by_name())} if touching else {}),
        "FMU_RATES": variables_of("rate", "rate", rates if linear else ()),
    }
    words: dict[str, Any] = {"forces": bool(groups["FMU_FORCES"]), "parameters": bool(parameters)}
    words |= {"acting": ", &forces" if words["forces"] else "", "contacts": bool(touching)}
    words["touched"] = ", &forces" if "forces" in manifest["functions"].get("touch", {}).get("inputs", ()) else ""
    return UnitContents(
        identifier=identifier,
        title=library.title,
        what="a planar continuum finger" + " with the object that it touches" * (subject.touching is not None),
        step=internal,
        any_step=True,
        stop=scene.time.duration if scene.time is not None else 1.0,
        groups=groups,
        counts=(count("code", "of the last step: 0 done, above a warning, below what was refused"),),
        continuous=True,
        linear=linear,
        feedthrough=model.tip.jac_sparsity(0, model.tip.index_in("u")).nnz() > 0,
        glue=("plant_types.c", "plant.c", *(["plant_linear.c"] if linear else [])),
        words=words,
        sources=library.sources,
        flags=tuple(library.flags()),
        manifest=manifest,
    )
