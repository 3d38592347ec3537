"""The bent finger at several instants, as frames and along the path of its tip, with the forces on it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.errors import InputError
from continuum_grasp.plotting.drawing.axes import bend_box, color_bar, head, plane_axes, time_map
from continuum_grasp.plotting.drawing.film import Film
from continuum_grasp.plotting.drawing.fingers import draw_body, draw_clamp, finger_outline, mass_positions, masses_of
from continuum_grasp.plotting.drawing.forces import draw_forces, explain, force_scale, sizes_of
from continuum_grasp.plotting.drawing.objects import draw_object, draw_supports, object_outlines
from continuum_grasp.plotting.drawing.style import BLUE, GRAY, INK, Z

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from continuum_grasp.planning.result import Plan
    from continuum_grasp.simulation.trajectory import Trajectory


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


def motion_frames(trajectory: Trajectory | Plan, indices: NDArray[Any], width: int) -> Iterator[NDArray[Any]]:
    """Draw a motion frame by frame.

    Parameters
    ----------
    trajectory : Trajectory or Plan
        What moves.
    indices : ndarray of int (F,)
        Instants to draw.
    width : int
        Width of a frame [pixels], made even.

    Yields
    ------
    ndarray of uint8 (height, width, 3)
        Height and width are even, as video coders want them.
    """
    t, tip, length, scene = np.asarray(trajectory.t), np.asarray(trajectory.tip), trajectory.length, trajectory.scene
    unique, back = np.unique(indices, return_inverse=True)
    shapes = np.asarray(trajectory.backbone(unique, points=60))
    forces = [[one for one in trajectory.loads_at(int(k)) if np.hypot(*one[1]) > 0] for k in unique]
    everything = [one for some in forces for one in some]
    scale = force_scale(sizes_of(everything), 0.25 * length)
    ends = [np.asarray(p) + scale * np.asarray(f) for p, f, _ in everything]
    outlines, bodies = [], []
    if trajectory.object_pose is not None and scene.object is not None:
        outlines = [object_outlines(scene.object, pose) for pose in np.asarray(trajectory.object_pose)[unique, :3]]
        bodies = [finger_outline(shape, scene.finger.thickness_radius) for shape in shapes]
    film = Film(bend_box([shapes, tip, *ends, *(one for some in outlines for one in some)], 0.09 * length), width)
    ax = film.ax
    draw_supports(ax, scene.supports)
    patches = draw_object(ax, outlines[0], animated=True) if outlines else []
    if bodies:
        patches.append(draw_body(ax, bodies[0], animated=True))
    draw_clamp(ax, shapes[0], length)
    (trail,) = ax.plot([], [], color=GRAY, linewidth=0.9, zorder=Z.SUPPORT, animated=True)
    (finger,) = ax.plot([], [], color=BLUE, linewidth=2.6, solid_capstyle="round", zorder=Z.SHAPE, animated=True)
    masses = masses_of(scene.finger)
    (dots,) = ax.plot([], [], "o", color=INK, markersize=7, zorder=Z.MASS, animated=True)
    clock = film.corner_text()
    explain(ax, masses, everything, trajectory.name)

    def moving(k: int) -> tuple[list[Any], list[Any]]:
        trail.set_data(*tip[: unique[k] + 1].T)
        finger.set_data(*shapes[k].T)
        clock.set_text(f"{t[unique[k]]:.2f} s")
        if masses:
            dots.set_data(*mass_positions(shapes[k], masses, length).T)
        # edges, then fillings of the object's parts, then the finger
        moved = [*outlines[k], *outlines[k], bodies[k]] if outlines else []
        for patch, outline in zip(patches, moved, strict=True):
            patch.set_xy(outline)
        arrows = list(draw_forces(ax, forces[k], scale).values())
        return [*patches, trail, finger, clock, *([dots] if masses else [])], arrows

    return film.frames(back, moving)


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
