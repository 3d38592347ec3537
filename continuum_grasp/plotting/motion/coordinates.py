"""The bending coordinates over time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from continuum_grasp.plotting.drawing.axes import colors, head, new_axes, split_unit, symbol
from continuum_grasp.plotting.drawing.style import INK

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from continuum_grasp.planning.result import Plan
    from continuum_grasp.simulation.trajectory import Trajectory

__all__ = ["plot_coordinates"]

_QUANTITY = {"rad": "bending angle", "1/m": "curvature"}


def plot_coordinates(trajectory: Trajectory | Plan, *, ax: Axes | None = None) -> Axes:
    """Draw every bending coordinate over time.

    Parameters
    ----------
    trajectory : Trajectory
        Its ``t`` (T,) [s] and the first ``n`` columns of ``x`` are drawn: angles [rad] or nodal curvatures
        [1/m].
    ax : matplotlib.axes.Axes, optional
        Where to draw; None: axes in a new figure.

    Returns
    -------
    matplotlib.axes.Axes
        The axes; one line per coordinate, in order.
    """
    ax = new_axes(ax)
    names = [split_unit(name) for name in trajectory.x_names[: trajectory.n]]
    values = np.asarray(trajectory.x)[:, : trajectory.n]
    for k, color in enumerate(colors(trajectory.n)):
        ax.plot(trajectory.t, values[:, k], color=color, linewidth=1.5, label=symbol(names[k][0]))
    units = list(dict.fromkeys(unit for _, unit in names))
    quantity = _QUANTITY.get(units[0], "bending coordinate") if len(units) == 1 else "bending coordinate"
    ax.set_xlabel("time [s]", color=INK)
    ax.set_ylabel(f"{quantity} [{', '.join(units)}]", color=INK)
    ax.margins(x=0.0)
    if len(names) == 1:
        ax.set_ylabel(f"{quantity} {symbol(names[0][0])} [{names[0][1]}]", color=INK)
    head(ax, trajectory.name, entries=len(names) if len(names) > 1 else 0, columns=8)
    return ax
