"""Settings of the C of estimators, controllers and supervisors."""

from __future__ import annotations

import math

import numpy as np

from continuum_grasp.control.compiled.source import Field
from continuum_grasp.control.estimation.model import Estimation
from continuum_grasp.control.estimation.noise import Ranges, measurement_std, noise_of, ranges_of
from continuum_grasp.control.ocp.bounds import ABSENT
from continuum_grasp.control.ocp.stages import Stages
from continuum_grasp.control.prediction import Prediction
from continuum_grasp.control.rti.settings import Settings
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
_RUNGS = 2
"""Fourfold raises of the weight of the command's rate [1]: 16 times the weight tolerates three periods of unmodeled
delay."""
_STILL = 1e-3
"""Change of a reading, relative to its sensor's standard deviation, up to which it is at rest [1]: 20 readings of white
noise in a row stay within it once in 1e60 cases, at a tenth of the declared noise once in 1e45."""
_CROSSING = 0.1
"""Time in which a fully active command crosses its range where its rate has no tighter limit [s]: that of the shipped
scenes (59 N at 600 N/s)."""
_FAR = 0.1
"""Distance of the tip from its setpoint beyond which it is away, in finger lengths [1]: working loops stay below 0.09
(configs/mpc/keep_out.yaml: 16 mm of 180 mm), lost ones reach 0.5."""


def delay_periods(scene: ControlScene) -> int:
    """Return the age of measurements in control periods."""
    return 0 if scene.estimator is None else round(scene.estimator.delay / scene.controller.step)


def estimator_fields(
    scene: ControlScene, model: Prediction, stages: Stages, estimation: Estimation, ranges: Ranges | None = None
) -> list[Field]:
    """List the members of ``ekf_settings``.

    Parameters
    ----------
    scene : ControlScene
        The scene, with an estimator.
    ranges : Ranges, optional
        Limits, if they exist already.
    """
    noise = noise_of(scene, model, estimation)
    limits = ranges_of(scene, model, stages, estimation) if ranges is None else ranges
    states = np.vstack([limits.x, limits.disturbances])
    period = scene.controller.step
    return [
        Field("noise", noise.process),
        Field("initial", noise.initial),
        Field("z_min", states[:, 0]),
        Field("z_max", states[:, 1]),
        Field("mixing", estimation.mixing),
        Field("variance", noise.measured),
        Field("y_min", limits.measurement[:, 0]),
        Field("y_max", limits.measurement[:, 1]),
        Field("period", period),
        Field("substeps", max(1, math.ceil(stages.substeps * period / stages.stage - 1e-9)), whole=True),
        Field("gate", scene.estimator.outlier if scene.estimator is not None else math.inf),
        Field("sensor", [estimation.sensor_names.index(name) for name in estimation.sensors], whole=True),
    ]


def controller_fields(
    scene: ControlScene, model: Prediction, stages: Stages, estimation: Estimation | None, precision: str
) -> list[Field]:
    """List the members of ``controller_settings``.

    Parameters
    ----------
    precision : {"double", "float"}
        Floating-point type of the C.
    """
    ranges, asked = ranges_of(scene, model, stages, estimation), scene.controller
    rate = asked.input.rate_max or ABSENT
    safe = np.clip(np.zeros(stages.nu), stages.u_min, stages.u_max)
    fields = [
        *_nested("rti", iteration_fields(scene, stages, precision)),
        Field("period", asked.step),
        Field("u_rate", np.full(stages.nu, rate)),
        Field("u_safe", safe),
        Field("safe_rate", np.maximum((stages.u_max - stages.u_min) / _RAMP, 1e-9)),
        Field("applied_min", ranges.applied[:, 0]),
        Field("applied_max", ranges.applied[:, 1]),
        Field("r_min", ranges.r[:, 0]),
        Field("r_max", ranges.r[:, 1]),
        Field("p_min", ranges.p[:, 0]),
        Field("p_max", ranges.p[:, 1]),
        Field("x_min", ranges.x[:, 0]),
        Field("x_max", ranges.x[:, 1]),
        Field("sqp_iterations", asked.sqp_iterations, whole=True),
        Field("start_iterations", asked.start_iterations, whole=True),
        *_nested("supervisor", supervisor_fields(scene, stages, estimation, delay_periods(scene))),
    ]
    if estimation is not None:
        fields += _nested("ekf", estimator_fields(scene, model, stages, estimation, ranges))
    return fields


def iteration_fields(scene: ControlScene, stages: Stages, precision: str) -> list[Field]:
    """List the members of ``rti_settings``."""
    nominal = Settings(stages, np.float64 if precision == "double" else np.float32)
    arrays = ("u_min", "u_max", "c_min", "c_max", "linear", "quadratic", "weights", "terminal_weights")
    return [
        *[Field(name, getattr(stages, name)) for name in arrays],
        Field("stage", stages.stage),
        Field("substeps", stages.substeps, whole=True),
        Field("iterations", scene.controller.iterations, whole=True),
        Field("tolerance", nominal.tolerance),
        Field("regularization", nominal.regularization),
    ]


def _nested(name: str, fields: list[Field]) -> list[Field]:
    return [Field(f"{name}.{f.member}", f.values, f.whole) for f in fields]


def supervisor_fields(scene: ControlScene, stages: Stages, estimation: Estimation | None, delay: int) -> list[Field]:
    """List the members of ``supervisor_settings``.

    Parameters
    ----------
    delay : int
        Age of measurements in periods.
    """
    asked, period = scene.controller, scene.controller.step
    window = max(_LEAST_WINDOW, math.ceil(_WINDOW / period - 1e-9)) if asked.supervisor else 0
    names = estimation.measurement_names if estimation is not None else tuple("x" * stages.nd)
    devices = estimation.sensor_names if estimation is not None else ()
    sensor = [devices.index(estimation.device(name)) for name in names] if estimation is not None else [0] * len(names)
    checks_frozen = scene.estimator is not None and scene.estimator.frozen
    rate = np.minimum(asked.input.rate_max or math.inf, (stages.u_max - stages.u_min) / _CROSSING)
    return [
        Field("window", window, whole=True),
        Field("delay", delay + _SETTLING, whole=True),
        Field("rungs", _RUNGS if asked.cost.input_rate else 0, whole=True),
        Field("sensor", sensor, whole=True),
        Field("shape", [int(name != "tension") for name in devices] or [0], whole=True),
        Field("cause", [_first(name, stages.u_names) for name in names], whole=True),
        Field("still", [_STILL * measurement_std(scene, name) if checks_frozen else -1.0 for name in names]),
        Field("change", np.maximum(rate * period, 1e-12)),
        Field("tip", _first("tip_x [m]", names), whole=True),
        Field("setpoint", _first("tip_x [m]", stages.r_names), whole=True),
        Field("far", _FAR * scene.finger.rod.length),
    ]


def _first(name: str, names: tuple[str, ...]) -> int:
    return names.index(name) if name in names else -1
