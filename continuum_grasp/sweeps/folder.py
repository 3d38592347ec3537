"""The folder of a sweep: its plan, its table as it grows, and the runs; one process works in it at a time."""

from __future__ import annotations

import json
import os
import shutil
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any

from continuum_grasp.errors import InputError
from continuum_grasp.results import begin_run, kind_of_run, write_text
from continuum_grasp.results.atomic import naming
from continuum_grasp.results.record import created_now, versions
from continuum_grasp.scene.document import refuse_what_is_no_file
from continuum_grasp.sweeps.plan import Plan, differences
from continuum_grasp.sweeps.quantities import decode

PLAN = "sweep.json"
TABLE = "table.jsonl"
_LOCK = ".lock"
_FLUSH_SECONDS = 2.0
"""Time between two writes to the disk [s]: what a loss of power can cost."""
_ABOUT = ("name", "created", "versions", "columns", "units", "pictures")
"""Entries of the stored plan that do not decide what is computed."""


def store_plan(folder: Path, plan: Plan) -> list[str]:
    """Write the plan into a new folder, or compare it with the one that is there.

    Returns
    -------
    list of str
        What to know before the work goes on.

    Raises
    ------
    InputError
        The folder holds a sweep of another plan, or a table without one.
    """
    new, pictures = plan.as_json(), plan.pictures
    if not (folder / PLAN).exists():
        if (folder / TABLE).exists():
            raise InputError(f"there is a {TABLE} without its {PLAN}; take another folder", file=str(folder))
        if kind_of_run(folder) not in (None, "sweep"):
            raise InputError(f"there is a run of {kind_of_run(folder)} in it; take another folder", file=str(folder))
        about = {"name": plan.sweep.name, "created": created_now(), "versions": versions()}
        _write(folder, {**about, "columns": list(plan.columns), "units": plan.units, "pictures": pictures, **new})
        return []
    old = read_plan(folder)
    changed = differences({key: value for key, value in old.items() if key not in _ABOUT}, new)
    if changed:
        raise InputError(
            "the folder holds a sweep with another plan: "
            + "; ".join(changed)
            + ". Take another folder, or remove this one to begin anew",
            file=str(folder),
        )
    if old.get("pictures") != pictures:
        begin_run(folder, "sweep", retained=(PLAN,))
        _write(folder, {**old, "pictures": pictures})
    was, now = old.get("versions", {}), versions()
    other = [f"{name} {was.get(name)}, now {now[name]}" for name in now if was.get(name) != now[name]]
    return [f"the rows so far were computed with other versions: {', '.join(other)}"] if other else []


def _write(folder: Path, plan: Mapping[str, Any]) -> None:
    write_text(json.dumps(plan, indent=1, ensure_ascii=False) + "\n", folder / PLAN)


def read_plan(folder: Path) -> dict[str, Any]:
    """The plan that a folder holds.

    Raises
    ------
    InputError
        There is none, or it cannot be read.
    """
    path = folder / PLAN
    refuse_what_is_no_file(path)
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(f"no sweep in this folder: there is no {PLAN}", file=str(folder)) from None
    except (OSError, ValueError) as error:
        raise InputError(f"cannot be read: {error}", file=str(path)) from None
    if not isinstance(found, dict) or not {"scenes", "vary", "sample", "follow", "record"} <= found.keys():
        raise InputError("not the plan of a sweep", file=str(path))
    return found


def lines_of(path: Path) -> Iterator[tuple[int, bytes, dict[str, Any]]]:
    """Place in the file, line and row of every whole line of a table; torn and damaged lines are left out."""
    refuse_what_is_no_file(path)
    try:
        file = open(path, "rb")  # noqa: SIM115
    except FileNotFoundError:
        return
    with file:
        place = 0
        for line in file:
            row = decode(line)
            if row is not None:
                yield place, line, row
            place += len(line)


class TableFile:
    """The growing table: whole lines are appended, each in one write, and nothing in it is ever changed.

    Every line is handed to the system at once, so that a killed process loses none; the disk is asked to keep them
    every two seconds, so that a power cut costs no more than that.

    Parameters
    ----------
    path : pathlib.Path
        A torn line at its end, of a process that was killed, is cut off.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        refuse_what_is_no_file(path)
        self._handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND | getattr(os, "O_BINARY", 0), 0o644)
        _cut_torn_end(self._handle)
        self._flushed = time.monotonic()

    def append(self, lines: bytes) -> None:
        """Add whole lines."""
        view = memoryview(lines)
        with naming(self._path):
            while view:
                view = view[os.write(self._handle, view) :]
            if time.monotonic() - self._flushed > _FLUSH_SECONDS:
                os.fsync(self._handle)
                self._flushed = time.monotonic()

    def close(self) -> None:
        """Have everything on the disk."""
        try:
            with naming(self._path):
                os.fsync(self._handle)
        finally:
            os.close(self._handle)


def run_path(folder: Path, index: int) -> Path:
    """The folder of one run; a thousand of them to a folder."""
    return folder / "runs" / f"{index // 1000:04d}" / f"{index:07d}"


def write_run_files(folder: Path, index: int, files: Mapping[str, bytes]) -> None:
    """Write the files of a run, whole or not at all."""
    target = run_path(folder, index)
    temporary = target.with_name(f".tmp-{target.name}")
    if temporary.exists():
        shutil.rmtree(temporary)
    try:
        temporary.mkdir(parents=True)
        for name, data in files.items():
            with naming(target / name):
                (temporary / name).write_bytes(data)
        if target.exists():  # of a process that was killed before it wrote the row
            shutil.rmtree(target)
        os.replace(temporary, target)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Keep other processes from working in the folder; the system lets go of it when this one ends, however it ends.

    Raises
    ------
    InputError
        Another process works in it.
    """
    folder.mkdir(parents=True, exist_ok=True)
    refuse_what_is_no_file(folder / _LOCK)
    with open(folder / _LOCK, "a+b") as file:
        if not _lock(file):
            raise InputError("another sweep is at work in this folder", file=str(folder))
        yield


def _lock(file: IO[bytes]) -> bool:
    try:
        import fcntl
    except ImportError:
        return _lock_elsewhere(file)
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # file systems without locks
        return True
    return True


def _lock_elsewhere(file: IO[bytes]) -> bool:
    with suppress(ImportError):
        import msvcrt

        file.seek(0)
        try:
            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined,unused-ignore]
        except OSError:
            return False
    return True


def _cut_torn_end(handle: int) -> None:
    """Cut off what stands behind the last end of a line."""
    end = os.lseek(handle, 0, os.SEEK_END)
    place = end
    while place > 0:
        start = max(0, place - 65536)
        os.lseek(handle, start, os.SEEK_SET)
        found = os.read(handle, place - start).rfind(b"\n")
        if found >= 0:
            place = start + found + 1
            break
        place = start
    if place < end:
        os.ftruncate(handle, place)
