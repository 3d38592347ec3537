"""A grasp: object, supports, bent fingers with their thickness, contacts, friction cones and forces to scale."""

from __future__ import annotations

import math
import textwrap
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from continuum_grasp.base import Array, amount_text, prefixes
from continuum_grasp.plotting.drawing.bodies import draw_body, draw_clamp, draw_object, draw_supports, side_path
from continuum_grasp.plotting.drawing.forces import draw_arrow
from continuum_grasp.plotting.drawing.style import Color, Font, Inch, Z, plain
from continuum_grasp.plotting.drawing.styled_axes import StyledAxes, wrapped
from continuum_grasp.plotting.grasp.labels import Label, place_labels
from continuum_grasp.plotting.grasp.margins import (
    friction_rows,
    plot_friction,
    plot_resistance,
    resistance_extremes,
    resistance_words,
)
from continuum_grasp.plotting.grasp.view import GraspView, lighter, turned
from continuum_grasp.scene import GraspFinger

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from continuum_grasp.grasp import Contact, GraspResult
    from continuum_grasp.scene import Tendon


_FAILED = "#A03000"
"""Color of the title where there is no grasp: a red that is read on white."""
_DRAWN = {
    "first_repair": "the grasp with the first repair",
    "nominal_grasp": "the grasp without errors",
    "closest_attempt": "the closest attempt",
    "": "the scene as it starts",
}
"""Names of a picture where there is no grasp, by the answer of its result."""


def plot_grasp(
    result: GraspResult,
    *,
    ax: Axes | None = None,
    numbers: bool = True,
    resisted: ArrayLike | bool = True,
) -> Axes:
    """Draw a grasp in the plane of the fingers.

    Arrows are the forces that the object bears, and its weight; the light wedges are the friction cones. Where
    friction carries weight out of the plane, the darker part of a wedge is what lift leaves for friction in it. Where
    there is no grasp, the grasp of the first repair is drawn in gray and without forces, else the closest attempt, and
    where there is none the scene as it starts; the title reports it, and why.

    ``numbers`` writes the forces: beside the drawing in a new figure, with the friction by contact where it acts out of
    the plane too; in the labels in axes that are given. ``resisted`` draws the forces that are resisted below them:
    the forces in the result's quality, or the greatest one in each of D directions around the circle (D, 2) [N].
    """
    view = GraspView(result)
    alone = ax is None
    if ax is None:
        ax = _sheet(view, numbers, resisted)
    else:
        ax.set_title(_title(result, ax.get_window_extent().width / ax.figure.dpi), **_title_style(result))
    unit = StyledAxes(ax).show_box(view.box)
    StyledAxes(ax).label(f"x [{unit}]", f"y [{unit}]")
    draw_object(ax, view.outlines)
    areas = [*draw_supports(ax, result.scene.supports), *_draw_fingers(ax, view)]
    cones, arrows = _draw_contacts(ax, view)
    areas += [*cones, *_draw_scale(ax, view)]
    arrows += _draw_weight(ax, view)
    # labels come last: they keep off all that is drawn
    place_labels(ax, _labels(view, forces=numbers and not alone), areas, arrows, view.outlines)
    return ax


def _sheet(view: GraspView, numbers: bool, resisted: ArrayLike | bool) -> Axes:
    """Axes in a new figure, which holds what stands beside them too."""
    rows = _panel_rows(view) if numbers else []
    if isinstance(resisted, bool):
        resisted = view.result.quality.resistance_polygon if resisted and rows and view.result.solved else np.zeros(0)
    sides = np.diff(np.reshape(view.box, (2, 2))).ravel()
    size = sides * min(np.array(Inch.DRAWING) / sides)
    polygon = bool(rows) and resistance_extremes(resisted)[1] > 0
    discs = Inch.DISCS * friction_rows(view) + 0.4 if rows and view.scene.spatial and view.contacts else 0.0
    text = Inch.ROW * len(rows)
    beside = Inch.BETWEEN + Inch.PANEL if rows else 0.0
    width = float(Inch.LEFT + size[0] + beside + 0.15)
    title = _title(view.result, float(size[0]))
    above = Inch.ABOVE + Inch.LINE * len(title.splitlines())
    tall = max(size[1], text + discs + (Inch.POLYGON + 1.0 if polygon else 0.0))
    height = float(Inch.BELOW + tall + above)
    figure = StyledAxes.figure(width, height, layout=None)
    ax = _at(figure, Inch.LEFT, height - above - size[1], size[0], size[1])
    ax.set_anchor("NW")
    ax.set_title(title, **_title_style(view.result))
    right = Inch.LEFT + size[0] + Inch.BETWEEN
    top = height - above
    if rows:
        _write_panel(_at(figure, right, top - text, Inch.PANEL, text), rows)
    if discs:
        plot_friction(view.result, ax=_at(figure, right, top - text - discs, Inch.PANEL, discs - 0.15)).set_label(
            "friction"
        )
    if polygon:
        below = top - text - discs - 0.6 - Inch.POLYGON
        forces = _at(figure, right + 0.55, below, Inch.POLYGON, Inch.POLYGON)
        plot_resistance(resisted, ax=forces).set_label("resisted")
        # the title begins above the labels of the y axis
        forces.set_title(resistance_words(resisted), fontsize=8, color=Color.INK, loc="left", x=-0.26)
    return ax


def _at(figure: Figure, left: float, bottom: float, width: float, height: float) -> Axes:
    """Axes at a place of a figure, all in inches."""
    wide, high = figure.get_size_inches()
    return figure.add_axes((left / wide, bottom / high, width / wide, height / high))


def _title(result: GraspResult, width: float) -> str:
    """Name, verdict, and why there is no grasp, in lines that are no wider [inch]."""
    name = wrapped(plain(result.scene.name or "grasp"), width)
    status = result.status.word
    if result.solved:
        return f"{name}\n{status}, verified{', UNSTABLE' if result.opens else ''}"
    if result.verified:
        return f"{name}\n{wrapped(f'{status}: {result.message}', width)}"
    what = _DRAWN[result.answer]
    why = wrapped(f"{result.message[:1].upper()}{result.message[1:]}.", width)
    drawn = wrapped(f"no grasp ({status}); drawn: {what}", width)
    return f"{name}\n{drawn}\n{why}"


def _title_style(result: GraspResult) -> dict[str, Any]:
    return {"fontsize": 10, "color": Color.INK if result.solved else _FAILED, "loc": "left"}


def _labels(view: GraspView, forces: bool) -> list[Label]:
    """Labels of contacts and weight; with the forces where they do not stand beside the picture."""
    labels = []
    nowhere = np.zeros(2)
    scene = view.scene
    unit = view.result.force_units[1]
    written = partial(view.result.force_text, unit=unit)
    for contacts in view.places:
        lines = [
            f"{each.name}\n{written(each.normal_force)} {unit}, friction {written(abs(each.friction_force))} {unit}"
            if forces
            else each.name
            for each in contacts
        ]
        first = contacts[0]
        labels.append(Label("\n".join(lines), view.color(first.name), first.position, first.normal))
    if scene.weight:
        out = scene.gravity[2]
        if any(scene.gravity[:2]) and out:
            into = "\nslanted"
        elif out:
            into = f"\n{'into' if out < 0.0 else 'out of'} plane"
        else:
            into = ""
        text = f"weight {amount_text(scene.weight, 'N', '.2f')}{into}"
        labels.append(Label(text, Color.INK, view.center_of_mass, nowhere, on_body=True))
    if not view.contacts:
        labels += [Label(name, view.color(name), base[0, 1:3], nowhere) for name, base in view.backbones.items()]
    return labels


def _tendons_inside(finger: GraspFinger) -> list[Tendon]:
    """Tendons that are used and run in the body: beside it, on discs, they would be taken for its outline."""
    sides = {"both": (1.0, -1.0), "left": (1.0,), "right": (-1.0,)}[finger.tendons_used]
    first = [(tendon, tendon.offsets[0]) for tendon in finger.tendon_list]
    return [tendon for tendon, e in first if math.copysign(1.0, e) in sides and abs(e) < finger.thickness_radius]


def _draw_fingers(ax: Axes, view: GraspView) -> list[Array]:
    """Draw all fingers; returns their outlines and their clamps' [m]."""
    drawn: list[Array] = []
    for name, finger in view.scene.named_fingers.items():
        backbone = view.backbones[name]
        body = view.body(name)
        color = view.color(name)
        line = backbone[:, 1:3]
        drawn += [body, draw_clamp(ax, line, finger)]
        edge = lighter(color, 0.25)
        style = "solid" if view.result.verified else "dashed"
        look = {"facecolor": lighter(color, 0.78), "edgecolor": edge, "linewidth": 1.1, "linestyle": style}
        draw_body(ax, body, alpha=1.0 if view.found else 0.6, joinstyle="round", **look)
        for tendon in _tendons_inside(finger):
            path = side_path(tendon, backbone, finger)
            ax.plot(*path.T, color=edge, linewidth=0.7, linestyle=(0, (4, 2)), zorder=Z.TENDON)
        ax.plot(*line.T, color=edge, linewidth=1.5, zorder=Z.CENTERLINE)
        if view.found:  # dots where elements meet
            stations = np.cumsum(view.result.fingers[name].lengths)[:-1]
            joints = np.stack([np.interp(stations, backbone[:, 0], backbone[:, k]) for k in (1, 2)])
            ax.plot(*joints, "o", markersize=3.6, color="white", markeredgecolor=edge, zorder=Z.JOINT)
    return drawn


def _draw_contacts(ax: Axes, view: GraspView) -> tuple[list[Array], list[Array]]:
    """Draw cones and the forces that the object bears; returns the cones' outlines and the arrows as lines [m]."""
    from matplotlib.patches import Polygon

    cones: list[Array] = []
    arrows: list[Array] = []
    # 0.3: length of a friction cone as a part of the object's width: a little shorter than the greatest force
    reach = 0.3 * view.extent
    for contact, *others in view.places:
        color = view.color(contact.name)
        at = contact.position
        for half, alpha in _cone_angles(view, contact):
            spread = np.linspace(-half, half, 21)
            wedge = np.array([at, *(at + reach * turned(-contact.normal, turn) for turn in spread)])
            ax.add_patch(Polygon(wedge, facecolor=color, alpha=alpha, linewidth=0.0, zorder=Z.CONE))
            for edge in (wedge[1], wedge[-1]):
                ax.plot(*np.transpose([at, edge]), color=color, alpha=3.0 * alpha, linewidth=0.7, zorder=Z.CONE)
            cones.append(wedge)
        # force acts on what touches; the object bears the opposite
        end = at - view.force_scale * np.sum([each.force for each in (contact, *others)], axis=0)
        draw_arrow(ax, at, end, color)
        arrows.append(np.array([at, end]))
        ax.plot(*at, "o", markersize=4.5, color=color, markeredgecolor="white", markeredgewidth=0.8, zorder=Z.CONTACT)
    return cones, arrows


def _cone_angles(view: GraspView, contact: Contact) -> list[tuple[float, float]]:
    """Half angles of the drawn friction cones [rad], and how opaque they are.

    Of the cone of those scenes where friction acts out of the plane too, the second is what the lift leaves in it.
    """
    friction = view.scene.friction(contact.name)
    if not view.scene.spatial or contact.normal_force <= 0.0:
        return [(math.atan(friction), 0.14)]
    left = math.sqrt(max(friction**2 - (contact.lift / contact.normal_force) ** 2, 0.0))
    return [(math.atan(friction), 0.08), (math.atan(left), 0.16)]


def _draw_weight(ax: Axes, view: GraspView) -> list[Array]:
    """Draw the center of mass and the weight; returns the arrow as a line [m]."""
    at = view.center_of_mass
    if view.scene.spatial:  # the tail of an arrow that flies away, or the point of one that comes
        mark, size = ("x", 5.5) if view.scene.gravity[2] < 0.0 else (".", 7.0)
        ax.plot(*at, "o", markersize=9, markerfacecolor="white", markeredgecolor=Color.INK, zorder=Z.FORCE)
        ax.plot(*at, mark, markersize=size, color=Color.INK, zorder=Z.FORCE + 0.1)
    else:
        ax.plot(*at, "+", color=Color.INK, markersize=7, zorder=Z.FORCE)
    if not view.weight.any():
        return []
    end = at + view.force_scale * view.weight
    draw_arrow(ax, at, end, Color.INK)
    return [np.array([at, end])]


def _draw_scale(ax: Axes, view: GraspView) -> list[Array]:
    """Draw an arrow of a round force in the lower right corner; returns it with its label as a box [m]."""
    if view.force_scale <= 0:
        return []
    decade = 10.0 ** math.floor(math.log10(view.greatest_force))
    # forces that the scale may show, times a power of ten
    size = max(k * decade for k in (0.5, 1.0, 2.0, 5.0) if k * decade <= view.greatest_force)
    left, right, bottom, top = view.box
    unit = 0.01 * max(right - left, top - bottom)
    length = size * view.force_scale
    x = right - 2.5 * unit
    y = bottom + 2.5 * unit
    draw_arrow(ax, np.array([x - length, y]), np.array([x, y]), Color.SLATE)
    ax.text(
        x, y + unit, amount_text(size, "N", "g"), fontsize=8, color=Color.SLATE, ha="right", va="bottom", zorder=Z.SCALE
    )
    begin = x - max(length, 9 * unit) - unit
    end = y + 6 * unit
    return [np.array([[begin, bottom], [right, bottom], [right, end], [begin, end]])]


Row = tuple[tuple[str, str], ...]


def _panel_rows(view: GraspView) -> list[Row]:
    """Rows of (text, color); the first of a row stands on the left, the others to the right.

    Where there is no grasp they say what would repair it.
    """
    result = view.result
    if not result.verified:
        # 6: number of repairs written beside the drawing; the report has all
        repairs = [textwrap.wrap(reason.repair, int(Font.PER_INCH * Inch.PANEL)) for reason in result.reasons[:6]]
        head: list[Row] = [(("any one of these repairs it", Color.SLATE),)] if repairs else []
        return [*head, *(((line, Color.INK),) for lines in repairs for line in ("", *lines))]
    of_tensions, of_contacts = result.force_units
    written, pulled = (partial(result.force_text, unit=unit) for unit in (of_contacts, of_tensions))
    heads = ["normal", "friction", *(["lift"] if view.scene.spatial else []), "margin"]
    rows: list[Row] = [((f"contact [{of_contacts}]", Color.SLATE), *((word, Color.SLATE) for word in heads))]
    for c in view.contacts:
        forces = (c.normal_force, abs(c.friction_force), *((c.lift,) if view.scene.spatial else ()))
        words = (*map(written, forces), result.margin_text(c))
        rows.append(((c.name, view.color(c.name)), *((word, Color.INK) for word in words)))
    rows += [
        (("", Color.INK),),
        ((f"tendons [{of_tensions}]", Color.SLATE), ("left", Color.SLATE), ("right", Color.SLATE), ("of", Color.SLATE)),
    ]
    for name, finger in result.fingers.items():
        tendons = view.scene.named_fingers[name].tendon_list
        limits = " / ".join(
            dict.fromkeys(f"{prefixes('N')[of_tensions] * tendon.max_tension:.4g}" for tendon in tendons)
        )
        left, right = map(pulled, finger.tensions)
        rows.append(((name, view.color(name)), (left, Color.INK), (right, Color.INK), (limits, Color.INK)))
    rows.append((("sum", Color.SLATE), (pulled(result.total_tension), Color.INK), ("", Color.INK), ("", Color.INK)))
    return rows


def _write_panel(ax: Axes, rows: list[Row]) -> None:
    """Write rows into axes that are as high as they need."""
    ax.set_axis_off()
    ax.set_xlim(0.0, 1.0)
    ax.set_ylim(len(rows), 0.0)
    columns = max(len(row) for row in rows) - 1
    # 6: digits that stand apart in a column, which words above them do as they are
    size = Font.SMALL * 6.0 / max([6, *(len(text) for row in rows for text, color in row[1:] if color == Color.INK)])
    for k, row in enumerate(rows):
        ax.text(0.0, k + 0.5, row[0][0], color=row[0][1], fontsize=Font.SMALL, va="center")
        for j, (text, color) in enumerate(row[1:]):
            right = 1.0 - 0.175 * (columns - 1 - j)  # columns of half an inch
            ax.text(
                right,
                k + 0.5,
                text,
                color=color,
                fontsize=size if color == Color.INK else Font.SMALL,
                ha="right",
                va="center",
            )
