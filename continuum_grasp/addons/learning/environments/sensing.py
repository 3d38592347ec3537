"""Control periods of many plants in one call of compiled C, in vector lanes, and their readings: sensors, contact
forces, use of the model's range, tip; names and bounds of the observations.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from continuum_grasp.addons.learning.environments.plants import Plants
from continuum_grasp.base import Array, InputError
from continuum_grasp.control import UNLIMITED, measurement_range
from continuum_grasp.core import Compiler, CSource, Template
from continuum_grasp.model import Lag

STATE = "state"
"""Sensor that reads the whole state of the plant, exactly and at once."""


class ControlPeriods:
    """Control periods of plants that differ by parameters alone.

    ``slope`` is (x, u, w, p) -> xd (nx), ``cost`` (x, u, held, w, p, r) -> cost at the start of the period [1], before
    which the input was ``held``, ``readings`` (x, u, w, p) -> y (ny), read at its end; y[``use``] is greater than 1
    where the model is not valid.
    """

    def __init__(self, slope: ca.Function, cost: ca.Function, readings: ca.Function, use: int) -> None:
        self.sizes = {"x": slope.numel_in(0), "u": slope.numel_in(1), "w": slope.numel_in(2), "p": slope.numel_in(3)}
        self.sizes |= {"r": cost.numel_in(5), "y": readings.numel_out(0)}
        functions = CSource((slope, cost, readings)).lanes()
        if not functions:
            why = "this plant has an operation without vector code, so that environments cannot run it in lanes"
            raise InputError(why)
        words = {"use": use} | {f"n{name}": size for name, size in self.sizes.items()}
        words |= {f"n{name}1": max(size, 1) for name, size in self.sizes.items()}  # C has no empty arrays
        text = Template.of("addons.learning.environments", "period.c").filled(words)
        source = f"{functions}\n{Template.of('core', 'gather.c').text}\n{text}"
        self._code = Compiler.load(source, "an environment").environment_period
        self._code.restype = None

    def __call__(
        self,
        x: Array,
        u: Array,
        held: Array,
        w: Array,
        p: Array,
        r: Array,
        bounds: Array,
        readings: Array,
        substeps: int,
        h: float,
    ) -> tuple[Array, NDArray[np.int8]]:
        """Move states (count, nx) by steps of h [s], in place; return costs, and where the motion ended.

        All arrays but ``bounds`` (2, nx), least and greatest states, have a row per plant; readings (count, ny) are
        those at the end. Without substeps only these are evaluated. A motion has ended by 1 where a number is not
        finite, with state and readings as they were, and by 2 out of range: where a state is beyond its bounds, or the
        reading ``use`` greater than 1.
        """
        count = len(x)
        cost = np.empty(count)
        ended = np.empty(count, dtype=np.int8)
        whole = ctypes.c_longlong
        arrays = [array.ctypes for array in (x, u, held, w, p, r, bounds, cost, readings)]
        self._code(whole(count), whole(substeps), ctypes.c_double(h), *arrays, ctypes.c_void_p(ended.ctypes.data))
        return cost, ended


@dataclass(frozen=True)
class Sensing:
    """Columns of readings: ``names`` of sensors, then contact forces, then use of the range, x and y of the tip.

    ``std`` is the noise of each sensor, ``late`` the delay in periods of those that are not read ``at_once``.
    """

    sensors: tuple[str, ...]
    names: tuple[str, ...]
    std: Array
    late: int
    at_once: NDArray[np.bool_]
    contacts: tuple[str, ...]
    periods: ControlPeriods

    @property
    def forces(self) -> slice:
        """Places of the contact forces [N]."""
        return slice(len(self.names), len(self.names) + len(self.contacts))


def sensing_of(plants: Plants, sensors: str | Sequence[str] | None) -> Sensing:
    """Compile the periods of plants, with the readings of sensors; see ``FingerVectorEnv``."""
    model = plants.model
    scene = plants.scenes[0]
    x, u, w, p = model.symbols
    whole = dict(zip(model.x_names, ca.vertsplit(x), strict=True))
    known = {STATE: whole}
    if scene.estimator is not None:
        known |= model.sensor_expressions(scene.estimator.measured, plants.prediction)
    measured = tuple(name for name in known if name != STATE) or (STATE,)
    if sensors is None:
        asked = measured
    elif isinstance(sensors, str):
        asked = (sensors,)
    else:
        asked = tuple(sensors)
    if not asked or any(name not in known or asked.count(name) > 1 for name in asked):
        raise InputError(
            f"expected some of {', '.join(known)} (as in estimator.measured), each once, got {list(asked)}",
            key="sensors",
        )
    delay = scene.plant.delay
    if delay is None:
        delay = 0.0 if scene.estimator is None else scene.estimator.delay
    late = 0 if asked == (STATE,) else round(delay / plants.period)
    if asked != (STATE,) and abs(late * plants.period - delay) > 1e-6 * plants.period:
        raise InputError(f"expected whole periods of {plants.period:g} s, got {delay:g} s", key="plant.delay")
    read = {name: value for sensor in asked for name, value in known[sensor].items()}
    exact = known[STATE] if STATE in asked else {}
    std = [0.0 if name in exact else scene.plant.noise * scene.measurement_std(name) for name in read]
    touched = [k for k, name in enumerate(model.system.touch_names) if name.startswith("finger.")]
    forces = [model.touch["normal_force"][k] for k in touched]
    held = ca.SX.sym("held", model.nu)
    r = ca.SX.sym("r", len(plants.outputs.names))
    error = model.tracked_expression(plants.prediction, held, scene.controller.horizon.stage) - r
    # The running cost of a controller, over a period of which it holds the command.
    cost = 0.5 * plants.period * ca.dot(ca.DM(plants.outputs.weights[:, 0]), error**2)
    inputs = {"x": x, "u": u, "w": w, "p": p}
    readings = ca.vertcat(*read.values(), *forces, ca.mmax(ca.fabs(model.range_use)), model.tip)
    periods = ControlPeriods(
        _function("slope", inputs, model.forward_dynamics(x, u, w, p)),
        _function("cost", {"x": x, "u": u, "held": held, "w": w, "p": p, "r": r}, cost),
        _function("readings", inputs, readings),
        len(read) + len(touched),
    )
    contacts = tuple(model.system.touch_names[k] for k in touched)
    at_once = np.array([name in exact for name in read])
    return Sensing(asked, tuple(read), np.array(std), late, at_once, contacts, periods)


def _function(name: str, inputs: dict[str, ca.SX], value: ca.SX) -> ca.Function:
    values: Sequence[ca.SX] = ca.cse([ca.densify(ca.SX(value))])
    return ca.Function(f"environment_{name}", [*inputs.values()], values, [*inputs], ["y"])


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
    """List the observations; ``of_state`` (nx, 2) are the bounds of states."""
    scene = plants.scenes[0]
    model = plants.model
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
    n = model.system.n
    system = model.elements
    reach = np.array(system.finger_model.structure.coordinate_limits())
    start = plants.start[:, :n]
    bounds = np.tile([-UNLIMITED, UNLIMITED], (model.nx, 1))
    # Above the shape at rest, which is zero of a finger that is straight; a start may be bent.
    low = np.minimum(start.min(axis=0), 0.0) - reach
    high = np.maximum(start.max(axis=0), 0.0) + reach
    bounds[:n] = np.stack([low, high], axis=1)
    # Rates of the fastest mode at that amplitude, as the estimator has it.
    bounds[n : 2 * n] = radius * np.stack([-reach, reach], axis=1)
    base = np.array(model.scene.finger.base.position)
    length = model.scene.finger.rod.length
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
        ranges |= zip(Lag(2).names(name), ((least, most), (-rate, rate)), strict=True)
    bounds[system.nx :] = np.reshape([ranges[name] for name in model.x_names[system.nx :]], (-1, 2))
    return bounds
