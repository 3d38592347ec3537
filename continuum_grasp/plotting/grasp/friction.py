"""Friction at each contact against its limit, in the plane and out of it: what a drawing in the plane cannot show."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from continuum_grasp.plotting.drawing.axes import new_axes
from continuum_grasp.plotting.drawing.style import GRAY, SLATE
from continuum_grasp.plotting.grasp.view import GraspView

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from continuum_grasp.grasp.result import GraspResult

DISCS = 4
"""Discs side by side."""
_LETTERS = 13
"""Letters of a contact's name that fit below a disc."""
_PITCH, _TALL = 2.5, 3.1
"""Width and height of what one takes, with its name below, in radii of a disc."""


def plot_friction(result: GraspResult, *, ax: Axes | None = None) -> Axes:
    """Draw the friction force of each contact in a disc whose rim is the friction coefficient times the normal force.

    Friction in the plane is drawn to the right, lift upward. A dot on the rim is about to slip: its distance from the
    rim is the friction margin. Nothing is drawn where there is no grasp.
    """
    from matplotlib.patches import Circle

    view = GraspView(result)
    rows = friction_rows(view)
    ax = new_axes(ax, 2.9, 0.9 * max(rows, 1) + 0.2)
    ax.set_axis_off()
    ax.set_aspect("equal", adjustable="box", anchor="NW")
    ax.set_xlim(0.0, DISCS * _PITCH)
    ax.set_ylim(-max(rows, 1) * _TALL, 0.75)
    if rows:
        words = "friction: sideways in the plane, up lift; rim: slips"
        ax.text(0.0, 0.35, words, fontsize=8, color=SLATE, va="center")
    for k, contact in enumerate(view.contacts):
        row, column = divmod(k, DISCS)
        x, y = (column + 0.5) * _PITCH, -row * _TALL - 1.25
        color, limit = view.color(contact.name), result.scene.friction(contact.name) * contact.normal_force
        ax.add_patch(Circle((x, y), 1.0, facecolor=color, alpha=0.14, linewidth=0.0))
        ax.add_patch(Circle((x, y), 1.0, facecolor="none", edgecolor=color, linewidth=0.8))
        ax.plot([x - 1.0, x + 1.0], [y, y], color=GRAY, linewidth=0.5)
        ax.plot([x, x], [y - 1.0, y + 1.0], color=GRAY, linewidth=0.5)
        if limit > 0.0:
            across, lift = contact.friction_force / limit, contact.lift / limit
            beyond = max(1.0, math.hypot(across, lift))  # what rounding puts beyond the rim
            end = x + across / beyond, y + lift / beyond
            ax.plot([x, end[0]], [y, end[1]], color=color, linewidth=1.6, solid_capstyle="round")
            ax.plot(*end, "o", markersize=4.5, color=color, markeredgecolor="white", markeredgewidth=0.8)
        name = contact.name if len(contact.name) <= _LETTERS else contact.name.replace(".", ".\n")
        ax.text(x, y - 1.15, name, fontsize=7, color=color, ha="center", va="top", linespacing=1.0)
    return ax


def friction_rows(view: GraspView) -> int:
    """Number of rows of discs."""
    return -(-len(view.contacts) // DISCS)
