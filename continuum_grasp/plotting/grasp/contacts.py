"""Contacts of a grasp: friction cones, forces to scale, weight."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.plotting.drawing.axes import GREY, INK
from continuum_grasp.plotting.grasp.view import MM, GraspView, turned
from continuum_grasp.scene.grasp_options import OutOfPlaneGravity, PlanarGravity

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["draw_contacts", "draw_scale", "draw_weight", "weight_words"]

Array = NDArray[Any]


def draw_contacts(ax: Axes, view: GraspView) -> tuple[list[Array], list[Array]]:
    """Draw cones and the forces that the object bears; returns the cones' outlines and the arrows as lines [mm]."""
    from matplotlib.patches import Polygon

    cones: list[Array] = []
    arrows: list[Array] = []
    reach = 0.3 * view.extent
    for contact in view.contacts:
        color, at = view.color(contact.name), MM * contact.position
        half = math.atan(view.result.scene.friction(contact.name))
        spread = np.linspace(-half, half, 21)
        wedge = np.array([at, *(at + reach * turned(-contact.normal, turn) for turn in spread)])
        cones.append(wedge)
        ax.add_patch(Polygon(wedge, facecolor=color, alpha=0.14, linewidth=0.0, zorder=2.5))
        for edge in (wedge[1], wedge[-1]):
            ax.plot(*np.transpose([at, edge]), color=color, alpha=0.45, linewidth=0.7, zorder=2.5)
        end = at - view.force_scale * contact.force
        _arrow(ax, at, end, color)
        arrows.append(np.array([at, end]))
        ax.plot(*at, "o", markersize=4.5, color=color, markeredgecolor="white", markeredgewidth=0.8, zorder=6)
    return cones, arrows


def draw_weight(ax: Axes, view: GraspView) -> list[Array]:
    """Draw the centre of mass and the weight; returns the arrow as a line [mm]."""
    at = view.center_of_mass
    if isinstance(view.result.scene.gravity, OutOfPlaneGravity):
        ax.plot(*at, "o", markersize=9, markerfacecolor="white", markeredgecolor=INK, zorder=5)
        ax.plot(*at, "x", markersize=5.5, color=INK, zorder=5.1)
        return []
    ax.plot(*at, "+", color=INK, markersize=7, zorder=5)
    end = at + view.force_scale * view.weight
    if not view.weight.any():
        return []
    _arrow(ax, at, end, INK)
    return [np.array([at, end])]


def weight_words(view: GraspView) -> str:
    """What stands at the centre of mass; empty without weight."""
    scene = view.result.scene
    if isinstance(scene.gravity, PlanarGravity):
        return f"weight {scene.weight:.2f} N"
    return f"weight {scene.weight:.2f} N,\ninto the picture" if isinstance(scene.gravity, OutOfPlaneGravity) else ""


def draw_scale(ax: Axes, view: GraspView) -> list[Array]:
    """Draw an arrow of a round force in the lower right corner; returns it with its label as a box [mm]."""
    if view.force_scale <= 0:
        return []
    decade = 10.0 ** math.floor(math.log10(view.greatest_force))
    size = max(k * decade for k in (0.5, 1.0, 2.0, 5.0) if k * decade <= view.greatest_force)
    (low, high) = view.box
    unit = 0.01 * float((high - low).max())
    right, bottom, length = high[0] - 2.5 * unit, low[1] + 2.5 * unit, size * view.force_scale
    _arrow(ax, np.array([right - length, bottom]), np.array([right, bottom]), GREY)
    ax.text(right, bottom + unit, f"{size:g} N", fontsize=8, color=GREY, ha="right", va="bottom", zorder=7)
    wide = max(length, 9 * unit) + unit
    corners = [
        [right - wide, low[1]],
        [high[0], low[1]],
        [high[0], bottom + 6 * unit],
        [right - wide, bottom + 6 * unit],
    ]
    return [np.array(corners)]


def _arrow(ax: Axes, start: Array, end: Array, color: str) -> None:
    shape = {"arrowstyle": "-|>,head_length=0.5,head_width=0.22", "color": color, "linewidth": 2.0}
    ends = {"shrinkA": 0, "shrinkB": 0}
    ax.annotate("", (end[0], end[1]), (start[0], start[1]), arrowprops={**shape, **ends}, zorder=5)
