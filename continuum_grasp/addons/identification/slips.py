"""Usual slips between a finger and its data: axes, signs, units, swapped columns and tendons, the frame of the base."""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from continuum_grasp.addons.identification.data import UNIT_OF, Data, Reading, TipPath
from continuum_grasp.addons.identification.read_sets import unit_of_entry
from continuum_grasp.base import Array, InputError
from continuum_grasp.scene import Scene, Unit

Pair = tuple[Data, Scene]
Columns = Mapping[str, tuple[str, float]]

_AXES: Mapping[str, Columns] = {
    "y points down in the data": {"y": ("y", -1.0)},
    "x points to the other side in the data": {"x": ("x", -1.0)},
    "the data are turned by 180 degrees": {"x": ("x", -1.0), "y": ("y", -1.0)},
    "columns of x and y are swapped": {"x": ("y", 1.0), "y": ("x", 1.0)},
    "the data are turned by 90 degrees": {"x": ("y", 1.0), "y": ("x", -1.0)},
    "the data are turned by -90 degrees": {"x": ("y", -1.0), "y": ("x", 1.0)},
    "columns of x and y are swapped, and both signs": {"x": ("y", -1.0), "y": ("x", -1.0)},
    "angle counts from the base (it is a bend)": {"angle": ("bend", 1.0)},
    "bend counts in the world (it is an angle)": {"bend": ("angle", 1.0)},
}
"""Columns of x and y, for all frames with axes along the world's, and of angles that count from elsewhere."""
_SHIFTS = 400
"""Parts of a motion by which its rows are tried to be late or early [1]."""
_GROUPS = {
    "positions": {"x": 1, "y": 1},
    "times": {"t": 1, "frequency": -1, "decay_rate": -1},
    "frequencies": {"frequency": 1, "decay_rate": 1},
}
"""Columns whose units are taken for others together, with the power of that unit; all others by their names."""


_OLD = ("deg", "deg/s", "in", "gf", "kgf", "lbf")
"""Units to try besides powers of ten: software counts in degrees and inches, and load cells
show weights. Each costs predictions anew, so units that no software chooses by itself, such as feet, are not tried."""


class PossibleMistake(NamedTuple):
    """A possible mistake, in words, and the change that undoes it."""

    words: str
    columns: Columns
    """The column that each wrong one should be, and the factor on its values."""
    turn: float = 0.0
    """Correction of the angle of the base [rad]."""
    gravity: float = 1.0
    """Factor on gravity [1]."""
    late: float = 0.0
    """Time by which rows of motions are late [s]."""


def slips_of(given: Sequence[Pair]) -> Iterator[PossibleMistake]:
    """Slips that may concern some of the sets."""
    units = {name: (unit, scene) for data, scene in given for name, unit in _columns(data, scene).items()}
    for words, columns in _AXES.items():
        if set(columns) <= set(units):
            yield PossibleMistake(words, columns)
    groups = {group: [name for name in powers if name in units] for group, powers in _GROUPS.items()}
    for name in units:
        if not any(name in powers for powers in _GROUPS.values()):
            # loads, tendons and drives are logged alike
            stem = re.sub(r"^(\w+) \d+$", r"measured \1", re.sub(r"_\d+", "", name))
            groups.setdefault(stem, []).append(name)
    for group, names in groups.items():
        powers = _GROUPS.get(group, dict.fromkeys(names, 1))
        for words, factor in _factors(group, *units[names[0]], names[0]) if names else ():
            yield PossibleMistake(f"{group} {words}", {name: (name, factor ** powers[name]) for name in names})
    names = [finger_input.name for finger_input in given[0][1].finger.inputs]
    commands = _renumbered(names)
    readings = dict[str, tuple[str, float]]()
    for quantity in UNIT_OF:
        if f"{quantity} 1" in units:
            readings |= _renumbered([f"{quantity} {k + 1}" for k in range(len(names))])
    if len(names) > 1:
        yield PossibleMistake("tendons are numbered from the other side", {**commands, **readings})
        yield PossibleMistake("commands of the tendons are swapped", commands)
        yield PossibleMistake("readings of the drives are swapped", readings)
    for degrees in (90, -90, 180):
        yield PossibleMistake(f"finger.base.angle is {degrees} degrees too small", {}, turn=math.radians(degrees))
    yield PossibleMistake("gravity points the other way", {}, gravity=-1.0)


def late(motions: Sequence[tuple[Array, Array, Array]]) -> PossibleMistake | None:
    """The time by which the rows of motions are late, by instants (T,), measured and predicted numbers (T, c) of each.

    It is that at which the predictions of all, moved by it, agree best over a quarter of the instants at least.
    """
    steps = [float(np.ptp(t)) / _SHIFTS for t, *_ in motions]
    if not steps or min(steps) <= 0.0:
        return None
    reach = 3 * _SHIFTS // 4
    shifts = min(steps) * np.arange(-reach, reach + 1)
    left = np.array([_missed(motions, shift) for shift in shifts])
    k = int(np.argmin(left))
    if not 0 < k < len(shifts) - 1 or k == reach:
        return None
    before, here, after = left[k - 1 : k + 2]
    shift = shifts[k] + 0.5 * min(steps) * (before - after) / max(before - 2.0 * here + after, 1e-300)
    words = f"rows of motions are {abs(shift):.3g} s {'late' if shift > 0.0 else 'early'}"
    return PossibleMistake(words, {"t": ("t", 1.0)}, late=float(shift))


def _missed(motions: Sequence[tuple[Array, Array, Array]], shift: float) -> float:
    """Mean square of what motions are off, each column per its range, if their rows are late by a ``shift`` [s]."""
    total = 0.0
    count = 0
    for t, measured, predicted in motions:
        inside = (t + shift >= t[0]) & (t + shift <= t[-1])
        moved = np.column_stack([np.interp(t[inside] + shift, t, column) for column in measured.T])
        total += float(np.sum(((moved - predicted[inside]) / np.maximum(np.ptp(measured, axis=0), 1e-12)) ** 2))
        count += moved.size
    return total / max(count, 1)


def undone(slip: PossibleMistake, data: Data, scene: Scene) -> Pair | None:
    """Data and scene without a slip; None where it does not concern them, or they cannot be so."""
    if not slip.columns.keys() & _columns(data, scene).keys() and (slip.columns or not any(scene.gravity)):
        return None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a tried slip, such as gravity that points up, is not the user's scene
            return _undone_data(slip, data), scene.changed(dict(_changes(slip, scene)))
    except InputError:
        return None


def _columns(data: Data, scene: Scene) -> dict[str, str]:
    """Columns of the data, and commands of the scene, with SI units; columns of conditions are left open."""
    inputs = () if scene.actuation is None else scene.finger.inputs
    units = {finger_input.name: finger_input.unit for finger_input in inputs}
    if isinstance(data, TipPath):
        units["t"] = "s"
    else:
        units |= dict.fromkeys(data.conditions, "")
    return units | {_column(reading): UNIT_OF[reading.quantity] for reading in data.measured}


def _column(reading: Reading) -> str:
    return reading.what if reading.of_drive else reading.quantity


def _factors(group: str, unit: str, scene: Scene, name: str) -> Iterator[tuple[str, float]]:
    """Signs and units that a group of columns may have in place of its own, with the factor on the numbers."""
    si = "s" if group == "times" else unit or unit_of_entry(name, scene, name)
    verb = "are" if group in _GROUPS else "is"
    if group not in _GROUPS:
        yield "has the other sign in the data", -1.0
    factors = Unit(si).factors.items()
    sizes = {float(size): other for other, size in factors if other != si and (other in _OLD or _is_decimal(size))}
    for size, other in sizes.items():
        yield f"{verb} in {other}, read as {si}", size
        yield f"{verb} in {si}, read as {other}", 1.0 / size


def _is_decimal(size: Fraction) -> bool:
    """Whether a unit is the SI unit times a power of ten."""
    return {*str(size.numerator * size.denominator)} <= {"0", "1"}


def _renumbered(names: Sequence[str]) -> Columns:
    return {name: (to, 1.0) for name, to in zip(names, reversed(names), strict=True)}


def _undone_data(slip: PossibleMistake, data: Data) -> Data:
    def scaled(name: str, values: ArrayLike) -> ArrayLike:
        return slip.columns[name][1] * np.asarray(values, dtype=float) if name in slip.columns else values

    def read(readings: Sequence[Reading]) -> tuple[Reading, ...]:
        corrected = []
        for reading in readings:
            column = _column(reading)
            meant = slip.columns.get(column, (column, 1.0))[0]
            quantity, _, of = meant.partition(" ")
            number = int(of) if of else reading.of
            corrected.append(replace(reading, quantity=quantity, of=number, values=scaled(column, reading.values)))
        return tuple(corrected)

    if isinstance(data, TipPath):
        t = np.asarray(scaled("t", data.t)) - slip.late
        begun = t >= 0.0
        measured = [reading.selected(begun) for reading in read(data.measured)]
        return replace(data, t=t[begun], measured=measured, before=read(data.before))
    conditions = {
        slip.columns.get(name, (name, 1.0))[0]: scaled(name, values) for name, values in data.conditions.items()
    }
    return replace(data, measured=read(data.measured), conditions=conditions)


def _changes(slip: PossibleMistake, scene: Scene) -> Iterator[tuple[str, Any]]:
    if slip.turn:
        yield "finger.base.angle", math.remainder(scene.finger.base.angle + slip.turn, 2.0 * math.pi)
    if slip.gravity != 1.0:
        yield "gravity", tuple(slip.gravity * component for component in scene.gravity)
    names = [finger_input.name for finger_input in scene.finger.inputs]
    if scene.actuation is None or not slip.columns.keys() & {"t", *names}:
        return
    commands = scene.actuation.values
    later = slip.columns.get("t", ("t", 1.0))[1]
    changed: list[Any] = list(commands)
    for name, command in zip(names, commands, strict=True):
        to, factor = slip.columns.get(name, (name, 1.0))
        if isinstance(command, (int, float)):
            changed[names.index(to)] = factor * command
            continue
        moved = {"times": [later * t for t in command.times], "values": [factor * value for value in command.values]}
        changed[names.index(to)] = command.model_dump() | moved
    yield "actuation", scene.finger.actuated(changed)
