"""Picture and web page of a result."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from continuum_grasp.grasp.result import GraspResult

__all__ = ["save_pictures"]


def save_pictures(result: GraspResult, folder: str | os.PathLike[str]) -> list[Path]:
    """Draw a result and write its page.

    Parameters
    ----------
    result : GraspResult
        A grasp, or the closest point to one, or neither: the scene is drawn then.
    folder : path-like
        Where the files go; created where missing, files of the same names are replaced.

    Returns
    -------
    list of pathlib.Path
        ``grasp.png`` and ``report.html`` in that folder.
    """
    from continuum_grasp.grasp.report.html.page import save_page
    from continuum_grasp.grasp.report.shown import resisted_forces
    from continuum_grasp.plotting.grasp.grasp import save_grasp_plot

    resisted, target = resisted_forces(result), Path(folder)
    picture = target / "grasp.png"
    save_grasp_plot(result, picture, resisted=resisted)
    return [picture, save_page(result, target / "report.html", resisted=resisted)]
