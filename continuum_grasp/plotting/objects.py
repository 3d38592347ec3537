"""The object of a scene as it was understood."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from continuum_grasp.arguments import check_arguments
from continuum_grasp.plotting.drawing import axes, bodies
from continuum_grasp.plotting.drawing.style import INK
from continuum_grasp.scene.objects.shapes import ObjectBody

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@check_arguments
def plot_object(body: ObjectBody, *, ax: Axes | None = None) -> Axes:
    """Draw an object in its own frame: the corners, its convex pieces, and its center of mass.

    Parameters
    ----------
    body : object of a scene
    ax : matplotlib.axes.Axes, optional
        Where to draw [m]; None: axes in a new figure.

    Examples
    --------
    >>> import continuum_grasp as cg
    >>> from continuum_grasp import plotting
    >>> plotting.plot_object(cg.load("configs/grasp/gear.yaml").object).get_title()
    '48 corners, 13 convex pieces, 79.72 mm x 79.72 mm'
    """
    outlines = bodies.object_outlines(body, np.zeros(3))  # type: ignore[arg-type]
    points = np.concatenate(outlines)
    ax = axes.plane_axes(ax, axes.bend_box(outlines, 0.1 * body.size), colorbar=False)
    bodies.draw_object(ax, outlines)
    pieces = [np.array(piece.outline()) for piece in body.pieces]
    for piece in pieces:
        ax.plot(*np.concatenate([piece, piece[:1]]).T, color=INK, linewidth=0.5, linestyle=":", zorder=9)
    corners = [outline for outline in outlines if len(outline) < 200]
    ax.plot(*np.concatenate([np.zeros((0, 2)), *corners]).T, ".", color=INK, markersize=3, zorder=9)
    ax.plot(*body.com, "+", color=INK, markersize=9, zorder=9)
    wide, high = 1e3 * np.ptp(points, axis=0)
    count = sum(len(corner) for corner in corners)
    ax.set_title(f"{count} corners, {len(pieces)} convex pieces, {wide:.4g} mm x {high:.4g} mm", fontsize=9)
    return ax
