"""A moving picture of a mission: finger, object, contact forces, and where the controller thinks the tip will go."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.plotting.drawing.axes import GREEN, INK, head, new_figure, plane_axes, quiet
from continuum_grasp.plotting.drawing.finger_shape import draw_clamp, draw_forces, force_scale
from continuum_grasp.plotting.drawing.objects import draw_surroundings
from continuum_grasp.plotting.mission.scene import (
    DrawableMission,
    acting_forces,
    box_of,
    draw_grasp,
    draw_moment,
    pull_at,
    pull_label,
)
from continuum_grasp.plotting.motion.animation import animate

__all__ = ["animate_mission", "mission_frames"]

_DPI = 100


def animate_mission(
    mission: DrawableMission, path: str | os.PathLike[str], fps: float = 25.0, *, speed: float = 1.0, width: int = 640
) -> Path:
    """Write an animation of a mission: finger, object, forces, predicted path of the tip, and the phase by name.

    Parameters and errors are those of ``animate``.
    """

    def draw(run: Any, indices: NDArray[Any], across: int) -> Iterator[NDArray[Any]]:
        return mission_frames(mission, indices, across)

    return animate(mission.run, path, fps, speed=speed, width=width, draw=draw)


def mission_frames(mission: DrawableMission, indices: NDArray[Any], width: int) -> Iterator[NDArray[Any]]:
    """Draw a mission frame by frame; as ``frames``."""
    run = mission.run
    unique, back = np.unique(indices, return_inverse=True)
    shapes, poses = np.asarray(run.backbone(unique, points=60)), np.asarray(run.object_pose)[unique, :3]
    loads = [acting_forces(mission, int(k)) for k in unique]
    scale = force_scale([load for one in loads for load in one], run.length)
    box = box_of(mission, shapes, poses[[0, -1]], 0.09 * run.length)
    across = 2 * max(1, width // 2)
    high = 2 * round(((across - 80) * (box[3] - box[2]) / (box[1] - box[0]) + 110) / 2)
    figure = new_figure(across / _DPI, high / _DPI)
    figure.set_dpi(_DPI)
    canvas: Any = figure.canvas
    ax = plane_axes(quiet(figure.add_subplot()), box, colorbar=False)
    draw_surroundings(ax, mission.scene)
    draw_clamp(ax, shapes[0], run.length)
    (ahead,) = ax.plot([], [], color=GREEN, linewidth=1.6, zorder=4, animated=True)
    ax.plot([], [], color=GREEN, linewidth=1.6, label="predicted tip")
    told: dict[str, Any] = {"transform": ax.transAxes, "ha": "right", "va": "top", "color": INK, "animated": True}
    words = ax.text(0.985, 0.975, "", **told)
    head(ax, mission.name, entries=1)
    canvas.draw()
    figure.set_layout_engine("none")
    background = canvas.copy_from_bbox(figure.bbox)
    for k in back:
        at = int(unique[k])
        t = float(run.t[at])
        canvas.restore_region(background)
        ahead.set_data(*run.plan_tip[min(at, len(run.plan_tip) - 1)].T)
        words.set_text(f"{_phase(mission, t)}\n{t:.2f} s")
        wrench = pull_at(mission, t)
        passing = draw_grasp(ax, mission, shapes[k], poses[k], animated=True)
        passing += draw_moment(ax, poses[k], float(wrench[2]), 0.12 * run.length, animated=True)
        passing += draw_forces(ax, loads[k], scale).values()
        for artist in sorted([*passing, ahead, words], key=lambda artist: float(artist.get_zorder())):
            ax.draw_artist(artist)
        for artist in passing:
            artist.remove()
        yield np.asarray(canvas.buffer_rgba())[..., :3].copy()


def _phase(mission: DrawableMission, t: float) -> str:
    """The phase at an instant; of a pull, what is pulled with."""
    span = next((span for span in mission.spans if span.start <= t < span.end), mission.spans[-1])
    return pull_label(mission.pulls[span.name]) if span.name in mission.pulls else str(span.name)
