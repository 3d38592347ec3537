"""What contacts bear over time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from continuum_grasp.errors import InputError
from continuum_grasp.plotting.drawing.axes import colors, head, new_axes
from continuum_grasp.plotting.drawing.style import INK

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from continuum_grasp.planning.result import Plan
    from continuum_grasp.simulation.trajectory import Trajectory

__all__ = ["plot_contact_forces"]


def plot_contact_forces(trajectory: Trajectory | Plan, *, ax: Axes | None = None) -> Axes:
    """Draw the normal force of every contact over time, and dashed the size of its friction force.

    Parameters
    ----------
    trajectory : Trajectory
        Its ``t`` (T,) [s] and ``contacts`` are drawn; contacts that never touch are left out.
    ax : matplotlib.axes.Axes, optional
        Where to draw; None: axes in a new figure.

    Returns
    -------
    matplotlib.axes.Axes
        The axes; two lines per contact, normal force and friction.

    Raises
    ------
    InputError
        There is no object.
    """
    contacts = trajectory.contacts
    if contacts is None:
        raise InputError("there are no contacts to draw: the scene has no object", key="object")
    ax = new_axes(ax)
    normal, shear = np.asarray(contacts.normal_force), np.asarray(contacts.shear)
    touching = [k for k in range(len(contacts.names)) if np.any(normal[:, k] > 0.0)]
    for k, color in zip(touching, colors(len(touching)), strict=True):
        ax.plot(trajectory.t, normal[:, k], color=color, linewidth=1.5, label=contacts.names[k])
        ax.plot(trajectory.t, shear[:, k], color=color, linewidth=1.0, linestyle="--")
    ax.set_xlabel("time [s]", color=INK)
    ax.set_ylabel("normal force, dashed: friction [N]", color=INK)
    ax.margins(x=0.0)
    head(ax, trajectory.name, entries=len(touching))
    return ax
