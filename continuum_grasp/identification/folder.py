"""Where the measured data lie that this project is checked against."""

from __future__ import annotations

import os
from pathlib import Path

__all__ = ["VARIABLE", "data_folder", "located"]

VARIABLE = "CONTINUUM_GRASP_DATA"
"""Environment variable with the path of the folder."""


def data_folder() -> Path | None:
    """The folder that ``CONTINUUM_GRASP_DATA`` names, or ``../shared/data`` beside a checkout; None: there is none.

    Examples
    --------
    >>> from continuum_grasp.identification import data_folder
    >>> folder = data_folder()
    >>> folder is None or folder.is_dir()
    True
    """
    named = os.environ.get(VARIABLE)
    folder = Path(named) if named else Path(__file__).resolve().parents[3] / "shared" / "data"
    return folder if folder.is_dir() else None


def located(path: Path) -> Path:
    """A path as it is given, or in the data folder where it is relative and not found as given."""
    folder = data_folder()
    if path.is_absolute() or path.exists() or folder is None:
        return path
    inside = folder / path
    return inside if inside.exists() else path
