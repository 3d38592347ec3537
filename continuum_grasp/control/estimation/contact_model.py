"""Settings and functions of a contact detector: members for what is uncertain, friction of motors, noise."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from continuum_grasp.base import Array, InputError
from continuum_grasp.control.estimation.free_finger import FreeFinger
from continuum_grasp.control.estimation.model import torque_name
from continuum_grasp.control.estimation.noise import measurement_range
from continuum_grasp.control.prediction import Prediction, first_state
from continuum_grasp.core import straight_function
from continuum_grasp.model import Motor, Scalar, Winch, winches_of
from continuum_grasp.scene import ControlScene, Measured, MotorDrive
from continuum_grasp.simulation import Friction, friction_of

_NOISE = 6.0
"""Standard deviations that noise reaches [1]: one sample of normal noise in 5e8 exceeds them."""
_SURE = 4.0
"""Standard deviations of a speed by differences from which on its direction is known [1]."""
_FILTER = 0.2617
"""Time constant of the filter where the scene states none, in natural times of the finger [1]: 20 ms of the hand
finger."""
_FADING = 5.0
"""Time constant of what a member deviated by before, in those of the filter [1]: 0.1 s, over half a period of the hand
finger's first mode. Without it one of nine random plants in motion
exceeded its bounds for 10 ms, by 13 %."""
_OF_MOTORS = ("inertia", "viscous", "dry", "slow", "ending", "jerk", "held", "noise")
"""Settings per drive that describe its motor."""
_MOST = 4000
"""Samples of an impulse response [1]: the longest filter, 1 s at periods of 1 ms, has died down to 2 %."""


@dataclass(frozen=True)
class ContactModel:
    """The model of a contact detector."""

    finger: FreeFinger
    measured: ca.Function
    """(y, u, before, h) -> length (winches), pull (winches): what winches have wound up [m], and what motors or sensors
    pull them with [N]."""
    measurement_names: tuple[str, ...]  # name and unit of each entry of y
    members: Array  # (M, np) parameters of the first, and at all combinations of the ends of uncertain numbers
    groups: tuple[int, ...]  # what each member is uncertain in; -1: the first
    scene: ControlScene

    @cached_property
    def prediction(self) -> Prediction:
        """The controller's model of the scene."""
        return Prediction(self.scene)

    @cached_property
    def lengths(self) -> Array:
        """Lengths that winches have wound up at the start of the scene [m]."""
        winches = winches_of(self.scene.finger)
        start, driven = first_state(self.scene, self.prediction), self.prediction.driven
        return np.array([w.radius * start[each.state] for w, each in zip(winches, driven, strict=False)])

    @cached_property
    def settings(self) -> dict[str, ArrayLike]:
        """Members of ``contact_settings``, the states at the start first."""
        return self.settings_within(self.measurement_names)

    def settings_within(self, names: Sequence[str]) -> dict[str, ArrayLike]:
        """Members for a step that is given the measurements of these names."""
        return {**_settings(self.scene, self), "felt": [names.index(name) for name in self.measurement_names]}

    @property
    def functions(self) -> list[ca.Function]:
        """Functions that the C calls."""
        return [self.measured, self.finger.step, self.finger.tension, self.finger.gain]

    @property
    def sizes(self) -> dict[str, int]:
        """Dimensions of the C."""
        finger = self.finger
        return {
            "ND": len(finger.winches),
            "NS": finger.size,
            "NF": finger.friction_states,
            "NP": finger.nominal.size,
            "NM": len(self.groups),
            "NG": max(self.groups) + 1,
            "NY": len(self.measurement_names),
            "NU": len(finger.winches),
            "NL": len(finger.places),
        }

    def first(self, lengths: Array, friction: Friction | None) -> Array:
        """States (M, size) of all members at rest where the winches have wound up lengths [m].

        ``friction`` says how the finger came there, as ``equilibrium_under`` takes it; None: that is not known.
        """
        finger, count = self.finger, len(self.groups)
        if friction is not None or not finger.friction_states:
            return np.tile(finger.start(lengths, friction or {}), (count, 1))
        states = np.tile(finger.start(lengths, {"reached_by": "pulling"}), (count, 1))
        states[-1] = finger.start(lengths, {"reached_by": "releasing"})
        return states


def contact_model_of(scene: ControlScene) -> ContactModel:
    """Build the model of a scene's contact detector."""
    asked = None if scene.estimator is None else scene.estimator.contact_detection
    if scene.estimator is None or asked is None:
        raise InputError("this needs `estimator.contact_detection`", key="estimator.contact_detection")
    finger = scene.finger
    errors = {
        "bending_stiffness": asked.bending_stiffness,
        "tendon_friction": asked.tendon_friction if finger.has_tendon_friction else 0.0,
        "tip_mass": asked.payload,
    }
    names = tuple(name for name, error in errors.items() if error > 0.0)
    length = finger.rod.length
    free = FreeFinger(scene, names, asked.places or (0.5 * length, length))
    # All combinations of ends: a payload bends a finger that is softer by more than both add up to.
    ends = [
        (nominal, nominal + errors[name])
        if name == "tip_mass"
        else (nominal * (1.0 - errors[name]), nominal * (1.0 + errors[name]))
        for name, nominal in zip(names, free.nominal, strict=True)
    ]
    members = [free.nominal, *(np.array(corner) for corner in product(*ends) if names)]
    groups = [-1] + [0] * (len(members) - 1)
    if finger.has_tendon_friction:
        members += [free.nominal] * 2
        groups += [max(groups) + 1] * 2
    measured, labels = _measured(scene.estimator.measured, winches_of(finger), scene)
    return ContactModel(free, measured, labels, np.array(members), tuple(groups), scene)


def _measured(asked: Measured, winches: tuple[Winch, ...], scene: ControlScene) -> tuple[ca.Function, tuple[str, ...]]:
    count = len(winches)
    names = [winch.names(k + 1)[0] for k, winch in enumerate(winches)]
    if not isinstance(winches[0], Motor):
        names += [f"tension_{k + 1} [N]" for k in range(len(scene.finger.tendon_list))]
    elif asked.torque is not None:
        names += [torque_name(k + 1) for k in range(count)]
    sizes = {"y": len(names), "u": count, "before": count, "h": 1}
    symbols = {name: ca.SX.sym(name, size) for name, size in sizes.items()}
    y, u = symbols["y"], symbols["u"]
    lengths, pulls = [], list[Scalar]()
    for k, winch in enumerate(winches):
        lengths.append(winch.radius * y[k])
        if not isinstance(winch, Motor):
            pulls.append(
                sum((side * y[count + j] for side, j in zip(winch.sides, winch.tendons, strict=True)), ca.SX(0))
            )
            continue
        if len(names) > count:
            torque: Scalar = y[count + k]
        else:
            torque = winch.torque(u[k], y[k], (lengths[k] - symbols["before"][k]) / (symbols["h"] * winch.radius))
        pulls.append(torque / winch.radius)
    outputs = {"length": ca.vertcat(*lengths), "pull": ca.densify(ca.vertcat(*pulls))}
    return straight_function("contact_measured", symbols, outputs), tuple(names)


def _settings(scene: ControlScene, model: ContactModel) -> dict[str, ArrayLike]:
    if scene.estimator is None or scene.estimator.contact_detection is None:
        raise InputError("this needs `estimator.contact_detection`", key="estimator.contact_detection")
    asked, period = scene.estimator.contact_detection, scene.controller.step
    finger = model.finger
    lag = asked.time_constant or _FILTER * scene.finger.rod.natural_time
    blend = -math.expm1(-period / lag)
    motors = winches_of(scene.finger)
    prediction = model.prediction
    friction: Friction | None = None
    if asked.history_known and scene.initial.reached_by is not None:
        friction = friction_of(scene.initial, finger.model)
    elif asked.history_known:  # it never slid
        friction = {"reached_by": "state", "friction_states": [0.0] * finger.friction_states}
    names = (*prediction.x_names[: 2 * finger.n], *finger.model.friction_names)
    limits = [measurement_range(scene, prediction, name) for name in model.measurement_names]
    frictions = [_friction(scene.estimator.measured, winch, period, blend) for winch in motors]
    return {
        "first": model.first(model.lengths, friction),
        "p": model.members,
        "group": model.groups,
        "period": period,
        "substeps": finger.substeps(model.members, period),
        "blend": blend,
        "fade": math.exp(-period / (_FADING * lag)),
        **{name: [each[name] for each in frictions] for name in _OF_MOTORS},
        "single": [int(len(winch.tendons) == 1) for winch in motors],
        "dry_error": asked.coulomb_friction,
        "model_error": asked.tension,
        "y_min": [low for low, _ in limits],
        "y_max": [high for _, high in limits],
        "from": [prediction.x_names.index(name) for name in names],
        "history_known": int(asked.history_known),
    }


def _friction(measured: Measured, winch: Winch, period: float, blend: float) -> dict[str, float]:
    """Inertia and friction of a motor by the cable, and the noise of its residual."""
    drive, radius = winch.drive, winch.radius
    motor = drive if isinstance(drive, MotorDrive) else None
    inertia = 0.0 if motor is None else motor.inertia / radius**2
    viscous = 0.0 if motor is None else motor.viscous_friction / radius**2
    noisy = radius * ((measured.angle if motor is not None else measured.length) or 0.0)
    # As the C weighs samples now, one and two periods before.
    stiff = float(winch.stiffness) * len(winch.tendons)
    weights = -stiff * np.array([0.25, 0.5, 0.25]) - inertia / period**2 * np.array([1.0, -2.0, 1.0])
    weights -= viscous / (2.0 * period) * np.array([1.0, 0.0, -1.0])
    if motor is None:
        pulled = (measured.tension or 0.0) * math.sqrt(len(winch.tendons))
    elif measured.torque is not None:
        pulled = measured.torque / radius
    else:
        pulled = 0.0  # of commands, which are known
    variance = (noisy * _filtered(weights, blend)) ** 2 + (pulled * _filtered(np.array([0.25, 0.5, 0.25]), blend)) ** 2
    slow = radius * winch.slow if motor is not None else 1.0
    ending, jerk = (1.0, 0.0) if motor is None else _at_end(motor, period)
    return {
        "inertia": inertia,
        "viscous": viscous,
        "dry": 0.0 if motor is None else motor.coulomb_friction / radius,
        "slow": max(slow, _SURE * math.sqrt(2.0) * noisy / period),
        "ending": ending,
        "jerk": jerk / radius**2,
        "held": 0.5 if motor is not None and motor.position_gain is None else 0.0,
        "noise": _NOISE * math.sqrt(variance),
    }


def _at_end(motor: MotorDrive, period: float) -> tuple[float, float]:
    """Speed of a servo at the end of a period over the mean one, and its torque for that alone [N m s].

    The command goes up by the same step at the begin of each period; a smooth one gives 1 and 0.
    """
    if motor.position_gain is None:
        return 1.0, 0.0
    inertia, damping = max(motor.inertia, 1e-12), motor.viscous_friction + motor.rate_gain
    slope = np.array([[0.0, 1.0], [-motor.position_gain / inertia, -damping / inertia]])
    values, vectors = np.linalg.eig(slope.astype(complex) * period)
    moved = (vectors @ np.diag(np.exp(values)) @ np.linalg.inv(vectors)).real
    # What it lags behind by and its rate at the end of a period of steps of one mean speed times the period.
    end = np.linalg.solve(np.eye(2) - moved, moved @ np.array([-period, 0.0]))
    return min(max(float(end[1]), 0.0), 1.0), abs(inertia * float(slope[1] @ end))


def _filtered(weights: Array, blend: float) -> float:
    """Deviation of weighted white noise after the low-pass filter, per deviation of a sample."""
    response = np.convolve(weights, blend * (1.0 - blend) ** np.arange(_MOST))
    return float(np.linalg.norm(response))
