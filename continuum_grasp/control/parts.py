"""Parts of a controller and their numbers: the source of its C and of its settings.

Settings are members of a structure of the C by name, with their values: whole numbers where the values are.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from continuum_grasp.base import Array, InputError
from continuum_grasp.control.estimation.excitation import memory_of, quiet_sensitivities
from continuum_grasp.control.estimation.model import Estimation, estimation_of
from continuum_grasp.control.estimation.noise import Ranges, noise_of, ranges_of
from continuum_grasp.control.iteration import source as rti
from continuum_grasp.control.members import CHANGEABLE, REPORTED, Changeable, Reported
from continuum_grasp.control.ocp.scene_problem import stages_of
from continuum_grasp.control.ocp.stages import Stages
from continuum_grasp.control.prediction import Prediction
from continuum_grasp.control.status import CALL_RATE
from continuum_grasp.scene import ControlScene

Settings = dict[str, ArrayLike]


def is_whole(values: ArrayLike) -> bool:
    """Whether a member of settings is of whole numbers."""
    return np.asarray(values).dtype.kind in "biu"


_WINDOW = 2.6
"""Natural times of the finger over which mismatch and activity are averaged [1], 0.2 s of the hand finger: a shorter
window reports noise, and a swinging loop is lost within five of them."""
_LEAST_WINDOW = 20
"""Least number of calls of that window [1]: a mean over fewer exceeds the thresholds of ``c/supervisor.c`` by
chance."""
_SETTLING = 3
"""Calls beyond the estimator's delay until innovations are compared [1]: the first ones contain the error of the
start."""
_RUNGS = 3
"""Fourfold raises of the weight of the command's rate [1]: with five periods of unmodeled delay, 64 times the weight
holds the tip of configs/mpc/steady_tip.yaml within 2.4 mm (r.m.s.), 16 times within 42 mm."""
_SHARED = 2
"""Steps of the estimator that one call remembers for the next [1]: implicit methods take two in a period, and each is
1.2 kB of an estimator with eight states."""
_STILL = 1e-3
"""Greatest change of a frozen reading, relative to its sensor's standard deviation [1]: 20 readings of white noise in a
row stay within it once in 1e60 cases, and at a tenth of the declared noise once in 1e45."""
_HELD = 3.0
"""Motion by drives that friction in the tendons, nearly unknown to the model, may hold, in standard deviations of a
reading [1]: in configs/mpc/winches.yaml a tip that rests answers none of the 1 to 2 that the noise causes."""
_CROSSING = 1.3
"""Least time for a fully active command to cross its range, in natural times of the finger [1], unless its rate has a
tighter limit: as in the scenes of the hand finger (59 N at 600 N/s)."""
_OFFSET = 0.01
"""Mean distance from a setpoint that stands at which the tip is off, in finger lengths [1], at least four standard
deviations of its measurement: working loops stay below 0.014 for less than 1 s (configs/mpc/tip_steps.yaml, under a
stiffness whose estimate wanders), a camera whose scale is 0.5 % off leads steady_tip.yaml to 0.034."""
_FAR = 0.1
"""Distance of the tip from its setpoint beyond which it is away, in finger lengths [1]: working loops stay below 0.09
(configs/mpc/keep_out.yaml: 16 mm of 180 mm), lost ones reach 0.5."""

_CORRECTED = 0.03
"""Greatest correction of a setpoint that stands, in finger lengths [1]: without any, configs/mpc/trunk_2m.yaml stood up
to 0.023 off (``python -m benchmarks.soak_standing --loops trunk_2m``); unknown parts are pressed no further."""


class ControllerCalls(NamedTuple):
    """Calls of a controller: numbers that its C needs in addition to the problem."""

    period: float  # [s]
    safe: Array  # input (nu) as the target of the command without a plan
    ramp: float  # time in which it crosses the whole range of an input [s]
    sqp_iterations: int  # per call
    start_iterations: int  # from a plan at rest
    start_calls: int  # over which these are spread
    iterations: int  # most factorizations of a QP


@dataclass(frozen=True, kw_only=True)
class ControlParts:
    """Parts that a controller is compiled from: a problem, and of a scene what estimates and supervises."""

    changeable: ClassVar[tuple[Changeable, ...]] = CHANGEABLE
    reported: ClassVar[tuple[Reported, ...]] = REPORTED
    diagnosis: ClassVar[tuple[Reported, ...]] = tuple(number for number in REPORTED if number.exported)
    """Numbers of the last call of a controller, by their names ``exported``."""

    stages: Stages
    calls: ControllerCalls
    ranges: Ranges  # beyond which what is given to it is implausible
    rate: Array  # (nu,) greatest change of the command per time
    supervisor: Settings  # members of ``supervisor_settings``
    filter: Settings  # members of ``ekf_settings``, none without an estimator
    correction: Settings  # members of ``controller_settings`` that correct setpoints which stand
    estimation: Estimation | None = None
    periods: int = 0  # age of a measurement when it arrives

    @staticmethod
    def of_scene(scene: ControlScene, model: Prediction) -> ControlParts:
        """Parts of a scene, whose model exists already."""
        asked = scene.controller
        stages = stages_of(scene, model)
        estimation = None
        _check_period(asked.step, stages, "controller.period")
        if scene.estimator is not None:
            estimation = estimation_of(scene, model, stages.method)
        counts = asked.sqp_iterations, asked.start_iterations, asked.start_calls, asked.iterations
        ranges = ranges_of(scene, model, stages, estimation)
        unknown = estimation.z_names if estimation is not None else ()
        touches = model.system.surroundings is not None or any("contact" in name for name in unknown)
        return ControlParts(
            stages=stages,
            # The safe ramp crosses the whole range of an input in a time in which it does not make the finger swing.
            calls=ControllerCalls(asked.step, np.array(scene.rest_input), scene.finger.rod.slow_time, *counts),
            ranges=ranges,
            rate=np.full(stages.nu, asked.input.rate_max or Stages.ABSENT),
            supervisor=_supervised(scene, stages, estimation, touches),
            filter={} if estimation is None else _filter(scene, model, stages, estimation, ranges),
            correction=_correction(scene, stages, estimation, touches),
            estimation=estimation,
            periods=scene.delay_periods,
        )

    @staticmethod
    def of_problem(stages: Stages, calls: ControllerCalls) -> ControlParts:
        """Parts of a problem without a scene, whose state is given.

        Any finite number is plausible, and nothing is supervised.
        """
        _check_period(calls.period, stages, "period")
        return ControlParts(
            stages=stages,
            calls=calls,
            ranges=_free_ranges(stages, Stages.ABSENT),
            rate=np.full(stages.nu, Stages.ABSENT),
            supervisor=_unsupervised(stages),
            filter={},
            correction=dict(_UNCORRECTED),
        )

    @property
    def observed(self) -> Estimation:
        """The estimator's model; InputError where there is none."""
        if self.estimation is None:
            raise InputError("this needs an `estimator:` section with `measured:`", key="estimator")
        return self.estimation

    @property
    def estimated_names(self) -> tuple[str, ...]:
        """Name and unit of each entry of what a plan starts from: states, then disturbances."""
        s = self.stages
        return s.x_names[: s.nd] if self.estimation is None else self.estimation.z_names

    @property
    def measurement_names(self) -> tuple[str, ...]:
        """Name and unit of each measured number; of the states where there is no estimator."""
        return self.estimated_names if self.estimation is None else self.estimation.measurement_names

    @property
    def sensor_names(self) -> tuple[str, ...]:
        """Supervised devices."""
        return () if self.estimation is None else self.estimation.sensor_names

    @property
    def watched(self) -> tuple[str, ...]:
        """Signals that the supervisor watches: the sensors, then the call rate."""
        return (*self.sensor_names, CALL_RATE)

    @property
    def ahead(self) -> int:
        """Number of the filter's steps from a measurement, some periods ago, to now."""
        return self.periods * int(np.asarray(self.filter["substeps"]))

    @property
    def shared(self) -> int:
        """Number of first steps that serve the next call too; only further ones need the step without derivatives."""
        return max(1, min(_SHARED, self.ahead, int(np.asarray(self.filter["substeps"]))))

    def unlimited(self) -> ControlParts:
        """Parts that take any finite number."""
        return replace(self, ranges=_free_ranges(self.stages, np.inf))

    def macros(self, *, controls: bool, iterations: str = "") -> list[str]:
        """Write the dimensions of the C: of the filter, with ``controls`` of the controller too.

        ``iterations`` is the type in which the real-time iterations compute; empty: they have theirs already.
        """
        s = self.stages
        e = self.estimation
        sizes = dict[str, int]()
        if controls:
            dimensions = {"ND": s.nd, "NM": len(self.measurement_names), "NS": len(self.sensor_names)}
            dimensions |= {"ESTIMATES": int(e is not None)}
            sizes |= {f"CONTROLLER_{name}": size for name, size in dimensions.items()}
        if e is not None:
            dimensions = {"NZ": e.nz, "NX": e.nx, "NU": s.nu, "NP": s.np, "NY": e.ny, "NM": e.nm}
            dimensions |= {"NS": len(e.sensor_names), "NF": len(e.friction), "NA": len(e.adapted)}
            dimensions |= {"DELAY": self.periods, "AHEAD": self.ahead, "STEPS": self.shared}
            sizes |= {f"EKF_{name}": size for name, size in dimensions.items()}
        lines = rti.dimensions(s, iterations) if iterations else []
        return [*lines, *(f"#define {name} {size}" for name, size in sizes.items())]

    @property
    def iteration_bodies(self) -> list[str]:
        """C of the real-time iterations behind their header, without vector lanes."""
        return rti.iteration_bodies(self.stages, lanes=False)

    def settings_in(self, precision: str) -> Settings:
        """Members of ``controller_settings``, for C in double or float."""
        s, calls, ranges = self.stages, self.calls, self.ranges
        real = np.float64 if precision == "double" else np.float32
        iteration: Settings = {member.name: getattr(s, member.name) for member in self.changeable}
        iteration |= {"stage": s.stage, "substeps": s.substeps, "iterations": calls.iterations}
        iteration |= {"tolerance": float(real(rti.TOLERANCE[precision]))}
        iteration |= {"regularization": rti.regularization(s.u_min, s.u_max), **rti.scenario_settings(s)}
        limits = {"applied": ranges.applied, "r": ranges.r, "p": ranges.p, "x": ranges.x}
        settings: Settings = {"period": calls.period, "u_rate": self.rate, "u_safe": calls.safe}
        # The C refuses a rate of zero, which an input that cannot move would have.
        settings["safe_rate"] = np.maximum((s.u_max - s.u_min) / calls.ramp, 1e-9)
        for name, pairs in limits.items():
            settings |= {f"{name}_min": pairs[:, 0], f"{name}_max": pairs[:, 1]}
        settings |= {f"reach_{end}": ranges.reach[:, k] for k, end in enumerate(("min", "max", "radius"))}
        settings |= {name: getattr(calls, name) for name in ("sqp_iterations", "start_iterations", "start_calls")}
        return {
            **_nested("rti", iteration),
            **settings,
            **self.correction,
            **_nested("supervisor", self.supervisor),
            **_nested("ekf", self.filter),
        }


def _free_ranges(stages: Stages, most: float) -> Ranges:
    """Ranges of a problem without a scene: all numbers up to a magnitude."""
    sizes = {"x": stages.nd, "r": stages.nr, "p": stages.np, "applied": stages.nu}
    limits = {key: np.tile((-most, most), (size, 1)) for key, size in sizes.items()}
    reach = np.tile((-most, most, 0.0), (stages.nr, 1))
    return Ranges(disturbances=np.zeros((0, 2)), measurement=limits["x"], reach=reach, **limits)


def _nested(name: str, settings: Mapping[str, ArrayLike]) -> Settings:
    return {f"{name}.{member}": values for member, values in settings.items()}


def _check_period(period: float, stages: Stages, key: str) -> None:
    # A plan is followed within its first stage; equal up to the rounding of a duration over a count.
    if period > stages.stage * (1.0 + 1e-9):
        raise InputError(
            f"{period:g} s is longer than a stage of {stages.stage:g} s, over which the plan holds an input: expected "
            "a period of at most a stage",
            key=key,
        )


def _window(scene: ControlScene) -> int:
    """Return the number of calls over which a controller's supervisor averages."""
    return max(_LEAST_WINDOW, math.ceil(_WINDOW * scene.finger.rod.natural_time / scene.controller.step - 1e-9))


def _filter(scene: ControlScene, model: Prediction, stages: Stages, estimation: Estimation, ranges: Ranges) -> Settings:
    """Members of ``ekf_settings`` of a scene with an estimator."""
    process, initial, measured = noise_of(scene, model, estimation)
    states = np.vstack([ranges.x, ranges.disturbances])
    period = scene.controller.step
    # At a limit for long, others are beyond what is plausible: there is no friction below none and none beyond its
    # limit, and an adapted parameter may be as far off as the range that it is adapted in.
    adapted = [adapted_state.state for adapted_state in estimation.adapted]
    natural = [
        int(k in adapted or name.startswith(("tendon_friction", "unknown_contact_friction")))
        for k, name in enumerate(estimation.z_names)
    ]
    drives = {drive.state: 1 for drive in model.driven} | {rate: 2 for drive in model.driven for rate in drive.rate}
    # Steps as long as the stages, if the stiffness allows them; rounding must not add one.
    substeps = max(1, math.ceil(stages.substeps * period / stages.stage - 1e-9))
    settings: Settings = {
        "noise": process,
        "initial": initial,
        "z_min": states[:, 0],
        "z_max": states[:, 1],
        "natural": natural,
        "mixing": estimation.mixing,
        "variance": measured,
        "y_min": ranges.measurement[:, 0],
        "y_max": ranges.measurement[:, 1],
        "period": period,
        "substeps": substeps,
        "gate": scene.estimator.outlier if scene.estimator is not None else math.inf,
        "sensor": [estimation.sensor_names.index(name) for name in estimation.sensors],
        "drive": [drives.get(k, 0) for k in range(estimation.nx)],
        "fade": 2.0 / _window(scene),
    }
    if estimation.friction:
        settings["friction"] = estimation.friction
    if adapted:
        settings |= {"adapted": adapted, "memory": memory_of(scene.finger)}
        settings["quiet"] = quiet_sensitivities(scene, model, estimation, substeps)
    return settings


def _unsupervised(stages: Stages) -> Settings:
    """Members of ``supervisor_settings`` where nothing is supervised."""
    none = np.full(stages.nd, -1)
    return {
        **dict.fromkeys(("window", "delay", "rungs"), 0),
        "sensor": 0 * none,
        "shape": [0],
        "drive": [0],
        "cause": none,
        "still": np.full(stages.nd, -1.0),
        "noise": np.full(stages.nd, -1.0),
        "hidden": np.zeros(stages.nd),
        "change": np.ones(stages.nu),
        "tip": -1,
        "setpoint": -1,
        "far": 1.0,
        "settling": 0,
        "offset": 0.0,
    }


def _supervised(scene: ControlScene, stages: Stages, estimation: Estimation | None, touches: bool) -> Settings:
    """Members of ``supervisor_settings`` of a scene."""
    asked = scene.controller
    period = scene.controller.step
    names = estimation.measurement_names if estimation is not None else tuple("x" * stages.nd)
    devices = estimation.sensor_names if estimation is not None else ()
    sensor = [devices.index(estimation.device(name)) for name in names] if estimation is not None else [0] * len(names)
    free = estimation is not None and not touches
    # Of what has no noise the reading of a finger at rest repeats itself.
    checks_frozen = scene.estimator is not None and scene.estimator.frozen and scene.plant.noise > 0.0
    crossing = _CROSSING * scene.finger.rod.natural_time
    rate = np.minimum(asked.input.rate_max or math.inf, (stages.u_max - stages.u_min) / crossing)
    tip = _first("tip_x [m]", names)
    length = scene.finger.rod.length
    return {
        "window": _window(scene) if asked.supervisor else 0,
        "delay": scene.delay_periods + _SETTLING,
        # Without a weight of the command's rate there is nothing to raise.
        "rungs": _RUNGS if asked.cost.input_rate else 0,
        "sensor": sensor,
        # Tip and angles show the shape, the pose of an object neither that nor a drive.
        "shape": [int(name in ("tip", "bending")) for name in devices] or [0],
        "drive": [int(name not in ("tip", "bending", "object")) for name in devices] or [0],
        # A tension moves with its own command, everything else with all of them.
        "cause": [_first(name, stages.u_names) for name in names],
        # Below zero: not tested.
        "still": [_STILL * scene.measurement_std(name) if checks_frozen else -1.0 for name in names],
        # A finger that touches something is held by it, whatever its drives do: then below zero.
        "noise": [scene.measurement_std(name) if free else -1.0 for name in names],
        "hidden": [_HELD**2 if scene.finger.has_tendon_friction else 0.0] * len(names),
        # Divisors in the C: not zero where an input cannot move.
        "change": np.maximum(rate * period, 1e-12),
        "tip": tip,
        "setpoint": _first("tip_x [m]", stages.r_names),
        "far": _FAR * length,
        # A plan's length and the time in which disturbances are found.
        "settling": math.ceil(stages.stages * stages.stage / period - 1e-9) + 5 * _window(scene),
        "offset": max(_OFFSET * length, 4.0 * scene.measurement_std("tip_x [m]")) if tip >= 0 else 0.0,
    }


_UNCORRECTED: Settings = {"correction": 0.0, "correction_most": 0.0, "correction_after": 0}


def _correction(scene: ControlScene, stages: Stages, estimation: Estimation | None, touches: bool) -> Settings:
    """Members of ``controller_settings`` by which setpoints that stand are corrected where a finger touches nothing."""
    measured = estimation.measurement_names if estimation is not None else ()
    if touches or "tip_x [m]" not in measured or "tip_x [m]" not in stages.r_names:
        return dict(_UNCORRECTED)
    return {
        # Means over five of the supervisor's windows, from a horizon after the setpoint moved.
        "correction": 1.0 / (5 * _window(scene)),
        "correction_most": _CORRECTED * scene.finger.rod.length,
        "correction_after": math.ceil(stages.stages * stages.stage / scene.controller.step - 1e-9),
    }


def _first(name: str, names: tuple[str, ...]) -> int:
    return names.index(name) if name in names else -1
