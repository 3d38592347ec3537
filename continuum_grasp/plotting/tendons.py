"""Pictures of tendons during a motion: tensions over time and along the finger, and loops by friction."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np

from continuum_grasp.errors import InputError
from continuum_grasp.plotting.drawing import axes
from continuum_grasp.plotting.drawing.style import INK

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from continuum_grasp.simulation.trajectory import Trajectory

_INSTANTS = 12
"""Instants at which tensions along the finger are drawn [1]."""
_STYLES: tuple[Literal["-", "--", ":", "-."], ...] = ("-", "--", ":", "-.")


@axes.over_time()
def plot_tensions(ax: Axes, trajectory: Trajectory) -> str:
    """Draw the tension of every tendon at its drive over time."""
    tensions = [along[:, 0] for _, along in _along(trajectory)]
    axes.curves(ax, trajectory.t, tensions, [f"tendon {k + 1}" for k in range(len(tensions))])
    return "tension at the drive [N]"


def plot_tensions_along(trajectory: Trajectory, *, ax: Axes | None = None) -> Axes:
    """Draw the tension of every tendon along the finger at some instants, colored by time."""
    along, t = _along(trajectory), np.asarray(trajectory.t)
    chosen = np.unique(np.linspace(0, len(t) - 1, _INSTANTS).round().astype(int))
    ax = axes.new_axes(ax)
    lines = [np.column_stack([at, tensions[k]]) for at, tensions in along for k in chosen]
    drawn = axes.draw_timed(ax, lines, np.tile(t[chosen], len(along)), t, 1.6)
    drawn.set_linestyle([_STYLES[k % len(_STYLES)] for k in range(len(along)) for _ in chosen])
    most = max(float(tensions[chosen].max()) for _, tensions in along)
    for k in range(len(along)):
        ax.plot([], [], color=INK, linestyle=_STYLES[k % len(_STYLES)], label=f"tendon {k + 1}")
    ax.set_xlim(0.0, trajectory.length)
    ax.set_ylim(0.0, 1.05 * max(most, 1e-3))
    axes.label(ax, "position along the finger [m]", "tension [N]")
    axes.head(ax, trajectory.name)
    return ax


def plot_tension_loop(trajectory: Trajectory, *, ax: Axes | None = None) -> Axes:
    """Draw the angle of the tip over the tension at the drive, per tendon: friction opens loops."""
    along = _along(trajectory)
    ax = axes.new_axes(ax)
    for k, ((_, tensions), color) in enumerate(zip(along, axes.colors(len(along)), strict=True)):
        ax.plot(tensions[:, 0], trajectory.tip_angle, color=color, linewidth=1.5, label=f"tendon {k + 1}")
    axes.label(ax, "tension at the drive [N]", "angle of the tip [rad]")
    axes.head(ax, trajectory.name)
    return ax


def _along(trajectory: Trajectory) -> list[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Places and tensions of every tendon."""
    found = trajectory.tensions_along
    if found is None:
        raise InputError("the tensions of this finger are those that are commanded: there is nothing more to draw")
    return found
