"""Measured quantities as expressions of a model: along the finger, and at the drives of its tendons."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, cast

import casadi as ca
import numpy as np

from continuum_grasp.errors import InputError
from continuum_grasp.identification.data import Reading
from continuum_grasp.model import FingerModel
from continuum_grasp.model.winches import Motor
from continuum_grasp.scene.consumer import refusals


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

    ``offsets`` (readings) [m] replace those of the readings, which may differ from row to row. InputError if a position
    is not on the finger, or a drive is not one of it.
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


_OF_MOTORS = refusals(
    "data.measured.quantity={motor_angle,torque} without kind=motor: is that of a motor: this drive has another kind"
)


def _at_drive(model: FingerModel, reading: Reading, u: ca.SX, tensions: ca.SX, states: ca.SX) -> ca.SX:
    number, winches = (reading.of or 1) - 1, model.structure.winches
    count = len(model.finger.tendon_list) if reading.quantity == "tension" else len(winches)
    if number >= count:
        what = "tendons" if reading.quantity == "tension" else "drives"
        raise InputError(f"{reading.quantity} {number + 1} of {count} {what}", key="measured")
    if reading.quantity == "tension":
        return tensions[number]
    start = sum(winch.states for winch in winches[:number])
    winch, drive_states = winches[number], states[start : start + winches[number].states]
    if reading.quantity == "length":
        return winch.radius * drive_states[0]
    for refusal in _OF_MOTORS:
        refusal.check(winch.drive, of={f"data.measured.quantity={reading.quantity}": "measured"})
    if reading.quantity == "motor_angle":
        return drive_states[0]
    return ca.SX(cast(Motor, winch).torque(u[number], drive_states[0], drive_states[1]))


def check_tensions(model: FingerModel, readings: Sequence[Reading], name: str) -> None:
    """Raise an InputError for tensions of tendons that have none of their own."""
    if not model.structure.own_tendons and any(reading.quantity == "tension" for reading in readings):
        raise InputError(
            "a tension that was measured at a drive is predicted for tendons with friction or on winches; here it is "
            "what is commanded: make it a condition",
            key=name,
        )
