"""The object of a grasp and what else holds it: walls, edges, grooves and pegs."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.plotting.drawing.axes import INK
from continuum_grasp.plotting.grasp.view import MM, GraspView, turned
from continuum_grasp.scene.supports import VGroove

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["draw_object", "draw_supports"]

Array = NDArray[Any]

_FILL, _EDGE = "#F3E9D6", "#A58A55"
_DEPTH = 0.035
"""Of the hatched material, as a part of the picture."""
_MATERIAL: dict[str, Any] = {"facecolor": "#E3E3E3", "edgecolor": "#9A9A9A", "hatch": "////", "linewidth": 0.0}


def draw_object(ax: Axes, view: GraspView) -> list[Array]:
    """Draw the parts as one body; returns their outlines [mm]."""
    from matplotlib.patches import Polygon

    for outline in view.outlines:
        ax.add_patch(Polygon(outline, facecolor=_EDGE, edgecolor=_EDGE, linewidth=3.0, joinstyle="round", zorder=2.0))
    for outline in view.outlines:
        ax.add_patch(Polygon(outline, facecolor=_FILL, linewidth=0.0, zorder=2.1))
    return list(view.outlines)


def draw_supports(ax: Axes, view: GraspView) -> list[Array]:
    """Draw walls, edges, grooves and pegs; returns their outlines [mm]."""
    from matplotlib.patches import Circle, Polygon

    low, high = view.box
    far = 2.0 * float(np.hypot(*(high - low)))
    depth = _DEPTH * float((high - low).max())
    blocks, faces = [], []
    for name, support in view.result.scene.supports.items():
        if isinstance(support, VGroove):
            block, face = _groove(support, far, depth)
            blocks.append(block)
            faces.append(face)
            continue
        for wall in support.walls(name):
            normal = np.array(wall.normal)
            along, reach = turned(normal, 0.5 * math.pi), min(MM * wall.half_length, far)
            face = MM * np.array(wall.point) + np.outer([-reach, reach], along)
            blocks.append(np.concatenate([face, face[::-1] - depth * normal]))
            faces.append(face)
        for peg in support.pegs(name):
            center, radius = MM * np.array(peg.position), max(MM * peg.radius, 0.012 * far / 2)
            ax.add_patch(Circle((center[0], center[1]), radius, **{**_MATERIAL, "linewidth": 1.2, "edgecolor": INK}))
            turns = np.linspace(0.0, math.tau, 25)
            blocks.append(center + radius * np.stack([np.cos(turns), np.sin(turns)], axis=1))
    for block, face in zip(blocks, faces, strict=False):
        ax.add_patch(Polygon(block, zorder=1.0, **_MATERIAL))
        ax.plot(*face.T, color=INK, linewidth=1.4, zorder=1.1, scalex=False, scaley=False)
    return blocks


def _groove(groove: VGroove, far: float, depth: float) -> tuple[Array, Array]:
    """Outline of the material and its face."""
    apex, half = MM * np.array(groove.apex), 0.5 * groove.opening_angle
    axis = np.array([math.cos(groove.axis_angle), math.sin(groove.axis_angle)])
    left, right = turned(axis, half), turned(axis, -half)
    face = np.array([apex + far * left, apex, apex + far * right])
    outside = (turned(left, 0.5 * math.pi), turned(right, -0.5 * math.pi))
    corner = apex - depth / math.sin(half) * axis
    back = np.array([face[2] + depth * outside[1], corner, face[0] + depth * outside[0]])
    return np.concatenate([face, back]), face
