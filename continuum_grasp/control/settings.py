"""Settings of the C of controllers and estimators: members of its structures, and their values."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from continuum_grasp.arrays import Array
from continuum_grasp.control.estimation.contact_model import ContactModel
from continuum_grasp.control.estimation.excitation import quiet_sensitivities
from continuum_grasp.control.estimation.model import Estimation
from continuum_grasp.control.estimation.noise import Ranges, measurement_std, noise_of, ranges_of
from continuum_grasp.control.field import Field
from continuum_grasp.control.ocp.bounds import ABSENT
from continuum_grasp.control.ocp.stages import Stages
from continuum_grasp.control.prediction import Prediction
from continuum_grasp.control.rti import source as rti
from continuum_grasp.scene.control import ControlScene

_RAMP = 0.5
"""Time in which the safe ramp crosses the whole range of an input [s]: longer than the period of the first mode of the
shipped fingers (0.4 s), so that the ramp does not make them swing."""
_WINDOW = 0.2
"""Time over which mismatch and activity are averaged [s]: a shorter one reports noise, and a swinging loop is lost
within a second."""
_LEAST_WINDOW = 20
"""Least number of calls of that window [1]: a mean over fewer exceeds the thresholds of ``c/supervisor.c`` by
chance."""
_SETTLING = 3
"""Calls beyond the estimator's delay until innovations are compared [1]: the first ones contain the error of the
start."""
_RUNGS = 3
"""Fourfold raises of the weight of the command's rate [1]: with five periods of unmodeled delay, 64 times the weight
holds the tip of configs/mpc/steady_tip.yaml within 2.4 mm (r.m.s.), 16 times within 42 mm."""
_STILL = 1e-3
"""Change of a reading, relative to its sensor's standard deviation, up to which it is at rest [1]: 20 readings of white
noise in a row stay within it once in 1e60 cases, at a tenth of the declared noise once in 1e45."""
_HELD = 3.0
"""Motion by drives that friction in the tendons, of which the model knows little, may hold, in standard deviations of a
reading [1]: in configs/mpc/winches.yaml a tip that rests answers none of the 1 to 2 that the noise causes."""
_CROSSING = 0.1
"""Time in which a fully active command crosses its range where its rate has no tighter limit [s]: that of the shipped
scenes (59 N at 600 N/s)."""
_FAR = 0.1
"""Distance of the tip from its setpoint beyond which it is away, in finger lengths [1]: working loops stay below 0.09
(configs/mpc/keep_out.yaml: 16 mm of 180 mm), lost ones reach 0.5."""


def delay_periods(scene: ControlScene) -> int:
    """Return the age of measurements in control periods."""
    return 0 if scene.estimator is None else round(scene.estimator.delay / scene.controller.step)


def window_of(scene: ControlScene) -> int:
    """Return the number of calls over which a controller's supervisor averages."""
    return max(_LEAST_WINDOW, math.ceil(_WINDOW / scene.controller.step - 1e-9))


def estimator_fields(
    scene: ControlScene, model: Prediction, stages: Stages, estimation: Estimation, ranges: Ranges
) -> list[Field]:
    """List the members of ``ekf_settings`` of a scene with an estimator."""
    process, initial, measured = noise_of(scene, model, estimation)
    states = np.vstack([ranges.x, ranges.disturbances])
    period = scene.controller.step
    # At a limit for long, others are beyond what is plausible: there is no friction below none and none beyond its
    # limit, and an adapted parameter may be as far off as the range that it is adapted in.
    adapted = {one.state for one in estimation.adapted}
    natural = [
        int(k in adapted or name.startswith(("tendon_friction", "unknown_contact_friction")))
        for k, name in enumerate(estimation.z_names)
    ]
    drives = {drive.state for drive in model.driven}
    # Steps as long as those of the stages, which the stiffness allows; rounding must not add one.
    substeps = max(1, math.ceil(stages.substeps * period / stages.stage - 1e-9))
    return [
        Field("noise", process),
        Field("initial", initial),
        Field("z_min", states[:, 0]),
        Field("z_max", states[:, 1]),
        Field("natural", natural, whole=True),
        Field("mixing", estimation.mixing),
        Field("variance", measured),
        Field("y_min", ranges.measurement[:, 0]),
        Field("y_max", ranges.measurement[:, 1]),
        Field("period", period),
        Field("substeps", substeps, whole=True),
        Field("gate", scene.estimator.outlier if scene.estimator is not None else math.inf),
        Field("sensor", [estimation.sensor_names.index(name) for name in estimation.sensors], whole=True),
        Field("drive", [int(k in drives) for k in range(estimation.nx)], whole=True),
        Field("fade", 2.0 / window_of(scene)),
        *([Field("friction", estimation.friction, whole=True)] if estimation.friction else []),
        *([Field("adapted", [one.state for one in estimation.adapted], whole=True)] if estimation.adapted else []),
        *([Field("quiet", quiet_sensitivities(scene, model, estimation, substeps))] if estimation.adapted else []),
    ]


def controller_fields(
    scene: ControlScene,
    model: Prediction,
    stages: Stages,
    estimation: Estimation | None,
    precision: str,
    contact: ContactModel | None = None,
) -> list[Field]:
    """List the members of ``controller_settings``, for C in double or float."""
    ranges, asked = ranges_of(scene, model, stages, estimation), scene.controller
    calls = calls_of(scene)
    rate = np.full(stages.nu, asked.input.rate_max or ABSENT)
    unknown = estimation.z_names if estimation is not None else ()
    touches = model.system.surroundings is not None or contact is not None or any("contact" in name for name in unknown)
    supervisor = _supervisor_fields(scene, stages, estimation, touches)
    fields = _fields(stages, calls, precision, ranges, rate, supervisor)
    if estimation is not None:
        fields += _nested("ekf", estimator_fields(scene, model, stages, estimation, ranges))
        if contact is not None:
            fields += _nested("contact", contact.fields_within(estimation.measurement_names))
    return fields


def solver_fields(stages: Stages, calls: Calls, precision: str) -> list[Field]:
    """List the members of ``controller_settings`` of a problem without a scene, whose state is given.

    Any finite number is plausible, and nothing is supervised.
    """
    none = np.full(stages.nd, -1)
    supervisor = [
        *[Field(name, 0, whole=True) for name in ("window", "delay", "rungs")],
        Field("sensor", 0 * none, whole=True),
        *[Field(name, [0], whole=True) for name in ("shape", "drive")],
        Field("cause", none, whole=True),
        Field("still", none),
        Field("noise", none),
        Field("hidden", 0 * none),
        Field("change", np.ones(stages.nu)),
        *[Field(name, -1, whole=True) for name in ("tip", "setpoint")],
        Field("far", 1.0),
    ]
    ranges = free_ranges(stages, ABSENT)
    return _fields(stages, calls, precision, ranges, np.full(stages.nu, ABSENT), supervisor)


def free_ranges(stages: Stages, most: float) -> Ranges:
    """Ranges of a problem without a scene: all numbers up to a magnitude."""
    sizes = {"x": stages.nd, "r": stages.nr, "p": stages.np, "applied": stages.nu}
    limits = {key: np.tile((-most, most), (size, 1)) for key, size in sizes.items()}
    return Ranges(disturbances=np.zeros((0, 2)), measurement=limits["x"], **limits)


def calls_of(scene: ControlScene) -> Calls:
    """Calls of the controller of a scene."""
    asked = scene.controller
    counts = asked.sqp_iterations, asked.start_iterations, asked.start_calls, asked.iterations
    return Calls(asked.step, np.array(scene.rest_input), _RAMP, *counts)


class Calls(NamedTuple):
    """Calls of a controller: numbers that its C needs beside the problem.

    Period [s]; safe input (nu), to which the command goes where there is no plan, and the time in which that ramp
    crosses the whole range of an input [s]; iterations per call and from a plan at rest, and calls over which the
    latter are spread; cap of a QP's factorizations.
    """

    period: float
    safe: Array
    ramp: float
    sqp_iterations: int
    start_iterations: int
    start_calls: int
    iterations: int


def _fields(
    stages: Stages, calls: Calls, precision: str, ranges: Ranges, rate: Array, supervisor: list[Field]
) -> list[Field]:
    """List the members of ``controller_settings`` but for those of the estimator."""
    return [
        *_nested("rti", _iteration_fields(stages, calls.iterations, precision)),
        Field("period", calls.period),
        Field("u_rate", rate),
        Field("u_safe", calls.safe),
        # The C refuses a rate of zero, which an input that cannot move would have.
        Field("safe_rate", np.maximum((stages.u_max - stages.u_min) / calls.ramp, 1e-9)),
        Field("applied_min", ranges.applied[:, 0]),
        Field("applied_max", ranges.applied[:, 1]),
        Field("r_min", ranges.r[:, 0]),
        Field("r_max", ranges.r[:, 1]),
        Field("p_min", ranges.p[:, 0]),
        Field("p_max", ranges.p[:, 1]),
        Field("x_min", ranges.x[:, 0]),
        Field("x_max", ranges.x[:, 1]),
        Field("sqp_iterations", calls.sqp_iterations, whole=True),
        Field("start_iterations", calls.start_iterations, whole=True),
        Field("start_calls", calls.start_calls, whole=True),
        *_nested("supervisor", supervisor),
    ]


def _iteration_fields(stages: Stages, iterations: int, precision: str) -> list[Field]:
    """List the members of ``rti_settings``."""
    real = np.float64 if precision == "double" else np.float32
    return [
        *[Field(name, getattr(stages, name)) for name in rti.SETTINGS],
        Field("stage", stages.stage),
        Field("substeps", stages.substeps, whole=True),
        Field("iterations", iterations, whole=True),
        Field("tolerance", float(real(rti.TOLERANCE[precision]))),
        Field("regularization", float(real(rti.REGULARIZATION))),
        *[Field(name, value) for name, value in rti.scenario_settings(stages).items()],
    ]


def _nested(name: str, fields: list[Field]) -> list[Field]:
    return [Field(f"{name}.{f.member}", f.values, f.whole) for f in fields]


def _supervisor_fields(
    scene: ControlScene, stages: Stages, estimation: Estimation | None, touches: bool
) -> list[Field]:
    """List the members of ``supervisor_settings``."""
    asked, period = scene.controller, scene.controller.step
    window = window_of(scene) if asked.supervisor else 0
    names = estimation.measurement_names if estimation is not None else tuple("x" * stages.nd)
    devices = estimation.sensor_names if estimation is not None else ()
    sensor = [devices.index(estimation.device(name)) for name in names] if estimation is not None else [0] * len(names)
    free = estimation is not None and not touches
    checks_frozen = scene.estimator is not None and scene.estimator.frozen
    rate = np.minimum(asked.input.rate_max or math.inf, (stages.u_max - stages.u_min) / _CROSSING)
    return [
        Field("window", window, whole=True),
        Field("delay", delay_periods(scene) + _SETTLING, whole=True),
        # Without a weight of the command's rate there is nothing to raise.
        Field("rungs", _RUNGS if asked.cost.input_rate else 0, whole=True),
        Field("sensor", sensor, whole=True),
        # Tip and angles show the shape, the pose of an object neither that nor a drive.
        Field("shape", [int(name in ("tip", "bending")) for name in devices] or [0], whole=True),
        Field("drive", [int(name not in ("tip", "bending", "object")) for name in devices] or [0], whole=True),
        # A tension moves with its own command, everything else with all of them.
        Field("cause", [_first(name, stages.u_names) for name in names], whole=True),
        # Below zero: not tested.
        Field("still", [_STILL * measurement_std(scene, name) if checks_frozen else -1.0 for name in names]),
        # A finger that touches something is held by it, whatever its drives do: then below zero.
        Field("noise", [measurement_std(scene, name) if free else -1.0 for name in names]),
        Field("hidden", [_HELD**2 if scene.finger.has_tendon_friction else 0.0] * len(names)),
        # Divisors in the C: not zero where an input cannot move.
        Field("change", np.maximum(rate * period, 1e-12)),
        Field("tip", _first("tip_x [m]", names), whole=True),
        Field("setpoint", _first("tip_x [m]", stages.r_names), whole=True),
        Field("far", _FAR * scene.finger.rod.length),
    ]


def _first(name: str, names: tuple[str, ...]) -> int:
    return names.index(name) if name in names else -1
