"""Frames of a moving finger: the unmoving part is drawn once, only the rest again."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.plotting.drawable import DrawableTrajectory
from continuum_grasp.plotting.drawing.axes import BLUE, GREY, INK, bend_box, new_figure, plane_axes, quiet
from continuum_grasp.plotting.drawing.finger_shape import (
    draw_clamp,
    draw_forces,
    explain,
    force_scale,
    mass_positions,
    masses_of,
)
from continuum_grasp.plotting.drawing.objects import (
    draw_body,
    draw_object,
    draw_surroundings,
    finger_outline,
    object_outlines,
    object_poses,
)

__all__ = ["frames"]

_DPI = 100


def frames(trajectory: DrawableTrajectory, indices: NDArray[Any], width: int) -> Iterator[NDArray[Any]]:
    """Draw a motion frame by frame.

    Parameters
    ----------
    trajectory : Trajectory
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
    t, tip, length = np.asarray(trajectory.t), np.asarray(trajectory.tip), trajectory.length
    unique, back = np.unique(indices, return_inverse=True)
    shapes = np.asarray(trajectory.backbone(unique, points=60))
    loads = [trajectory.loads_at(int(k)) for k in unique]
    all_loads = [load for one in loads for load in one if np.hypot(*load[1]) > 0]
    scale = force_scale(all_loads, length)
    ends = [np.asarray(p) + scale * np.asarray(f) for p, f, _ in all_loads]
    poses = object_poses(trajectory, unique)
    outlines = [] if poses is None else [object_outlines(trajectory.scene, pose) for pose in poses]
    box = bend_box([shapes, tip, *ends, *(outline for one in outlines for outline in one)], 0.09 * length)

    across = 2 * max(1, width // 2)
    high = 2 * round(((across - 80) * (box[3] - box[2]) / (box[1] - box[0]) + 110) / 2)
    figure = new_figure(across / _DPI, high / _DPI)
    figure.set_dpi(_DPI)
    canvas: Any = figure.canvas
    ax = plane_axes(quiet(figure.add_subplot()), box)
    draw_surroundings(ax, trajectory.scene)
    bodies = draw_object(ax, outlines[0], animated=True) if outlines else []
    if outlines:
        bodies.append(draw_body(ax, finger_outline(trajectory.scene, shapes[0]), animated=True))
    draw_clamp(ax, shapes[0], length)
    (trail,) = ax.plot([], [], color=GREY, linewidth=0.9, zorder=1, animated=True)
    (finger,) = ax.plot([], [], color=BLUE, linewidth=2.6, solid_capstyle="round", zorder=2, animated=True)
    masses = masses_of(trajectory.scene)
    (dots,) = ax.plot([], [], "o", color=INK, markersize=7, zorder=4, animated=True)
    clock = ax.text(0.985, 0.975, "", transform=ax.transAxes, ha="right", va="top", color=INK, animated=True)
    explain(ax, masses, all_loads, trajectory.name)
    canvas.draw()
    figure.set_layout_engine("none")
    background = canvas.copy_from_bbox(figure.bbox)

    for k in back:
        canvas.restore_region(background)
        trail.set_data(*tip[: unique[k] + 1].T)
        finger.set_data(*shapes[k].T)
        clock.set_text(f"{t[unique[k]]:.2f} s")
        moved = [*outlines[k], finger_outline(trajectory.scene, shapes[k])] if outlines else []
        for body, outline in zip(bodies, moved, strict=True):
            body.set_xy(outline)
        moving = [*bodies, trail, finger, clock]
        if masses:
            dots.set_data(*mass_positions(shapes[k], masses, length).T)
            moving.append(dots)
        acting = [load for load in loads[k] if np.hypot(*load[1]) > 0]
        arrows = list(draw_forces(ax, acting, scale).values()) if acting else []
        for artist in (*moving, *arrows):
            ax.draw_artist(artist)
        for one in arrows:
            one.remove()
        yield np.asarray(canvas.buffer_rgba())[..., :3].copy()
