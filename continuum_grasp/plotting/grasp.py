"""A grasp: object, palm, bent finger with its thickness, contacts, friction cones and forces to scale."""

from __future__ import annotations

import math
import os
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.plotting.axes import BLUE, GREEN, GREY, INK, ORANGE, new_axes
from continuum_grasp.scene.grasp import OutOfPlaneGravity, PlanarGravity

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from continuum_grasp.grasp.result import Contact, GraspResult

__all__ = ["plot_grasp", "save_grasp_plot"]

Array = NDArray[Any]

_MM = 1e3
_PALM_DEPTH = 9.0  # mm
_LABEL = (24.0, 4.2)  # mm: width, height of a line
_FINGER, _FINGER_EDGE = "#C9DCEA", "#4F7892"
_OBJECT, _OBJECT_EDGE = "#F3E9D6", "#A58A55"
_COLORS = {"middle": BLUE, "tip": GREEN, "palm": ORANGE}


def plot_grasp(result: GraspResult, *, ax: Axes | None = None, tendons: bool = True) -> Axes:
    """Draw a grasp in the plane of the finger, in millimetres.

    Parameters
    ----------
    result : GraspResult
        Any result with a shape; where there is no verified grasp the closest point is drawn, and the title
        says so.
    ax : matplotlib.axes.Axes, optional
        Where to draw; None: axes in a new figure.
    tendons : bool, optional
        Draw the two tendons.

    Returns
    -------
    matplotlib.axes.Axes
        Arrows are the forces that the object bears; the light wedges are the friction cones. Numbers beside a
        contact are normal and friction force and, where weight acts out of the plane, the share of it that is
        carried there.
    """
    ax = new_axes(ax, 7.0, 5.8)
    if "backbone" in result.arrays:
        _draw_palm(ax, result)
        _draw_object(ax, result)
        _draw_finger(ax, result, tendons)
        scale = _force_scale(result)
        for contact in result.contacts:
            _draw_contact(ax, result, contact, scale)
        _draw_weight(ax, result, scale)
        _draw_scale(ax, result, scale)
    ax.set_aspect("equal", adjustable="box")
    ax.set_xlabel("x [mm]", color=INK)
    ax.set_ylabel("y [mm]", color=INK)
    ax.set_title(_title(result), fontsize=10, color=INK, loc="left")
    return ax


def save_grasp_plot(result: GraspResult, path: str | os.PathLike[str]) -> Axes:
    """Draw a grasp into a picture file, whose suffix is the format; returns the axes."""
    from continuum_grasp.plotting.pictures import save_picture

    ax = plot_grasp(result)
    save_picture(ax, path)
    return ax


def _title(result: GraspResult) -> str:
    name = result.scene.name or "grasp"
    if not result.solved:
        return f"{name}\nnot a grasp ({result.status.value}): the closest point found"
    first, second = result.tensions
    return f"{name}\ntendon tensions {first:.3g} N and {second:.3g} N, {result.status.value}, verified"


def _force_scale(result: GraspResult) -> float:
    """Drawn length per force [mm/N]: the greatest force is two thirds of the radius long."""
    greatest = max((float(np.hypot(*c.force)) for c in result.contacts), default=0.0)
    return 0.66 * result.scene.object.radius * _MM / greatest if greatest > 0 else 0.0


def _box(result: GraspResult) -> tuple[Array, Array]:
    """Corners of what must be seen, labels included [mm]."""
    scene = result.scene
    centre, radius = np.asarray(scene.object.position), scene.object.radius
    half = scene.finger.thickness_radius
    body = np.concatenate([result.backbone[:, 1:3], result.backbone[:1, 1:3]])
    low = np.minimum(body.min(axis=0) - half, centre - radius) * _MM
    high = np.maximum(body.max(axis=0) + half, centre + radius) * _MM
    for contact in result.contacts:
        at, across, up = _label_place(result, contact)
        size = np.array([_LABEL[0], _LABEL[1] * len(_label_lines(result, contact))])
        share = np.array(
            [
                {"left": 0.0, "center": 0.5, "right": 1.0}[across],
                {"bottom": 0.0, "center": 0.5, "top": 1.0}[up],
            ]
        )
        low, high = np.minimum(low, at - share * size), np.maximum(high, at + (1 - share) * size)
    return low - [5.0, 13.0], high + 5.0  # below: room for the scale of forces


def _label_place(result: GraspResult, contact: Contact) -> tuple[Array, str, str]:
    """Where a contact's label stands [mm], and its alignment across and up."""
    away = contact.normal
    gap = _PALM_DEPTH + 2.0 if contact.name == "palm" else _MM * 2 * result.scene.finger.thickness_radius + 3.0
    across = "left" if away[0] > 0.35 else "right" if away[0] < -0.35 else "center"
    up = "bottom" if away[1] > 0.35 else "top" if away[1] < -0.35 else "center"
    return _MM * contact.position + gap * away, across, up


def _label_lines(result: GraspResult, contact: Contact) -> list[str]:
    lines = [contact.name, f"N {contact.normal_force:.2f} N", f"f {abs(contact.friction_force):.2f} N"]
    if isinstance(result.scene.gravity, OutOfPlaneGravity):
        lines.append(f"lift {contact.lift:.2f} N")
    return lines


def _draw_palm(ax: Axes, result: GraspResult) -> None:
    from matplotlib.patches import Polygon

    low, high = _box(result)
    palm = result.scene.palm
    if palm is not None:
        normal = np.asarray(palm.normal)
        along = np.array([-normal[1], normal[0]])
        point = np.asarray(palm.point) * _MM
        corners = np.array([[x, y] for x in (low[0], high[0]) for y in (low[1], high[1])])
        reach = (corners - point) @ along
        face = point + np.outer([reach.min(), reach.max()], along)
        block = np.concatenate([face, face[::-1] - _PALM_DEPTH * normal])
        ax.add_patch(Polygon(block, facecolor="#E3E3E3", edgecolor="#9A9A9A", hatch="////", linewidth=0.0, zorder=1))
        ax.plot(*face.T, color=INK, linewidth=1.4, zorder=1)
        low, high = np.minimum(low, block.min(axis=0)), np.maximum(high, block.max(axis=0))
    ax.set_xlim(low[0], high[0])
    ax.set_ylim(low[1], high[1])


def _draw_object(ax: Axes, result: GraspResult) -> None:
    from matplotlib.patches import Circle

    thing = result.scene.object
    centre = (_MM * thing.position[0], _MM * thing.position[1])
    ax.add_patch(Circle(centre, _MM * thing.radius, facecolor=_OBJECT, edgecolor=_OBJECT_EDGE, linewidth=1.6, zorder=2))


def _draw_finger(ax: Axes, result: GraspResult, tendons: bool) -> None:
    from matplotlib.patches import Polygon

    finger = result.scene.finger
    line, angle = _MM * result.backbone[:, 1:3], result.backbone[:, 3]
    across = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    half = _MM * finger.thickness_radius
    round_ = np.linspace(0.0, math.pi, 25)
    cap = line[-1] + half * np.stack([np.cos(angle[-1] + round_), np.sin(angle[-1] + round_)], axis=1)
    outline = np.concatenate([line + half * across, cap, (line - half * across)[::-1]])
    ax.add_patch(
        Polygon(outline, facecolor=_FINGER, edgecolor=_FINGER_EDGE, linewidth=1.1, joinstyle="round", zorder=3)
    )
    if tendons and finger.tendons is not None and finger.tendons.offset < finger.thickness_radius:
        for side in (-1.0, 1.0):
            path = line + side * _MM * finger.tendons.offset * across
            ax.plot(*path.T, color=_FINGER_EDGE, linewidth=0.7, linestyle=(0, (4, 2)), zorder=3.2)
    ax.plot(*line.T, color=_FINGER_EDGE, linewidth=1.6, zorder=3.3)
    starts = np.concatenate([[0.0], np.cumsum(result.lengths)])
    for s in starts[1:-1]:
        at = np.array([np.interp(s, result.backbone[:, 0], line[:, k]) for k in (0, 1)])
        ax.plot(*at, "o", markersize=4.0, color="white", markeredgecolor=_FINGER_EDGE, zorder=3.4)


def _draw_contact(ax: Axes, result: GraspResult, contact: Contact, scale: float) -> None:
    from matplotlib.patches import Polygon

    color = _COLORS[contact.name]
    at, inward = _MM * contact.position, -contact.normal
    scene = result.scene
    coefficient = scene.palm_friction if contact.name == "palm" else scene.contacts.friction
    reach = 0.78 * _MM * scene.object.radius
    spread = np.linspace(-1.0, 1.0, 21) * math.atan(coefficient)
    turned = np.stack(
        [
            np.cos(spread) * inward[0] - np.sin(spread) * inward[1],
            np.sin(spread) * inward[0] + np.cos(spread) * inward[1],
        ],
        axis=1,
    )
    wedge = np.concatenate([[at], at + reach * turned])
    ax.add_patch(Polygon(wedge, facecolor=color, alpha=0.13, linewidth=0.0, zorder=2.5))
    for edge in (wedge[1], wedge[-1]):
        ax.plot(*np.transpose([at, edge]), color=color, alpha=0.45, linewidth=0.7, zorder=2.5)
    force = -scale * contact.force
    _arrow(ax, at, at + force, color)
    ax.plot(*at, "o", markersize=4.5, color=color, markeredgecolor="white", markeredgewidth=0.8, zorder=6)
    _label_contact(ax, result, contact, color)


def _label_contact(ax: Axes, result: GraspResult, contact: Contact, color: str) -> None:
    at, across, up = _label_place(result, contact)
    text = "\n".join(_label_lines(result, contact))
    ax.text(at[0], at[1], text, color=color, fontsize=8, ha=across, va=up, linespacing=1.25, zorder=7)


def _draw_weight(ax: Axes, result: GraspResult, scale: float) -> None:
    scene = result.scene
    centre = _MM * np.asarray(scene.object.position)
    mass = scene.object.mass
    if isinstance(scene.gravity, PlanarGravity):
        weight = mass * np.asarray(scene.gravity.vector)
        _arrow(ax, centre, centre + scale * weight, INK)
        text = f"weight {float(np.hypot(*weight)):.2f} N"
    elif isinstance(scene.gravity, OutOfPlaneGravity):
        ax.plot(*centre, "o", markersize=9, markerfacecolor="white", markeredgecolor=INK, zorder=5)
        ax.plot(*centre, "x", markersize=5.5, color=INK, zorder=5.1)
        text = f"weight {mass * scene.gravity.magnitude:.2f} N\ninto the picture"
    else:
        text = "no weight"
    ax.plot(*centre, "+" if not isinstance(scene.gravity, OutOfPlaneGravity) else "", color=INK, zorder=5)
    ax.annotate(
        text,
        (centre[0], centre[1]),
        xytext=(8, 4),
        textcoords="offset points",
        fontsize=8,
        color=INK,
        va="bottom",
        zorder=7,
    )


def _draw_scale(ax: Axes, result: GraspResult, scale: float) -> None:
    """An arrow of a round force in the lower right corner."""
    if scale <= 0:
        return
    greatest = max(float(np.hypot(*c.force)) for c in result.contacts)
    decade = 10.0 ** math.floor(math.log10(greatest))
    size = max(k * decade for k in (0.5, 1.0, 2.0, 5.0) if k * decade <= greatest)
    right, bottom = ax.get_xlim()[1] - 4.0, ax.get_ylim()[0] + 4.0
    _arrow(ax, np.array([right - size * scale, bottom]), np.array([right, bottom]), GREY)
    ax.text(
        right - 0.5 * size * scale,
        bottom + 1.6,
        f"{size:g} N",
        fontsize=8,
        color=GREY,
        ha="center",
        va="bottom",
    )


def _arrow(ax: Axes, start: Array, end: Array, color: str) -> None:
    shape = {"arrowstyle": "-|>,head_length=0.55,head_width=0.25", "color": color, "linewidth": 2.1}
    ends = {"shrinkA": 0, "shrinkB": 0}
    ax.annotate("", (end[0], end[1]), (start[0], start[1]), arrowprops={**shape, **ends}, zorder=5)
