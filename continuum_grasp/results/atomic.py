"""Files that appear whole or not at all."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

from continuum_grasp.results.record import check_own, is_run_folder, naming, note_file, swapped


@contextlib.contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Write a file under a temporary name and give it its own name once it is complete; folders are made.

    The body writes the path it is given, which lies in the same folder, ends in the same suffix and begins with
    ``.tmp-``. When the body ends without an error the file is flushed to the disk and renamed over ``path``; whoever
    opens ``path`` sees the old content or the new one, never a part. When the body raises, ``path`` is as before and
    the temporary file is removed. A killed process leaves ``path`` as before and may leave the temporary file. In the
    folder of a run the file is recorded as the run's, and a file there that no run wrote is an InputError.
    """
    target = Path(path)
    if is_run_folder(target.parent):
        check_own(target)
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
