"""Pictures of missions: what happened over time, the finger at the instants that matter, and many plants."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from continuum_grasp.plotting.drawing.axes import GREY, INK, colors, head, new_figure, quiet
from continuum_grasp.plotting.drawing.finger_shape import draw_clamp, draw_forces, force_scale
from continuum_grasp.plotting.drawing.objects import draw_surroundings
from continuum_grasp.plotting.drawing.pictures import save_picture
from continuum_grasp.plotting.mission.scene import (
    DrawableMission,
    acting_forces,
    box_of,
    draw_grasp,
    draw_moment,
    explain_forces,
    instants,
    pull_at,
    pull_label,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["plot_mission_snapshots", "plot_mission_timeline", "save_mission_pictures"]

_BANDS = {
    "approach": "#EAF2FA",
    "squeeze": "#D3E5F5",
    "lift": "#FBEFD5",
    "hold": "#E3F3EA",
    "rest": "#E3F3EA",
    "pull": "#F8DDD2",
    "lower": "#FBEFD5",
    "release": "#EAF2FA",
}
_LEAST_INCH = 0.14
"""Width of a phase below which its name has no room."""
_COLUMNS = (4, 5, 6)
"""Numbers of snapshots in a row."""


def plot_mission_timeline(mission: DrawableMission) -> list[Axes]:
    """Draw tensions, contact forces, use of friction and motion of the object over the phases.

    Parameters
    ----------
    mission : MissionRun

    Returns
    -------
    list of matplotlib.axes.Axes
        Of phases, tensions, normal forces, friction, and motion, in one figure.
    """
    figure = new_figure(8.6, 9.4)
    axes = list(figure.subplots(5, 1, sharex=True, height_ratios=(0.66, 1.0, 1.35, 1.0, 1.0)))
    strip, tension, force, friction, motion = axes
    end = float(mission.run.t[-1])
    for ax in axes[1:]:
        quiet(ax)
        for span in mission.spans:
            ax.axvspan(span.start, span.end, color=_band(span.name), linewidth=0.0, zorder=0)
    _draw_tensions(tension, mission)
    _draw_forces(force, mission)
    _draw_friction(friction, mission)
    _draw_motion(motion, mission)
    motion.set_xlabel("time [s]", color=INK)
    motion.set_xlim(0.0, max(end, 1e-3))
    _draw_phases(strip, mission, end)
    return axes


def _band(name: str) -> str:
    return _BANDS.get(name.partition(" ")[0], "white")


def _draw_phases(ax: Axes, mission: DrawableMission, end: float) -> None:
    """Names of the phases, upright, and with what each pull pulls."""
    ax.set_axis_off()
    ax.set_ylim(0.0, 1.0)
    per_second = 7.4 / max(end, 1e-3)
    for span in mission.spans:
        if span.start >= end:
            break
        ax.axvspan(span.start, span.end, color=_band(span.name), linewidth=0.0)
        wide = per_second * (min(span.end, end) - span.start)
        if wide < _LEAST_INCH or span.name in ("rest", "end"):
            continue
        wrench = mission.pulls.get(span.name)
        text = span.name if wrench is None else pull_label(wrench).replace("pull ", "")
        rotation = 0.0 if wide > 0.07 * len(text) else 90.0
        middle = 0.5 * (span.start + min(span.end, end))
        ax.text(middle, 0.5, text, rotation=rotation, ha="center", va="center", fontsize=7.5, color=INK)
    ax.set_title(mission.name or " ", fontsize=10, color=INK, loc="left")


def _draw_tensions(ax: Axes, mission: DrawableMission) -> None:
    run = mission.run
    for k, color in zip(range(run.u.shape[1]), colors(run.u.shape[1]), strict=True):
        name = run.u_names[k]
        ax.stairs(
            run.u[:, k],
            run.t,
            color=color,
            linewidth=1.3,
            baseline=None,
            label=name.partition(" ")[0].replace("_", " "),
        )
        if name in run.r_names:
            ax.plot(run.t, run.r[:, run.r_names.index(name)], color=color, linewidth=0.9, linestyle="--")
    ax.plot([], [], color=GREY, linewidth=0.9, linestyle="--", label="set-point")
    for limit in np.unique([*run.u_min, *run.u_max]):
        ax.axhline(limit, color=GREY, linewidth=0.9, linestyle=":", zorder=1)
    ax.plot([], [], color=GREY, linewidth=0.9, linestyle=":", label="limit")
    ax.set_ylabel("tension [N]", color=INK)
    _legend(ax, run.u.shape[1] + 2)


def _draw_forces(ax: Axes, mission: DrawableMission) -> None:
    run = mission.run
    contacts = run.contacts
    shown = [k for k, name in enumerate(contacts.names) if np.any(contacts.normal_force[:, k] > 0.0)]
    for k, color in zip(shown, colors(len(shown)), strict=True):
        ax.plot(run.t, contacts.normal_force[:, k], color=color, linewidth=1.3, label=contacts.names[k])
    wanted = run.r[:, run.r_names.index(f"contact_force_{mission.held_contact} [N]")]
    ax.plot(run.t, wanted, color=INK, linewidth=1.0, linestyle="--", label=f"set-point of {mission.held_contact}")
    ax.plot(run.t[:-1], mission.force_estimate, color=GREY, linewidth=0.9, label="its estimate", zorder=1.9)
    ax.set_ylim(bottom=0.0)
    ax.set_ylabel("normal force [N]", color=INK)
    _legend(ax, len(shown) + 2)


def _draw_friction(ax: Axes, mission: DrawableMission) -> None:
    run = mission.run
    names = run.contacts.names
    shown = [k for k, name in enumerate(names) if np.any(np.isfinite(mission.friction_use[:, k]))]
    everything = [k for k, name in enumerate(names) if np.any(run.contacts.normal_force[:, k] > 0.0)]
    shade = dict(zip(everything, colors(len(everything)), strict=True))
    for k in shown:
        ax.plot(run.t, mission.friction_use[:, k], color=shade.get(k, GREY), linewidth=1.3, label=names[k])
    ax.axhline(1.0, color=GREY, linewidth=0.9, linestyle=":", zorder=1, label="whole friction cone")
    ax.set_ylim(0.0, 1.08)
    ax.set_ylabel("friction used [1]", color=INK)
    _legend(ax, len(shown) + 1)


def _draw_motion(ax: Axes, mission: DrawableMission) -> None:
    """Motion since the lift began; before that, the object is slid along the table by the finger."""
    run = mission.run
    start = next((span.start for span in mission.spans if span.name == "lift"), 0.0)
    begin = min(int(np.searchsorted(run.t, start - 1e-9)), len(run.t) - 1)
    moved = 1e3 * (run.object_pose - run.object_pose[begin])
    labels = ("x since the lift", "y", "height")
    for values, label, color in zip((moved[:, 0], moved[:, 1], moved[:, 3]), labels, colors(3), strict=True):
        ax.plot(run.t, values, color=color, linewidth=1.3, label=label)
    ax.set_ylabel("object moved [mm]", color=INK)
    _legend(ax, 3)


def _legend(ax: Axes, entries: int) -> None:
    head(ax, None, entries=entries, columns=max(entries, 1))


def plot_mission_snapshots(mission: DrawableMission) -> list[Axes]:
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
    shapes, poses = np.asarray(run.backbone(at, points=60)), np.asarray(run.object_pose)[at, :3]
    box = box_of(mission, shapes, poses, 0.06 * run.length)
    loads = [load for k in at for load in acting_forces(mission, int(k))]
    scale = force_scale(loads, run.length)
    columns = min(_COLUMNS, key=lambda count: -len(at) % count) if len(at) > max(_COLUMNS) else len(at)
    rows = -(-len(at) // columns)
    wide = 2.1
    high = wide * (box[3] - box[2]) / (box[1] - box[0])
    figure = new_figure(columns * (wide + 0.12) + 0.55, rows * (high + 0.42) + 0.95)
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
        draw_surroundings(ax, mission.scene)
        draw_clamp(ax, shape, run.length)
        draw_grasp(ax, mission, shape, pose)
        wrench = pull_at(mission, float(run.t[k]))
        draw_forces(ax, acting_forces(mission, int(k)), scale)
        draw_moment(ax, pose, float(wrench[2]), 0.12 * run.length)
        ax.set_title(f"{chosen[int(k)]}\n{run.t[k]:.2f} s", fontsize=8.5, color=INK, loc="left")
    figure.supxlabel("x [m]", fontsize=9, color=INK)
    figure.supylabel("y [m]", fontsize=9, color=INK)
    explain_forces(figure, mission.name, loads)
    return axes


def save_mission_pictures(mission: DrawableMission, folder: str | os.PathLike[str]) -> list[Path]:
    """Draw a mission into PNG files.

    Returns
    -------
    list of pathlib.Path
        ``timeline.png`` and ``snapshots.png`` in the folder, which is made where missing.
    """
    drawn = {"timeline": plot_mission_timeline, "snapshots": plot_mission_snapshots}
    return [save_picture(draw(mission), Path(folder) / f"{name}.png") for name, draw in drawn.items()]
