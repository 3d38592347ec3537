"""Pictures of plans: the way through the plane, and the inputs."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from continuum_grasp.plotting.control.scene import draw_surroundings, zone_points
from continuum_grasp.plotting.drawing.axes import (
    BLUE,
    GREY,
    INK,
    ORANGE,
    bend_box,
    colors,
    head,
    new_axes,
    plane_axes,
    split_unit,
    time_bar,
    time_map,
)
from continuum_grasp.plotting.drawing.finger_shape import draw_clamp
from continuum_grasp.plotting.drawing.objects import draw_object, object_outlines
from continuum_grasp.plotting.drawing.objects import draw_surroundings as draw_supports
from continuum_grasp.plotting.drawing.pictures import save_picture
from continuum_grasp.plotting.motion.contact import plot_contact_forces
from continuum_grasp.plotting.motion.coordinates import plot_coordinates

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["plot_plan_inputs", "plot_plan_path", "save_plan_pictures"]

_SNAPSHOTS = 12


def plot_plan_path(plan: Any, *, ax: Axes | None = None) -> Axes:
    """Draw the finger at several nodes, coloured by time, the path of its tip, the goal and what must be avoided.

    Parameters
    ----------
    plan : Plan
    ax : matplotlib.axes.Axes, optional
        Where to draw; None: axes in a new figure.

    Returns
    -------
    matplotlib.axes.Axes
        The axes; the backbones are their first collection.
    """
    from matplotlib.collections import LineCollection

    around, tip = plan.prediction.scene, np.asarray(plan.tip)
    shown = np.unique(np.linspace(0, len(tip) - 1, _SNAPSHOTS).astype(int))
    shapes = plan.backbone(shown, points=60)
    things = [] if plan.object_pose is None else object_outlines(plan.scene, np.asarray(plan.object_pose)[-1, :3])
    ax = plane_axes(ax, bend_box([shapes, tip, *zone_points(around), *things], 0.07 * plan.length))
    draw_surroundings(ax, around.model_copy(update={"object": None}))
    if plan.object_pose is not None:
        draw_supports(ax, plan.scene)
        for k, pose in enumerate(np.asarray(plan.object_pose)[[0, -1], :3]):
            draw_object(ax, object_outlines(plan.scene, pose), faint=k == 0)
    lines = LineCollection(list(shapes), cmap=time_map(), linewidths=2.0, capstyle="round", zorder=2)
    lines.set_array(plan.t[shown])
    ax.add_collection(lines)
    draw_clamp(ax, shapes[0], plan.length)
    ax.plot(*tip.T, color=BLUE, linewidth=1.2, zorder=3, label="tip")
    goals = _goal_points(plan.scene.goal)
    if goals:
        ax.plot(*np.array(goals).T, "x", color=ORANGE, markersize=8, markeredgewidth=2.0, zorder=4, label="goal")
    time_bar(ax, lines)
    head(ax, plan.name, entries=1 + bool(goals))
    return ax


def _goal_points(goal: Any) -> list[tuple[float, float]]:
    """Points that the finger should reach [m]."""
    tip = [goal.tip.value] if goal.tip is not None else []
    return [*tip, *(goal.shape.value if goal.shape is not None else ())]


def plot_plan_inputs(plan: Any, *, ax: Axes | None = None) -> Axes:
    """Draw the inputs over time, with their limits.

    Parameters
    ----------
    plan : Plan
    ax : matplotlib.axes.Axes, optional
        Where to draw; None: axes in a new figure.

    Returns
    -------
    matplotlib.axes.Axes
        The axes; one line per input, in order, after those of the limits.
    """
    ax = new_axes(ax)
    for limit in plan.scene.input_limits:
        ax.axhline(limit, color=GREY, linewidth=0.9, linestyle="--", zorder=1)
    style = "default" if plan.scene.input.form == "linear" else "steps-post"
    for column, name, color in zip(plan.u.T, plan.u_names, colors(plan.u.shape[1]), strict=True):
        label = split_unit(name)[0].replace("_", " ")
        ax.plot(plan.t, column, color=color, linewidth=1.5, drawstyle=style, label=label)
    ax.set_xlabel("time [s]", color=INK)
    ax.set_ylabel(f"input [{split_unit(plan.u_names[0])[1]}]", color=INK)
    ax.margins(x=0.0)
    head(ax, plan.name, entries=plan.u.shape[1])
    return ax


def save_plan_pictures(plan: Any, folder: str | os.PathLike[str]) -> list[Path]:
    """Draw a plan into PNG files.

    Parameters
    ----------
    plan : Plan
        What to draw.
    folder : path-like
        Where the files go; made where missing, files of the same names are replaced.

    Returns
    -------
    list of pathlib.Path
        ``path.png``, ``inputs.png`` and ``coordinates.png`` in that folder, and ``contact_forces.png`` where there is
        an object.
    """
    drawn: dict[str, Any] = {"path": plot_plan_path, "inputs": plot_plan_inputs, "coordinates": plot_coordinates}
    if plan.contacts is not None:
        drawn["contact_forces"] = plot_contact_forces
    return [save_picture(draw(plan), Path(folder) / f"{name}.png") for name, draw in drawn.items()]
