"""The way into a grasp: fingers on their way, light to dark, and what presses where."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from continuum_grasp.errors import InputError
from continuum_grasp.plotting.drawing.axes import label, new_axes, show_box
from continuum_grasp.plotting.drawing.bodies import draw_object, draw_supports, object_outlines
from continuum_grasp.plotting.drawing.style import INK, Z
from continuum_grasp.plotting.grasp.view import MM, GraspView, lighter

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from continuum_grasp.grasp.result import GraspResult


_DRAWN = 8
"""Postures that are drawn."""
_SIZE = 5.4
"""Greatest side of the drawing [inch]."""


def plot_closing(result: GraspResult, *, ax: Axes | None = None) -> Axes:
    """Draw how fingers close on an object, in millimeters.

    Lines are the fingers' central lines, darker the farther the tensions have grown; dots are places that press on the
    object, as large as they press; the dashed line is the grasp.
    """
    view, path = GraspView(result), result.closing
    if path is None:
        raise InputError("there is no way in to draw: the scene has no closing, or there is no grasp")
    (left, bottom), (right, top) = view.box
    ways = [MM * line.reshape(-1, 2) for line in path.lines.values()]
    low = np.minimum([left, bottom], np.min([way.min(axis=0) for way in ways], axis=0) - 5.0)
    high = np.maximum([right, top], np.max([way.max(axis=0) for way in ways], axis=0) + 5.0)
    wide, tall = high - low
    size = _SIZE / max(wide, tall)
    ax = new_axes(ax, size * wide + 0.9, size * tall + 1.1)
    show_box(ax, (low[0], high[0], low[1], high[1]))
    label(ax, "x [mm]", "y [mm]")
    ax.set_title(f"{result.scene.name or 'grasp'}\nclosing: {path.status.value}", fontsize=10, color=INK, loc="left")
    draw_object(ax, view.outlines)
    draw_supports(ax, result.scene.supports, MM)
    steps = np.unique(np.linspace(0, len(path.shares) - 1, _DRAWN).round().astype(int))
    greatest = max((float(forces.max(initial=0.0)) for forces in path.normal_forces.values()), default=0.0) or 1.0
    for name in path.lines:
        color = view.color(name)
        for step in steps:
            shade = lighter(color, 0.75 * (1.0 - step / steps[-1]))
            line, pressed = MM * path.lines[name][step], path.normal_forces[name][step] / greatest
            ax.plot(*line.T, color=shade, linewidth=1.6, zorder=Z.CENTERLINE)
            on = pressed > 1e-2
            x, y = line[1:][on].T
            ax.scatter(x, y, 60.0 * pressed[on], color=shade, zorder=Z.CONTACT, linewidths=0.0)
        ax.plot(*view.backbones[name][:, 1:3].T, color=INK, linewidth=0.8, linestyle=(0, (4, 3)), zorder=Z.CENTERLINE)
    for outline in object_outlines(result.scene.object, path.poses[-1]):
        ax.plot(*(MM * outline.T), color=INK, linewidth=0.6, linestyle=":", zorder=Z.CENTERLINE)
    return ax
