"""Files that appear whole or not at all."""

from __future__ import annotations

import contextlib
import os
import secrets
from collections.abc import Iterator
from pathlib import Path

__all__ = ["replacing"]


@contextlib.contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Write a file under a temporary name and give it its own name once it is complete.

    The body writes the path it is given, which lies in the same folder, ends in the same suffix and begins
    with ``.tmp-``. When the body ends without an error the file is flushed to the disk and renamed over
    ``path``; whoever opens ``path`` sees the old content or the new one, never a part. When the body raises,
    ``path`` is as before and the temporary file is removed. A killed process leaves ``path`` as before and
    may leave the temporary file.

    Parameters
    ----------
    path : path-like
        File to write; missing folders are made.

    Yields
    ------
    pathlib.Path
        Where the body is to write.

    Raises
    ------
    OSError
        The folder cannot be made or the file not be written.
    FileNotFoundError
        The body wrote nothing.
    """
    target = Path(path)
    target.parent.mkdir(parents=True, exist_ok=True)
    temporary = target.with_name(f".tmp-{os.getpid()}-{secrets.token_hex(6)}-{target.name}")
    try:
        yield temporary
        _flush(temporary)
        os.replace(temporary, target)
    finally:
        temporary.unlink(missing_ok=True)
    flush_folder(target.parent)


def _flush(path: Path) -> None:
    """Have the content of a file on the disk before it gets its name."""
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
