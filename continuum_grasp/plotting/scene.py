"""A scene before anything is solved: unloaded fingers, object, supports, gravity, loads, zones and targets."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from continuum_grasp.base import Array, check_arguments, clipped
from continuum_grasp.plotting.drawing import bodies
from continuum_grasp.plotting.drawing.forces import draw_arrow
from continuum_grasp.plotting.drawing.style import Color, Z, plain
from continuum_grasp.plotting.drawing.styled_axes import StyledAxes, wrapped
from continuum_grasp.plotting.grasp.labels import Label, place_labels
from continuum_grasp.plotting.grasp.view import FINGERS, turned
from continuum_grasp.plotting.scene_view import SceneView
from continuum_grasp.scene import Value

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_LETTERS = 34
"""Letters of a label at most: names of fingers and supports have up to 31."""
_ARROW = 0.12
"""Length of the arrow of a load, as a part of the picture: seen, and not taken for a body."""


@check_arguments
def plot_scene(scene: Value, *, ax: Axes | None = None) -> Axes:
    """Draw a scene of any kind, or a finger alone, before anything is solved.

    Fingers are drawn unloaded, at their bases; dots along them are contacts, required or optional. The
    object is drawn where it starts, dashed frames are ranges in which positions are chosen, and an arrow above the
    picture, or a cross in a circle for one into the plane, is gravity.

    Parameters
    ----------
    scene : Scene, GraspScene, ControlScene, MissionScene, PlanScene, IdentifyScene or Finger
        Lengths in m.
    ax : matplotlib.axes.Axes, optional
        Axes to draw into [m]; None: axes in a new figure.

    Returns
    -------
    matplotlib.axes.Axes

    Examples
    --------
    >>> import continuum_grasp as cg
    >>> from continuum_grasp import plotting
    >>> ax = plotting.plot_scene(cg.load("configs/grasp/gear.yaml"))
    >>> ax.get_title(loc="left").splitlines()[0]
    'gear held against the palm'
    """
    view = SceneView(scene)
    styled = StyledAxes.plane(ax, view.box, colorbar=False)
    ax = styled.ax
    _head(ax, view)
    bodies.draw_zones(ax, bodies.zones_of(scene))
    areas = bodies.draw_supports(ax, view.supports)
    if view.before:
        bodies.draw_object(ax, view.before, faint=True)
    bodies.draw_object(ax, view.outlines)
    labels = [*_fingers(ax, view), *_object(ax, view), *_supports(view), *_targets(ax, view)]
    labels += _loads(ax, view)
    place_labels(ax, labels, [*areas, *view.thickness.values()], [], view.outlines)
    return ax


def _head(ax: Axes, view: SceneView) -> None:
    """Write name and gravity above the axes."""
    from matplotlib.transforms import Affine2D, ScaledTranslation

    in_plane, into = view.gravity
    size = float(np.hypot(*in_plane))
    # 0.75: ticks and labels beside the axes [inch]
    wide = ax.figure.bbox.width / ax.figure.dpi - 0.75
    lines = plain(getattr(view.scene, "name", None) or "scene"), "fingers unloaded, nothing is solved yet"
    # 24: height of the row with gravity [points]
    ax.set_title("\n".join(wrapped(text, wide) for text in lines), fontsize=10, color=Color.INK, loc="left", pad=24.0)
    # points to the right of, and above, the upper left corner of the axes
    corner: Any = ax.transAxes
    points: Any = Affine2D().scale(1.0 / 72.0) + ax.figure.dpi_scale_trans + ScaledTranslation(0.0, 1.0, corner)
    words = f"gravity {np.hypot(size, into):.3g} m/s\N{SUPERSCRIPT TWO}"
    if into:
        words += " slanted to the plane" if size else f" {'into' if into > 0.0 else 'out of'} the plane"
    words = words if into or size else "no gravity in the plane"
    ax.text(26.0 if into or size else 0.0, 11.0, words, fontsize=8, color=Color.INK, va="center", transform=points)
    at = np.array([12.0, 11.0])
    if into:  # the tail of an arrow that flies away, or the point of one that comes
        for marker, width in (("o", 9.0), ("x", 5.5) if into > 0.0 else (".", 7.0)):
            look: dict[str, Any] = {
                "markersize": width,
                "markerfacecolor": "white",
                "color": Color.INK,
                "clip_on": False,
            }
            ax.plot(*at, marker, transform=points, scalex=False, scaley=False, **look)
    elif size:
        half = 8.0 * in_plane / size
        look = {"arrowstyle": "-|>", "color": Color.INK, "linewidth": 1.4, "shrinkA": 0.0, "shrinkB": 0.0}
        ax.annotate("", tuple(at + half), tuple(at - half), points, points, arrowprops=look, annotation_clip=False)


def _fingers(ax: Axes, view: SceneView) -> list[Label]:
    """Draw the fingers with their clamps, masses and contacts; returns their labels."""
    labels = []
    for k, (name, finger) in enumerate(view.fingers.items()):
        line = view.backbones[name]
        color = FINGERS[k % len(FINGERS)]
        bodies.draw_clamp(ax, line[:, 1:3], finger)
        bodies.draw_thickness(ax, line, finger, facecolor=color)
        ax.plot(*line[:, 1:3].T, color=color, linewidth=1.5, zorder=Z.CENTERLINE)
        labels.append(_label(name if len(view.fingers) > 1 else "base", color, line[0, 1:3]))
        for mass, at in zip(bodies.masses_of(finger), bodies.mass_positions(line, finger), strict=True):
            ax.plot(*at, "o", color=Color.INK, markersize=7, zorder=Z.MASS)
            labels.append(_label(f"{1e3 * mass:.3g} g", Color.INK, at))
        places = view.on(name, view.contacts.get(name, []))
        look: dict[str, Any] = {"color": "white", "markeredgecolor": color, "markersize": 5.0, "zorder": Z.CONTACT}
        ax.plot(*places.T, "o", **look)
        if len(places):
            labels.append(_label("may touch" if len(places) == 1 else "may touch at dots", color, places[0]))
    return labels


def _object(ax: Axes, view: SceneView) -> list[Label]:
    """Draw the chosen positions, and the center of mass; returns labels of object and ranges."""
    from matplotlib.patches import Polygon

    labels = []
    body = view.object
    for name, (low, high) in view.ranges.items():
        frame = np.array([low, (high[0], low[1]), high, (low[0], high[1])])
        ax.add_patch(
            Polygon(frame, fill=False, edgecolor=Color.SLATE, linewidth=1.2, linestyle=(0, (3, 2)), zorder=Z.MARK)
        )
        labels.append(_label(f"position of {name}: chosen", Color.SLATE, frame[1]))
    if body is not None:
        at = np.array(body.position) + turned(np.array(body.com), body.angle)
        ax.plot(*at, "+", color=Color.INK, markersize=7, zorder=Z.FORCE)
        mass = f"{body.mass:.3g} kg" if body.mass >= 0.1 else f"{1e3 * body.mass:.3g} g"
        labels.append(_label(f"{body.shape}, {mass}", Color.INK, at, on_body=True))
    if view.before:
        seen = max(view.before[0], key=lambda point: body.distance((float(point[0]), float(point[1]))))
        labels.append(_label("where it stands before", Color.SLATE, seen))
    return labels


def _supports(view: SceneView) -> list[Label]:
    """Labels of supports and zones, each at a place of it that is seen."""
    left, right, low, high = view.box
    middle = np.array([left + right, low + high]) / 2.0
    sides = np.array([right - left, high - low])
    labels = [_label(peg.name, Color.INK, np.array(peg.position)) for peg in view.pegs]
    for wall in view.walls:
        along = np.array([-wall.normal[1], wall.normal[0]])
        foot = middle - wall.height((float(middle[0]), float(middle[1]))) * np.array(wall.normal)
        reach = 0.5 * float(np.abs(along) @ sides)
        start = float((foot - wall.point) @ along)
        # 0.7: position of the name, as a part of the distance from the middle of the picture to its edge
        at = np.clip(start + 0.7 * reach, -wall.half_length, wall.half_length)
        near = np.array(wall.point) + at * along
        labels.append(_label(wall.name, Color.INK, near))
    for name, zone in bodies.zones_of(view.scene).items():
        labels.append(
            _label(f"keep out: {name}", Color.ORANGE, np.array(zone.center if zone.type == "disc" else zone.point))
        )
    return labels


def _targets(ax: Axes, view: SceneView) -> list[Label]:
    """Draw where finger and object are led to; returns labels."""
    for points in view.targets.values():
        ax.plot(*points.T, ":", color=Color.GREEN, linewidth=1.0, zorder=Z.SHAPE)
        ax.plot(*points[:: max(1, len(points) // 12)].T, "x", color=Color.GREEN, markersize=6, zorder=Z.SHAPE)
    return [_label(name, Color.GREEN, points[0]) for name, points in view.targets.items()]


def _loads(ax: Axes, view: SceneView) -> list[Label]:
    """Draw loads as arrows of one length; returns labels."""
    left, right, low, high = view.box
    length = _ARROW * max(right - left, high - low)
    for load in view.loads:
        size = float(np.hypot(*load.force))
        if size > 0.0:
            draw_arrow(ax, load.at, load.at + length * load.force / size, Color.ORANGE)
    return [_label(load.text, Color.ORANGE, load.at) for load in view.loads]


def _label(text: str, color: str, at: Array, *, on_body: bool = False) -> Label:
    return Label(plain(clipped(text, _LETTERS)), color, at, np.zeros(2), on_body)
