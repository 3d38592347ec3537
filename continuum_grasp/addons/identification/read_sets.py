"""Read the measurements of a set from its table."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.addons.identification.data import OF_MODES, Data, Poses, Reading, Signal, TipPath
from continuum_grasp.addons.identification.read_points import Points, read_column
from continuum_grasp.addons.identification.scene import (
    Column,
    DataSet,
    RingDown,
    StaticPoses,
    TipTrajectory,
    as_column,
)
from continuum_grasp.addons.identification.vibrations import fit_damped_sine
from continuum_grasp.base import Array, InputError, split_unit
from continuum_grasp.model import FingerModel
from continuum_grasp.scene import DataTable, Scene

SomeScene = TypeVar("SomeScene", bound=Scene)


def plain_scene(scene: Scene) -> Scene:
    """The scene without its keys about the data."""
    excluded = {"estimate", "laws", "data", "excitation"}
    return Scene(**scene.model_dump(mode="json", exclude_unset=True, exclude=excluded))


def changed_at(scene: SomeScene, changes: Sequence[str], key: str) -> SomeScene:
    """The scene with the changes of a key, which errors name."""
    try:
        return scene.changed(changes)
    except InputError as error:
        where = ".".join(part for part in (key, error.key) if part)
        raise InputError(error.message, key=where) from None


def read_set(data_set: DataSet, table: DataTable, scene: Scene, name: str, key: str) -> list[Data]:
    """Return the measurements of a table; shapes at rest give a set per combination of readings in a row."""
    fitted = data_set.use == "fit"
    if isinstance(data_set, StaticPoses):
        points = Points(data_set, table, scene, key, table.groups(data_set.pose), data_set.pose)
        chosen = np.full(len(points.groups), fitted)
        for row in data_set.holdout_rows:
            if row > chosen.size:
                raise InputError(f"there is no row {row}: the set has {chosen.size} rows", key=f"{key}.holdout_rows")
            chosen[row - 1] = False
        conditions = _conditions(points, scene, key, held=data_set.sequence)
        sets = list[Data]()
        for k, (have, rows) in enumerate(points.patterns(data_set.measured)):
            readings = [reading.selected(rows) for reading in have]
            under = {which: values[rows] for which, values in conditions.items()}
            called = name if k == 0 else f"{name} ({k + 1})"
            notes = () if k else table.notes
            sets.append(
                Poses(readings, under, chosen[rows], scene, called, data_set.sequence, data_set.plane, notes=notes)
            )
        return sets
    time = as_column(data_set.t)
    t = read_column(table, time, "s")
    heading = time.column
    table.check_clock(t, heading, "s" if time.scale != 1.0 else time.unit)
    long = isinstance(data_set, TipTrajectory) and any(isinstance(of.at, Column) for of in data_set.measured)
    table, t = table.in_time(t, heading, several=long)
    groups = table.groups(heading if long else None)
    first = np.array([rows[0] for rows in groups])
    start, end = data_set.window or (-math.inf, math.inf)
    inside = (t >= start) & (t <= end)
    if not inside.any():
        message = f"no sample between {start:g} and {end:g} s; they go from {t.min():g} to {t.max():g} s"
        raise InputError(message, file=table.file)
    if isinstance(data_set, RingDown):
        return [_ring_downs(data_set, table, t, inside, scene, name)]
    points = Points(data_set, table, scene, key, groups, heading)
    t, inside = t[first], inside[first]
    if data_set.conditions:
        scene = commanded(scene, t, _conditions(points, scene, key, held=True, t=t), table.file, key)
    readings = [reading for k, of in enumerate(data_set.measured) for reading in points.readings(of, f"measured[{k}]")]
    there = np.isfinite([np.asarray(reading.values) for reading in readings]).all(axis=0)
    if not (there & inside).any():
        raise InputError("every row has an empty cell in one of the columns", file=table.file)
    inside &= there
    earlier = [reading.selected(there & (t < t[inside][0])) for reading in readings]
    selected = [reading.selected(inside) for reading in readings]
    try:
        known = None if data_set.start_prior is None else (data_set.start_prior.bend, data_set.start_prior.rate)
        return [
            TipPath(
                t[inside],
                selected,
                fitted=fitted,
                scene=scene,
                name=name,
                start=data_set.start,
                before=earlier,
                start_sigma=known,
                plane=data_set.plane,
                notes=table.notes,
            )
        ]
    except InputError as error:
        raise InputError(error.message, file=table.file) from None


def commanded(scene: Scene, t: Array, commands: Mapping[str, Array], file: str, key: str) -> Scene:
    """Return the scene under logged commands, smooth between their instants."""
    names = [finger_input.name for finger_input in scene.finger.inputs]
    unknown = [name for name in commands if name not in names]
    if unknown:
        message = f"{unknown[0]} is no command of the drives; expected {', '.join(names)}"
        raise InputError(message, key=f"{key}.conditions")
    missing = [name for name in names if name not in commands]
    if missing:
        raise InputError(f"no column gives {missing[0]}", key=f"{key}.conditions")
    signals = [{"times": t.tolist(), "values": commands[name].tolist()} for name in names]
    try:
        return scene.changed({"actuation": scene.finger.actuated(signals)})
    except InputError as error:
        message = f"{error.message} ({error.key})" if error.key else error.message
        raise InputError(message, file=file) from None


def _ring_downs(
    ring_down: RingDown, table: DataTable, t: Array, inside: NDArray[np.bool_], scene: Scene, name: str
) -> Poses:
    """One row per signal."""
    sines = []
    signals = list[Signal]()
    for heading in ring_down.signals:
        signal = table.numbers(heading, gaps=True)
        there = inside & np.isfinite(signal)
        try:
            sines.append(fit_damped_sine(t[there], signal[there], heading))
        except InputError as error:
            raise InputError(f"{heading}: {error.message}", file=table.file) from None
        signals.append(Signal(heading, t[there], signal[there]))
    vibrations = [Reading(which, [getattr(sine, which) for sine in sines], of=ring_down.mode) for which in OF_MODES]
    fitted = np.full(len(sines), ring_down.use == "fit")
    return Poses(vibrations, {}, fitted, scene, name, plane=ring_down.plane, signals=signals, notes=table.notes)


def _conditions(points: Points, scene: Scene, key: str, *, held: bool, t: Array | None = None) -> dict[str, Array]:
    """Return loads, inputs and parameters (R,) of all groups of rows by name; empty cells are errors unless ``held``.

    A held input keeps its value from the previous group; before its first value it follows the scene's ``actuation`` at
    the instants ``t`` (R,).
    """
    table = points.table
    columns = dict[str, Array]()
    for k, condition in enumerate(points.of.conditions):
        where = f"{key}.conditions[{k}].name"
        name = condition.name
        if name in columns:
            raise InputError(f"{name} is given twice", key=where)
        values = points.same(read_column(table, condition, unit_of_entry(name, scene, where), gaps=held), name)
        if not np.isfinite(values).any():
            at = table.index(condition.column)
            raise table.error(f"column {condition.column}: every cell is empty; expected numbers", at)
        empty = int(np.argmax(np.isfinite(values)))
        if empty:
            begin = None if t is None else _scene_command(scene, name, t[:empty])
            if begin is None:
                message = f"column {condition.column}: the cell is empty before the first command; "
                message += "expected a number there, or the scene's actuation until then"
                raise table.error(message, table.index(condition.column), int(points.first[0]))
            values[:empty] = begin
        last = np.maximum.accumulate(np.where(np.isfinite(values), np.arange(values.size), 0))
        columns[name] = values[last]
    return columns


def _scene_command(scene: Scene, name: str, t: Array) -> Array | None:
    """Return the commands (K,) of an input in the scene's ``actuation`` at instants; None without actuation."""
    names = [finger_input.name for finger_input in scene.finger.inputs]
    if scene.actuation is None or name not in names:
        return None
    command = scene.actuation.values[names.index(name)]
    if isinstance(command, (int, float)):
        return np.full(t.size, float(command))
    return np.interp(t, command.times, command.values)


def unit_of_entry(name: str, scene: Scene, key: str) -> str:
    """Unit of an input, force or parameter of the model."""
    units = entries_of(scene)
    if name not in units:
        try:
            units = entries_of(scene, name)
        except InputError as error:
            message = f"no input or force {name!r} (this scene has {', '.join(units)}), and {error.message}"
            raise InputError(message, key=key) from None
    if name not in units:
        raise InputError(f"{name} has several components: name one of {', '.join(units)}", key=key)
    return units[name]


@lru_cache(maxsize=1)  # cached, because all conditions of a set belong to one scene
def entries_of(scene: Scene, *parameters: str) -> Mapping[str, str]:
    """Units of the inputs and forces of the model by name, or of ``parameters`` of it."""
    # every model has the same inputs, so none is chosen by tolerance
    plain = scene.model_copy(update={"fidelity": scene.fidelity.model_copy(update={"tolerance": None})})
    model = FingerModel(plain, parameters=parameters, input_rates=False)
    return dict(split_unit(label) for label in (model.p_names if parameters else (*model.u_names, *model.w_names)))
