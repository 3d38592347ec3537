"""From files, as a configuration describes them, to measurements."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any, cast

from continuum_grasp.addons.identification.data import Data, Poses
from continuum_grasp.addons.identification.data_files import files_in, in_data_folder, located
from continuum_grasp.addons.identification.read_headings import by_headings
from continuum_grasp.addons.identification.read_sets import changed_at, plain_scene, read_set
from continuum_grasp.addons.identification.scene import DataSet, IdentifyScene, StaticPoses, as_column
from continuum_grasp.base import InputError, check_arguments
from continuum_grasp.scene import DataTable, Scene


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
        return [measured for file in files for measured in by_headings(file, scene)]
    used: set[Path] = set()
    read = dict[Path, _ReadColumns]()
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
            read.setdefault(file, _ReadColumns(table)).add(data_set, key)
            for choice in data_set.where:
                table = table.chosen(choice.column, choice.equals)
            measurements += read_set(data_set, table, changed_scene, data_set.name or file.stem, key)
    for path in paths:
        if path in files and path not in used:
            wanted = ", ".join(str(data_set.file) for data_set in sets)
            raise InputError(f"no set of the configuration reads this file; the sets read {wanted}", file=str(path))
    unread = tuple(text for columns in read.values() if (text := columns.unread))
    return [replace(measured, unread=() if k else unread) for k, measured in enumerate(measurements)]


class _ReadColumns:
    """Columns of a table that sets read, and unused columns."""

    def __init__(self, table: DataTable) -> None:
        self._table = table
        self._read = set[int]()

    def add(self, data_set: DataSet, key: str) -> None:
        """Note the columns that a set reads."""
        self._read |= {self._table.index(name) for name, _ in _columns(data_set.model_dump(), key)}

    @property
    def unread(self) -> str:
        """Name the file and its unused columns; empty if all are used, and for bags."""
        names = [name for at, name in enumerate(self._table.headings) if at not in self._read]
        return f"{Path(self._table.file).name}: {', '.join(names)}" if names and not self._table.topics else ""


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
    (poses,) = read_set(plain, DataTable.of(headings, cells), changed, data.name or key, key)
    return headings, cells, cast(Poses, poses)


_ROWS = 5000
"""Most rows to choose from [1]: the equilibria of so many take a quarter of a minute."""
