"""A mission at the instants that matter, side by side."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from continuum_grasp.plotting.drawing.axes import new_figure, quiet
from continuum_grasp.plotting.drawing.fingers import draw_clamp
from continuum_grasp.plotting.drawing.forces import Force, draw_forces, force_keys, force_scale, sizes_of
from continuum_grasp.plotting.drawing.style import INK
from continuum_grasp.plotting.drawing.surroundings import draw_supports
from continuum_grasp.plotting.mission.instants import (
    acting_forces,
    box_of,
    draw_grasp,
    draw_moment,
    instants,
    pull_at,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from continuum_grasp.mission.result import MissionRun

__all__ = ["plot_mission_snapshots"]

_COLUMNS = (4, 5, 6)
"""Numbers of snapshots in a row, of which that is taken that leaves the fewest places empty."""
_WIDE = 2.1
"""Width of one [inch]: six fit across a page in landscape."""
_WORDS = {"load": "pull", "contact": "contact, on the finger", "support": "support, on the object"}
"""What a legend calls a kind of force, where that is another word."""


def plot_mission_snapshots(mission: MissionRun) -> list[Axes]:
    """Draw finger, object, supports and forces at the instants that matter, side by side.

    Parameters
    ----------
    mission : MissionRun

    Returns
    -------
    list of matplotlib.axes.Axes
        One per instant, in one figure; forces of all are to one scale.
    """
    run, chosen = mission.run, instants(mission)
    at = np.array(list(chosen))
    shapes, poses = np.asarray(run.backbone(at, points=60)), mission.object_pose[at, :3]
    box = box_of(mission, shapes, poses, 0.06 * run.length)
    forces = [force for k in at for force in acting_forces(mission, int(k))]
    scale = force_scale(sizes_of(forces), 0.25 * run.length)
    columns = min(_COLUMNS, key=lambda count: -len(at) % count) if len(at) > max(_COLUMNS) else len(at)
    rows = -(-len(at) // columns)
    high = _WIDE * (box[3] - box[2]) / (box[1] - box[0])
    figure = new_figure(columns * (_WIDE + 0.12) + 0.55, rows * (high + 0.42) + 0.95)
    grid = figure.subplots(rows, columns, squeeze=False)
    for ax in grid.ravel()[len(at) :]:
        ax.set_axis_off()
    axes = list(grid.ravel()[: len(at)])
    for j, (ax, k, shape, pose) in enumerate(zip(axes, at, shapes, poses, strict=True)):
        quiet(ax).set_aspect("equal")
        ax.set_xlim(box[0], box[1])
        ax.set_ylim(box[2], box[3])
        ax.grid(False)
        ax.tick_params(labelleft=j % columns == 0, labelbottom=j + columns >= len(at), labelsize=8)
        draw_supports(ax, mission.scene.supports)
        draw_clamp(ax, shape, run.length)
        draw_grasp(ax, mission, shape, pose)
        wrench = pull_at(mission, float(run.t[k]))
        draw_forces(ax, acting_forces(mission, int(k)), scale)
        draw_moment(ax, pose, float(wrench[2]), 0.12 * run.length)
        ax.set_title(f"{chosen[int(k)]}\n{run.t[k]:.2f} s", fontsize=8.5, color=INK, loc="left")
    figure.supxlabel("x [m]", fontsize=9, color=INK)
    figure.supylabel("y [m]", fontsize=9, color=INK)
    _explain(figure, mission.name, forces)
    return axes


def _explain(figure: Figure, name: str | None, forces: Sequence[Force]) -> None:
    """Above all axes of a figure: the name, and what arrows mean, with the greatest force of each kind."""
    from matplotlib.lines import Line2D

    handles = [Line2D([], [], **key) for key in force_keys(forces, _WORDS)]
    figure.suptitle(name or " ", fontsize=10, color=INK, x=0.01, ha="left")
    figure.legend(handles=handles, loc="outside upper right", ncols=max(len(handles), 1), frameon=False, fontsize=9)
