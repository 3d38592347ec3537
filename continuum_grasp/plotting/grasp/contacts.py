"""Contacts of a grasp: friction cones, forces to scale, weight."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.plotting.drawing.forces import draw_arrow
from continuum_grasp.plotting.drawing.style import GRAY, INK, Z
from continuum_grasp.plotting.grasp.view import MM, GraspView, turned
from continuum_grasp.scene.grasp_options import OutOfPlaneGravity, PlanarGravity

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["draw_contacts", "draw_scale", "draw_weight", "weight_words"]

Array = NDArray[Any]

_CONE = 0.3
"""Length of a friction cone as a part of the object's width: a little shorter than the greatest force."""
_ROUND_SIZES = 0.5, 1.0, 2.0, 5.0
"""What the force of the scale may be, times a power of ten."""


def draw_contacts(ax: Axes, view: GraspView) -> tuple[list[Array], list[Array]]:
    """Draw cones and the forces that the object bears; returns the cones' outlines and the arrows as lines [mm]."""
    from matplotlib.patches import Polygon

    cones: list[Array] = []
    arrows: list[Array] = []
    reach = _CONE * view.extent
    for contact in view.contacts:
        color, at = view.color(contact.name), MM * contact.position
        half = math.atan(view.result.scene.friction(contact.name))
        spread = np.linspace(-half, half, 21)
        wedge = np.array([at, *(at + reach * turned(-contact.normal, turn) for turn in spread)])
        cones.append(wedge)
        ax.add_patch(Polygon(wedge, facecolor=color, alpha=0.14, linewidth=0.0, zorder=Z.CONE))
        for edge in (wedge[1], wedge[-1]):
            ax.plot(*np.transpose([at, edge]), color=color, alpha=0.45, linewidth=0.7, zorder=Z.CONE)
        end = at - view.force_scale * contact.force
        draw_arrow(ax, at, end, color)
        arrows.append(np.array([at, end]))
        ax.plot(*at, "o", markersize=4.5, color=color, markeredgecolor="white", markeredgewidth=0.8, zorder=Z.CONTACT)
    return cones, arrows


def draw_weight(ax: Axes, view: GraspView) -> list[Array]:
    """Draw the center of mass and the weight; returns the arrow as a line [mm]."""
    at = view.center_of_mass
    if isinstance(view.result.scene.gravity, OutOfPlaneGravity):
        ax.plot(*at, "o", markersize=9, markerfacecolor="white", markeredgecolor=INK, zorder=Z.FORCE)
        ax.plot(*at, "x", markersize=5.5, color=INK, zorder=Z.FORCE + 0.1)
        return []
    ax.plot(*at, "+", color=INK, markersize=7, zorder=Z.FORCE)
    end = at + view.force_scale * view.weight
    if not view.weight.any():
        return []
    draw_arrow(ax, at, end, INK)
    return [np.array([at, end])]


def weight_words(view: GraspView) -> str:
    """What stands at the center of mass; empty without weight."""
    scene = view.result.scene
    if isinstance(scene.gravity, PlanarGravity):
        return f"weight {scene.weight:.2f} N"
    return f"weight {scene.weight:.2f} N,\ninto the picture" if isinstance(scene.gravity, OutOfPlaneGravity) else ""


def draw_scale(ax: Axes, view: GraspView) -> list[Array]:
    """Draw an arrow of a round force in the lower right corner; returns it with its label as a box [mm]."""
    if view.force_scale <= 0:
        return []
    decade = 10.0 ** math.floor(math.log10(view.greatest_force))
    size = max(k * decade for k in _ROUND_SIZES if k * decade <= view.greatest_force)
    (low, high) = view.box
    unit = 0.01 * float((high - low).max())
    right, bottom, length = high[0] - 2.5 * unit, low[1] + 2.5 * unit, size * view.force_scale
    draw_arrow(ax, np.array([right - length, bottom]), np.array([right, bottom]), GRAY)
    ax.text(right, bottom + unit, f"{size:g} N", fontsize=8, color=GRAY, ha="right", va="bottom", zorder=Z.SCALE)
    wide = max(length, 9 * unit) + unit
    corners = [
        [right - wide, low[1]],
        [high[0], low[1]],
        [high[0], bottom + 6 * unit],
        [right - wide, bottom + 6 * unit],
    ]
    return [np.array(corners)]
