"""Files of measurements, and where they may lie."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path

from continuum_grasp.addons.identification.scene import DataSet, IdentifyScene
from continuum_grasp.base import InputError, check_arguments
from continuum_grasp.scene import DataTable, Scene

VARIABLE = "CONTINUUM_GRASP_DATA"
"""Environment variable with the path of the folder."""


def sets_of(scene: IdentifyScene, paths: Sequence[Path]) -> tuple[DataSet, ...]:
    """Sets of a configuration that are in some files, or in folders of them."""
    files = list(files_in([in_data_folder(path) for path in paths], scene.data))

    def is_there(data_set: DataSet) -> bool:
        return any(data_set.file is None or file.resolve().match(data_set.file) for file in files)

    return tuple(filter(is_there, scene.data))


def located(scene: Scene, beside: Path | None) -> list[Path]:
    """Files that the data of a scene name, in a folder, or in one folder of the data folder.

    InputError if the scene names none, or one is in none of these, or in several.
    """
    sets = scene.data if isinstance(scene, IdentifyScene) else ()
    if not sets:
        raise InputError("expected files with measurements, or a configuration that names them: data: [{file: ...}]")
    paths = dict[Path, None]()
    for k, data_set in enumerate(sets):
        key = f"data[{k}].file"
        if data_set.file is None:
            raise InputError("expected the name of a file, or a file that is given", key=key)
        shared = data_folder()
        folders = [] if beside is None else [beside]
        folders += [] if shared is None else [shared, *sorted(folder for folder in shared.iterdir() if folder.is_dir())]
        mine = [files for folder in folders if (files := sorted(folder.glob(data_set.file)))]
        if not mine or (len(mine) > 1 and mine[0][0].parent != beside):
            where = "is in several folders" if mine else f"is neither beside the configuration nor in {VARIABLE}"
            raise InputError(f"{data_set.file} {where}: give the file or its folder", key=key)
        paths.update(dict.fromkeys(mine[0]))
    return list(paths)


def folder_of(scene: object) -> Path | None:
    """Folder of the file of a scene; None where it is given as such."""
    return Path(scene).parent if isinstance(scene, (str, os.PathLike)) else None


def files_in(paths: Sequence[Path], sets: Sequence[DataSet]) -> Iterator[Path]:
    """Return the files among paths, and the files in folders that sets name; the folder of a bag counts as a file."""
    for path in paths:
        if DataTable.is_bag_folder(path) and not _names_files_in(path, sets):
            yield path
        elif path.is_dir():
            # a folder may hold other files; in the order of their names, which no file system promises
            patterns = [pattern for of in sets for pattern in _patterns(of.file)] or _patterns(None)
            yield from sorted(file for file in path.iterdir() if any(file.resolve().match(p) for p in patterns))
        elif path.is_file():
            yield path
        else:
            raise InputError(f"no such file, nor in the folder that {VARIABLE} names", file=str(path))


def _names_files_in(folder: Path, sets: Sequence[DataSet]) -> bool:
    """Whether a set names a file in a folder."""
    files = [file.resolve() for file in folder.iterdir()]
    return any(of.file is not None and any(file.match(of.file) for file in files) for of in sets)


def _patterns(file: str | None) -> list[str]:
    return ["*.csv", "*.mcap", "*.db3"] if file is None else [file]


@check_arguments
def data_folder() -> Path | None:
    """The folder that ``CONTINUUM_GRASP_DATA`` names, or ``../shared/data`` next to a checkout; None: there is none.

    Examples
    --------
    >>> from continuum_grasp.addons.identification import data_folder
    >>> folder = data_folder()
    >>> folder is None or folder.is_dir()
    True
    """
    named = os.environ.get(VARIABLE)
    folder = Path(named) if named else Path(__file__).resolve().parents[3] / "shared" / "data"
    return folder if folder.is_dir() else None


def in_data_folder(path: Path) -> Path:
    """A path as it is given, or in the data folder where it is relative and not found as given."""
    folder = data_folder()
    if path.is_absolute() or path.exists() or folder is None or not (folder / path).exists():
        return path
    return folder / path
