"""The path of the tip in the plane."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from continuum_grasp.plotting.drawing.axes import bend_box, color_bar, head, plane_axes, time_map
from continuum_grasp.plotting.drawing.style import INK

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from continuum_grasp.simulation.trajectory import Trajectory

__all__ = ["plot_tip_path"]


def plot_tip_path(trajectory: Trajectory, *, ax: Axes | None = None) -> Axes:
    """Draw where the tip goes in the plane, colored by time.

    Parameters
    ----------
    trajectory : Trajectory
        Its ``t`` (T,) [s] and ``tip`` (T, 2) [m, world] are drawn.
    ax : matplotlib.axes.Axes, optional
        Where to draw; None: axes in a new figure.

    Returns
    -------
    matplotlib.axes.Axes
        The axes; the path is their first collection.

    Examples
    --------
    >>> import continuum_grasp as cg
    >>> from continuum_grasp import plotting
    >>> motion = cg.simulate(cg.load("configs/simulate/hanging.yaml", ["time.duration=0.05"]))
    >>> plotting.plot_tip_path(motion).get_xlabel()
    'x [m]'
    """
    from matplotlib.collections import LineCollection

    t, tip = np.asarray(trajectory.t), np.asarray(trajectory.tip)
    span = np.nanmax(tip, axis=0) - np.nanmin(tip, axis=0)
    size = max(float(span.max()), 0.02 * trajectory.length)
    ax = plane_axes(ax, bend_box([tip], 0.06 * size))
    segments = np.stack([tip[:-1], tip[1:]], axis=1)
    path = LineCollection(list(segments), cmap=time_map(), linewidths=1.6, capstyle="round")
    path.set_array((t[:-1] + t[1:]) / 2)
    path.set_clim(float(t[0]), float(t[-1]))
    ax.add_collection(path)
    ax.plot(*tip[0], "o", color="white", markeredgecolor=INK, markersize=6, label="start", zorder=4)
    ax.plot(*tip[-1], "s", color=INK, markersize=5, label="end", zorder=4)
    color_bar(ax, path)
    head(ax, trajectory.name, entries=2)
    return ax
