"""The energies over time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from continuum_grasp.plotting.drawing.axes import head, new_axes
from continuum_grasp.plotting.drawing.style import BLUE, INK, ORANGE

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from continuum_grasp.simulation.trajectory import Trajectory

__all__ = ["plot_energy"]


def plot_energy(trajectory: Trajectory, *, ax: Axes | None = None) -> Axes:
    """Draw kinetic, potential and total energy over time.

    Parameters
    ----------
    trajectory : Trajectory
        Its ``t`` (T,) [s], ``kinetic`` (T,) [J] and ``potential`` (T,) [J] are drawn.
    ax : matplotlib.axes.Axes, optional
        Where to draw; None: axes in a new figure.

    Returns
    -------
    matplotlib.axes.Axes
        The axes; lines are kinetic, potential and total energy.
    """
    ax = new_axes(ax)
    kinetic, potential = np.asarray(trajectory.kinetic), np.asarray(trajectory.potential)
    ax.plot(trajectory.t, kinetic, color=ORANGE, linewidth=1.3, label="kinetic")
    ax.plot(trajectory.t, potential, color=BLUE, linewidth=1.3, label="potential")
    ax.plot(trajectory.t, kinetic + potential, color=INK, linewidth=1.8, label="total")
    ax.set_xlabel("time [s]", color=INK)
    ax.set_ylabel("energy [J]", color=INK)
    ax.margins(x=0.0)
    head(ax, trajectory.name, entries=3)
    return ax
