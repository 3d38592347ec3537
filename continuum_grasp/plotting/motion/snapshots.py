"""The bent finger at several instants, with the forces on it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from continuum_grasp.errors import InputError
from continuum_grasp.plotting.drawing.axes import bend_box, color_bar, plane_axes, time_map
from continuum_grasp.plotting.drawing.fingers import draw_body, draw_clamp, finger_outline, mass_positions, masses_of
from continuum_grasp.plotting.drawing.forces import draw_forces, explain, force_scale, sizes_of
from continuum_grasp.plotting.drawing.objects import draw_object, object_outlines
from continuum_grasp.plotting.drawing.style import Z
from continuum_grasp.plotting.drawing.surroundings import draw_supports

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from continuum_grasp.simulation.trajectory import Trajectory

__all__ = ["plot_snapshots"]


def plot_snapshots(
    trajectory: Trajectory,
    *,
    times: Sequence[float] | int = 12,
    ax: Axes | None = None,
) -> Axes:
    """Draw the finger at several instants, colored by time, with clamp, point masses and forces to scale.

    An object is drawn at the same instants, filled at the last of them, with its supports.

    Parameters
    ----------
    trajectory : Trajectory
        Its ``t``, ``backbone`` and ``loads_at`` are drawn, and the point masses of its ``scene``.
    times : sequence of float, or int
        Instants [s]; the nearest computed ones are drawn. A number: so many, evenly spaced from first to
        last.
    ax : matplotlib.axes.Axes, optional
        Where to draw; None: axes in a new figure.

    Returns
    -------
    matplotlib.axes.Axes
        The axes; the backbones are their first collection, arrows of each kind of force a quiver.

    Raises
    ------
    InputError
        No instant is asked for, or one outside the trajectory.

    Examples
    --------
    >>> import continuum_grasp as cg
    >>> from continuum_grasp import plotting
    >>> motion = cg.simulate(cg.load("configs/simulate/hanging.yaml", ["time.duration=0.05"]))
    >>> len(plotting.plot_snapshots(motion, times=[0.0, 0.05]).collections[0].get_segments())
    2
    """
    from matplotlib.collections import LineCollection

    t, length, scene = np.asarray(trajectory.t), trajectory.length, trajectory.scene
    indices = _nearest(t, times)
    shapes = np.asarray(trajectory.backbone(indices, points=60))
    forces = [one for k in indices for one in trajectory.loads_at(int(k)) if np.hypot(*one[1]) > 0]
    scale = force_scale(sizes_of(forces), 0.25 * length)
    ends = [np.asarray(position) + scale * np.asarray(force) for position, force, _ in forces]
    outlines = []
    if trajectory.object_pose is not None and scene.object is not None:
        outlines = [object_outlines(scene.object, pose) for pose in np.asarray(trajectory.object_pose)[indices, :3]]
    ax = plane_axes(ax, bend_box([shapes, *ends, *(one for some in outlines for one in some)], 0.09 * length))
    draw_supports(ax, scene.supports)
    for k, some in enumerate(outlines):
        draw_object(ax, some, faint=k < len(outlines) - 1)
    if outlines:
        draw_body(ax, finger_outline(shapes[-1], scene.finger.thickness_radius))

    lines = LineCollection(list(shapes), cmap=time_map(), linewidths=2.0, capstyle="round", zorder=Z.SHAPE)
    lines.set_array(t[indices])
    lines.set_clim(float(t[0]), float(t[-1]) if t[-1] > t[0] else float(t[0]) + 1.0)
    ax.add_collection(lines)
    draw_clamp(ax, shapes[0], length)
    masses = masses_of(scene.finger)
    if masses:
        spots = np.concatenate([mass_positions(shape, masses, length) for shape in shapes])
        shade = lines.to_rgba(np.repeat(t[indices], len(masses)))
        ax.scatter(spots[:, 0], spots[:, 1], s=34, c=shade, edgecolors="white", linewidths=0.7, zorder=Z.MASS)
    draw_forces(ax, forces, scale)
    explain(ax, masses, forces, trajectory.name)
    color_bar(ax, lines)
    return ax


def _nearest(t: np.ndarray, times: Sequence[float] | int) -> np.ndarray:
    """Indices of the instants nearest to ``times``, each once."""
    if isinstance(times, int):
        if times < 1:
            raise InputError(f"expected at least one instant, got {times}", key="times")
        wanted = np.linspace(t[0], t[-1], times)
    else:
        wanted = np.asarray(times, dtype=float)
    slack = 1e-9 * max(1.0, abs(float(t[-1])))
    if not wanted.size or np.any((wanted < t[0] - slack) | (wanted > t[-1] + slack) | np.isnan(wanted)):
        raise InputError(f"expected instants from {t[0]:g} s to {t[-1]:g} s, got {wanted.tolist()}", key="times")
    return np.unique(np.abs(t[None, :] - wanted[:, None]).argmin(axis=1))
