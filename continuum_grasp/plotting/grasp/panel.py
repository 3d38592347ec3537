"""Numbers beside the picture of a grasp: forces at the contacts, tensions, what is resisted."""

from __future__ import annotations

from typing import TYPE_CHECKING

from continuum_grasp.plotting.drawing.style import GRAY, INK
from continuum_grasp.plotting.grasp.view import GraspView
from continuum_grasp.scene.grasp_options import OutOfPlaneGravity

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from continuum_grasp.grasp.result import Contact

__all__ = ["ROW", "Row", "panel_rows", "write_panel"]

ROW = 0.17
"""Height of a row [inch]."""
_SIZE = 8.0
"""Of the font [points]: a row of 0.17 inch is 12 points high."""
_Cell = tuple[str, str]
Row = tuple[_Cell, ...]


def panel_rows(view: GraspView) -> list[Row]:
    """Rows of (text, color); the first of a row stands on the left, the others to the right; none without numbers."""
    if not view.found:
        return []
    lifted = isinstance(view.result.scene.gravity, OutOfPlaneGravity)
    heads = ["normal", "friction", *(["lift"] if lifted else []), "margin"]
    rows: list[Row] = [(("contact [N]", GRAY), *((word, GRAY) for word in heads))]
    for c in view.contacts:
        words = [f"{c.normal_force:.2f}", f"{abs(c.friction_force):.2f}", *([f"{c.lift:.2f}"] if lifted else [])]
        rows.append(((c.name, view.color(c.name)), *((word, INK) for word in (*words, _margin(c)))))
    rows += [(("", INK),), (("tendons [N]", GRAY), ("left", GRAY), ("right", GRAY), ("of", GRAY))]
    for name, finger in view.result.fingers.items():
        tendons = view.fingers[name].tendons
        most = "" if tendons is None else f"{tendons.max_tension:g}"
        left, right = finger.tensions
        rows.append(((name, view.color(name)), (f"{left:.2f}", INK), (f"{right:.2f}", INK), (most, INK)))
    return rows


def write_panel(ax: Axes, rows: list[Row]) -> None:
    """Write rows into axes that are as high as they need."""
    ax.set_axis_off()
    ax.set_xlim(0.0, 1.0)
    ax.set_ylim(len(rows), 0.0)
    columns = max(len(row) for row in rows) - 1
    for k, row in enumerate(rows):
        ax.text(0.0, k + 0.5, row[0][0], color=row[0][1], fontsize=_SIZE, va="center")
        for j, (text, color) in enumerate(row[1:]):
            right = 1.0 - 0.175 * (columns - 1 - j)
            ax.text(right, k + 0.5, text, color=color, fontsize=_SIZE, ha="right", va="center")


def _margin(contact: Contact) -> str:
    """Share of the friction cone that is left; nothing where nothing presses."""
    if contact.normal_force < 5e-3 or contact.friction_margin <= -9.99:
        return "\N{EN DASH}"
    return f"{contact.friction_margin if contact.friction_margin < -5e-4 else max(contact.friction_margin, 0.0):.0%}"
