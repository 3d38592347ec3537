"""Measurements of tables whose headings name the quantities."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from pathlib import Path

from continuum_grasp.addons.identification.data import Data
from continuum_grasp.addons.identification.read_sets import entries_of, plain_scene, read_set
from continuum_grasp.addons.identification.scene import (
    Column,
    Condition,
    DataSet,
    Quantity,
    ReadingColumn,
    StaticPoses,
    TipTrajectory,
)
from continuum_grasp.base import InputError
from continuum_grasp.control import ControlLog
from continuum_grasp.scene import DataTable, Scene

_TIMES = ("t", "time")


def by_headings(file: Path, scene: Scene) -> list[Data]:
    """Read the measurements of a table whose headings name quantities, with units in brackets or behind an underscore;
    InputError if headings do not.
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
    if "z" in columns and not {"y", "tip_y"} & columns.keys() and {"x", "tip_x"} & columns.keys():
        height = columns["y"] = columns.pop("z")
        table = table.noted(f"column {height.column} is read as the height y, since the table has none")
    measured = tuple(
        ReadingColumn(quantity=quantity, at=at, **columns.pop(name).model_dump(exclude_unset=True))
        for name, quantity in quantities
        if name in columns
    )
    # In a controller's log use the commands: measured channels of the drives have the names of inputs.
    commands = {
        key.removeprefix(ControlLog.COMMANDED): of
        for key, of in columns.items()
        if key.startswith(ControlLog.COMMANDED)
    }
    known = entries_of(scene)
    entries = {key: column for key, column in (commands or columns).items() if key in known}
    conditions = tuple(Condition(name=key, **column.model_dump(exclude_unset=True)) for key, column in entries.items())
    unread = {name: column for name, column in columns.items() if column not in entries.values()}
    if measured and not commands:
        _refuse_measured(table, unread, [*(name for name, _ in quantities), *_TIMES, "at", "pose", *known])
        if unread and not table.topics:
            table = table.noted(f"nothing reads {', '.join(column.column for column in unread.values())}")
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
    return read_set(data_set, table, plain_scene(scene), file.stem, "data")


def _refuse_measured(table: DataTable, unread: Mapping[str, Column], expected: Sequence[str]) -> None:
    """Refuse unused columns except notes and the third coordinate: an unused load would falsify the comparison."""
    for name, column in unread.items():
        if name == "z":
            continue
        at = table.index(column.column)
        others = [name for name in expected if name != table.headings[at]]
        near = difflib.get_close_matches(table.headings[at], others, n=1, cutoff=0.8)
        if near or column.unit or table.units[at] or column.column == "frame":
            hint = f"did you mean {near[0]}?" if near else f"expected {', '.join(expected)}"
            raise table.error(f"nothing reads the column {column.column!r}; {hint}, or data: in a configuration", at)
