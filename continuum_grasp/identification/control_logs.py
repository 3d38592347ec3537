"""Logs of a controller from CSV files."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from pathlib import Path

import numpy as np

from continuum_grasp.control.log import COMMANDED, ControlLog
from continuum_grasp.errors import InputError
from continuum_grasp.identification.table import Table, read_table
from continuum_grasp.labels import split_unit

Log = ControlLog | str | PathLike[str]


def read_logs(given: Sequence[Log], u_names: Sequence[str], y_names: Sequence[str], period: float) -> list[ControlLog]:
    """Logs, those that are files read: of every input and every measurement a column, at every period.

    Raises
    ------
    InputError
        With the place of what is wrong: columns that are missing, other periods than the controller's.
    """
    found = []
    for one in given:
        log = one if isinstance(one, ControlLog) else _read(Path(one), u_names, y_names)
        for key, own, wanted in (("u_names", log.u_names, u_names), ("y_names", log.y_names, y_names)):
            if tuple(own) != tuple(wanted):
                raise InputError(f"{log.name}.{key}: expected {', '.join(wanted)}, got {', '.join(own)}", key="data")
        if abs(log.period - period) > 1e-3 * period:
            message = f"{log.name}: expected a row per control period of {period:g} s, got one per {log.period:g} s"
            raise InputError(message, key="data")
        found.append(log)
    return found


def _read(path: Path, u_names: Sequence[str], y_names: Sequence[str]) -> ControlLog:
    table = read_table(path)
    t = table.in_si("t", "s")
    if t.size < 2:
        raise InputError("expected two rows or more", file=str(path))
    try:
        return ControlLog(
            t=t,
            u=np.column_stack([_column(table, COMMANDED, name) for name in u_names]),
            y=np.column_stack([_column(table, "", name, gaps=True) for name in y_names]),
            u_names=tuple(u_names),
            y_names=tuple(y_names),
            name=path.name,
        )
    except InputError as error:
        raise InputError(error.message, file=error.file or str(path)) from None


def _column(table: Table, before: str, name: str, *, gaps: bool = False) -> np.ndarray:
    heading, unit = split_unit(name)
    return table.in_si(before + heading, unit, gaps=gaps)
