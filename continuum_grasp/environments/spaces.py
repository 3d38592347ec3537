"""Names and bounds of what an environment observes, and the range of states within which its model is valid."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.arrays import Array
from continuum_grasp.control.estimation.noise import measurement_range
from continuum_grasp.control.ocp.cost_terms import UNLIMITED
from continuum_grasp.environments.plants import Plants
from continuum_grasp.environments.sensing import STATE, Sensing
from continuum_grasp.labels import split_unit
from continuum_grasp.model.actuation import lag_names

_FRICTION = 2.0
"""Greatest friction state of a contact [1]; one that slides is 1, and a step may overshoot."""
_AWAY = 10.0
"""Greatest distance of an object from the base, in finger lengths [1], as of what its camera may show."""


@dataclass(frozen=True)
class Observed:
    """Entries of an observation: readings, the command before, setpoints.

    ``bounds`` (entries, 2) have the least and the greatest of each; ``setpoints`` (scenes or 1, periods or 1, width)
    are those that are shown at the start of a period.
    """

    names: tuple[str, ...]
    bounds: Array
    setpoints: NDArray[np.float32]


def observed_of(plants: Plants, sensing: Sensing, of_state: Array) -> Observed:
    """List what is observed; ``of_state`` (nx, 2) are the bounds of states."""
    scene, model = plants.scenes[0], plants.model
    state_ranges = dict(zip(model.x_names, of_state, strict=True)) if STATE in sensing.sensors else {}
    sensed = [
        state_ranges[n] if n in state_ranges else measurement_range(scene, plants.prediction, n) for n in sensing.names
    ]
    cost = scene.controller.cost
    terms = [term for term in plants.outputs.terms if term.of_state]
    # Rates have no setpoint but zero, of which nothing is to be seen.
    columns = np.flatnonzero([bool(term.reference) for term in terms for _ in term.names(cost, plants.prediction)])
    horizon = scene.controller.horizon
    length = round(horizon.stages * horizon.stage / plants.period)
    ahead: tuple[int, ...] = (0, length // 2, length) if plants.setpoints.shape[1] > 1 else (0,)
    when = ["" if k == 0 else f" {k * plants.period:g} s ahead" for k in ahead]
    names = (
        *sensing.names,
        *(f"command_{name}" for name in model.u_names),
        *(f"setpoint_{plants.outputs.names[k]}{later}" for later in when for k in columns),
    )
    shown = plants.setpoints.reshape(-1, plants.setpoints.shape[2])[:, columns]
    setpoints = np.stack([shown.min(axis=0), shown.max(axis=0)], axis=1)
    command = np.transpose(scene.input_limits)
    bounds = np.vstack([np.reshape(sensed, (-1, 2)), command, np.tile(setpoints, (len(ahead), 1))])
    times = plants.setpoints.shape[1]
    later = np.minimum(np.arange(times)[:, None] + np.array(ahead), times - 1)
    table = plants.setpoints[:, later][..., columns].astype(np.float32)
    return Observed(names, bounds, np.ascontiguousarray(table.reshape(*table.shape[:2], -1)))


def single_precision(bounds: Array) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Least and greatest values in single precision, rounded outwards."""
    low, high = bounds.T.astype(np.float32)
    low = np.where(low > bounds[:, 0], np.nextafter(low, np.float32(-np.inf)), low)
    high = np.where(high < bounds[:, 1], np.nextafter(high, np.float32(np.inf)), high)
    return low, high


def state_bounds(plants: Plants, radius: float) -> Array:
    """Least and greatest value of each state (nx, 2), beyond which the model is not valid.

    ``radius`` is the fastest rate of the model [1/s].
    """
    model, scenes = plants.model, plants.scenes
    n, system = model.system.n, model.elements
    reach = np.array(system.finger_model.structure.coordinate_limits())
    start = plants.start[:, :n]
    bounds = np.tile([-UNLIMITED, UNLIMITED], (model.nx, 1))
    # Above the shape at rest, which is zero of a finger that is straight; a start may be bent.
    low, high = np.minimum(start.min(axis=0), 0.0) - reach, np.maximum(start.max(axis=0), 0.0) + reach
    bounds[:n] = np.stack([low, high], axis=1)
    # Rates of the fastest mode at that amplitude, as the estimator has it.
    bounds[n : 2 * n] = radius * np.stack([-reach, reach], axis=1)
    base, length = np.array(model.scene.finger.base.position), model.scene.finger.rod.length
    pose = system.object_states
    for k in range(min(2, pose.stop - pose.start)):
        bounds[pose.start + k] = base[k] - _AWAY * length, base[k] + _AWAY * length
    bounds[system.friction_states] = -_FRICTION, _FRICTION
    for k, name in enumerate(model.x_names):
        if name.startswith(("length_", "motor_angle_")) and "_rate" not in name:
            bounds[k] = measurement_range(scenes[0], plants.prediction, name)
    # A lag without overshoot, which starts and ends within the limits of the command.
    lags = [t.time_constant for scene in scenes for t in scene.finger.tendon_list]
    lags += [scene.plant.time_constant or scene.controller.input.time_constant for scene in scenes]
    fastest = min((lag for lag in lags if lag is not None), default=math.inf)
    ranges = dict[str, tuple[float, float]]()
    for name, least, most in zip(model.u_names, *scenes[0].input_limits, strict=True):
        # Of a critically damped lag of time T under commands that jump: range / (e T), at most.
        rate = (most - least) / (math.e * fastest)
        ranges |= zip(lag_names(*split_unit(name), 2), ((least, most), (-rate, rate)), strict=True)
    bounds[system.nx :] = np.reshape([ranges[name] for name in model.x_names[system.nx :]], (-1, 2))
    return bounds
