"""Pictures into files."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from continuum_grasp.plotting.drawable import DrawableTrajectory
from continuum_grasp.plotting.motion.contact import plot_contact_forces
from continuum_grasp.plotting.motion.coordinates import plot_coordinates
from continuum_grasp.plotting.motion.energy import plot_energy
from continuum_grasp.plotting.motion.snapshots import plot_snapshots
from continuum_grasp.plotting.motion.tip_path import plot_tip_path
from continuum_grasp.results import replacing

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["save_picture", "save_simulation_pictures"]

_PICTURES = {
    "snapshots": plot_snapshots,
    "tip_path": plot_tip_path,
    "coordinates": plot_coordinates,
    "energy": plot_energy,
}


def save_picture(drawn: Axes | Sequence[Axes] | Figure, path: str | os.PathLike[str], *, dpi: float = 150) -> Path:
    """Save the figure of what a plot returned.

    Parameters
    ----------
    drawn : matplotlib.axes.Axes, sequence of them, or matplotlib.figure.Figure
        What a plot returned.
    path : path-like
        File; its suffix is the format (png, pdf, svg). It is replaced whole.
    dpi : float
        Pixels per inch.

    Returns
    -------
    pathlib.Path
        ``path``.
    """
    first: Any = drawn[0] if isinstance(drawn, (list, tuple)) else drawn
    figure = first if hasattr(first, "savefig") else first.figure
    target = Path(path)
    with replacing(target) as temporary:
        figure.savefig(temporary, format=target.suffix[1:] or "png", dpi=dpi)
    return target


def save_simulation_pictures(trajectory: DrawableTrajectory, folder: str | os.PathLike[str]) -> list[Path]:
    """Draw snapshots, tip path, bending coordinates, energies and contact forces of a motion into PNG files.

    Parameters
    ----------
    trajectory : Trajectory
        What to draw.
    folder : path-like
        Where the files go; made where missing, files of the same names are replaced.

    Returns
    -------
    list of pathlib.Path
        ``snapshots.png``, ``tip_path.png``, ``coordinates.png`` and ``energy.png`` in that folder, and
        ``contact_forces.png`` where there is an object.
    """
    pictures = dict(_PICTURES)
    if getattr(trajectory, "contacts", None) is not None:
        pictures["contact_forces"] = plot_contact_forces
    return [save_picture(draw(trajectory), Path(folder) / f"{name}.png") for name, draw in pictures.items()]
