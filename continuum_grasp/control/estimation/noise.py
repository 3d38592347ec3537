"""Noise of states and measurements, and the ranges beyond which numbers are implausible."""

from __future__ import annotations

import math
from dataclasses import dataclass

import casadi as ca
import numpy as np

from continuum_grasp.base import Array, InputError
from continuum_grasp.control.estimation.model import Estimation
from continuum_grasp.control.ocp.cost_terms import REACH, UNLIMITED, Outputs
from continuum_grasp.control.ocp.stages import Stages
from continuum_grasp.control.prediction import Prediction
from continuum_grasp.control.quantities import OBJECT_POSE
from continuum_grasp.scene import ControlScene, MotorDrive

_DRIVE = 0.01
"""Standard deviation of a drive at rest from the model of its lag, as a share of the greatest tip moment [1]: four
times the noise of the tension sensors in configs/mpc, so that the filter trusts these more than the model."""
_DRIVE_AT_START = 0.1
"""Noise of the drive at the start [1], where the tensions before are unknown."""
_SWINGING = 0.764
"""Rate of a bend at the start, per its deviation and in a natural time of the finger [1]: a fifth of the angular
frequency of the first mode of a uniform rod, 10 per second of the hand finger."""
_ACCELERATION = 0.2113
"""Unmodeled acceleration of a bend where the scene states none, in natural times of the finger to the power of -1.5
[1]: 10 rad/s2 s^0.5 of the hand finger."""
_OBJECT_ACCELERATION = 0.01174
"""Deviation of an object, in finger lengths too [1]: 0.1 m/s2 s^0.5 of the hand finger."""
_MARGIN = 1.5
"""Limits of estimates and measurements as multiples of the model's limits [1]: an estimate may overshoot by noise, but
the model's series are accurate within its range only."""
_SEEN_OFF = 0.1
"""Greatest error of a measured tip across its path, in finger lengths [1]: a camera that is turned by 6 degrees."""
_FORCES = 100.0
"""Greatest unknown force as a multiple of EI/L2 [1]: 2.5 EI/L2 buckles a clamped rod, so this is far beyond any
touch."""
_MOMENT = 2.0
"""Greatest missing tip moment per greatest commanded one [1]: a larger moment is no model error."""
_STABLE = 2.5
"""Greatest step of RK4 in time constants of the drive [1]: it is stable up to 2.78."""
_PAYLOAD = 20.0
"""Greatest unknown mass at the tip, in masses of a rod that is everywhere as at its base [1]: more stops its motion."""
_KNOWN = 10.0
"""Greatest known force or moment as a multiple of the greatest unknown one [1]: larger than an error."""


@dataclass(frozen=True)
class Ranges:
    """Limits beyond which numbers are implausible: least and most of each entry, (size, 2).

    ``applied`` limits an applied input, which may be off (0 N) or beyond what can be commanded; ``reach`` (nr, 3)
    limits setpoints that can be met, with the radius of a circle about their middle at the x of a point.
    """

    x: Array
    disturbances: Array
    measurement: Array
    applied: Array
    r: Array
    reach: Array
    p: Array


def noise_of(scene: ControlScene, model: Prediction, estimation: Estimation) -> tuple[Array, Array, Array]:
    """Compute the noise of a scene's estimator: of the states the intensity, variance per second (nz), and the variance
    at the start (nz), and the variance of each compared quantity (ny).

    White noise drives the rate of each coordinate so that the bending angles (root of the sum of squares over the
    elements) have the acceleration of ``acceleration_std``, and a lagging drive so that it differs from its model by a
    hundredth of its greatest moment. Disturbances are random walks; their variance at the start comes from
    ``estimator.spread``, or is their variance after 100 control periods.
    """
    if scene.estimator is None:
        raise InputError("this needs an `estimator:` section with `measured:`", key="estimator")
    asked = scene.estimator
    process, initial = np.zeros(estimation.nz), np.zeros(estimation.nz)
    n = model.system.finger_model.n
    bends = ca.jacobian(model.bending(model.x, model.u, model.p), model.x)
    slope = ca.Function("slope", [model.x, model.u, model.p], [bends])
    j = np.array(slope(np.zeros(model.nx), np.zeros(model.nu), model.p_nominal))[:, :n]
    # Coordinates differ in unit and effect between families; noise refers to the bending angles, which do not.
    per_angle = 1.0 / np.sqrt((j**2).sum(axis=0))
    rod = scene.finger.rod
    per_time = rod.natural_time**-1.5
    process[n : 2 * n] = ((asked.acceleration_std or _ACCELERATION * per_time) * per_angle) ** 2
    initial[:n] = (asked.initial_std * per_angle) ** 2
    swinging = _SWINGING / rod.natural_time
    initial[n : 2 * n] = (swinging * asked.initial_std * per_angle) ** 2
    for drive in model.driven:
        # Under white noise s a lag of time T has the variance s^2 T / 2, a critically damped one s^2 T^3 / 4.
        wanted = (_DRIVE * drive.most) ** 2
        rate = [*drive.rate]
        lag = drive.lag
        process[rate or drive.state] = 4.0 * wanted / lag**3 if rate else 2.0 * wanted / lag
        initial[drive.state], initial[rate] = (
            (_DRIVE_AT_START * drive.most) ** 2,
            (_DRIVE_AT_START * drive.most / lag) ** 2,
        )
    body = model.system.surroundings
    if asked.measured.object is not None and body is not None and body.object is not None:
        pose = model.system.object_states
        count = pose.stop - pose.start
        rates = slice(pose.stop, pose.stop + count)
        gyration = math.sqrt(body.inertia / body.object.mass)
        per_rate = np.array([1.0, 1.0, 1.0 / gyration, *[0.0] * (count - 3)])
        pushed = asked.object_acceleration_std or _OBJECT_ACCELERATION * rod.length * per_time
        process[rates] = (pushed * per_rate) ** 2
        seen = [scene.measurement_std(name) for name in OBJECT_POSE]
        # It is where the scene has it but for what a camera would show, and nearly at rest: an acceleration of that
        # size acts on it for a period.
        initial[pose] = np.square([*seen, *[0.0] * (count - 3)])
        initial[rates] = process[rates] * scene.controller.step
    process[model.nx :] = estimation.drifts**2
    initial[model.nx :] = estimation.spreads**2
    for at in estimation.friction:
        # They are anywhere between -1 and 1, because the history is unknown.
        initial[at] = 1.0 / 3.0
    variances = np.array([scene.measurement_std(name) ** 2 for name in estimation.measurement_names])
    # Measurements are independent: variances add with the squares of their shares.
    return process, initial, estimation.mixing**2 @ variances


def ranges_of(scene: ControlScene, model: Prediction, stages: Stages, estimation: Estimation | None) -> Ranges:
    """Compute the limits of states, disturbances, measurements, setpoints and parameters of a scene."""
    cost = scene.controller.cost
    x = _state_range(model, stages)
    unknown = estimation.z_names[estimation.nx :] if estimation is not None else ()
    measured = estimation.measurement_names if estimation is not None else ()
    applied = np.array([_applicable(scene, model, name) for name in stages.u_names])
    outputs = Outputs.of(cost, model)
    return Ranges(
        x=x,
        disturbances=np.array([_unknown_range(model, stages, name) for name in unknown]).reshape(-1, 2),
        # Without an estimator the state is measured.
        measurement=np.array([measurement_range(scene, model, name) for name in measured]) if measured else x,
        # The range of the drives includes the range of commands; a drive that is off is below the least tension.
        applied=np.stack([np.minimum(applied[:, 0], stages.u_min), np.maximum(applied[:, 1], stages.u_max)], axis=1),
        r=np.vstack([term.ranges(cost, model) for term in outputs.terms]),
        reach=np.vstack([term.entries_in_reach(outputs.reach, cost, model) for term in outputs.terms]),
        p=np.array([_parameter_range(model, *v) for v in zip(model.p_names, model.p_nominal, strict=True)]).reshape(
            -1, 2
        ),
    )


def _state_range(model: Prediction, stages: Stages) -> Array:
    """Coordinates well beyond the bending range, and rates of the fastest mode at that amplitude."""
    finger = model.system.finger_model
    n = model.system.finger_model.n
    bend = max(map(finger.structure.family.coordinate_size, finger.ranges, finger.lengths))
    limits = np.full(model.nx, UNLIMITED)
    limits[:n] = _MARGIN * bend
    limits[n : 2 * n] = _MARGIN * bend * model.fastest_rate(stages.u_min, stages.u_max)
    for drive in model.driven:
        # A step of the command: 0.37 moment / lag.
        limits[[drive.state, *drive.rate]] = 2.0 * drive.most, *[10.0 * drive.most / drive.lag] * len(drive.rate)
    return np.stack([-limits, limits], axis=1)


def _unknown_range(model: Prediction, stages: Stages, name: str) -> tuple[float, float]:
    """Range of a disturbance or of the error of an adapted parameter."""
    rod = model.scene.finger.profile
    nominal = dict(zip(model.p_names, model.p_nominal, strict=True))
    if name == "drive_time_constant_error [1]":
        # From a quarter to four times the nominal one, within the stability of the integrator's steps.
        limit = _STABLE * nominal["drive_time_constant [s]"]
        stable = stages.stage / stages.substeps / limit if stages.method == "rk4" else 0.0
        return (max(0.25, stable) - 1.0, 3.0)
    if name == "tip_mass_error [kg]":
        return (-nominal["tip_mass [kg]"], _PAYLOAD * float(rod.linear_density(0.0)) * rod.length)
    limits = {
        "bending_stiffness": (-0.9, 9.0),  # from a tenth to ten times the nominal one
        "tendon_friction": (-1.0, 9.0),  # from none to ten times the nominal one
        "object_": (-rod.length, rod.length),
        "tip_offset": (-_SEEN_OFF * rod.length, _SEEN_OFF * rod.length),
        "unknown_contact_friction": (-1.0, 1.0),  # of its limit
    }
    greatest = _greatest_unknown(model, name)
    return next((pair for start, pair in limits.items() if name.startswith(start)), (-greatest, greatest))


def _greatest_unknown(model: Prediction, name: str) -> float:
    """Greatest unknown force [N] or moment [N m], by its name and unit."""
    if name.endswith("[N m]"):
        return _MOMENT * model.scene.greatest_moment
    rod = model.scene.finger.profile
    return _FORCES * float(rod.bending_stiffness(0.0)) / rod.length**2


def _applicable(scene: ControlScene, model: Prediction, name: str) -> tuple[float, float]:
    """Range of the applied input, by its name."""
    if not scene.finger.winches:
        return measurement_range(scene, model, name)
    low, high = (limit[model.u_names.index(name)] for limit in scene.input_limits)
    return (1.5 * low - 0.5 * high, 1.5 * high - 0.5 * low)


def measurement_range(scene: ControlScene, model: Prediction, name: str) -> tuple[float, float]:
    """Return the least and the greatest plausible measurement, by its name."""
    finger = scene.finger
    middle = 0.0
    word, _, last = name.split(" ")[0].rpartition("_")
    number = int(last) - 1 if last.isdigit() else 0
    if word == "tension":
        greatest = finger.tendon_list[number].max_tension
        return (-0.5 * greatest, 2.0 * greatest)  # a slack tendon may read below zero, and a drive overshoot
    if word == "pressure":
        chamber = finger.chambers[number]
        reach = chamber.max_pressure - chamber.min_pressure
        return (chamber.min_pressure - reach, chamber.max_pressure + reach)
    if word in ("tip", "object") and last in ("x", "y"):
        reach = (_MARGIN if word == "tip" else REACH) * finger.rod.length
        middle = finger.base.position["xy".index(last)]
    elif word == "object":
        reach = UNLIMITED
    elif word == "angle":
        middle = finger.base.angle
        reach = math.pi + _MARGIN * sum(model.system.finger_model.ranges)
    elif word in ("length", "motor_angle"):
        reach = 2.0 * model.driven[number].most
    elif finger.winches:
        drive = finger.winches[number]
        reach = 2.0 * drive.torque_max if isinstance(drive, MotorDrive) else math.inf
    else:
        reach = 2.0 * model.scene.greatest_moment
    return (middle - reach, middle + reach)


def _parameter_range(model: Prediction, name: str, nominal: float) -> tuple[float, float]:
    unit = name[name.index("[") + 1 : -1]
    if unit in ("N", "N m"):
        greatest = _KNOWN * _greatest_unknown(model, name)
        return (-greatest, greatest)
    # Parameters of either sign, or with a nominal value of zero.
    if name.startswith(("gravity", "base_", "rest_curvature", "object_", "tip_offset")):
        return (-UNLIMITED, UNLIMITED)
    # Stiffness, masses and the like are positive; one that is nominally zero has no scale of its own.
    return (1e-3 * nominal, 1e3 * nominal) if nominal > 0.0 else (0.0, UNLIMITED)
