"""What can be read as a file."""

from __future__ import annotations

import os
from pathlib import Path

from continuum_grasp.errors import InputError

__all__ = ["refuse_what_is_no_file"]


def refuse_what_is_no_file(path: str | os.PathLike[str], name: str | None = None) -> None:
    """Refuse folders, pipes and devices, which have no end or wait for a writer; a missing file is not looked at.

    Raises
    ------
    InputError
        There is something else than a file; ``name`` is what it is called in place of its path.
    """
    given = Path(path)
    try:
        if given.is_file() or not given.exists():
            return
    except (OSError, ValueError):  # opening it says why
        return
    what = "a folder" if given.is_dir() else "a pipe" if given.is_fifo() else "a device or socket"
    raise InputError(f"expected a file, got {what}", file=name or os.fspath(path))
