"""Folders of runs: whether one may be written, and locks on those in which a process works."""

from __future__ import annotations

import contextlib
import hashlib
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import IO

from continuum_grasp.base import InputError
from continuum_grasp.results.record import kind_of_run
from continuum_grasp.results.result import Result
from continuum_grasp.results.run_folder import check_files


def check_folder(folder: str | os.PathLike[str], verb: str | None = None) -> None:
    """Refuse a path that is a file, or a folder that cannot be created or written.

    Also refuse a folder with output of another ``verb``, or with a file that no run wrote under a name of this run.
    """
    path = Path(folder)
    there = next(place for place in (path, *path.absolute().parents) if place.exists())
    if not there.is_dir():
        raise InputError("expected a folder, got a file", file=str(there))
    if not os.access(there, os.W_OK | os.X_OK):
        raise InputError("this folder cannot be written", file=str(there))
    kind = None if verb is None else kind_of_run(path)
    if kind not in (None, verb):
        raise InputError(f"the folder holds results of {kind}; choose another one, or remove it", file=str(folder))
    if verb is not None:
        check_files(path, sorted(Result.file_names(verb)))


_HELD: dict[Path, contextlib.ExitStack] = {}
"""Locks of folders in which this process works, by folder."""


def hold_folder(folder: Path) -> None:
    """Keep other processes of this machine from a folder until `release_folders`, or the end of this one.

    The lock is beside the system's temporary files, since a folder that does not exist yet can be held too.
    """
    path = folder.resolve()
    name = f"continuum_grasp-{hashlib.sha256(os.fsencode(path)).hexdigest()[:20]}.lock"
    if path not in _HELD:
        stack = contextlib.ExitStack()
        with contextlib.suppress(OSError):  # where nothing can be locked, any process may work
            stack.enter_context(locked(Path(tempfile.gettempdir()) / name, folder, "run"))
        _HELD[path] = stack


def release_folders() -> None:
    """Let go of all folders that this process holds."""
    while _HELD:
        _HELD.popitem()[1].close()


@contextlib.contextmanager
def locked(lock: Path, folder: Path, what: str) -> Iterator[None]:
    """Keep other processes from a folder by a lock on a file, which the system lifts when this one ends, however.

    Raises
    ------
    InputError
        Another ``what`` holds it.
    """
    with open(lock, "a+b") as file:
        if not _lock(file):
            text = f"another {what} is using this folder: wait for it, or choose another folder"
            raise InputError(text, file=str(folder))
        yield


def _lock(file: IO[bytes]) -> bool:
    """Whether the file could be locked; where the system or the file system has no locks, any process may work."""
    with contextlib.suppress(ImportError):
        import fcntl

        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            return not isinstance(error, BlockingIOError)
        return True
    with contextlib.suppress(ImportError):  # Windows
        import msvcrt

        file.seek(0)
        try:
            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined,unused-ignore]
        except OSError:
            return False
    return True
