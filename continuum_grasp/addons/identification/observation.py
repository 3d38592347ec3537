"""Measured quantities as expressions of a model, along the finger and at the drives of its tendons, and the smoothest
shape and rates that the first samples of a motion show.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, cast

import casadi as ca
import numpy as np

from continuum_grasp.addons.identification.data import START_SAMPLES, Reading, column
from continuum_grasp.addons.identification.least_squares import least_squares
from continuum_grasp.addons.identification.rows import symbols
from continuum_grasp.addons.identification.unknowns import START, Unknown
from continuum_grasp.base import Array, InputError, SolverError, split_unit
from continuum_grasp.model import FingerModel
from continuum_grasp.scene import Consumer


def observed(
    model: FingerModel,
    readings: Sequence[Reading],
    q: ca.SX,
    u: ca.SX,
    p: ca.SX,
    drives: Callable[[], Sequence[ca.SX]] = tuple,
    offsets: ca.SX | None = None,
) -> ca.SX:
    """Readings of a finger, where ``drives`` gives tensions of its tendons and states of its drives.

    ``offsets`` (readings) [m] replace the readings' own offsets, which may differ from row to row. InputError if a
    position is not on the finger, or a drive is not one of it.
    """
    at_drives = drives() if any(reading.of_drive for reading in readings) else ()
    values = [
        _at_drive(model, reading, u, *at_drives)
        if reading.of_drive
        else _along(model, reading, q, u, p, reading.offset if offsets is None else offsets[k])
        for k, reading in enumerate(readings)
    ]
    return ca.vertcat(*values)


def _along(model: FingerModel, reading: Reading, q: ca.SX, u: ca.SX, p: ca.SX, offset: Any) -> ca.SX:
    length = model.finger.rod.length
    s = length if reading.at is None else reading.at
    if not 0.0 <= s <= length * (1 + 1e-9):  # the tip as a sum of lengths is rounded
        raise InputError(f"{reading.quantity} at {s:g} m is not on the finger of {length:g} m", key="measured")
    if reading.quantity in ("x", "y"):
        on_backbone = model.position(q, u, s, p)["xy".index(reading.quantity)]
        if not np.any(reading.offset):
            return on_backbone
        if not isinstance(offset, ca.SX) and np.ndim(offset):
            raise InputError("along a motion the offset of a marker must be one number", key="measured")
        across = model.orientation(q, u, s, p)
        return cast(ca.SX, on_backbone + offset * (ca.cos(across) if reading.quantity == "x" else ca.sin(across)))
    base = model.orientation(q, u, reading.since or 0.0, p) if reading.quantity == "bend" else 0.0
    return model.orientation(q, u, s, p) - base


_OF_MOTORS = Consumer.refusals(
    "data.measured.quantity={motor_angle,torque} without kind=motor: needs a motor: this drive has another kind"
)


def _at_drive(model: FingerModel, reading: Reading, u: ca.SX, tensions: ca.SX, states: ca.SX) -> ca.SX:
    number = (reading.of or 1) - 1
    winches = model.structure.winches
    count = len(model.finger.tendon_list) if reading.quantity == "tension" else len(winches)
    if number >= count:
        what = "tendons" if reading.quantity == "tension" else "drives"
        raise InputError(f"no {reading.quantity} {number + 1}: the finger has {count} {what}", key="measured")
    if reading.quantity == "tension":
        return tensions[number]
    start = sum(winch.states for winch in winches[:number])
    winch = winches[number]
    drive_states = states[start : start + winches[number].states]
    if reading.quantity == "length":
        return winch.radius * drive_states[0]
    for refusal in _OF_MOTORS:
        refusal.check(winch.drive, of={f"data.measured.quantity={reading.quantity}": "measured"})
    if reading.quantity == "motor_angle":
        return drive_states[0]
    (motor,) = (motor for motor in model.structure.motors if motor is winch)
    return ca.SX(motor.torque(u[number], drive_states[0], drive_states[1]))


def check_tensions(model: FingerModel, readings: Sequence[Reading], name: str) -> None:
    """Raise an InputError for tensions of tendons that have none of their own."""
    if not model.structure.own_tendons and any(reading.quantity == "tension" for reading in readings):
        raise InputError(
            "only tendons with friction or on winches have a predicted tension at the drive; this one equals its "
            "command: make it a condition",
            key=name,
        )


class MeasuredStart:
    """Coordinates q and rates qd (n,) that minimize, with J the derivative of the readings with respect to q,

    ``|readings(q) - y|^2 + s |q / reach|^2`` and ``|J qd - v|^2 + s |qd slow / reach|^2``,

    where y and v are value and slope of a parabola through the first samples of each reading, positions per length of
    the finger, and ``slow`` is a time scale of bending [s]. ``z`` are inputs, forces and parameters [u, w, p] there.
    """

    def __init__(self, model: FingerModel, readings: Sequence[Reading], t: Array, z: Array, name: str) -> None:
        self._model = model
        self._name = name
        self._z = z
        readings = [reading for reading in readings if not reading.of_drive]
        rod = model.finger.rod
        length = model.finger.rod.length
        self._reach = model.structure.family.coordinate_size(min(model.ranges), max(model.lengths))
        self._slow = length**2 * float(np.sqrt(rod.mass_per_length / rod.stiffness))
        first = np.stack([column(name, reading.values)[:START_SAMPLES] for reading in readings])
        after = t[:START_SAMPLES] - t[0]
        # value, slope and curvature of a parabola
        parabola = np.linalg.lstsq(np.vander(after / after[-1], 3, increasing=True), first.T, rcond=None)[0]
        self._scale = np.array([1.0 / length if reading.quantity in ("x", "y") else 1.0 for reading in readings])
        self._value = self._scale * parabola[0]
        self._slope = self._scale * parabola[1] / after[-1]
        q, u, w, p = symbols(model)
        y = self._scale * observed(model, readings, q, u, p)
        inputs = [q, ca.vertcat(u, w, p), ca.SX.sym("target", self._value.size)]
        # 1e-4: weight of the squared coordinates per range beside that of the squared readings per length: what moves a
        # reading by less than a hundredth of the length stays small, and what is seen is off by a thousandth
        near = ca.vertcat(y - inputs[2], np.sqrt(1e-4) / self._reach * q)
        self._missed = ca.Function("missed", inputs, [near, ca.densify(ca.jacobian(near, q))])
        # least squares end near the minimum, from where Newton's method takes it to rounding: starts that repeat
        still = {"x": q, "p": ca.vertcat(*inputs[1:]), "g": ca.gradient(0.5 * ca.sumsqr(near), q)}
        self._still = ca.rootfinder("still", "newton", still, {"abstol": 1e-13})
        self._straight = np.zeros(model.n)

    def state(self) -> tuple[Array, Array]:
        """Coordinates and rates (n,) at the first sample; SolverError if no shape comes near the readings."""
        q = self._near(self._straight, self._value)
        try:
            q = np.array(self._still(q, np.append(self._z, self._value))).ravel()
        except RuntimeError as error:  # of the root finder
            raise self._lost() from error
        slope = np.array(self._missed(q, self._z, self._value)[1])
        slope[self._slope.size :] *= self._slow
        return q, np.linalg.lstsq(slope, np.append(self._slope, np.zeros(q.size)), rcond=None)[0]

    def unknowns(self, bends: tuple[float, float] | None) -> list[Unknown]:
        """Coordinates and rates at the first sample, to be estimated from those that are read there.

        ``bends`` are standard deviations about these, of the bend of an element [rad] and of its rate [rad/s].
        """
        model = self._model
        known = [math.inf] * (2 * self._model.n)
        if bends is not None:
            family = model.structure.family
            element_lengths = [[h for k, h in enumerate(model.lengths) if i in family.local(k)] for i in range(model.n)]
            known = [family.coordinate_size(bend, max(lengths)) for bend in bends for lengths in element_lengths]
        sizes = [self._reach] * model.n + [self._reach / self._slow] * model.n
        rows = zip(model.x_names[: 2 * model.n], np.append(*self.state()).tolist(), sizes, known, strict=True)
        return [
            Unknown(*split_unit(label), START, start=value, typical=size, per="set", sigma=sigma)
            for label, value, size, sigma in rows
        ]

    def before(self, readings: Sequence[Reading]) -> list[Array]:
        """Shapes (n,) through readings of sections before the start, one shape per instant."""
        seen = [np.asarray(reading.values, dtype=float) for reading in readings if not reading.of_drive]
        shapes = [self._straight]
        for row in np.stack(seen, axis=1) if seen else ():
            if np.isfinite(row).all():
                shapes.append(self._near(shapes[-1], self._scale * row))
        return shapes[1:]

    def _near(self, q: Array, target: Array) -> Array:
        def missed(q: Array) -> tuple[Array, Array]:
            near, slope = (np.array(part) for part in self._missed(q, self._z, target))
            return near.ravel(), slope

        free = np.full(q.size, np.inf)
        minimum = least_squares(missed, q, -free, free, np.full(q.size, self._reach))
        if not minimum.converged:
            raise self._lost()
        return minimum.values

    def _lost(self) -> SolverError:
        return SolverError(
            f"{self._name}: no shape of the finger goes through the first samples",
            status="no start",
            advice="check units, signs and positions of the readings, and the base's position",
        )
