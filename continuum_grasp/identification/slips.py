"""Usual slips between a finger and its data: axes, signs, columns, units and the frame of the base.

A slip is undone by a change of data and scene; one that does not concern them gives None.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from continuum_grasp.errors import InputError
from continuum_grasp.identification.data import UNIT_OF, Data, Frequencies, Poses, Reading, TipPath
from continuum_grasp.labels import split_unit
from continuum_grasp.model import FingerModel
from continuum_grasp.scene.simulate import Scene
from continuum_grasp.scene.units import units_of

Pair = tuple[Data, Scene]
Undo = Callable[[Data, Scene], Pair | None]

_AXES = {
    "y points down in the data": ("x", "-y"),
    "x points to the other side in the data": ("-x", "y"),
    "the data are turned by 180 degrees": ("-x", "-y"),
    "columns of x and y are swapped": ("y", "x"),
    "the data are turned by 90 degrees": ("-y", "x"),
    "the data are turned by -90 degrees": ("y", "-x"),
    "columns of x and y are swapped, and both signs": ("-y", "-x"),
}
"""World x and y by those of the data: all frames with axes along these."""
_TURNS = (90, -90, 180)
"""By which the base is turned [deg]: along which world axis the straight finger points."""


class Slip(NamedTuple):
    """What may be wrong, in words, and what undoes it."""

    words: str
    undo: Undo


def slips_of(given: Sequence[Pair]) -> Iterator[Slip]:
    """Slips that may concern some of the sets."""
    for words, axes in _AXES.items():
        yield Slip(words, _turned(axes))
    quantities = {one.quantity for data, _ in given for one in readings_of(data)}
    for quantity in sorted(quantities & {"angle", "bend", *(q for q in UNIT_OF if q not in ("x", "y"))}):
        yield Slip(f"{quantity} has the other sign in the data", _scaled({quantity}, -1.0))
    for group in ({"x", "y"}, *({q} for q in sorted(quantities - {"x", "y"}))):
        if group & quantities:
            unit = UNIT_OF[min(group)]
            for words, factor in _ratios(unit):
                name = "positions" if "x" in group else min(group)
                yield Slip(f"{name} {'are' if 'x' in group else 'is'} in {words}", _scaled(group, factor))
    commands = {name: unit for data, scene in given for name, unit in _channels(data, scene).items()}
    for stem in sorted({_stem(name) for name in commands}):
        unit = next(unit for name, unit in commands.items() if _stem(name) == stem)
        yield Slip(f"{stem} has the other sign", _commanded(stem, -1.0))
        for words, factor in _ratios(unit):
            yield Slip(f"{stem} is in {words}", _commanded(stem, factor))
    tendons = max(len(scene.finger.tendon_list) if scene.finger.tendons is not None else 0 for _, scene in given)
    if tendons > 1:
        yield Slip("tendons are numbered from the other side", _renumbered(tendons))
        yield Slip("commands of the tendons are swapped", _renumbered(tendons, readings=False))
        if any(one.of_drive for data, _ in given for one in readings_of(data)):
            yield Slip("readings of the drives are swapped", _renumbered(tendons, commands=False))
    for words, factor in _ratios("s"):
        yield Slip(f"times are in {words}", _timed(factor))
    for words, factor in _ratios("Hz"):
        yield Slip(f"frequencies are in {words}", _vibrating(factor))
    for turn in _TURNS:
        yield Slip(f"finger.base.angle is {turn} degrees too small", _based(turn))
    if any(any(scene.gravity) for _, scene in given):
        yield Slip("gravity points the other way", _heavy)


def readings_of(data: Data) -> tuple[Reading, ...]:
    """All readings of a set of data at sections and drives."""
    if isinstance(data, Frequencies):
        return ()
    return data.readings if isinstance(data, TipPath) else tuple(data.measured)


def with_readings(data: Poses | TipPath, change: Callable[[Sequence[Reading]], Sequence[Reading]]) -> Data:
    """The data with other readings in the places of theirs."""
    if isinstance(data, Poses):
        return replace(data, measured=tuple(change(data.measured)))
    # x and y are readings as all others: of the same place and deviation
    return replace(
        data,
        x=None,
        y=None,
        at=None,
        sigma=None,
        measured=tuple(change(data.readings)),
        before=tuple(change(data.before)),
    )


def _ratios(si: str) -> list[tuple[str, float]]:
    """Units that are taken for the SI unit, and it for them, with the factor on numbers that were read so."""
    units = units_of(si)
    found: dict[float, str] = {}
    for read, size in units.items():
        for own, other in units.items():
            if own != read and si in (own, read):
                found.setdefault(float(f"{float(other / size):.9g}"), f"{own}, read as {read}")
    return [(words, factor) for factor, words in found.items()]


def _stem(name: str) -> str:
    return re.sub(r"_\d+", "", name)


def _channels(data: Data, scene: Scene) -> Mapping[str, str]:
    """Inputs and forces that data or scene give values, with their units."""
    plain = scene.model_copy(update={"fidelity": scene.fidelity.model_copy(update={"tolerance": None})})
    model = FingerModel(plain, input_rates=False)
    units = dict(map(split_unit, (*model.u_names, *model.w_names)))
    conditions = () if isinstance(data, TipPath) else data.conditions
    commanded = [split_unit(label)[0] for label in model.u_names] if scene.actuation is not None else []
    return {name: unit for name, unit in units.items() if name in conditions or name in commanded}


def _turned(axes: tuple[str, str]) -> Undo:
    def undo(data: Data, scene: Scene) -> Pair | None:
        points = [one for one in readings_of(data) if one.quantity in ("x", "y")]
        if isinstance(data, Frequencies) or not points:
            return None
        there = {(one.quantity, one.at): one for one in points}
        wanted = {axis: axes["xy".index(axis)] for axis in "xy"}

        def change(readings: Sequence[Reading]) -> list[Reading]:
            own = {(one.quantity, one.at): one for one in readings if one.quantity in ("x", "y")}
            return [
                one
                if one.quantity not in wanted
                else replace(one, values=_signed(wanted[one.quantity], own[wanted[one.quantity][-1], one.at]))
                for one in readings
            ]

        if any((wanted[quantity][-1], at) not in there for quantity, at in there):
            return None
        if all(wanted[quantity] == quantity for quantity, _ in there):
            return None
        return with_readings(data, change), scene

    return undo


def _signed(axis: str, reading: Reading) -> np.ndarray:
    return np.asarray(reading.values, dtype=float) * (-1.0 if axis[0] == "-" else 1.0)


def _scaled(quantities: set[str], factor: float) -> Undo:
    def undo(data: Data, scene: Scene) -> Pair | None:
        if isinstance(data, Frequencies) or not any(one.quantity in quantities for one in readings_of(data)):
            return None

        def change(readings: Sequence[Reading]) -> list[Reading]:
            return [
                replace(one, values=factor * np.asarray(one.values, dtype=float)) if one.quantity in quantities else one
                for one in readings
            ]

        return with_readings(data, change), scene

    return undo


def _commanded(stem: str, factor: float) -> Undo:
    def undo(data: Data, scene: Scene) -> Pair | None:
        if stem not in {_stem(name) for name in _channels(data, scene)}:
            return None
        if not isinstance(data, TipPath) and any(_stem(name) == stem for name in data.conditions):
            given = {
                name: factor * np.asarray(values, dtype=float) if _stem(name) == stem else values
                for name, values in data.conditions.items()
            }
            data = replace(data, conditions=given)
        return data, _actuated(scene, lambda values: [_times(factor, one) for one in values])

    return undo


def _actuated(scene: Scene, change: Callable[[list[Any]], list[Any]]) -> Scene:
    if scene.actuation is None:
        return scene
    key, given = scene.actuation.given
    values = change([one if isinstance(one, (int, float)) else one.model_dump() for one in given])
    return scene.changed({"actuation": {key: values[0] if key == "tip_moment" else values}})


def _times(factor: float, value: Any) -> Any:
    if isinstance(value, (int, float)):
        return factor * value
    return {**value, "values": [factor * one for one in value["values"]]}


def _renumbered(count: int, commands: bool = True, readings: bool = True) -> Undo:
    def other(name: str) -> str:
        found = re.fullmatch(r"(tension|length|torque|current|angle)_(\d+)", name)
        return name if found is None else f"{found[1]}_{count + 1 - int(found[2])}"

    def undo(data: Data, scene: Scene) -> Pair | None:
        if commands:
            if not isinstance(data, TipPath):
                data = replace(data, conditions={other(name): values for name, values in data.conditions.items()})
            scene = _actuated(scene, lambda values: values[::-1])
        if readings and not isinstance(data, Frequencies):
            data = with_readings(
                data, lambda rows: [replace(one, of=count + 1 - (one.of or 1)) if one.of_drive else one for one in rows]
            )
        return data, scene

    return undo


def _timed(factor: float) -> Undo:
    def undo(data: Data, scene: Scene) -> Pair | None:
        if isinstance(data, Poses):
            return None
        if isinstance(data, Frequencies):
            return _vibrating(1.0 / factor)(data, scene)
        changed = scene
        if scene.actuation is not None:
            changed = _actuated(
                scene,
                lambda values: [
                    one if isinstance(one, (int, float)) else {**one, "times": [factor * t for t in one["times"]]}
                    for one in values
                ],
            )
        return replace(data, t=factor * np.asarray(data.t, dtype=float)), changed

    return undo


def _vibrating(factor: float) -> Undo:
    def undo(data: Data, scene: Scene) -> Pair | None:
        if not isinstance(data, Frequencies):
            return None
        decay = None if data.decay_rate is None else factor * np.asarray(data.decay_rate, dtype=float)
        return replace(data, frequency=factor * np.asarray(data.frequency, dtype=float), decay_rate=decay), scene

    return undo


def _based(turn: float) -> Undo:
    def undo(data: Data, scene: Scene) -> Pair | None:
        angle = scene.finger.base.angle + np.deg2rad(turn)
        return data, scene.changed({"finger.base.angle": float(np.arctan2(np.sin(angle), np.cos(angle)))})

    return undo


def _heavy(data: Data, scene: Scene) -> Pair | None:
    if not any(scene.gravity):
        return None
    return data, scene.changed({"gravity": tuple(-one for one in scene.gravity)})


def try_undo(slip: Slip, data: Data, scene: Scene) -> Pair | None:
    """Data and scene without a slip; None where it does not concern them, or they cannot be so."""
    try:
        return slip.undo(data, scene)
    except InputError:
        return None
