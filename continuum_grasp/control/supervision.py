"""Numbers of the supervisor, which tells whether sensors, model and call rate of a controller agree."""

from __future__ import annotations

import math

import numpy as np

from continuum_grasp.control.controller_source import Field
from continuum_grasp.control.estimation import Estimation
from continuum_grasp.control.noise import measurement_std
from continuum_grasp.control.stages import Stages
from continuum_grasp.scene.control import ControlScene

__all__ = ["supervisor_fields"]

_WINDOW = 0.2
"""Time over which mismatch and activity are averaged [s]: shorter reports noise, and a loop that swings is lost within
a second."""
_LEAST_WINDOW = 20
"""The same in calls: a mean over fewer passes the bounds of ``c/supervisor.c`` by chance."""
_SETTLING = 3
"""Calls beyond the estimator's delay after which innovations mean something."""
_RUNGS = 2
"""Fourfold raises of the weight of the command's rate: 16 times hold three periods of unknown delay."""
_STILL = 1e-3
"""Share of a sensor's standard deviation by which a reading moves at least; 20 readings in a row of white noise stay
within it once in 1e60, at a tenth of the declared noise once in 1e45."""
_CROSSING = 0.1
"""Time in which a command that is fully active crosses its range where its rate has no tighter limit [s]."""
_FAR = 0.1
"""Distance of a tip that is away from its setpoint, in lengths of the finger."""


def supervisor_fields(scene: ControlScene, stages: Stages, estimation: Estimation | None, delay: int) -> list[Field]:
    """Members of ``supervisor_settings``.

    Parameters
    ----------
    scene : ControlScene
        The scene.
    stages : Stages
        Its problem.
    estimation : Estimation or None
        Model of its estimator.
    delay : int
        Age of measurements in periods.

    Returns
    -------
    list of Field
    """
    asked, period = scene.controller, scene.controller.step
    window = max(_LEAST_WINDOW, math.ceil(_WINDOW / period - 1e-9)) if asked.supervisor else 0
    names = estimation.measurement_names if estimation is not None else tuple("x" * stages.nd)
    devices = estimation.sensor_names if estimation is not None else ()
    sensor = [devices.index(estimation.device(name)) for name in names] if estimation is not None else [0] * len(names)
    asks = scene.estimator is not None and scene.estimator.frozen
    rate = np.minimum(asked.input.rate_max or math.inf, (stages.u_max - stages.u_min) / _CROSSING)
    return [
        Field("window", window, whole=True),
        Field("delay", delay + _SETTLING, whole=True),
        Field("rungs", _RUNGS if asked.cost.input_rate else 0, whole=True),
        Field("sensor", sensor, whole=True),
        Field("shape", [int(name != "tension") for name in devices] or [0], whole=True),
        Field("cause", [_first(name, stages.u_names) for name in names], whole=True),
        Field("still", [_STILL * measurement_std(scene, name) if asks else -1.0 for name in names]),
        Field("change", np.maximum(rate * period, 1e-12)),
        Field("tip", _first("tip_x [m]", names), whole=True),
        Field("setpoint", _first("tip_x [m]", stages.r_names), whole=True),
        Field("far", _FAR * scene.finger.rod.length),
    ]


def _first(name: str, names: tuple[str, ...]) -> int:
    return names.index(name) if name in names else -1
