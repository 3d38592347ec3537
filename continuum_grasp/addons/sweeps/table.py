"""The table of a sweep as arrays, and as CSV for spreadsheets and other programs."""

from __future__ import annotations

import csv
import json
import os
import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.addons.sweeps.folder import SOLVED, read_plan, rows_of, run_path
from continuum_grasp.addons.sweeps.plan import keys_of
from continuum_grasp.addons.sweeps.scene import SWEEP_QUANTITIES
from continuum_grasp.base import Array, Indices, InputError, check_arguments, nearest
from continuum_grasp.results import Dimension, Picture, Result, Stored, pareto, replacing

CSV = "table.csv"
_TEXTS = ("scene", "status", "reason", "message")
_REDUCE: dict[str, Callable[[Array], Any]] = {
    "median": np.median,
    "mean": np.mean,
    "least": np.min,
    "greatest": np.max,
}
Best = Literal["least", "greatest"]
"""Direction in which a quantity is better."""


@dataclass(frozen=True)
class SweepTable(Result):
    """The rows of a sweep, in the order of its scenes.

    Attributes
    ----------
    folder : pathlib.Path
        Its path.
    total : int
        Number of scenes of the sweep; there are fewer rows while it is not finished.
    keys : tuple of str
        The varied keys.
    columns : mapping of str to ndarray, shape (rows,)
        ``index``, the keys, ``status``, ``reason``, ``message``, ``scene`` (hash of the scene's content) and the
        numbers of the grasps; numbers that a row does not have are NaN. Keys whose values are not all numbers hold
        words.
    grid_keys : tuple of str
        Keys with a few values each: keys of the grid, and keys that follow them.
    units : mapping of str to str
        Units of keys and numbers, where known.
    requested : mapping
        The ``maps`` and ``pareto`` pictures that the configuration asks for.
    statistics : mapping
        Times of the call that made it.
    """

    kind: ClassVar[str] = "sweep"
    dimensions: ClassVar[tuple[Dimension, ...]] = (Dimension("row", "scenes that have a row", "index"),)

    on_request: ClassVar[tuple[Picture, ...]] = (
        Picture("map", "continuum_grasp.addons.sweeps.pictures:plot_map"),
        Picture("pareto", "continuum_grasp.addons.sweeps.pictures:plot_front"),
    )

    folder: Path
    total: int
    keys: tuple[str, ...]
    columns: Mapping[str, NDArray[Any]]
    grid_keys: tuple[str, ...] = ()
    units: Mapping[str, str] = field(default_factory=dict)
    requested: Mapping[str, Any] = field(default_factory=dict)
    statistics: Mapping[str, Any] = field(default_factory=dict)
    scene: None = None
    """Scene of the result; None, since a sweep has many."""
    warnings: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.columns["index"])

    @check_arguments
    def __getitem__(self, name: str) -> NDArray[Any]:
        """A column.

        Raises
        ------
        InputError
            There is no such column.
        """
        if name not in self.columns:
            raise InputError(f"no such column: {name!r}{nearest(name, self.columns)}")
        return self.columns[name]

    @property
    def finished(self) -> bool:
        """Whether every scene has its row."""
        return len(self) == self.total

    @property
    def solved(self) -> NDArray[np.bool_]:
        """Rows with a verified grasp, shape (rows,)."""
        return np.isin(self["status"], SOLVED)

    @property
    def counts(self) -> dict[str, int]:
        """Rows by status, the most frequent first."""
        return dict(Counter(self["status"].tolist()).most_common())

    @property
    def failures(self) -> dict[str, int]:
        """Rows without a grasp by reason, or by status where there is none; the most frequent first."""
        return dict(Counter(self.kinds[~self.solved].tolist()).most_common())

    @property
    def kinds(self) -> NDArray[np.str_]:
        """Reason of every row, or its status where it has none (rows,)."""
        return np.asarray(np.where(self["reason"] == "", self["status"], self["reason"]))

    def label(self, name: str) -> str:
        """Words for a column, with its unit."""
        numbers = self[name].dtype.kind in "iuf"
        unit = self.units.get(name) or "1" * numbers
        _, words = SWEEP_QUANTITIES.get(name, ("", name))
        return f"{words} [{unit}]" if unit else words

    def of_grasps(self, name: str) -> Array:
        """Numbers of a column (rows,); NaN where there is no grasp, and of words."""
        values = self[name]
        return np.where(self.solved, values, np.nan) if values.dtype.kind in "iuf" else np.full(len(self), np.nan)

    @check_arguments
    def map(
        self, x: str, y: str, color: str, reduce: Literal["median", "mean", "least", "greatest"] = "median"
    ) -> tuple[NDArray[Any], NDArray[Any], Array, NDArray[np.str_]]:
        """Compute a map of a quantity: over the grid where both columns are keys of it, else row by row.

        Parameters
        ----------
        x, y, color : str
            Columns across, upwards and in color.
        reduce : {"median", "mean", "least", "greatest"}
            Value that a place of the grid shows for several grasps.

        Returns
        -------
        x, y : ndarray, shapes (nx,) and (ny,)
            Numbers or words, in the order of the picture; row by row (rows,), as the others.
        color : ndarray, shape (ny, nx)
            The quantity; NaN where there is no grasp.
        kind : ndarray of str, shape (ny, nx)
            Reason why there is none; empty where there is one, or no row yet.
        """
        colors = self.of_grasps(color)
        kinds = np.where(self.solved, "", self.kinds)
        if not {x, y} <= set(self.grid_keys):
            return self[x], self[y], colors, kinds
        (xs, column), (ys, row) = _places(self[x]), _places(self[y])
        color_at = np.full((len(ys), len(xs)), np.nan)
        kind_at = np.full(color_at.shape, "", dtype=object)
        # Rows of one place stand together after sorting: one pass, also for millions of rows.
        order = np.lexsort((column, row))
        cells = row[order] * len(xs) + column[order]
        starts = np.flatnonzero(np.diff(cells, prepend=-1))
        for rows in np.split(order, starts[1:]) if len(order) else ():
            place = row[rows[0]], column[rows[0]]
            there = colors[rows][np.isfinite(colors[rows])]
            if len(there):
                color_at[place] = _REDUCE[reduce](there)
            else:
                names, counts = np.unique(kinds[rows], return_counts=True)  # the most frequent reason
                kind_at[place] = names[np.argmax(counts)]
        return xs, ys, color_at, kind_at.astype(str)

    @check_arguments
    def front(self, x: str, y: str, x_best: Best = "least", y_best: Best = "least") -> Indices:
        """Find the rows of the Pareto front of two quantities (n,): no other grasp is better in both.

        In the order of x; ``x_best`` and ``y_best`` are the directions that are better.
        """
        xs, ys = self.of_grasps(x), self.of_grasps(y)
        rows = np.flatnonzero(np.isfinite(xs) & np.isfinite(ys))
        return rows[pareto(xs[rows], ys[rows], x_best == "greatest", y_best == "greatest")]

    def run_folder(self, index: int) -> Path:
        """The folder of a run, by the number of its scene."""
        return run_path(self.folder, index)

    def drawable(self) -> list[Picture]:
        """The maps and Pareto pictures that the configuration asks for."""
        return _pictures(self.requested)

    @property
    def _own_folder(self) -> Path:
        return self.folder

    @classmethod
    def file_names(cls, kind: str) -> set[str]:
        """Names of the files of a sweep, its growing table among them."""
        return super().file_names(kind) | ({CSV} if kind == cls.kind else set())

    @check_arguments
    def save(self, folder: str | os.PathLike[str]) -> Path:
        """Write the table as arrays into another folder than the sweep's own, which has it as it grows."""
        if Path(folder).resolve() == self.folder.resolve():
            raise InputError("the sweep is stored in this folder already", file=str(folder))
        return super().save(folder)

    @property
    def index(self) -> NDArray[Any]:
        """Number of the scene of each row, shape (rows,)."""
        return self["index"]

    @property
    def name(self) -> str | None:
        """Name of the sweep."""
        name: str | None = read_plan(self.folder).get("name")
        return name

    @property
    def status(self) -> str:
        """``finished``, or ``unfinished`` where scenes have no row yet."""
        return "finished" if self.finished else "unfinished"

    def pairs(self) -> dict[str, str]:
        """Number of scenes with a grasp, and reasons of the others."""
        return {
            "scenes": f"{len(self)} of {self.total}",
            "varied": ", ".join(self.keys),
            "status": ", ".join(f"{count} {name}" for name, count in self.counts.items()) or "none",
            "without a grasp": ", ".join(f"{count} {name}" for name, count in self.failures.items()) or "none",
        }

    def declared(self) -> list[Stored]:
        """The columns."""
        declared = []
        for name, values in self.columns.items():
            unit = "text" if values.dtype.kind == "U" else self.units.get(name, "")
            _, meaning = SWEEP_QUANTITIES.get(name, ("", "varied key" if name in self.keys else name))
            declared.append(Stored(name, "(row,)", unit, meaning))
        return declared

    def stored_arrays(self) -> dict[str, Any]:
        """The columns by name."""
        return dict(self.columns)


@check_arguments
def sweep_table(folder: str | os.PathLike[str]) -> SweepTable:
    """Read the table of a sweep, also while it grows.

    Parameters
    ----------
    folder : path-like
        The sweep's folder.

    Returns
    -------
    SweepTable

    Raises
    ------
    InputError
        There is no sweep in the folder.

    Examples
    --------
    >>> import tempfile
    >>> import continuum_grasp as cg
    >>> folder = tempfile.mkdtemp()
    >>> mass = {"object.mass": {"values": [0.1]}}  # kg
    >>> config = {"scene": "configs/grasp/mug_arcs.yaml", "vary": mass}
    >>> _ = cg.sweep(config, folder=folder, workers=1, keep="none")
    >>> cg.sweep_table(folder)["object.mass"].tolist()  # kg
    [0.1]
    """
    target = Path(folder)
    plan = read_plan(target)
    columns = {name: _column(values, name in _TEXTS) for name, values in _cells(target, plan).items()}
    units = {key: unit for key, unit in plan.get("units", {}).items() if unit}
    follow = (key for key, tie in plan["follow"].items() if tie["key"] in plan["vary"])
    grid = (*plan["vary"], *follow)
    pictures = plan.get("pictures", {})
    keys = tuple(keys_of(plan))
    return SweepTable(target, int(plan["scenes"]), keys, columns, grid, units, pictures)


def _cells(folder: Path, plan: Mapping[str, Any]) -> dict[str, list[Any]]:
    """Entries of all rows by column, in the order of the scenes; None where a row has none."""
    cells: dict[str, list[Any]] = {name: [] for name in ("index", *_TEXTS, *keys_of(plan), *plan["columns"])}
    for row in rows_of(folder, int(plan["scenes"])):
        entries = row | row["values"]
        for name, values in cells.items():
            values.append(entries.get(name))
    order = np.argsort(cells["index"], kind="stable")
    return {name: [values[k] for k in order] for name, values in cells.items()}


def _column(values: list[Any], words: bool) -> NDArray[Any]:
    if words or any(isinstance(value, str | bool) for value in values):
        return np.array([_word(value) for value in values], dtype=str)
    if values and all(isinstance(value, int) for value in values):  # NaN needs floats
        return np.array(values, dtype=int)
    return np.array([np.nan if value is None else value for value in values], dtype=float)


def _word(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return str(value).lower()
    return str(value)


def _places(values: NDArray[Any]) -> tuple[NDArray[Any], Indices]:
    """Distinct values, numbers in their order and words as they come, and which each row has."""
    distinct, first, place = np.unique(values, return_index=True, return_inverse=True)
    if values.dtype.kind in "iuf":
        return distinct, place.astype(np.int64)
    order = np.argsort(first)
    return distinct[order], np.argsort(order)[place]


def write_csv(folder: Path) -> None:
    """Write ``table.csv``, in the order of the scenes."""
    plan = read_plan(folder)
    cells = _cells(folder, plan)
    names = ("index", "scene", *keys_of(plan), "status", "reason", *plan["columns"], "message")
    with replacing(folder / CSV) as temporary, open(temporary, "w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(names)
        for row in zip(*(cells[name] for name in names), strict=True):
            # true and false as in YAML and JSON, not as in Python.
            writer.writerow([json.dumps(cell) if isinstance(cell, bool) else cell for cell in row])


def _pictures(requested: Mapping[str, Sequence[Mapping[str, Any]]]) -> list[Picture]:
    """The ``maps`` and the ``pareto`` pictures that a configuration asks for, by name."""
    maps = [
        Picture(
            f"map_{k + 1}_{_file_name(spec['color'])}", "continuum_grasp.addons.sweeps.pictures:plot_map", options=spec
        )
        for k, spec in enumerate(requested.get("maps", ()))
    ]
    fronts = [
        Picture(
            f"pareto_{k + 1}_{_file_name(spec['x'])}_{_file_name(spec['y'])}",
            "continuum_grasp.addons.sweeps.pictures:plot_front",
            options=spec,
        )
        for k, spec in enumerate(requested.get("pareto", ()))
    ]
    return maps + fronts


def _file_name(column: str) -> str:
    return re.sub(r"[^A-Za-z0-9]+", "_", column).strip("_")
