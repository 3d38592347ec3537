"""The bent finger at several instants, as frames and along the path of its tip, with the forces on it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.errors import InputError
from continuum_grasp.plotting.drawing.axes import Box, bend_box, draw_timed, head, plane_axes
from continuum_grasp.plotting.drawing.bodies import (
    draw_body,
    draw_clamp,
    draw_object,
    draw_supports,
    finger_outline,
    mass_positions,
    masses_of,
    outlines_at,
)
from continuum_grasp.plotting.drawing.film import Film
from continuum_grasp.plotting.drawing.forces import Force, draw_forces, explain, force_scale, sizes_of
from continuum_grasp.plotting.drawing.style import INK, Z

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
    t, length, scene = np.asarray(trajectory.t), trajectory.length, trajectory.scene
    indices = _nearest(t, times)
    shapes = np.asarray(trajectory.backbone(indices, points=60))
    outlines = outlines_at(trajectory, indices)
    forces, scale, box = _forces_and_box(trajectory, indices, [shapes], outlines)
    ax = plane_axes(ax, box)
    draw_supports(ax, scene.supports)
    for k, some in enumerate(outlines):
        draw_object(ax, some, faint=k < len(outlines) - 1)
    if outlines:
        draw_body(ax, finger_outline(shapes[-1], scene.finger.thickness_radius))
    lines = draw_timed(ax, shapes, t[indices], t)
    draw_clamp(ax, shapes[0], length)
    masses = masses_of(scene.finger)
    if masses:
        spots = np.concatenate([mass_positions(shape, masses, length) for shape in shapes])
        shade = lines.to_rgba(np.repeat(t[indices], len(masses)))
        ax.scatter(spots[:, 0], spots[:, 1], s=34, c=shade, edgecolors="white", linewidths=0.7, zorder=Z.MASS)
    everything = [one for some in forces for one in some]
    draw_forces(ax, everything, scale)
    explain(ax, masses, everything, trajectory.name)
    return ax


def _nearest(t: np.ndarray, times: Sequence[float] | int) -> np.ndarray:
    """Indices of the instants nearest to ``times``, each once."""
    if isinstance(times, int):
        if times < 1:
            raise InputError(f"expected at least one instant, got {times}", key="times")
        wanted = np.linspace(t[0], t[-1], times)
    else:
        wanted = np.asarray(times, dtype=float)
    slack = 1e-9 * max(1.0, abs(float(t[-1])))  # rounding of an instant that a user computes, k * step
    if not wanted.size or np.any((wanted < t[0] - slack) | (wanted > t[-1] + slack) | np.isnan(wanted)):
        raise InputError(f"expected instants from {t[0]:g} s to {t[-1]:g} s, got {wanted.tolist()}", key="times")
    return np.unique(np.abs(t[None, :] - wanted[:, None]).argmin(axis=1))


def motion_frames(trajectory: Trajectory | Plan, indices: NDArray[Any], width: int) -> Iterator[NDArray[Any]]:
    """Draw a motion at instants (F,), frame by frame: (height, width, 3), both even, as video coders want them."""
    length, scene = trajectory.length, trajectory.scene
    unique, back = np.unique(indices, return_inverse=True)
    shapes = np.asarray(trajectory.backbone(unique, points=60))
    outlines = outlines_at(trajectory, unique)
    bodies = [finger_outline(shape, scene.finger.thickness_radius) for shape in shapes] if outlines else []
    forces, scale, box = _forces_and_box(trajectory, unique, [shapes, np.asarray(trajectory.tip)], outlines)
    film = Film(box, width)
    ax = film.ax
    draw_supports(ax, scene.supports)
    patches = draw_object(ax, outlines[0], animated=True) if outlines else []
    if bodies:
        patches.append(draw_body(ax, bodies[0], animated=True))
    draw_clamp(ax, shapes[0], length)
    finger = film.finger(trajectory, unique, shapes, dot=7)
    explain(ax, masses_of(scene.finger), [one for some in forces for one in some], trajectory.name)

    def moving(k: int) -> tuple[list[Any], list[Any]]:
        # edges, then fillings of the object's parts, then the finger
        moved = [*outlines[k], *outlines[k], bodies[k]] if outlines else []
        for patch, outline in zip(patches, moved, strict=True):
            patch.set_xy(outline)
        return [*patches, *finger(k)], draw_forces(ax, forces[k], scale)

    return film.frames(back, moving)


def _forces_and_box(
    motion: Trajectory | Plan, indices: NDArray[Any], points: list[NDArray[Any]], outlines: list[list[NDArray[Any]]]
) -> tuple[list[list[Force]], float, Box]:
    """Forces at each of some instants, their drawn length per force, and limits that hold all arrows and shapes."""
    forces = [[one for one in motion.loads_at(int(k)) if np.hypot(*one[1]) > 0] for k in indices]
    everything = [one for some in forces for one in some]
    # a quarter of the finger: long enough to see the direction, without dwarfing the finger
    scale = force_scale(sizes_of(everything), 0.25 * motion.length)
    ends = [np.asarray(at) + scale * np.asarray(force) for at, force, _ in everything]
    box = bend_box([*points, *ends, *(one for some in outlines for one in some)], 0.09 * motion.length)
    return forces, scale, box


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
    t, tip = np.asarray(trajectory.t), np.asarray(trajectory.tip)
    span = np.nanmax(tip, axis=0) - np.nanmin(tip, axis=0)
    size = max(float(span.max()), 0.02 * trajectory.length)  # a tip that rests shows where it rests
    ax = plane_axes(ax, bend_box([tip], 0.06 * size))
    draw_timed(ax, np.stack([tip[:-1], tip[1:]], axis=1), (t[:-1] + t[1:]) / 2, t, 1.6)
    ax.plot(*tip[0], "o", color="white", markeredgecolor=INK, markersize=6, label="start", zorder=4)
    ax.plot(*tip[-1], "s", color=INK, markersize=5, label="end", zorder=4)
    head(ax, trajectory.name)
    return ax
