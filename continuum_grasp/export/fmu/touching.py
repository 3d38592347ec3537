"""A finger of a simulated scene with the object that it touches, as ``simulate`` moves them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import casadi as ca

from continuum_grasp.core.integrators import step_function
from continuum_grasp.errors import InputError
from continuum_grasp.export.fmu.moved import labeled, moved_unit, shown
from continuum_grasp.export.fmu.variable import Group, Kind, Unit, variables_of
from continuum_grasp.export.manifest import entry
from continuum_grasp.export.ranges import JointRange, input_fields, parameter_fields
from continuum_grasp.export.source import names_of
from continuum_grasp.model import System
from continuum_grasp.model.equations import Equations
from continuum_grasp.scene.integrators import INTEGRATORS
from continuum_grasp.scene.simulate import Scene
from continuum_grasp.simulation.initial import initial_state
from continuum_grasp.simulation.signals import Signals
from continuum_grasp.simulation.simulate import simulate


def touching_unit(
    scene: Scene,
    identifier: str,
    *,
    step: float | None,
    substeps: int | None,
    ranges: Mapping[str, Sequence[float]] | None,
) -> Unit:
    """Finger and object of a scene, with the method and the sub-steps that its simulation takes.

    The scene is simulated once for them: contacts ask for short steps that only the motion shows.
    """
    if (time := scene.time) is None:
        raise InputError("steps with contacts follow from a simulation: expected time: {duration, step}", key="time")
    if step is not None:
        time = time.replaced(step=step, duration=max(1, round(time.duration / step)) * step)
    if time.method not in INTEGRATORS:
        time = time.replaced(method="auto")
    scene = scene.replaced(time=time)
    system = System(scene)
    model, used = system.finger_model, simulate(scene).statistics
    method, least = used["method"], used["substeps"]
    if substeps is not None and substeps < least and INTEGRATORS[method].stable is not None:
        raise InputError(f"steps of {time.step:g} s need {least} sub-steps of {method}", key="substeps")
    # Inputs of a unit may jump at any step: each takes as many as the first one of the simulation.
    count = used["start_substeps"] if substeps is None else substeps
    x, u, w, p = (ca.MX.sym(name, getattr(system, f"n{name}")) for name in "xuwp")
    r, angle = system.sections((scene.finger.rod.length,))(x, u, p)
    names = system.touch.name_out()
    touch = dict(zip(names, system.touch(x, u, w, p), strict=True))
    ahead: ca.MX = step_function(system, method)(x, u, u, u, w, w, w, p, time.step / count)
    signals = Signals(scene, model, nw=system.nw)
    inputs = JointRange.of(model, Equations(model.structure)).bounded(input_fields(model))
    own = [entry(field) for field in parameter_fields(model, ranges or {})]
    acts: Kind = "fixed" if model.structure.moment_is_constant else "input"
    start = signals.u(0.0)[0]
    return moved_unit(
        identifier=identifier,
        title=names_of(scene)[0],
        what="a planar continuum finger with the object that it touches",
        step=time.step,
        stop=time.duration,
        functions={
            name: ca.Function(name, [x, u, w, p], [value])
            for name, value in {"plant_step": ahead, "shown": shown(r, angle, touch)}.items()
        },
        groups=(
            Group("FMU_INPUTS", variables_of("input", acts, [entry(field) for field in inputs], start)),
            labeled("forces", "input", system.w_names, signals.w(0.0)[0]),
            Group("FMU_PARAMETERS", variables_of("parameters", "tunable", own, system.p_nominal)),
            labeled("state", "state", system.x_names, initial_state(scene, system)),
        ),
        touching=system.touch_names,
        words={"substeps": count},
        manifest={"integrator": method, "substeps": count, "configuration": scene.model_dump(mode="json")},
    )
