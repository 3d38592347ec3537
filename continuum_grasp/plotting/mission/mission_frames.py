"""Frames of a mission: finger, object, contact forces, and where the controller predicts the tip to go."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.plotting.drawing.axes import head
from continuum_grasp.plotting.drawing.film import Film
from continuum_grasp.plotting.drawing.fingers import draw_clamp
from continuum_grasp.plotting.drawing.forces import draw_forces, force_scale, sizes_of
from continuum_grasp.plotting.drawing.style import GREEN, Z
from continuum_grasp.plotting.drawing.surroundings import draw_supports
from continuum_grasp.plotting.mission.instants import (
    acting_forces,
    box_of,
    draw_grasp,
    draw_moment,
    pull_at,
    pull_label,
)

if TYPE_CHECKING:
    from continuum_grasp.mission.result import MissionRun

__all__ = ["mission_frames"]


def mission_frames(mission: MissionRun, indices: NDArray[Any], width: int) -> Iterator[NDArray[Any]]:
    """Draw a mission frame by frame; as `motion_frames`."""
    run = mission.run
    unique, back = np.unique(indices, return_inverse=True)
    shapes, poses = np.asarray(run.backbone(unique, points=60)), mission.object_pose[unique, :3]
    forces = [acting_forces(mission, int(k)) for k in unique]
    scale = force_scale(sizes_of(one for some in forces for one in some), 0.25 * run.length)
    film = Film(box_of(mission, shapes, poses[[0, -1]], 0.09 * run.length), width)
    ax = film.ax
    draw_supports(ax, mission.scene.supports)
    draw_clamp(ax, shapes[0], run.length)
    (ahead,) = ax.plot([], [], color=GREEN, linewidth=1.6, zorder=Z.MASS, animated=True)
    ax.plot([], [], color=GREEN, linewidth=1.6, label="predicted tip")
    words = film.corner_text()
    head(ax, mission.name, entries=1)

    def moving(k: int) -> tuple[list[Any], list[Any]]:
        at = int(unique[k])
        t = float(run.t[at])
        ahead.set_data(*run.plan_tip[min(at, len(run.plan_tip) - 1)].T)
        words.set_text(f"{_phase(mission, t)}\n{t:.2f} s")
        passing = draw_grasp(ax, mission, shapes[k], poses[k], animated=True)
        passing += draw_moment(ax, poses[k], float(pull_at(mission, t)[2]), 0.12 * run.length, animated=True)
        passing += draw_forces(ax, forces[k], scale).values()
        return [ahead, words], passing

    return film.frames(back, moving)


def _phase(mission: MissionRun, t: float) -> str:
    """The phase at an instant; of a pull, what is pulled with."""
    span = next((span for span in mission.spans if span.start <= t < span.end), mission.spans[-1])
    return pull_label(mission.pulls[span.name]) if span.name in mission.pulls else str(span.name)
