"""Files that appear whole or not at all."""

from __future__ import annotations

import contextlib
import hashlib
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import IO

from continuum_grasp.base import InputError
from continuum_grasp.results.record import kind_of_run, naming, note_file, swapped


def check_folder(folder: str | os.PathLike[str], verb: str | None = None) -> None:
    """Refuse a folder that is a file, or that cannot be made or written, or that holds what another ``verb`` wrote."""
    path = Path(folder)
    there = next(place for place in (path, *path.absolute().parents) if place.exists())
    if not there.is_dir():
        raise InputError("expected a folder, got a file", file=str(there))
    if not os.access(there, os.W_OK | os.X_OK):
        raise InputError("this folder cannot be written", file=str(there))
    kind = None if verb is None else kind_of_run(path)
    if kind not in (None, verb):
        raise InputError(f"the folder holds results of {kind}; choose another one, or remove it", file=str(folder))


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


@contextlib.contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Write a file under a temporary name and give it its own name once it is complete; folders are made.

    The body writes the path it is given, which lies in the same folder, ends in the same suffix and begins with
    ``.tmp-``. When the body ends without an error the file is flushed to the disk and renamed over ``path``; whoever
    opens ``path`` sees the old content or the new one, never a part. When the body raises, ``path`` is as before and
    the temporary file is removed. A killed process leaves ``path`` as before and may leave the temporary file. In the
    folder of a run the file is recorded as the run's.
    """
    target = Path(path)
    with naming(target):
        target.parent.mkdir(parents=True, exist_ok=True)
    with swapped(target) as temporary:
        yield temporary
        _flush(temporary)
        note_file(target, temporary)
    flush_folder(target.parent)


def write_text(text: str, path: str | os.PathLike[str]) -> Path:
    """Write a text file, UTF-8 with line feeds, whole or not at all; returns its path."""
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")
    return Path(path)


def _flush(path: Path) -> None:
    """Have the content of a file on the disk before it gets its name."""
    # Else a power cut after the rename may leave the new name with no content.
    with open(path, "r+b") as file:
        os.fsync(file.fileno())


def flush_folder(path: Path) -> None:
    """Have the names in a folder on the disk, where the system can do that."""
    if os.name != "posix":
        return
    handle = os.open(path, os.O_RDONLY)
    try:
        with contextlib.suppress(OSError):  # some network file systems refuse it
            os.fsync(handle)
    finally:
        os.close(handle)
