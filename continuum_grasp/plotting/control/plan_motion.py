"""Pictures of planned motions: the path through the plane, and the inputs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from continuum_grasp.plotting.drawing.axes import (
    bend_box,
    color_bar,
    colors,
    head,
    new_axes,
    plane_axes,
    split_unit,
    time_axes,
    time_map,
)
from continuum_grasp.plotting.drawing.fingers import draw_clamp
from continuum_grasp.plotting.drawing.objects import (
    draw_object,
    draw_supports,
    draw_zones,
    object_outlines,
    zone_points,
)
from continuum_grasp.plotting.drawing.style import BLUE, GRAY, ORANGE, Z

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from continuum_grasp.planning.result import Plan

_SNAPSHOTS = 12
"""Nodes drawn, as of the snapshots of a simulation."""


def plot_plan_path(plan: Plan, *, ax: Axes | None = None) -> Axes:
    """Draw the finger at several nodes, colored by time, the path of its tip, the goal and what must be avoided.

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

    scene, tip, zones = plan.scene, np.asarray(plan.tip), plan.scene.bounds.keep_out
    shown = np.unique(np.linspace(0, len(tip) - 1, _SNAPSHOTS).astype(int))
    shapes = plan.backbone(shown, points=60)
    outlines = []
    if plan.object_pose is not None and scene.object is not None:
        outlines = [object_outlines(scene.object, pose) for pose in np.asarray(plan.object_pose)[[0, -1], :3]]
    points = [shapes, tip, *zone_points(zones), *(outlines[-1] if outlines else ())]
    ax = plane_axes(ax, bend_box(points, 0.07 * plan.length))
    draw_zones(ax, zones)
    draw_supports(ax, scene.supports)
    for k, outline in enumerate(outlines):
        draw_object(ax, outline, faint=k == 0)
    lines = LineCollection(list(shapes), cmap=time_map(), linewidths=2.0, capstyle="round", zorder=Z.SHAPE)
    lines.set_array(plan.t[shown])
    ax.add_collection(lines)
    draw_clamp(ax, shapes[0], plan.length)
    ax.plot(*tip.T, color=BLUE, linewidth=1.2, zorder=3, label="tip")
    goals = _goal_points(scene.goal)
    if goals:
        ax.plot(*np.array(goals).T, "x", color=ORANGE, markersize=8, markeredgewidth=2.0, zorder=4, label="goal")
    color_bar(ax, lines)
    head(ax, plan.name, entries=1 + bool(goals))
    return ax


def _goal_points(goal: Any) -> list[tuple[float, float]]:
    """Points that the finger should reach [m]."""
    tip = [goal.tip.value] if goal.tip is not None else []
    return [*tip, *(goal.shape.value if goal.shape is not None else ())]


def plot_plan_inputs(plan: Plan, *, ax: Axes | None = None) -> Axes:
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
        ax.axhline(limit, color=GRAY, linewidth=0.9, linestyle="--", zorder=1)
    style = "default" if plan.scene.input.form == "linear" else "steps-post"
    for column, name, color in zip(plan.u.T, plan.u_names, colors(plan.u.shape[1]), strict=True):
        label = split_unit(name)[0].replace("_", " ")
        ax.plot(plan.t, column, color=color, linewidth=1.5, drawstyle=style, label=label)
    ax.margins(x=0.0)
    return time_axes(ax, f"input [{split_unit(plan.u_names[0])[1]}]", plan.name, plan.u.shape[1])
