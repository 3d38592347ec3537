"""A folder per run: ``result.npz`` and ``meta.json``."""

from __future__ import annotations

import contextlib
import io
import json
import os
import zipfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.base import InputError, Summarized, check_arguments
from continuum_grasp.results.atomic import flush_folder, replacing, write_text
from continuum_grasp.results.plain_values import digest, plain
from continuum_grasp.results.record import begin_run, check_own, naming, provenance, swapped

RESULT = "result.npz"
META = "meta.json"
FORMAT_VERSION = 1
"""Version of the format of run folders, the only one so far; a later one is refused rather than misread."""
_META_KEY = "__meta__"


@dataclass(frozen=True)
class Run(Summarized):
    """A run as read from its folder.

    Attributes
    ----------
    folder : pathlib.Path
        Its path.
    arrays : dict of str to numpy.ndarray
        Results, by name.
    meta : dict
        Origin of the results: see `write_run`.
    """

    folder: Path
    arrays: dict[str, NDArray[Any]]
    meta: dict[str, Any]

    def headline(self) -> str:
        """Kind, status and folder."""
        return f"of {self.meta.get('kind')}, {self.meta.get('status')}, in {self.folder}"

    def pairs(self) -> dict[str, str]:
        """Size of each array."""
        return {name: f"{array.shape} {array.dtype}" for name, array in self.arrays.items()}

    @staticmethod
    def digest(config: Any) -> str:
        """SHA-256 of a configuration's plain form, whatever the order of its keys: its ``config_sha256``."""
        return digest(config)

    @staticmethod
    def pack(arrays: Mapping[str, Any], meta: Mapping[str, Any] | None = None) -> bytes:
        """The content of ``result.npz`` alone, to write many runs elsewhere by `write_packed`."""
        return _packed(arrays, json.dumps(_complete(meta or {}), separators=(",", ":"), allow_nan=False))

    @staticmethod
    def write_packed(folder: Path, content: bytes) -> None:
        """Write the bytes of `pack` into a folder, without a record of its files; `read_run` reads it."""
        target = folder / RESULT
        with naming(target):
            target.parent.mkdir(parents=True, exist_ok=True)
        # Always the same name: what a killed process leaves is replaced.
        with swapped(target, "") as temporary:
            temporary.write_bytes(content)


def write_run(folder: str | os.PathLike[str], arrays: Mapping[str, Any], meta: Mapping[str, Any] | None = None) -> Path:
    """Write a run into a folder, whole or not at all.

    ``result.npz`` holds the arrays and a copy of the meta data, so one rename turns the old run into the new
    one; a process killed at any instant leaves the old run or the new one. ``meta.json`` is the same meta
    data for people and other programs: it is removed before that rename and written after it, so it is never
    from another run. Writing into a folder that already holds a run replaces that run: its pictures and
    reports go (`begin_run`), so save a run before it is drawn; files that no run wrote stay, and one under a name of
    this run's is an error.

    Parameters
    ----------
    folder : path-like
        Folder of the run; made where missing.
    arrays : mapping of str to array_like
        Results: numbers, booleans and strings of fixed length; no Python objects, nothing is
        pickled.
    meta : mapping, optional
        Origin of the results. Keys used by the package: ``kind`` (command that computes such runs), ``config``
        (resolved configuration), ``seed``,
        ``status``, ``statistics``, ``warnings``; others are stored as given. Added here: ``format_version``,
        ``config_sha256`` (of the plain form of ``config``), ``versions``, ``platform``, ``created`` (UTC).
        ``versions`` given by the caller, of a compiler or solver, are joined to those added.

    Returns
    -------
    pathlib.Path
        The folder.

    Raises
    ------
    InputError
        An array holds Python objects or has a name that cannot be a file name; a meta value has no JSON form;
        the folder's name is empty, or it has a ``result.npz`` or ``meta.json`` that no run wrote.
    OSError
        The files cannot be written.

    Notes
    -----
    The meta data is converted as by `continuum_grasp.results.plain_values.plain`: NaN and infinity become strings.

    Examples
    --------
    >>> from tempfile import mkdtemp
    >>> import numpy as np
    >>> from continuum_grasp.results import read_run, write_run
    >>> folder = write_run(mkdtemp(), {"force": np.ones(2)}, {"kind": "test", "status": "finished"})
    >>> sorted(path.name for path in folder.iterdir())
    ['.run.json', 'meta.json', 'result.npz']
    """
    if not os.fspath(folder):
        raise InputError("expected the name of a folder, got an empty one", key="folder")
    target = Path(folder)
    text = json.dumps(_complete(meta or {}), indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    content = _packed(arrays, text)
    check_files(target, (RESULT, META))
    with replacing(target / RESULT) as temporary:
        temporary.write_bytes(content)
        begin_run(target, (meta or {}).get("kind"), retained=(RESULT,))
        (target / META).unlink(missing_ok=True)
        flush_folder(target)
    write_text(text, target / META)
    return target


def check_files(folder: Path, names: Iterable[str]) -> None:
    """Refuse a folder with a file of one of some names that no run wrote; InputError names it.

    The contents identify results and their meta data too, because copies of a folder may lack the record.
    """
    for name in names:
        target = folder / name
        if not (name in _CONTENTS and target.is_file() and not target.is_symlink() and _CONTENTS[name](target)):
            check_own(target)


def _is_result(path: Path) -> bool:
    with contextlib.suppress(OSError, zipfile.BadZipFile), zipfile.ZipFile(path) as archive:
        return f"{_META_KEY}.npy" in archive.namelist()
    return False


def _is_meta(path: Path) -> bool:
    with contextlib.suppress(OSError, ValueError):
        meta = json.loads(path.read_bytes())
        return isinstance(meta, dict) and {"format_version", "config_sha256"} <= meta.keys()
    return False


_CONTENTS = {RESULT: _is_result, META: _is_meta}
"""Tests that recognize a run's file by its contents."""


@check_arguments
def read_run(folder: str | os.PathLike[str]) -> Run:
    """Read a run that `write_run` wrote.

    Parameters
    ----------
    folder : path-like
        Folder of the run.

    Returns
    -------
    Run
        Arrays and meta data of the same run, also where ``meta.json`` is missing.

    Raises
    ------
    InputError
        There is no run in the folder, or its file is damaged or of a later format.

    Examples
    --------
    >>> from tempfile import mkdtemp
    >>> import numpy as np
    >>> from continuum_grasp.results import read_run, write_run
    >>> run = read_run(write_run(mkdtemp(), {"force": np.ones(2)}, {"kind": "test"}))
    >>> run.meta["kind"], run.arrays["force"]
    ('test', array([1., 1.]))
    """
    target = Path(folder)
    path = target / RESULT
    if not path.is_file():
        raise InputError(f"expected a run folder with {RESULT} in it, found none", file=str(target))
    try:
        with open(path, "rb") as file, np.load(file, allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in stored.files}
        meta = json.loads(arrays.pop(_META_KEY).tobytes().decode("utf-8"))
        version = meta["format_version"]
    except Exception as error:  # zipfile and numpy raise ten kinds of them on damaged files
        raise InputError(f"not readable as the result of a run: {error}", file=str(path)) from error
    if version > FORMAT_VERSION:
        raise InputError(
            f"written in format {version}, this version of the package reads up to {FORMAT_VERSION}",
            file=str(path),
        )
    return Run(target, arrays, meta)


def _complete(meta: Mapping[str, Any]) -> dict[str, Any]:
    """The caller's meta data in plain form, with the entries that are always recorded."""
    entries: dict[str, Any] = plain(meta)
    recorded = {"config_sha256", "created", "format_version", "platform"} & entries.keys()
    if recorded:
        raise InputError(f"recorded by the run folder itself, not given: {', '.join(sorted(recorded))}", key="meta")
    config = entries.pop("config", None)
    about = provenance()
    return {
        "format_version": FORMAT_VERSION,
        "created": about["created"],
        "status": entries.pop("status", None),
        "seed": entries.pop("seed", None),
        "config_sha256": None if config is None else Run.digest(config),
        "versions": {**about["versions"], **entries.pop("versions", {})},
        "platform": about["platform"],
        **entries,
        "config": config,
    }


def _packed(arrays: Mapping[str, Any], text: str) -> bytes:
    """Content of the file, put together in memory: a ZIP file that fills the disk hides why it failed."""
    stored = {name: _checked(name, value) for name, value in arrays.items()}
    stored[_META_KEY] = np.frombuffer(text.encode("utf-8"), dtype=np.uint8)
    file = io.BytesIO()
    # np.savez has no choice of level; a smooth motion in doubles shrinks to 95 % at level 1, and to 94.5 % at 4 and 9.
    with zipfile.ZipFile(file, "w", compression=zipfile.ZIP_DEFLATED, compresslevel=4) as archive:
        for name, array in stored.items():
            # The size is not known before the end, and may exceed 4 GiB.
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                np.lib.format.write_array(member, array, allow_pickle=False)
    return file.getvalue()


def _checked(name: str, value: Any) -> NDArray[Any]:
    if not isinstance(name, str) or not name or name == _META_KEY or set(name) & set("/\\:\0") or name[0] == ".":
        raise InputError(f"expected a plain name for an array, got {name!r}", key="arrays")
    try:
        array = np.asarray(value)
    except ValueError as error:
        raise InputError(f"expected an array, got a ragged sequence: {error}", key=name) from error
    if array.dtype.hasobject:
        raise InputError("expected an array of numbers, booleans or strings, got Python objects", key=name)
    return array
