"""From files, as a configuration describes them, to measurements."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.addons.identification.data import KIND_OF, OF_MODES, UNIT_OF, Data, Poses, Reading, Signal, TipPath
from continuum_grasp.addons.identification.data_files import files_in, in_data_folder, located
from continuum_grasp.addons.identification.scene import (
    Column,
    ColumnLike,
    Condition,
    DataSet,
    IdentifyScene,
    Quantity,
    ReadingColumn,
    RingDown,
    StaticPoses,
    TipTrajectory,
    as_column,
)
from continuum_grasp.addons.identification.vibrations import fit_damped_sine
from continuum_grasp.base import Array, InputError, check_arguments, split_unit
from continuum_grasp.control import ControlLog
from continuum_grasp.model import FingerModel
from continuum_grasp.scene import DataTable, Scene

SomeScene = TypeVar("SomeScene", bound=Scene)


@check_arguments
def read_data(scene: Scene, paths: Sequence[Path] = (), *, beside: Path | None = None) -> list[Data]:
    r"""Measurements of all sets that a configuration describes, or that the headings of files do.

    Parameters
    ----------
    scene : Scene
        Where it is an `IdentifyScene` with ``data``, these define how files are read.
    paths : sequence of path
        Files, or folders that hold them; relative ones may lie in the data folder. None: the files that the data name.
    beside : path, optional
        Folder in which files that the data name are looked for first.

    Raises
    ------
    InputError
        If a set has no file, a file no set, or a file has a fault.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import continuum_grasp as cg
    >>> from continuum_grasp.addons.identification import read_data
    >>> scene = cg.load("configs/identify/belendez_strip.yaml", ["data[0].holdout_rows=[]"])
    >>> file = pathlib.Path(tempfile.mkdtemp()) / "tip_drop.csv"
    >>> _ = file.write_text("tip_load_N,measured_tip_drop_m\n0.0,0.089\n0.098,0.149\n")
    >>> (poses,) = read_data(scene, [file])
    >>> len(poses.measured), poses.conditions["load_1_y"].tolist()  # quantities, N
    (1, [-0.0, -0.098])
    """
    sets = scene.data if isinstance(scene, IdentifyScene) else ()
    paths = [in_data_folder(path) for path in paths] or located(scene, beside)
    files = list(files_in(paths, sets))
    for file in files:
        if sum(file.resolve() == other.resolve() for other in files) > 1:
            raise InputError("this file is given twice: its measurements would count twice", file=str(file))
    if not sets:
        return [measured for file in files for measured in _by_headings(file, scene)]
    used: set[Path] = set()
    measurements: list[Data] = []
    for k, data_set in enumerate(sets):
        key = f"data[{k}]"
        mine = [file for file in files if data_set.file is None or file.resolve().match(data_set.file)]
        if not mine:
            raise InputError(
                f"no file {data_set.file or '*.csv'} among {', '.join(map(str, paths))}", key=f"{key}.file"
            )
        used.update(mine)
        changed_scene = changed_at(plain_scene(scene), data_set.set, f"{key}.set")
        for file in mine:
            table = _table(file, data_set, key)
            for choice in data_set.where:
                table = table.chosen(choice.column, choice.equals)
            measurements += _read(data_set, table, changed_scene, data_set.name or file.stem, key)
    for path in paths:
        if path.is_file() and path not in used:
            wanted = ", ".join(str(data_set.file) for data_set in sets)
            raise InputError(f"no set of the configuration reads this file; the sets read {wanted}", file=str(path))
    return measurements


def _table(file: Path, data_set: DataSet, key: str) -> DataTable:
    """The table of a set; of a bag the columns that the set names, by the topic of the times."""
    named = dict(_columns(data_set.model_dump(), key))
    leader = data_set.measured[0].column if isinstance(data_set, StaticPoses) else as_column(data_set.t).column
    try:
        return DataTable.read(file, columns=[*named], leader=leader, stamps=data_set.stamps, max_age=data_set.max_age)
    except InputError as error:
        keys = {name: f"{key}.{name}" for name in ("stamps", "max_age")} | named
        raise error.at(keys.get(error.key or "")) from None


_OF_COLUMNS = ("t", "column", "minus", "pose", "signals")
"""Keys of a set that name columns."""


def _columns(part: Any, key: str) -> Iterator[tuple[str, str]]:
    """Columns that a part of a set names, with the key of each."""
    entries = part.items() if isinstance(part, dict) else enumerate(part) if isinstance(part, (list, tuple)) else ()
    for name, value in entries:
        below = f"{key}[{name}]" if isinstance(name, int) else f"{key}.{name}"
        if isinstance(value, str) and (name in _OF_COLUMNS or key.endswith(".signals")):
            yield value, below
        yield from _columns(value, below)


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


def _read(data_set: DataSet, table: DataTable, scene: Scene, name: str, key: str) -> list[Data]:
    """The measurements of a table: of shapes at rest a set for each choice of readings that some of its rows have."""
    fitted = data_set.use == "fit"
    if isinstance(data_set, StaticPoses):
        points = _Points(data_set, table, scene, key, table.groups(data_set.pose), data_set.pose)
        chosen = np.full(len(points.groups), fitted)
        for row in data_set.holdout_rows:
            if row > chosen.size:
                raise InputError(f"there is no row {row}: the set has {chosen.size} rows", key=f"{key}.holdout_rows")
            chosen[row - 1] = False
        conditions = {
            which: points.same(v, which) for which, v in _conditions(table, data_set.conditions, scene, key).items()
        }
        sets = list[Data]()
        for k, (have, rows) in enumerate(points.patterns(data_set.measured)):
            readings = [reading.selected(rows) for reading in have]
            under = {which: values[rows] for which, values in conditions.items()}
            called = name if k == 0 else f"{name} ({k + 1})"
            sets.append(Poses(readings, under, chosen[rows], scene, called, data_set.sequence, data_set.plane))
        return sets
    time = as_column(data_set.t)
    t = _column(table, time, "s")
    heading = time.column
    table.check_clock(t, heading, "s" if time.scale != 1.0 else time.unit)
    long = isinstance(data_set, TipTrajectory) and any(isinstance(of.at, Column) for of in data_set.measured)
    groups = table.groups(heading if long else None)
    first = np.array([rows[0] for rows in groups])
    table.check_order(t[first], heading, first)
    start, end = data_set.window or (-math.inf, math.inf)
    inside = (t >= start) & (t <= end)
    if not inside.any():
        message = f"no sample between {start:g} and {end:g} s; they go from {t.min():g} to {t.max():g} s"
        raise InputError(message, file=table.file)
    if isinstance(data_set, RingDown):
        return [_ring_downs(data_set, table, t, inside, scene, name)]
    points = _Points(data_set, table, scene, key, groups, heading)
    t, inside = t[first], inside[first]
    if data_set.conditions:
        condition_values = _conditions(table, data_set.conditions, scene, key)
        scene = commanded(
            scene, t, {which: points.same(v, which) for which, v in condition_values.items()}, table.file, key
        )
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
            )
        ]
    except InputError as error:
        raise InputError(error.message, file=table.file) from None


def choices_of(data: StaticPoses, scene: Scene, key: str) -> tuple[tuple[str, ...], list[tuple[str, ...]], Poses]:
    """Table of all rows that the choices of a set's conditions make, as it is read back: headings, cells, poses.

    Cells of quantities to measure are zero. InputError if a condition has no choices, or there are too many rows.
    """
    choices = dict[str, Sequence[float]]()
    for k, condition in enumerate(data.conditions):
        if not (condition.choices or choices.get(condition.column)):
            raise InputError(
                f"expected choices for {condition.name} to choose from", key=f"{key}.conditions[{k}].choices"
            )
        choices[condition.column] = condition.choices or choices[condition.column]
    fixed = {of.column: of.equals[0] for of in data.where}
    seen = dict.fromkeys(text for of in data.measured for text in (of.column, of.minus) if text is not None)
    rows = list(product(*choices.values()))
    if len(rows) > _ROWS:
        raise InputError(f"the choices of all conditions make {len(rows)} rows; expected at most {_ROWS}", key=key)
    headings = (*fixed, *choices, *seen)
    cells = [(*fixed.values(), *(f"{v:.12g}" for v in row), *["0"] * len(seen)) for row in rows]
    plain = data.model_copy(update={"where": (), "holdout_rows": (), "use": "fit", "pose": None})
    changed = changed_at(plain_scene(scene), data.set, f"{key}.set")
    (poses,) = _read(plain, DataTable.of(headings, cells), changed, data.name or key, key)
    return headings, cells, cast(Poses, poses)


@dataclass(frozen=True)
class _Points:
    """Readings of a table whose rows are poses or instants, or points of these: groups of rows (R,) each.

    ``heading`` names the column that rows of a group share.
    """

    one: StaticPoses | TipTrajectory
    table: DataTable
    scene: Scene
    key: str
    groups: Sequence[NDArray[np.intp]]
    heading: str | None

    @property
    def first(self) -> NDArray[np.intp]:
        """First row (R,) of each group."""
        return np.array([rows[0] for rows in self.groups])

    def same(self, values: Array, name: str) -> Array:
        """Values (R,) of the groups, all of whose rows must have the same."""
        for rows in self.groups:
            other = rows[values[rows] != values[rows[0]]]
            if other.size:
                message = f"{name} differs from the first row with the same {self.heading}"
                raise self.table.error(message, 0, int(other[0]))
        return np.asarray(values[self.first])

    def readings(self, m: ReadingColumn, key: str) -> Iterator[Reading]:
        """Readings of a column, one for each place that it has, NaN where a group has none."""
        table = self.table
        data_set = self.one
        length = self.scene.finger.rod.length
        quantity = m.quantity
        sign = 1.0
        if quantity in ("x", "y"):
            axis = data_set.axes["xy".index(quantity)]
            quantity = "x" if axis[-1] == "x" else "y"
            sign = -1.0 if axis[0] == "-" else 1.0
        elif quantity in KIND_OF and data_set.axes != ("x", "y"):
            raise InputError(f"axes apply to x and y only: use scale for {quantity}", key=f"{self.key}.axes")
        origin = data_set.origin["xy".index(quantity)] if quantity in ("x", "y") else 0.0
        values = sign * _column(table, m, UNIT_OF[quantity], gaps=True) + origin
        if quantity in ("x", "y") and m.sigma is not None and m.sigma > length:
            message = f"{m.sigma:g} m is more than the finger is long: a deviation is in m, whatever the column is in"
            raise InputError(message, key=f"{self.key}.{key}.sigma")
        offset = _column(table, m.offset, "m", gaps=True) if isinstance(m.offset, Column) else m.offset
        places = _column(table, m.at, "m") if isinstance(m.at, Column) else None
        for at in [m.place] if places is None else np.unique(places).tolist():
            here = np.full(len(self.groups), -1)
            for k, rows in enumerate(self.groups):
                mine = rows if places is None else rows[places[rows] == at]
                if len(mine) > 1:
                    hint = "say which place each has: at: {column: ...}" if places is None else "expected one"
                    raise table.error(f"{len(mine)} rows of one {self.heading} at one place; {hint}", 0, int(mine[1]))
                here[k] = mine[0] if len(mine) else -1
            for word, where in (("at", at), ("since", m.since)):
                # 1e-6: part of the length by which a measured place may be beyond the tip: places are written with six
                # digits
                if where is not None and not 0.0 <= where <= length * (1 + 1e-6):
                    message = f"{where:g} m is not on the finger of {length:g} m"
                    if word == "at" and places is not None:
                        raise table.error(message, table.index(as_column(cast(Column, m.at)).column), int(here.max()))
                    raise InputError(message, key=f"{self.key}.{key}.{word}")
            column = np.where(here < 0, np.nan, values[here])
            offsets = np.broadcast_to(offset, values.shape)[here]
            if isinstance(m.offset, Column):
                self._check_offsets(m.offset.column, np.where(np.isfinite(column), offsets, 0.0), here)
            offsets = np.nan_to_num(offsets)
            is_one = np.ptp(offsets[here >= 0]) == 0.0
            missing = offsets.max(initial=0.0) if is_one else 0.0
            beside = np.where(here < 0, missing, offsets)
            same = float(beside[0]) if np.ptp(beside) == 0.0 else beside
            there = None if at is None else min(at, length)
            yield Reading(quantity, column, there, m.sigma, m.since, m.of, same)

    def _check_offsets(self, heading: str, offsets: Array, rows: NDArray[np.intp]) -> None:
        """Refuse markers without an offset, or one in another unit, in the rows (R,) that have them."""
        at = self.table.index(heading)
        length = self.scene.finger.rod.length
        for value, row in zip(offsets.tolist(), rows.tolist(), strict=True):
            if np.isnan(value):
                raise self.table.empty(at, row)
            if abs(value) > length:
                message = f"{value:g} m is farther from the backbone than the finger of {length:g} m is long"
                raise self.table.error(message, at, row)

    def patterns(self, measured: Sequence[ReadingColumn]) -> Iterator[tuple[list[Reading], NDArray[np.bool_]]]:
        """Readings that groups have, and which groups have just these; in the order of their first group."""
        each = [list(self.readings(m, f"measured[{k}]")) for k, m in enumerate(measured)]
        readings = [reading for of in each for reading in of]
        there = np.isfinite([np.asarray(reading.values) for reading in readings]).T
        for k, row in enumerate(there):
            if not row.any():
                raise self.table.empty(self.table.index(measured[0].column), int(self.first[k]))
        for m, of in zip(measured, each, strict=True):
            if not np.isfinite([np.asarray(reading.values) for reading in of]).any():
                message = f"column {m.column}: every cell is empty; expected numbers, or leave it out of measured"
                raise self.table.error(message, self.table.index(m.column))
        for pattern in dict.fromkeys(map(tuple, there)):
            have = [reading for reading, yes in zip(readings, pattern, strict=True) if yes]
            yield have, (there == pattern).all(axis=1)


def commanded(scene: Scene, t: Array, commands: Mapping[str, Array], file: str, key: str) -> Scene:
    """The scene under commands that were logged, smooth between their instants."""
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
    return Poses(vibrations, {}, fitted, scene, name, plane=ring_down.plane, signals=signals)


def _conditions(table: DataTable, conditions: Sequence[Condition], scene: Scene, key: str) -> dict[str, Array]:
    columns = {}
    for k, condition in enumerate(conditions):
        if condition.name in columns:
            raise InputError(f"{condition.name} is given twice", key=f"{key}.conditions[{k}].name")
        columns[condition.name] = _column(
            table, condition, unit_of_entry(condition.name, scene, f"{key}.conditions[{k}].name")
        )
    return columns


def unit_of_entry(name: str, scene: Scene, key: str) -> str:
    """Unit of an input, force or parameter of the model."""
    units = _entries_of(scene)
    if name not in units:
        try:
            units = _entries_of(scene, name)
        except InputError as error:
            message = f"no input or force {name!r} (this scene has {', '.join(units)}), and {error.message}"
            raise InputError(message, key=key) from None
    if name not in units:
        raise InputError(f"{name} has several components: name one of {', '.join(units)}", key=key)
    return units[name]


def _column(table: DataTable, column: ColumnLike, si: str, *, gaps: bool = False) -> Array:
    definition = as_column(column)
    values = table.in_si(definition.column, si, definition.unit, definition.zero, gaps=gaps)
    if definition.minus is not None:
        values = values - table.in_si(definition.minus, si, definition.unit, gaps=gaps)
    return definition.scale * values


_ROWS = 5000
"""Most rows to choose from [1]: the equilibria of so many take a quarter of a minute."""
_TIMES = ("t", "time")


def _by_headings(file: Path, scene: Scene) -> list[Data]:
    """Measurements of a table whose headings say what they are, with their units in brackets or behind an underscore;
    InputError if they do not.
    """
    table = DataTable.read(file)
    columns = {name: Column(column=heading, unit=unit) for name, (heading, unit) in table.named().items()}
    if "mode" in columns:
        message = (
            "give each mode a column of its own, by data: in a configuration: {quantity: frequency, of: 2, column: ...}"
        )
        raise InputError(message, file=str(file), line=table.header_line)
    time = next((columns.pop(name) for name in _TIMES if name in columns), None)
    at = columns.pop("at", None)
    pose = columns.pop("pose", None)
    quantities: tuple[tuple[str, Quantity], ...] = (
        *(("x", "x"), ("tip_x", "x"), ("y", "y"), ("tip_y", "y")),
        *(("angle", "angle"), ("bend", "bend"), ("frequency", "frequency"), ("decay_rate", "decay_rate")),
    )
    measured = tuple(
        ReadingColumn(quantity=quantity, at=at, **columns.pop(name).model_dump(exclude_unset=True))
        for name, quantity in quantities
        if name in columns
    )
    # Of the log of a controller the commands: what it measured of the drives has the names of inputs.
    commands = {
        key.removeprefix(ControlLog.COMMANDED): of
        for key, of in columns.items()
        if key.startswith(ControlLog.COMMANDED)
    }
    known = _entries_of(scene)
    entries = {key: column for key, column in (commands or columns).items() if key in known}
    conditions = tuple(Condition(name=key, **column.model_dump(exclude_unset=True)) for key, column in entries.items())
    if measured and not commands:
        unread = [column for name, column in columns.items() if name not in entries]
        _refuse_measured(table, unread, [*(name for name, _ in quantities), *_TIMES, "at", "pose", *known])
    data_set: DataSet | None = None
    if measured and time is not None:
        data_set = TipTrajectory(kind="trajectory", t=time, measured=measured, conditions=conditions)
    elif measured:
        named = None if pose is None else pose.column
        data_set = StaticPoses(kind="static", measured=measured, pose=named, conditions=conditions)
    if data_set is None:
        message = f"the headings ({', '.join(table.headings)}) do not say what was measured: "
        message += "expected some of t, x, y, angle, bend, at, pose, "
        message += "frequency, decay_rate, tension_1, load_1_y, ..., or data: in a configuration"
        raise InputError(message, file=str(file), line=table.header_line)
    return _read(data_set, table, plain_scene(scene), file.stem, "data")


def _refuse_measured(table: DataTable, unread: Sequence[Column], expected: Sequence[str]) -> None:
    """Refuse columns that nothing reads, but for notes: a load that is left out would be missing."""
    for column in unread:
        at = table.index(column.column)
        others = [name for name in expected if name != table.headings[at]]
        near = difflib.get_close_matches(table.headings[at], others, n=1, cutoff=0.8)
        if near or column.unit or table.units[at] or column.column == "frame":
            hint = f"did you mean {near[0]}?" if near else f"expected {', '.join(expected)}"
            raise table.error(f"nothing reads the column {column.column!r}; {hint}, or data: in a configuration", at)


@lru_cache(maxsize=1)  # all conditions of a set ask for those of one scene
def _entries_of(scene: Scene, *parameters: str) -> Mapping[str, str]:
    """Units of the inputs and forces of the model by name, or of ``parameters`` of it."""
    # inputs are those of any model, so none is chosen by tolerance
    plain = scene.model_copy(update={"fidelity": scene.fidelity.model_copy(update={"tolerance": None})})
    model = FingerModel(plain, parameters=parameters, input_rates=False)
    return dict(split_unit(label) for label in (model.p_names if parameters else (*model.u_names, *model.w_names)))
