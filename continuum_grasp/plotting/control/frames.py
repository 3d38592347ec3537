"""A moving picture of a closed loop: the finger, where its tip was, and where the controller thinks it will go."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.plotting.control.scene import draw_surroundings, zone_points
from continuum_grasp.plotting.drawable import DrawableControl
from continuum_grasp.plotting.drawing.axes import (
    BLUE,
    GREEN,
    GREY,
    INK,
    ORANGE,
    bend_box,
    head,
    new_figure,
    plane_axes,
    quiet,
)
from continuum_grasp.plotting.drawing.finger_shape import draw_clamp, mass_positions, masses_of
from continuum_grasp.plotting.motion.animation import animate

__all__ = ["animate_control", "control_frames"]

_DPI = 100


def animate_control(
    run: DrawableControl, path: str | os.PathLike[str], fps: float = 30.0, *, speed: float = 1.0, width: int = 640
) -> Path:
    """Write an animation of a closed loop: finger, trail, set-point, predicted path of the tip, zones.

    Parameters and errors are those of ``animate``.
    """
    return animate(run, path, fps, speed=speed, width=width, draw=control_frames)


def control_frames(run: Any, indices: NDArray[Any], width: int) -> Iterator[NDArray[Any]]:
    """Draw a closed loop frame by frame; as ``frames``."""
    t, tip, wanted = np.asarray(run.t), np.asarray(run.tip), run.tip_reference
    unique, back = np.unique(indices, return_inverse=True)
    shapes = np.asarray(run.backbone(unique, points=60))
    points = [shapes, tip, *([] if wanted is None else [wanted]), *zone_points(run.scene)]
    box = bend_box(points, 0.09 * run.length)
    across = 2 * max(1, width // 2)
    high = 2 * round(((across - 80) * (box[3] - box[2]) / (box[1] - box[0]) + 110) / 2)
    figure = new_figure(across / _DPI, high / _DPI)
    figure.set_dpi(_DPI)
    canvas: Any = figure.canvas
    ax = plane_axes(quiet(figure.add_subplot()), box, colorbar=False)
    draw_surroundings(ax, run.scene)
    draw_clamp(ax, shapes[0], run.length)
    if wanted is not None:
        ax.plot(*wanted.T, color=ORANGE, linewidth=0.8, alpha=0.6, zorder=1)
    style: dict[str, Any] = {"animated": True}
    (trail,) = ax.plot([], [], color=GREY, linewidth=0.9, zorder=1, **style)
    (finger,) = ax.plot([], [], color=BLUE, linewidth=2.6, solid_capstyle="round", zorder=2, **style)
    (ahead,) = ax.plot([], [], color=GREEN, linewidth=1.4, zorder=3, **style)
    (target,) = ax.plot([], [], "+", color=ORANGE, markersize=11, markeredgewidth=1.8, zorder=5, **style)
    (dots,) = ax.plot([], [], "o", color=INK, markersize=6, zorder=4, **style)
    ax.plot([], [], color=GREEN, linewidth=1.4, label="predicted")
    ax.plot([], [], "+", color=ORANGE, markersize=9, markeredgewidth=1.8, label="set-point")
    clock = ax.text(0.985, 0.975, "", transform=ax.transAxes, ha="right", va="top", color=INK, animated=True)
    head(ax, run.name, entries=2)
    canvas.draw()
    figure.set_layout_engine("none")
    background = canvas.copy_from_bbox(figure.bbox)
    masses = masses_of(run.scene)
    for k in back:
        at = unique[k]
        canvas.restore_region(background)
        trail.set_data(*tip[: at + 1].T)
        finger.set_data(*shapes[k].T)
        ahead.set_data(*run.plan_tip[min(at, len(run.plan_tip) - 1)].T)
        clock.set_text(f"{t[at]:.2f} s")
        moving = [trail, finger, ahead, clock]
        if masses:
            dots.set_data(*mass_positions(shapes[k], masses, run.length).T)
            moving.append(dots)
        if wanted is not None:
            target.set_data(*wanted[at : at + 1].T)
            moving.append(target)
        for artist in moving:
            ax.draw_artist(artist)
        yield np.asarray(canvas.buffer_rgba())[..., :3].copy()
