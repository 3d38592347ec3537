"""A motion over time: bending coordinates, energies, contact forces."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from continuum_grasp.errors import InputError
from continuum_grasp.plotting.drawing.axes import colors, new_axes, split_unit, symbol, time_axes
from continuum_grasp.plotting.drawing.style import BLUE, INK, ORANGE

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from continuum_grasp.planning.result import Plan
    from continuum_grasp.simulation.trajectory import Trajectory

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

    Examples
    --------
    >>> import continuum_grasp as cg
    >>> from continuum_grasp import plotting
    >>> motion = cg.simulate(cg.load("configs/simulate/hanging.yaml", ["time.duration=0.05"]))
    >>> len(plotting.plot_coordinates(motion).lines) == motion.n
    True
    """
    ax = new_axes(ax)
    names = [split_unit(name) for name in trajectory.x_names[: trajectory.n]]
    values = np.asarray(trajectory.x)[:, : trajectory.n]
    alone = len(names) == 1  # which the axis names; the others have a legend
    for k, color in enumerate(colors(trajectory.n)):
        ax.plot(trajectory.t, values[:, k], color=color, linewidth=1.5, label=None if alone else symbol(names[k][0]))
    units = ", ".join(dict.fromkeys(unit for _, unit in names))
    quantity = _QUANTITY.get(units, "bending coordinate") + (f" {symbol(names[0][0])}" if alone else "")
    ax.margins(x=0.0)
    return time_axes(ax, f"{quantity} [{units}]", trajectory.name, columns=8)


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

    Examples
    --------
    >>> import continuum_grasp as cg
    >>> from continuum_grasp import plotting
    >>> motion = cg.simulate(cg.load("configs/simulate/hanging.yaml", ["time.duration=0.05"]))
    >>> [line.get_label() for line in plotting.plot_energy(motion).lines]
    ['kinetic', 'potential', 'total']
    """
    ax = new_axes(ax)
    kinetic, potential = np.asarray(trajectory.kinetic), np.asarray(trajectory.potential)
    ax.plot(trajectory.t, kinetic, color=ORANGE, linewidth=1.3, label="kinetic")
    ax.plot(trajectory.t, potential, color=BLUE, linewidth=1.3, label="potential")
    ax.plot(trajectory.t, kinetic + potential, color=INK, linewidth=1.8, label="total")
    ax.margins(x=0.0)
    return time_axes(ax, "energy [J]", trajectory.name)


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

    Examples
    --------
    >>> import continuum_grasp as cg
    >>> from continuum_grasp import plotting
    >>> motion = cg.simulate(cg.load("configs/simulate/swing_against_disc.yaml", ["time.duration=0.02"]))
    >>> plotting.plot_contact_forces(motion).get_ylabel()
    'normal force, dashed: friction [N]'
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
    ax.margins(x=0.0)
    return time_axes(ax, "normal force, dashed: friction [N]", trajectory.name)
