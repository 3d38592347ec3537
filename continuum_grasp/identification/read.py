"""From files, as a configuration describes them, to measurements; where the files may lie."""

from __future__ import annotations

import fnmatch
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.arguments import check_arguments
from continuum_grasp.errors import InputError
from continuum_grasp.identification.damped_sine import fit_damped_sine
from continuum_grasp.identification.data import UNIT_OF, Data, Frequencies, Poses, Reading, TipPath
from continuum_grasp.identification.table import Table, read_table
from continuum_grasp.labels import split_unit
from continuum_grasp.model import FingerModel
from continuum_grasp.scene.identify import (
    Column,
    ColumnLike,
    Condition,
    DataSet,
    FrequencyTable,
    IdentifyScene,
    ReadingColumn,
    RingDown,
    StaticPoses,
)
from continuum_grasp.scene.loads import by_key
from continuum_grasp.scene.simulate import Scene

Array = NDArray[np.float64]


@check_arguments
def read_data(scene: IdentifyScene, paths: Sequence[Path]) -> list[Data]:
    r"""Measurements of all sets that a configuration describes.

    Parameters
    ----------
    scene : IdentifyScene
    paths : sequence of path
        Files, or folders that hold them; relative ones may lie in the data folder.

    Raises
    ------
    InputError
        If a set has no file, a file no set, or something in a file is wrong.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import continuum_grasp as cg
    >>> from continuum_grasp.identification import read_data
    >>> scene = cg.load("configs/identify/belendez_strip.yaml", ["data[0].holdout_rows=[]"])
    >>> file = pathlib.Path(tempfile.mkdtemp()) / "tip_drop.csv"
    >>> _ = file.write_text("tip_load_N,measured_tip_drop_m\n0.0,0.089\n0.098,0.149\n")
    >>> (poses,) = read_data(scene, [file])
    >>> len(poses.measured), poses.conditions["load_1_y"].tolist()  # quantities, N
    (1, [-0.0, -0.098])
    """
    if not scene.data:
        raise InputError("a configuration that reads files says how: data: [{kind: ...}]", key="data")
    paths = [_located(path) for path in paths]
    files = list(_files(paths, scene.data))
    for file in files:
        if sum(file.resolve() == other.resolve() for other in files) > 1:
            raise InputError("this file is given twice: its measurements would count twice", file=str(file))
    used: set[Path] = set()
    found: list[Data] = []
    for k, one in enumerate(scene.data):
        key = f"data[{k}]"
        mine = [file for file in files if one.file is None or fnmatch.fnmatch(file.name, one.file)]
        if not mine:
            raise InputError(f"no file {one.file or '*.csv'} among {', '.join(map(str, paths))}", key=f"{key}.file")
        used.update(mine)
        own = _changed(scene, one.set, f"{key}.set")
        for file in mine:
            table = read_table(file)
            for choice in one.where:
                table = table.chosen(choice.column, choice.equals)
            found.append(_read(one, table, own, one.name or file.stem, key))
    for path in paths:
        if path.is_file() and path not in used:
            wanted = ", ".join(str(one.file) for one in scene.data)
            raise InputError(f"no set of the configuration reads this file; they read {wanted}", file=str(path))
    return found


def _files(paths: Sequence[Path], sets: Iterable[DataSet]) -> Iterator[Path]:
    for path in paths:
        if path.is_dir():
            # a folder may hold other files; in the order of their names, which no file system promises
            patterns = [one.file or "*.csv" for one in sets]
            yield from sorted(file for file in path.iterdir() if any(fnmatch.fnmatch(file.name, p) for p in patterns))
        elif path.is_file():
            yield path
        else:
            raise InputError(f"no such file, nor in the folder that {VARIABLE} names", file=str(path))


def plain_scene(scene: IdentifyScene) -> Scene:
    """The scene without what is said of the data."""
    return Scene(
        **scene.model_dump(mode="json", exclude_unset=True, exclude={"estimate", "data", "excitation", "loss"})
    )


def _changed(scene: IdentifyScene, changes: Sequence[str], key: str) -> Scene:
    """The scene without what is said of the data, changed."""
    try:
        return plain_scene(scene).changed(changes)
    except InputError as error:
        where = ".".join(part for part in (key, error.key) if part)
        raise InputError(error.message, key=where) from None


def _read(one: DataSet, table: Table, scene: Scene, name: str, key: str) -> Data:
    rows, fitted = len(table.rows), one.use == "fit"
    if isinstance(one, StaticPoses):
        readings = _readings(one.measured, table, scene, key)
        chosen = _chosen(rows, fitted, one.holdout_rows, key)
        conditions = _conditions(table, one.conditions, scene, key)
        return Poses(readings, conditions, chosen, scene, name, one.sequence)
    if isinstance(one, FrequencyTable):
        mode = np.full(rows, one.mode) if isinstance(one.mode, int) else table.numbers(one.mode)
        decay = None if one.decay_rate is None else _column(table, one.decay_rate, "1/s")
        chosen = _chosen(rows, fitted, one.holdout_rows, key)
        conditions = _conditions(table, one.conditions, scene, key)
        return Frequencies(mode, _column(table, one.frequency, "Hz"), decay, conditions, chosen, scene, name)
    t = _column(table, one.t, "s")
    inside = np.ones(t.size, dtype=bool) if one.window is None else (t >= one.window[0]) & (t <= one.window[1])
    if one.window is not None and not inside.any():
        start, end = one.window
        message = f"no sample between {start:g} and {end:g} s; they go from {t.min():g} to {t.max():g} s"
        raise InputError(message, file=table.file)
    if isinstance(one, RingDown):
        return _ring_downs(one, table, t, inside, scene, name)
    if one.conditions:
        scene = commanded(scene, t, _conditions(table, one.conditions, scene, key), table.file, key)
    x, y = (None if value is None else _column(table, value, "m") for value in (one.x, one.y))
    measured = _readings(one.measured, table, scene, key)
    points = [Reading(key, values, one.at) for key, values in (("x", x), ("y", y)) if values is not None]
    earlier = [_of(reading, t < t[inside][0]) for reading in (*points, *measured)]
    x, y = (None if values is None else values[inside] for values in (x, y))
    further = [_of(reading, inside) for reading in measured]
    try:
        known = None if one.start_prior is None else (one.start_prior.bend, one.start_prior.rate)
        return TipPath(t[inside], x, y, one.at, one.sigma, fitted, scene, name, further, one.start, earlier, known)
    except InputError as error:
        raise InputError(error.message, file=table.file) from None


def _of(reading: Reading, rows: NDArray[np.bool_]) -> Reading:
    return replace(reading, values=np.asarray(reading.values)[rows])


def _readings(measured: Sequence[ReadingColumn], table: Table, scene: Scene, key: str) -> list[Reading]:
    length, readings = scene.finger.rod.length, []
    for k, m in enumerate(measured):
        for name, at in (("at", m.at), ("since", m.since)):
            if at is not None and at > length * (1 + 1e-9):
                message = f"{at:g} m is beyond the finger's length of {length:g} m"
                raise InputError(message, key=f"{key}.measured[{k}].{name}")
        readings.append(Reading(m.quantity, _column(table, m, UNIT_OF[m.quantity]), m.at, m.sigma, m.since, m.of))
    return readings


def commanded(scene: Scene, t: Array, commands: Mapping[str, Array], file: str, key: str) -> Scene:
    """The scene under commands that were logged, smooth between their instants."""
    names = [one.name for one in scene.finger.inputs]
    unknown = [name for name in commands if name not in names]
    if unknown:
        message = f"{unknown[0]} is no command of the drives; expected {', '.join(names)}"
        raise InputError(message, key=f"{key}.conditions")
    missing = [name for name in names if name not in commands]
    if missing:
        raise InputError(f"no column gives {missing[0]}", key=f"{key}.conditions")
    if np.any(np.diff(t) <= 0.0):
        raise InputError("instants must increase", file=file)
    given = [{"times": t.tolist(), "values": commands[name].tolist()} for name in names]
    try:
        return scene.changed({"actuation": by_key(scene.finger.input_keys, given)})
    except InputError as error:
        raise InputError(f"{error.message} ({error.key})" if error.key else error.message, file=file) from None


def _ring_downs(
    one: RingDown, table: Table, t: Array, inside: NDArray[np.bool_], scene: Scene, name: str
) -> Frequencies:
    """One row per signal."""
    found = []
    for heading in one.signals:
        signal = table.numbers(heading, gaps=True)
        there = inside & np.isfinite(signal)
        try:
            found.append(fit_damped_sine(t[there], signal[there], heading))
        except InputError as error:
            raise InputError(f"{heading}: {error.message}", file=table.file) from None
    fitted, modes = np.full(len(found), one.use == "fit"), np.full(len(found), one.mode)
    frequency, decay = [sine.frequency for sine in found], [sine.decay_rate for sine in found]
    return Frequencies(modes, frequency, decay, {}, fitted, scene, name)


def _chosen(rows: int, fitted: bool, holdout: Sequence[int], key: str) -> NDArray[np.bool_]:
    """Rows that are fitted."""
    chosen = np.full(rows, fitted)
    for row in holdout:
        if row > rows:
            raise InputError(f"row {row} of {rows}", key=f"{key}.holdout_rows")
        chosen[row - 1] = False
    return chosen


def _conditions(table: Table, conditions: Sequence[Condition], scene: Scene, key: str) -> dict[str, Array]:
    found = {}
    for k, one in enumerate(conditions):
        if one.name in found:
            raise InputError(f"{one.name} is given twice", key=f"{key}.conditions[{k}].name")
        found[one.name] = _column(table, one, unit_of_entry(one.name, scene, f"{key}.conditions[{k}].name"))
    return found


def unit_of_entry(name: str, scene: Scene, key: str) -> str:
    """Unit of an input, force or parameter of the model."""
    # inputs are those of any model, so none is chosen by tolerance
    plain = scene.model_copy(update={"fidelity": scene.fidelity.model_copy(update={"tolerance": None})})
    model = FingerModel(plain, input_rates=False)
    units = dict(split_unit(label) for label in (*model.u_names, *model.w_names))
    if name not in units:
        try:
            labels = FingerModel(plain, parameters=(name,), input_rates=False).p_names
        except InputError as error:
            message = f"no input or force {name!r} (this scene has {', '.join(units)}), and {error.message}"
            raise InputError(message, key=key) from None
        units = dict(split_unit(label) for label in labels)
    if name not in units:
        raise InputError(f"{name} is several numbers: name one of {', '.join(units)}", key=key)
    return units[name]


def _column(table: Table, column: ColumnLike, si: str) -> Array:
    one = Column(column=column) if isinstance(column, str) else column
    values = table.in_si(one.column, si, one.unit, one.zero)
    if one.minus is not None:
        values = values - table.in_si(one.minus, si, one.unit)
    return one.scale * values


VARIABLE = "CONTINUUM_GRASP_DATA"
"""Environment variable with the path of the folder."""


@check_arguments
def data_folder() -> Path | None:
    """The folder that ``CONTINUUM_GRASP_DATA`` names, or ``../shared/data`` beside a checkout; None: there is none.

    Examples
    --------
    >>> from continuum_grasp.identification import data_folder
    >>> folder = data_folder()
    >>> folder is None or folder.is_dir()
    True
    """
    named = os.environ.get(VARIABLE)
    folder = Path(named) if named else Path(__file__).resolve().parents[3] / "shared" / "data"
    return folder if folder.is_dir() else None


def _located(path: Path) -> Path:
    """A path as it is given, or in the data folder where it is relative and not found as given."""
    folder = data_folder()
    if path.is_absolute() or path.exists() or folder is None or not (folder / path).exists():
        return path
    return folder / path
