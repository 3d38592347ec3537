"""The model of an estimator: motion of states and disturbances, and their measurement."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca
import numpy as np

from continuum_grasp.base import Array, InputError
from continuum_grasp.control.estimation.adaptation import AdaptedState
from continuum_grasp.control.estimation.detection import check_detectable
from continuum_grasp.control.ocp.cost_terms import predicted
from continuum_grasp.control.prediction import Prediction
from continuum_grasp.core import call, differentiated_step, straight_function
from continuum_grasp.scene import INTEGRATORS, ControlScene, EstimatorSettings, Measured

_DRIFTING = 100.0
"""Number of control periods in which a disturbance drifts by its default standard deviation at the start [1]."""
_FORGETTING = 785.0
"""Default time for the return of variances of adapted parameters, in natural times of the finger [1]: 60 s for the hand
finger."""
_DISTURBANCES = (
    ("contact_force", r"(contact_\w+) \[N\]", r"unknown_\1 [N]"),
    ("tip_force", r"(tip_[xy]) \[N\]", r"unknown_\1 [N]"),
    ("contact_friction", r"(contact_friction_\w+) \[1\]", r"unknown_\1 [1]"),
    ("object_position", r"(object_[xy]) \[m\]", r"\1_error [m]"),
    ("tip_moment", r"missing_tip_moment \[N m\]", r"missing_tip_moment [N m]"),
    ("tip_offset", r"tip_offset \[m\]", r"tip_offset_error [m]"),
    ("bending_stiffness", r"bending_stiffness \[.+\]", r"bending_stiffness_error [1]"),
    ("tendon_friction", r"tendon_friction \[1\]", r"tendon_friction_error [1]"),
    ("tip_mass", r"tip_mass \[kg\]", r"tip_mass_error [kg]"),
    ("drive_time_constant", r"drive_time_constant \[s\]", r"drive_time_constant_error [1]"),
)
"""Key in ``estimator.disturbances`` or ``adapt``, the parameters that the disturbances add to, and their names."""


FRICTION = r"(motor_|unknown_contact_)?friction_\w+ \[1\]"
"""Names of friction states of tendons and motors, and of contact friction with no known property except its limit."""


@dataclass(frozen=True)
class Estimation:
    """The model of an estimator.

    Its state z = [x, d] has the nx continuous states of the prediction and the disturbances d: world forces [N] and tip
    moment [N m] in addition to those in p, and the relative error of the bending stiffness [1].

    Derivatives are by the variational equations, and functions of steps calls of straight-line functions.
    """

    step: ca.Function
    """(z, u, p, h) -> zn, F, G (nz, nz): one step of length h, its derivative by z, and the derivative of half the
    step.
    """
    flow: ca.Function
    """(z, u, p, h) -> zn: the step alone."""
    single: ca.Function | None
    """(z, u, p, h) -> zn, F: the step with its own derivative, of methods without a continuous extension, whose half
    step is a step of its own; vector lanes make both side by side."""
    outputs: ca.Function  # (z, u, p) -> y (ny), H (ny, nz): the compared quantities, and their derivative
    parameters: ca.Function  # (z, p) -> p (np): with the disturbances
    contact_forces: ca.Function | None
    """(z, u, p) -> f (C), H (C, nz): normal forces on the object [N] at parameters with the disturbances, and their
    derivative; None without an object."""
    nx: int
    z_names: tuple[str, ...]  # states, then disturbances, with their units; so are the others
    drifts: Array  # (nz - nx,) of each disturbance per square root of a second
    spreads: Array  # (nz - nx,) standard deviations at the start
    y_names: tuple[str, ...]  # compared quantities
    measurement_names: tuple[str, ...]
    mixing: Array  # (ny, nm) compared quantities as sums of measurements: of two opposed tensions, their difference
    sensors: tuple[str, ...]
    """Device of each compared quantity, by its key in ``estimator.measured``, such as tip, tension or bending. The gate
    acts on devices, since the rows of one fail together."""
    friction: tuple[int, ...]  # indices in z for tendons, motors or contacts, as a share of the limit from -1 to 1
    adapted: tuple[AdaptedState, ...]  # parameters of ``estimator.adapt``

    @property
    def nz(self) -> int:
        return len(self.z_names)

    @property
    def ny(self) -> int:
        return len(self.y_names)

    @property
    def nm(self) -> int:
        return len(self.measurement_names)

    @property
    def sensor_names(self) -> tuple[str, ...]:
        """The devices, in the order of their first rows."""
        return tuple(dict.fromkeys(self.sensors))

    def device(self, measurement: str) -> str:
        """Device of a measurement, by its name."""
        row = int(np.flatnonzero(self.mixing[:, self.measurement_names.index(measurement)])[0])
        return self.sensors[row]


def estimation_of(scene: ControlScene, model: Prediction, method: str = "rk4") -> Estimation:
    """Build the model of a scene's estimator, with the integrator of the stages by name."""
    if scene.estimator is None:
        raise InputError("this needs an `estimator:` section with `measured:`", key="estimator")
    disturbances = _disturbances(scene.estimator, model, scene)
    d = ca.SX.sym("d", len(disturbances))
    z = ca.vertcat(model.x, d)
    u = model.u
    p = model.p
    full = ca.SX(p)
    for k, disturbance in enumerate(disturbances):
        # A relative error of the stiffness needs no scale of its own; forces and moments add to the known ones.
        full[disturbance.parameter] += p[disturbance.parameter] * d[k] if disturbance.relative else d[k]
    compared = _compared(scene, scene.estimator.measured, model)
    measurement_names = tuple(dict.fromkeys(name for row in compared for name in row.parts))

    def function(name: str, inputs: dict[str, ca.SX], **results: ca.SX) -> ca.Function:
        return straight_function(name, inputs, {key: ca.densify(value) for key, value in results.items()})

    inputs = {"z": z, "u": u, "p": p}
    parameters = function("estimated_parameters", {"z": z, "p": p}, full=full)
    # By the disturbed parameters themselves, as the stages' slope is, so that one kernel may serve both.
    nominal = ca.SX.sym("nominal", model.np)
    full_by_d = ca.substitute(ca.jacobian(full, d), p, nominal)

    def by_z(value: ca.SX) -> ca.SX:
        return ca.horzcat(ca.jacobian(value, model.x), ca.mtimes(ca.jacobian(value, p), full_by_d))

    rate = model.dynamics(model.x, u, p)
    seen = ca.vertcat(*[row.value for row in compared])
    at = inputs | {"nominal": nominal}
    slope = straight_function("estimator_slope", at, {"rate": rate, "jacobian": by_z(rate)})
    outputs_of = _outputs(function("estimator_values", at, y=seen, H=by_z(seen)), parameters)
    adapted = [k for k, disturbance in enumerate(disturbances) if disturbance.adapted]
    check_detectable(model, [disturbance.name for disturbance in disturbances], adapted, slope, outputs_of)
    step, flow, single = _steps(slope, parameters, method)
    z_names = (*model.x_names, *(disturbance.name for disturbance in disturbances))
    return Estimation(
        step=step,
        flow=flow,
        single=single if INTEGRATORS[method].stable is None else None,
        outputs=outputs_of,
        parameters=parameters,
        contact_forces=_contact_forces(model, disturbances),
        nx=model.nx,
        z_names=z_names,
        drifts=np.array([disturbance.drift for disturbance in disturbances]),
        spreads=np.array([disturbance.spread for disturbance in disturbances]),
        y_names=tuple(row.name for row in compared),
        measurement_names=measurement_names,
        mixing=np.array([[row.parts.get(name, 0.0) for name in measurement_names] for row in compared]),
        sensors=tuple(row.sensor for row in compared),
        friction=tuple(k for k, name in enumerate(z_names) if re.fullmatch(FRICTION, name)),
        adapted=tuple(
            AdaptedState(model.p_names[disturbance.parameter], model.nx + k, disturbance.parameter, disturbance.spread)
            for k, disturbance in enumerate(disturbances)
            if disturbance.adapted
        ),
    )


class _Disturbance(NamedTuple):
    """A disturbance: the parameter that it adds to, its drift and spread, whether it is relative, and adapted."""

    name: str
    parameter: int
    drift: float
    spread: float
    relative: bool
    adapted: bool


def _contact_forces(model: Prediction, disturbances: list[_Disturbance]) -> ca.Function | None:
    if not model.contact_names:
        return None
    d = ca.SX.sym("d", len(disturbances))
    force = model.contact_force(model.x, model.u, model.p)
    by_p = ca.jacobian(force, model.p)
    # By a relative error: what was given is the parameter without it.
    by_d = [
        by_p[:, disturbance.parameter]
        * (model.p[disturbance.parameter] / (1.0 + d[k]) if disturbance.relative else 1.0)
        for k, disturbance in enumerate(disturbances)
    ]
    slope = ca.horzcat(ca.jacobian(force, model.x), *by_d)
    inputs = [ca.vertcat(model.x, d), model.u, model.p]
    return ca.Function("contact_forces", inputs, [force, ca.densify(slope)], ["z", "u", "p"], ["f", "H"])


def _outputs(values: ca.Function, parameters: ca.Function) -> ca.Function:
    """Write the compared quantities, with their derivative, at parameters with the disturbances."""
    z, u, p = (ca.MX.sym(name, values.size1_in(k)) for k, name in enumerate("zup"))
    found = call(values, z, u, *call(parameters, z, p), p)
    return ca.Function("estimator_outputs", [z, u, p], found, ["z", "u", "p"], ["y", "H"])


def _steps(slope: ca.Function, parameters: ca.Function, method: str) -> tuple[ca.Function, ca.Function, ca.Function]:
    """Write the next z with the derivatives over the step and over half of it, without them, and with the first."""
    symbols = [ca.MX.sym(name, slope.size1_in(k)) for k, name in enumerate("zup")] + [ca.MX.sym("h")]
    start, u, p, h = symbols
    others = (u, *call(parameters, start, p), p)
    reached = differentiated_step(method, "estimator", slope, start, others, h, instants=2)
    (end,) = differentiated_step(method, "flow", slope, start, others, h, instants=0)
    nz, nx = start.numel(), end.numel()
    z, x = ca.SX.sym("z", nz), ca.SX.sym("x", nx)
    parts = {name: ca.SX.sym(name, by.sparsity()) for name, by in zip(("whole", "half"), reached[1:], strict=True)}
    # Disturbances are constant except for their drift, which is part of the noise.
    moved = {"zn": ca.vertcat(x, z[nx:])}
    below = ca.horzcat(ca.SX(nz - nx, nx), ca.SX.eye(nz - nx))
    derivatives = {f: ca.densify(ca.vertcat(part, below)) for f, part in zip("FG", parts.values(), strict=True)}
    ends = {"z": z, "x": x}
    collect = straight_function("estimator_derivatives", ends | parts, moved | derivatives)
    ends_alone = ends | {"whole": parts["whole"]}
    collect_alone = straight_function("single_derivatives", ends_alone, moved | {"F": derivatives["F"]})
    collect_end = straight_function("estimator_end", ends, moved)
    names = ["z", "u", "p", "h"]
    return (
        ca.Function("estimator_step", symbols, call(collect, start, *reached), names, ["zn", "F", "G"]),
        ca.Function("estimator_flow", symbols, call(collect_end, start, end), names, ["zn"]),
        ca.Function("estimator_single", symbols, call(collect_alone, start, *reached[:2]), names, ["zn", "F"]),
    )


def _disturbances(asked: EstimatorSettings, model: Prediction, scene: ControlScene) -> list[_Disturbance]:
    """List the disturbances that are estimated."""
    root = math.sqrt(_DRIFTING * scene.controller.step)  # [s^0.5]
    relative = ("bending_stiffness", "tendon_friction", "drive_time_constant")
    drifts = dict(asked.disturbances)
    spreads = dict(asked.spread)
    adapted = {}
    if asked.adapt is not None:
        adapted = asked.adapt.spreads
        # In the stated time, the variance grows by its start value; more slowly as it approaches this value.
        forgetting = asked.adapt.forgetting_time or _FORGETTING * scene.finger.rod.natural_time
        drifts |= {name: std / math.sqrt(forgetting) for name, std in adapted.items()}
        spreads |= adapted
    return [
        _Disturbance(
            match.expand(name), index, drift, spreads.get(key) or root * drift, key in relative, key in adapted
        )
        for key, parameter, name in _DISTURBANCES
        if (drift := drifts.get(key)) is not None
        for index, label in enumerate(model.p_names)
        if (match := re.fullmatch(parameter, label))
    ]


class _Compared(NamedTuple):
    """A compared quantity: its device, name and unit, expression, and share of each measurement in it."""

    sensor: str
    name: str
    value: ca.SX
    parts: dict[str, float]


def _compared(scene: ControlScene, asked: Measured, model: Prediction) -> list[_Compared]:
    """List the quantities that the filter compares: readings, or for tensions without winches their bending part."""
    structure = model.system.finger_model.structure
    tensions = dict[str, ca.SX]()
    if structure.winches and asked.tension is not None:
        pulled = ca.vertsplit(model.tensions(model.x, model.u, model.p))
        tensions = {f"tension_{k + 1} [N]": tension for k, tension in enumerate(pulled)}
    states = dict(zip(model.x_names, ca.vertsplit(model.x), strict=True))
    shape = predicted(scene.controller.cost, model)
    read = shape.sensed(asked, structure.motors, states, model.u, tensions)
    compared = list[_Compared]()
    for sensor, values in read.items():
        compared += [_Compared(sensor, name, value, {name: 1.0}) for name, value in values.items()]
        if sensor != "tension" or structure.winches:
            continue
        unit = model.u_names[0].split("[")[1][:-1]
        of_tendons = [drive for drive in model.driven if not model.x_names[drive.state].startswith("pressure_")]
        for k, moment in enumerate(of_tendons):
            # Only the difference of parallel tendons bends the finger; their mean is no state of the model.
            first = next(arm for arm in moment.arms if arm)
            runtime = "tendon_offset [m]" in model.p_names
            arm = model.p[model.p_names.index("tendon_offset [m]")] if runtime else first
            inputs = model.u_names[: model.nu - len(scene.finger.chambers)]
            parts = {name: of / first for name, of in zip(inputs, moment.arms, strict=False)}
            compared.append(_Compared("tension", f"net_input_{k + 1} [{unit}]", model.x[moment.state] / arm, parts))
    return compared
