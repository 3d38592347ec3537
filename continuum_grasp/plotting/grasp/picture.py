"""A grasp: object, supports, bent fingers with their thickness, contacts, friction cones and forces to scale."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from continuum_grasp.plotting.drawing.axes import label, new_figure, quiet, show_box
from continuum_grasp.plotting.drawing.bodies import draw_body, draw_clamp, draw_object, draw_supports, tendon_path
from continuum_grasp.plotting.drawing.forces import draw_arrow
from continuum_grasp.plotting.drawing.style import GRAY, INK, Z
from continuum_grasp.plotting.grasp.labels import Label, place_labels
from continuum_grasp.plotting.grasp.resistance import plot_resistance, resistance_extremes, resistance_words
from continuum_grasp.plotting.grasp.view import MM, GraspView, lighter, turned
from continuum_grasp.scene.graded import ends
from continuum_grasp.scene.grasp_options import GraspFinger, OutOfPlaneGravity, PlanarGravity

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from continuum_grasp.grasp.result import Contact, GraspResult
    from continuum_grasp.scene.tendons import Tendon

Array = NDArray[Any]

_DRAWING = (6.2, 5.4)
"""Greatest width and height of the drawing [inch]."""
_NARROW = (4.6, 5.0)
"""The same where it stands alone, as on a small screen."""
_LEFT, _BELOW, _ABOVE = 0.65, 0.55, 0.62
"""Margins for the axes' ticks and labels, and for two lines of title [inch]."""
_BETWEEN, _PANEL, _POLYGON = 0.3, 2.9, 2.05
"""Distance to the numbers, their width for four columns, and the side of the resisted forces below them [inch]."""
_FAILED = "#A03000"
"""Color of the title where there is no grasp: a red that is read on white."""


def plot_grasp(
    result: GraspResult,
    *,
    ax: Axes | None = None,
    tendons: bool = True,
    numbers: bool = True,
    resisted: ArrayLike | None = None,
) -> Axes:
    """Draw a grasp in the plane of the fingers, in millimeters.

    Arrows are the forces that the object bears, and its weight; the light wedges are the friction cones.

    Parameters
    ----------
    result : GraspResult
        Where there is no verified grasp the closest point is drawn, and where there is none the scene as it starts;
        the title says so.
    ax : matplotlib.axes.Axes, optional
        Where to draw; None: axes in a new figure.
    tendons : bool, optional
        Draw the tendons.
    numbers : bool, optional
        Write the forces: beside the drawing in a new figure, in the labels in axes that are given.
    resisted : array_like, shape (D, 2), optional
        Greatest resisted force in each of D directions around the circle [N], drawn below the numbers.

    Examples
    --------
    >>> import continuum_grasp as cg
    >>> from continuum_grasp import plotting
    >>> scene = cg.load("configs/grasp/pinch.yaml", ["solver.max_iterations=1"])
    >>> result = cg.optimize_grasp(scene, raise_on_failure=False)
    >>> plotting.plot_grasp(result).get_xlabel()
    'x [mm]'
    """
    view = GraspView(result)
    alone = ax is None
    if ax is None:
        ax = _sheet(view, _panel_rows(view) if numbers else [], resisted)
    (left, bottom), (right, top) = view.box
    show_box(ax, (left, right, bottom, top))
    label(ax, "x [mm]", "y [mm]")
    ax.set_title(_title(result), fontsize=10, color=INK if result.solved else _FAILED, loc="left")
    draw_object(ax, view.outlines)
    areas = [*draw_supports(ax, result.scene.supports, MM), *_draw_fingers(ax, view, tendons)]
    cones, arrows = _draw_contacts(ax, view)
    areas += [*cones, *_draw_scale(ax, view)]
    arrows += _draw_weight(ax, view)
    # labels come last: they keep off all that is drawn
    place_labels(ax, _labels(view, forces=numbers and not alone), areas, arrows, view.outlines)
    return ax


def _sheet(view: GraspView, rows: list[Row], resisted: ArrayLike | None) -> Axes:
    """Axes in a new figure, which holds what stands beside them too."""
    low, high = view.box
    size = (high - low) * min(np.array(_DRAWING if rows else _NARROW) / (high - low))
    polygon = bool(rows) and resisted is not None and resistance_extremes(resisted)[1] > 0
    text = _ROW * len(rows)
    tall = max(size[1], text + (_POLYGON + 1.0 if polygon else 0.0))
    beside = _BETWEEN + _PANEL if rows else 0.0
    width, height = _LEFT + size[0] + beside + 0.15, _BELOW + tall + _ABOVE
    figure = new_figure(float(width), float(height))
    figure.set_layout_engine("none")
    ax = quiet(_at(figure, _LEFT, height - _ABOVE - size[1], size[0], size[1]))
    ax.set_anchor("NW")
    right = _LEFT + size[0] + _BETWEEN
    if rows:
        _write_panel(_at(figure, right, height - _ABOVE - text, _PANEL, text), rows)
    if polygon and resisted is not None:
        forces = quiet(_at(figure, right + 0.55, height - _ABOVE - text - 0.6 - _POLYGON, _POLYGON, _POLYGON))
        plot_resistance(resisted, ax=forces)
        # the title begins above the labels of the y axis
        forces.set_title(resistance_words(resisted), fontsize=8, color=INK, loc="left", x=-0.26)
    return ax


def _at(figure: Figure, left: float, bottom: float, width: float, height: float) -> Axes:
    """Axes at a place of a figure, all in inches."""
    wide, high = figure.get_size_inches()
    return figure.add_axes((left / wide, bottom / high, width / wide, height / high))


def _title(result: GraspResult) -> str:
    name = result.scene.name or "grasp"
    if result.solved:
        return f"{name}\n{result.status.value}, verified"
    what = "the closest point found" if result.arrays else "the scene as it starts"
    return f"{name}\nno grasp ({result.status.value}): {what}"


def _labels(view: GraspView, forces: bool) -> list[Label]:
    """Of contacts and weight; with the forces where they do not stand beside the picture."""
    found, nowhere, scene = [], np.zeros(2), view.result.scene
    for contact in view.result.contacts:
        numbers = f"\n{contact.normal_force:.2f} N, friction {abs(contact.friction_force):.2f} N" if forces else ""
        found.append(Label(contact.name + numbers, view.color(contact.name), MM * contact.position, contact.normal))
    if isinstance(scene.gravity, PlanarGravity | OutOfPlaneGravity):
        into = ",\ninto the picture" if isinstance(scene.gravity, OutOfPlaneGravity) else ""
        text = f"weight {scene.weight:.2f} N{into}"
        found.append(Label(text, INK, view.center_of_mass, nowhere, on_body=True))
    if not view.found:
        found += [Label(name, view.color(name), view.backbones[name][0, 1:3], nowhere) for name in view.fingers]
    return found


def _tendons_inside(finger: GraspFinger) -> list[Tendon]:
    """Tendons that are used and run in the body: beside it, on discs, they would be taken for its outline."""
    sides = {"both": (1.0, -1.0), "left": (1.0,), "right": (-1.0,)}[finger.tendons_used]
    first = [(tendon, ends(tendon.offset)[0]) for tendon in finger.tendon_list]
    return [tendon for tendon, e in first if math.copysign(1.0, e) in sides and abs(e) < finger.thickness_radius]


def _draw_fingers(ax: Axes, view: GraspView, tendons: bool) -> list[Array]:
    """Draw all fingers; returns their outlines and those of their clamps [mm]."""
    drawn: list[Array] = []
    for name, finger in view.fingers.items():
        backbone, body, color = view.backbones[name], view.body(name), view.color(name)
        line = backbone[:, 1:3]
        drawn += [body, draw_clamp(ax, line, finger, MM)]
        edge, style = lighter(color, 0.25), "solid" if view.found else "dashed"
        look = {"facecolor": lighter(color, 0.78), "edgecolor": edge, "linewidth": 1.1, "linestyle": style}
        draw_body(ax, body, alpha=1.0 if view.found else 0.6, joinstyle="round", **look)
        for tendon in _tendons_inside(finger) if tendons else ():
            path = tendon_path(tendon, finger=finger, **view.path(name))
            ax.plot(*path.T, color=edge, linewidth=0.7, linestyle=(0, (4, 2)), zorder=Z.TENDON)
        ax.plot(*line.T, color=edge, linewidth=1.5, zorder=Z.CENTERLINE)
        if view.found:  # dots where elements meet
            stations = MM * np.cumsum(view.result.fingers[name].lengths)[:-1]
            joints = np.stack([np.interp(stations, backbone[:, 0], backbone[:, k]) for k in (1, 2)])
            ax.plot(*joints, "o", markersize=3.6, color="white", markeredgecolor=edge, zorder=Z.JOINT)
    return drawn


_CONE = 0.3
"""Length of a friction cone as a part of the object's width: a little shorter than the greatest force."""
_ROUND_SIZES = 0.5, 1.0, 2.0, 5.0
"""What the force of the scale may be, times a power of ten."""


def _draw_contacts(ax: Axes, view: GraspView) -> tuple[list[Array], list[Array]]:
    """Draw cones and the forces that the object bears; returns the cones' outlines and the arrows as lines [mm]."""
    from matplotlib.patches import Polygon

    cones: list[Array] = []
    arrows: list[Array] = []
    reach = _CONE * view.extent
    for contact in view.result.contacts:
        color, at = view.color(contact.name), MM * contact.position
        half = math.atan(view.result.scene.friction(contact.name))
        spread = np.linspace(-half, half, 21)
        wedge = np.array([at, *(at + reach * turned(-contact.normal, turn) for turn in spread)])
        cones.append(wedge)
        ax.add_patch(Polygon(wedge, facecolor=color, alpha=0.14, linewidth=0.0, zorder=Z.CONE))
        for edge in (wedge[1], wedge[-1]):
            ax.plot(*np.transpose([at, edge]), color=color, alpha=0.45, linewidth=0.7, zorder=Z.CONE)
        end = at - view.force_scale * contact.force  # force acts on what touches; the object bears the opposite
        draw_arrow(ax, at, end, color)
        arrows.append(np.array([at, end]))
        ax.plot(*at, "o", markersize=4.5, color=color, markeredgecolor="white", markeredgewidth=0.8, zorder=Z.CONTACT)
    return cones, arrows


def _draw_weight(ax: Axes, view: GraspView) -> list[Array]:
    """Draw the center of mass and the weight; returns the arrow as a line [mm]."""
    at = view.center_of_mass
    if isinstance(view.result.scene.gravity, OutOfPlaneGravity):  # the tail of an arrow that flies away
        ax.plot(*at, "o", markersize=9, markerfacecolor="white", markeredgecolor=INK, zorder=Z.FORCE)
        ax.plot(*at, "x", markersize=5.5, color=INK, zorder=Z.FORCE + 0.1)
        return []
    ax.plot(*at, "+", color=INK, markersize=7, zorder=Z.FORCE)
    if not view.weight.any():
        return []
    end = at + view.force_scale * view.weight
    draw_arrow(ax, at, end, INK)
    return [np.array([at, end])]


def _draw_scale(ax: Axes, view: GraspView) -> list[Array]:
    """Draw an arrow of a round force in the lower right corner; returns it with its label as a box [mm]."""
    if view.force_scale <= 0:
        return []
    decade = 10.0 ** math.floor(math.log10(view.greatest_force))
    size = max(k * decade for k in _ROUND_SIZES if k * decade <= view.greatest_force)
    low, high = view.box
    unit = 0.01 * float((high - low).max())
    right, bottom, length = high[0] - 2.5 * unit, low[1] + 2.5 * unit, size * view.force_scale
    draw_arrow(ax, np.array([right - length, bottom]), np.array([right, bottom]), GRAY)
    ax.text(right, bottom + unit, f"{size:g} N", fontsize=8, color=GRAY, ha="right", va="bottom", zorder=Z.SCALE)
    left, top = right - max(length, 9 * unit) - unit, bottom + 6 * unit
    return [np.array([[left, low[1]], [high[0], low[1]], [high[0], top], [left, top]])]


_ROW = 0.17
"""Height of a row [inch]."""
_SIZE = 8.0
"""Of the font [points]: a row of 0.17 inch is 12 points high."""
Row = tuple[tuple[str, str], ...]


def _panel_rows(view: GraspView) -> list[Row]:
    """Rows of (text, color); the first of a row stands on the left, the others to the right; none without numbers."""
    if not view.found:
        return []
    lifted = isinstance(view.result.scene.gravity, OutOfPlaneGravity)
    heads = ["normal", "friction", *(["lift"] if lifted else []), "margin"]
    rows: list[Row] = [(("contact [N]", GRAY), *((word, GRAY) for word in heads))]
    for c in view.result.contacts:
        words = [f"{c.normal_force:.2f}", f"{abs(c.friction_force):.2f}", *([f"{c.lift:.2f}"] if lifted else [])]
        rows.append(((c.name, view.color(c.name)), *((word, INK) for word in (*words, _margin(c)))))
    rows += [(("", INK),), (("tendons [N]", GRAY), ("left", GRAY), ("right", GRAY), ("of", GRAY))]
    for name, finger in view.result.fingers.items():
        most = " / ".join(dict.fromkeys(f"{tendon:g}" for tendon in view.fingers[name].tension_limits[1]))
        left, right = finger.tensions
        rows.append(((name, view.color(name)), (f"{left:.2f}", INK), (f"{right:.2f}", INK), (most, INK)))
    return rows


def _write_panel(ax: Axes, rows: list[Row]) -> None:
    """Write rows into axes that are as high as they need."""
    ax.set_axis_off()
    ax.set_xlim(0.0, 1.0)
    ax.set_ylim(len(rows), 0.0)
    columns = max(len(row) for row in rows) - 1
    for k, row in enumerate(rows):
        ax.text(0.0, k + 0.5, row[0][0], color=row[0][1], fontsize=_SIZE, va="center")
        for j, (text, color) in enumerate(row[1:]):
            right = 1.0 - 0.175 * (columns - 1 - j)  # columns of half an inch
            ax.text(right, k + 0.5, text, color=color, fontsize=_SIZE, ha="right", va="center")


def _margin(contact: Contact) -> str:
    """Share of the friction cone that is left; nothing where nothing presses."""
    # forces are written with two digits: what reads 0.00 has no margin
    if contact.normal_force < 5e-3 or contact.friction_margin <= -9.99:
        return "\N{EN DASH}"
    # rounding to the percent must not give "-0%"
    return f"{contact.friction_margin if contact.friction_margin < -5e-4 else max(contact.friction_margin, 0.0):.0%}"
