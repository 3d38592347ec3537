"""The grasp of a hand: the hand in space, and each finger in its plane with the section of the object there."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.plotting.drawing.bodies import draw_body, finger_outline
from continuum_grasp.plotting.drawing.forces import draw_arrow
from continuum_grasp.plotting.drawing.style import MATERIAL, Color, Inch, Z, plain
from continuum_grasp.plotting.drawing.styled_axes import StyledAxes, wrapped

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_SUPPORT = MATERIAL["edgecolor"]
_VIEW = 18.0, -50.0
"""Elevation and azimuth from which the hand is seen [deg]."""
_LIGHT = 160.0, 45.0
"""Azimuth and altitude of the light, as matplotlib counts them [deg]."""
_ARROW = 0.35
"""Length of the greatest force, per length of the longest finger [1]."""


def plot_hand(result: Any) -> list[Axes]:
    """Draw the grasp of a hand: in space, and in the plane of each finger.

    Arrows are the forces that the object bears at its contacts, in a plane the part of them that lies in it. Palm and
    table are gray. Closed lines in a plane are the sections of the object; a finger beside its center touches it at a
    slant, and its contact then lies off the section.
    """
    from mpl_toolkits.mplot3d import Axes3D  # type: ignore[import-untyped]

    scene = result.scene
    columns = 2 if len(scene.setups) in (2, 4) else min(len(scene.setups), 3)
    rows = math.ceil(len(scene.setups) / columns)
    figure = StyledAxes.figure(Inch.SPACE + columns * Inch.PLANE, max(Inch.SPACE, rows * Inch.PLANE) + 0.5)
    grid = figure.add_gridspec(rows, columns + 1, width_ratios=[1.15 * Inch.SPACE / Inch.PLANE, *[1.0] * columns])
    space: Any = figure.add_subplot(grid[:, 0], axes_class=Axes3D)
    title = f"{plain(scene.name or 'hand')}: {result.status.word}"
    figure.suptitle(wrapped(title, Inch.SPACE + columns * Inch.PLANE), fontsize=10, color=Color.INK, x=0.02, ha="left")
    lines = {s.name: result.arrays[f"{s.name}.backbone"] for s in scene.setups if result.arrays}
    scale = _arrow_scale(result)
    _draw_space(space, result, lines, scale)
    planes = []
    for k, (setup, frame) in enumerate(zip(scene.setups, result.frames, strict=True)):
        ax = figure.add_subplot(grid[k // columns, 1 + k % columns])
        _draw_plane(ax, result, setup, frame, lines.get(setup.name), scale)
        if k % columns == 0:
            ax.set_ylabel("along [mm]", fontsize=8)
        planes.append(ax)
    _align(planes)
    return [space, *planes]


def _align(planes: list[Axes]) -> None:
    """Give planes one scale: the same spans around what each shows. Bases are above, as in the hand."""
    spans = np.array([[ax.dataLim.width, ax.dataLim.height] for ax in planes]).max(axis=0)
    for ax in planes:
        middle = 0.5 * (np.asarray(ax.dataLim.min) + np.asarray(ax.dataLim.max))
        half = 0.53 * spans
        ax.set_xlim(middle[0] + half[0], middle[0] - half[0])
        ax.set_ylim(middle[1] + half[1], middle[1] - half[1])


def _arrow_scale(result: Any) -> float:
    """Length of an arrow per force [m/N]."""
    greatest = max((float(np.linalg.norm(c.force)) for c in result.contacts), default=0.0)
    longest = max(setup.finger.rod.length for setup in result.scene.setups)
    return _ARROW * longest / greatest if greatest > 0.0 else 0.0


def _colors(result: Any) -> dict[str, str]:
    names = [setup.name for setup in result.scene.setups]
    return dict(zip(names, Color.distinct(len(names)), strict=True))


def _draw_space(ax: Any, result: Any, lines: dict[str, Array], scale: float) -> None:
    from matplotlib.colors import LightSource

    scene = result.scene
    colors = _colors(result)
    corners, triangles = result.body.triangles()
    surface = 1e3 * corners
    ax.computed_zorder = False  # by the depth of whole surfaces, which passes fingers through an object that they touch
    ax.view_init(elev=_VIEW[0], azim=_VIEW[1])
    look = {"linewidth": 0.0, "lightsource": LightSource(azdeg=_LIGHT[0], altdeg=_LIGHT[1])}
    ax.plot_trisurf(*surface.T, triangles=triangles, color=Color.OBJECT, alpha=0.75, zorder=Z.OBJECT, **look)
    boxes = [surface]
    for support in scene.supports:
        patch = 1e3 * _patch(scene, support)
        ax.plot_surface(
            *np.moveaxis(patch, -1, 0), color=_SUPPORT, linewidth=0.0, alpha=0.35, zorder=_layer(patch, surface)
        )
        boxes.append(patch.reshape(-1, 3))
    for setup, frame in zip(scene.setups, result.frames, strict=True):
        length = setup.finger.rod.length
        line = lines.get(setup.name, np.array([[0.0] * 4, [length, 0.0, length, 0.0]]))
        points = 1e3 * _tube(frame, line, setup.finger.profile.half_thickness)[::-1]
        layer = _layer(points, surface)
        ax.plot_surface(*np.moveaxis(points, -1, 0), color=colors[setup.name], alpha=0.9, zorder=layer, **look)
        boxes.append(points.reshape(-1, 3))
    for contact in result.contacts:
        start = 1e3 * contact.position
        push = -1e3 * scale * contact.force
        ax.quiver(*(start - push), *push, color=Color.INK, linewidth=1.4, arrow_length_ratio=0.25, zorder=Z.FORCE)
    low, high = (getattr(np.concatenate(boxes), side)(axis=0) for side in ("min", "max"))
    center = 0.5 * (low + high)
    reach = 0.5 * float((high - low).max())
    ax.set(**{f"{name}lim": (c - reach, c + reach) for name, c in zip("xyz", center, strict=True)})
    high_end = center + reach * np.array([1.0, 1.0, 1.08])
    ax.set_box_aspect((1.0, 1.0, 1.0))
    ax.set_xlabel("x [mm]", fontsize=8)
    ax.set_ylabel("y [mm]", fontsize=8)
    # At the top of its axis: beside it, it would lie on the next panel.
    ax.text(high_end[0], high_end[1], high_end[2], "z [mm]", fontsize=8, va="bottom")
    ax.tick_params(labelsize=7)


def _layer(points: Array, surface: Array) -> float:
    """Order of drawing of something that is behind the object, or before it."""
    up, around = np.radians(_VIEW)
    toward = np.array([math.cos(up) * math.cos(around), math.cos(up) * math.sin(around), math.sin(up)])
    nearer = points.reshape(-1, 3).mean(axis=0) - surface.reshape(-1, 3).mean(axis=0)
    return Z.SHAPE if float(nearer @ toward) > 0.0 else Z.SUPPORT


def _patch(scene: Any, support: Any) -> Array:
    """Points (2, 49, 3) of the disc of a support, or of one below the object and the hand [m]."""
    normal = np.array(support.normal)
    center = np.array(support.point)
    radius = support.radius
    if math.isinf(radius):
        bases = [base.position for base in scene.hand.named_bases.values()]
        around = np.array([scene.object.position, *bases])
        around = around - ((around - center) @ normal)[:, None] * normal
        center = 0.5 * (around.min(axis=0) + around.max(axis=0))
        radius = float(np.linalg.norm(around - center, axis=1).max()) + scene.object.size
    first = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    first = first / np.linalg.norm(first)
    turn = np.linspace(0.0, 2.0 * np.pi, 49)
    rim = np.cos(turn)[:, None] * first + np.sin(turn)[:, None] * np.cross(normal, first)
    return np.asarray(center + np.array([0.0, radius])[:, None, None] * rim)


def _tube(frame: Any, line: Array, half_thickness: Any) -> Array:
    """Points (K, 13, 3) of the skin of a round finger whose shape in its plane is (K, 4) [m]."""
    turn = np.linspace(0.0, 2.0 * np.pi, 13)
    places = line[::4]
    angle = places[:, 3]
    across = np.stack([np.cos(angle), np.sin(angle), np.zeros(len(places))], axis=1)
    center = np.column_stack([places[:, 1:3], np.zeros(len(places))])
    ring = np.cos(turn)[None, :, None] * across[:, None] + np.sin(turn)[None, :, None] * np.array([0.0, 0.0, 1.0])
    half = np.broadcast_to(half_thickness(places[:, 0]), len(places))
    return np.asarray(frame.world(center[:, None] + half[:, None, None] * ring))


def _draw_trace(ax: Axes, frame: Any, support: Any, shape: Array) -> None:
    """Draw the line in which a support meets the plane of a finger, along the drawn points there (K, 2) [m]."""
    normal = np.array(support.normal)
    center = np.array(support.point)
    inside = frame.axes[:, :2].T @ normal
    size = float(np.linalg.norm(inside))
    if size < 0.1:  # nearly parallel: they meet far off
        return
    foot = float((center - frame.base) @ normal) / size**2 * inside
    along = np.array([-inside[1], inside[0]]) / size
    middle = float((frame.axes[:, :2].T @ (center - frame.base) - foot) @ along)
    nearest = frame.base + frame.axes[:, :2] @ (foot + middle * along)
    low = ((shape - foot) @ along).min()
    high = ((shape - foot) @ along).max()
    if math.isfinite(support.radius):
        reach = math.sqrt(max(support.radius**2 - float((nearest - center) @ (nearest - center)), 0.0))
        low = middle - reach
        high = middle + reach
    ax.plot(*(1e3 * (foot[:, None] + np.array([low, high]) * along[:, None])), color=_SUPPORT, zorder=Z.OBJECT)


def _fill(ax: Axes, lines: list[Array]) -> None:
    """Fill closed lines but for the holes in them: lines that lie within an odd number of others."""
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path

    paths = []
    for line in lines:
        around = sum(Path(other).contains_points(line).mean() > 0.5 for other in lines if other is not line)
        # Matplotlib leaves out what lines of both directions go around.
        turns = float(line[:-1, 0] @ line[1:, 1] - line[:-1, 1] @ line[1:, 0]) > 0.0
        goes_right = turns == (around % 2 == 0)
        paths.append(Path(line if goes_right else line[::-1], closed=True))
    patch = PathPatch(Path.make_compound_path(*paths), facecolor=Color.OBJECT, edgecolor=Color.EDGE, zorder=Z.OBJECT)
    ax.add_patch(patch)


def _draw_plane(ax: Axes, result: Any, setup: Any, frame: Any, line: Array | None, scale: float) -> None:
    sections = [1e3 * section for section in result.body.sections(frame)]
    if sections:
        _fill(ax, sections)
    if sections and line is not None:
        shape = np.concatenate([*(1e-3 * section for section in sections), line[:, 1:3]])
        for support in result.scene.supports:
            _draw_trace(ax, frame, support, shape)
    if line is not None:
        shown = line * [1e3, 1e3, 1e3, 1.0]
        draw_body(ax, 1e3 * finger_outline(line, setup.finger), facecolor=_colors(result)[setup.name])
        ax.plot(shown[:, 1], shown[:, 2], color=_colors(result)[setup.name], linewidth=1.2, zorder=Z.CENTERLINE)
    for contact in result.contacts:
        if contact.name.startswith(f"{setup.name}."):
            at = 1e3 * ((contact.position - frame.base) @ frame.axes[:, :2])
            push = -1e3 * scale * (contact.force @ frame.axes[:, :2])
            draw_arrow(ax, at - push, at, Color.INK)
            ax.plot(*at, "o", color="white", markeredgecolor=Color.INK, markersize=4.0, zorder=Z.CONTACT)
    words = ""
    if line is not None:
        left, right = result.tensions[setup.name]
        # 0.005: tension below which it would read 0.00 N
        pulls = [f"{name} {tension:.2f} N" for name, tension in (("bends", left), ("back", right)) if tension >= 0.005]
        words = f"\n{', '.join(pulls)}"
    ax.set_title(f"{setup.name}{words}", fontsize=8, color=Color.INK, loc="left")
    ax.set_aspect("equal")
    ax.tick_params(labelsize=7)
    ax.set_xlabel("across [mm]", fontsize=8)
