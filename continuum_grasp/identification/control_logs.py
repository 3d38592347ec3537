"""Logs of a controller from CSV files."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from pathlib import Path

import numpy as np

from continuum_grasp.control.log import COMMANDED, ControlLog
from continuum_grasp.errors import ContinuumGraspError, InputError, SolverError
from continuum_grasp.identification.data import START_SAMPLES, Reading, TipPath
from continuum_grasp.identification.fitting import identify
from continuum_grasp.identification.plausibility import IMPLAUSIBLE
from continuum_grasp.identification.read import commanded
from continuum_grasp.identification.table import Table, read_table
from continuum_grasp.labels import split_unit
from continuum_grasp.scene.control import ControlScene
from continuum_grasp.scene.simulate import Scene

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


def refuse_implausible(scene: ControlScene, log: ControlLog, delay: int) -> None:
    """Refuse a log that cannot be that of the finger, as measurements are refused, and name the slip that explains it.

    Measurements had been taken ``delay`` periods before they arrived. Logs without tip and angles, and those that the
    model cannot follow for another reason, are not judged.

    Raises
    ------
    SolverError
        With the status ``implausible``.
    """
    at = scene.estimator.measured.bending.at if scene.estimator and scene.estimator.measured.bending else ()
    places: dict[str, tuple[str, float | None]] = {"tip_x": ("x", None), "tip_y": ("y", None)}
    places |= {f"angle_{k}": ("angle", place) for k, place in enumerate(at, 1)}
    names, columns = ([split_unit(label)[0] for label in labels] for labels in (log.y_names, log.u_names))
    seen = [k for k, name in enumerate(names) if name in places]
    y, t = log.y[delay:, seen], log.t - log.t[0]
    there = np.isfinite(y).all(axis=1)
    if not seen or there.sum() < START_SAMPLES:
        return
    finger, fidelity = scene.finger, scene.fidelity.model_copy(update={"residual": None})
    plain = Scene(finger=finger, gravity=scene.gravity, fidelity=fidelity)
    readings = [
        Reading(places[names[k]][0], values, places[names[k]][1]) for k, values in zip(seen, y[there].T, strict=True)
    ]
    try:
        moved = commanded(plain, t, dict(zip(columns, log.u.T, strict=True)), log.name, "data")
        path = TipPath(t[: len(y)][there], measured=readings, start="measured", name=log.name)
        # A stiffness that is off is what a residual is to learn.
        fit = identify(moved, path, parameters=["bending_stiffness"])
    except ContinuumGraspError as error:
        if isinstance(error, SolverError) and error.status == IMPLAUSIBLE:
            raise
        return
    if fit.reason:
        raise SolverError(fit.verdict, status=IMPLAUSIBLE, advice="correct the log or the scene")


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
