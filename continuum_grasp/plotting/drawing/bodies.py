"""Solid bodies: fingers, the object in any pose, what supports it, and zones that must not be entered."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.plotting.drawing.style import CLAMP, FAINT, FORBIDDEN, MATERIAL, Color, Z

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.patches import Circle, Polygon

    from continuum_grasp.scene import Chamber, Finger, GraspObject, Support, Tendon


_POINTS = {False: 60, True: 240}
"""Points of a backbone, without and with a thickness that changes: chords of a spiral of two turns, whose last turn
is a fortieth of the length across, are then as short as its units."""
CIRCLE = np.stack([np.cos(np.linspace(0.0, math.tau, 25)), np.sin(np.linspace(0.0, math.tau, 25))], axis=1)
"""Points of a unit circle: enough for limits of pictures and places of labels."""


def finger_outline(backbone: Array, finger: Finger) -> Array:
    """Outline (points, 2) of a finger as thick as it is, with a rounded end, round its backbone.

    The backbone is (points, 2), evenly spaced, or as grasps have it (points, 4): position along the finger, x, y [m],
    angle of the section's X axis [rad].
    """
    line, s, angle = _placed(backbone, finger)
    at, half = _thickness_line(finger, s)
    if _cuts(finger):  # units are rigid: straight between cuts, and turned as their chords are
        edges = np.array(finger.rod.spirob.edges(finger.rod.length)) if finger.rod.spirob else s
        line = np.column_stack([np.interp(edges, s, line[:, k]) for k in (0, 1)])
        s = edges
        chord = np.diff(line, axis=0)
        turned = np.unwrap(np.arctan2(-chord[:, 0], chord[:, 1]))
        turn = turned[np.clip(np.searchsorted(edges, at, side="right") - 1, 0, len(turned) - 1)]
    else:
        turn = np.interp(at, s, angle)
    points = np.column_stack([np.interp(at, s, line[:, k]) for k in (0, 1)])
    across = half[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    cap = turn[-1] + np.linspace(0.0, math.pi, 25)
    end = points[-1] + half[-1] * np.stack([np.cos(cap), np.sin(cap)], axis=1)
    return np.concatenate([points + across, end, (points - across)[::-1]])


def side_path(side: Tendon | Chamber, backbone: Array, finger: Finger) -> Array:
    """Path of a tendon or a chamber (points, 2), towards the tip; backbone as of `finger_outline`."""
    line, s, angle = _placed(backbone, finger)
    length = finger.rod.length
    begin = getattr(side, "start", 0.0)
    to = length if side.to is None else side.to
    at = np.concatenate([[begin], s[(s > begin) & (s < to)], [to]])
    turn = np.interp(at, s, angle)
    shape = side.shape(length)
    along = np.append(shape(at[:1], tip_side=True), shape(at[1:]))
    # The X axis of a section points away from tendons of positive offset.
    offset = -side.offsets[0] * along
    points = np.column_stack([np.interp(at, s, line[:, k]) for k in (0, 1)])
    return np.asarray(points + offset[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1))


def _placed(backbone: Array, finger: Finger) -> tuple[Array, Array, Array]:
    """Points of a backbone, positions along it [m], and angles of the X axes [rad]; by default by differences."""
    line = np.asarray(backbone)
    if line.shape[1] == 4:
        return line[:, 1:3], line[:, 0], line[:, 3]
    s = np.linspace(0.0, finger.rod.length, len(line))
    tangent = np.gradient(line, s, axis=0)
    # the tangent is the sections' Y axis
    return line, s, np.unwrap(np.arctan2(-tangent[:, 0], tangent[:, 1]))


def _cuts(finger: Finger) -> bool:
    """Whether a finger is seen to be cut into units: a spiral without a skin."""
    return finger.rod.spirob is not None and finger.half_thickness is None


def _thickness_line(finger: Finger, s: Array) -> tuple[Array, Array]:
    """Positions along a finger and half its thickness there [m], with both sides of jumps and the cuts of a spiral."""
    half, spiral = finger.profile.half_thickness, finger.rod.spirob
    edges = np.array(half.edges[1:-1])
    at = np.concatenate([s, edges, edges])
    halves = np.concatenate([half(s), half(edges), half(edges, tip_side=True)])
    if spiral is not None and _cuts(finger):
        cuts = np.array(spiral.edges(finger.rod.length)[1:-1])
        # Wedges down to the elastic layer, whose outer ends meet where units are turned by their angle.
        wide = math.tan(0.5 * spiral.unit_angle(finger.rod.length)) * half(cuts)
        sides = np.concatenate([cuts - wide, cuts + wide])
        inside = np.all([np.abs(at - cut) > width for cut, width in zip(cuts, wide, strict=True)], axis=0)
        at = np.concatenate([at[inside], sides, cuts])
        halves = np.concatenate([halves[inside], half(sides), spiral.core * half(cuts)])
    order = np.argsort(at, kind="stable")
    return at[order], halves[order]


def draw_body(ax: Axes, outline: Array, **style: Any) -> Polygon:
    """Draw the thickness of a finger."""
    from matplotlib.patches import Polygon

    look: dict[str, Any] = {"facecolor": Color.BLUE, "alpha": 0.2, "linewidth": 0.0, "zorder": Z.BODY, **style}
    body = Polygon(outline, **look)
    ax.add_patch(body)
    return body


def draw_clamp(ax: Axes, backbone: Array, finger: Finger) -> Array:
    """Draw a hatched block that holds the base of a finger; returns its outline (5, 2)."""
    from matplotlib.patches import Polygon

    p = backbone
    # one-sided difference of second order: the first chord of a bent finger would tilt the clamp
    tangent = -3 * p[0] + 4 * p[1] - p[2] if len(p) > 2 else p[1] - p[0]
    size = float(np.hypot(*tangent))
    along = tangent / size if size > 0 else np.array([0.0, 1.0])
    across = np.array([-along[1], along[0]])
    # 0.12, 0.035: width and depth as parts of the finger's length
    # 1.3: least width as a part of the finger's thickness at the base
    half = max(0.06 * finger.rod.length, 1.3 * float(finger.profile.half_thickness(0.0)))
    depth = 0.035 * finger.rod.length
    face = [p[0] - half * across, p[0] + half * across]
    corners = np.array([*face, face[1] - depth * along, face[0] - depth * along])
    ax.plot(*np.transpose(face), color=Color.INK, linewidth=1.5, solid_capstyle="butt", zorder=Z.CLAMP_FACE)
    block = Polygon(corners, zorder=Z.CLAMP, **CLAMP)
    ax.add_patch(block)
    return np.asarray(block.get_xy())


def backbone_points(finger: Finger) -> int:
    """Number of points of a backbone that show the finger: more where its thickness changes, or it may curl up."""
    return _POINTS[finger.profile.graded]


def draw_earlier(ax: Axes, backbones: Array, shades: Array, finger: Finger) -> None:
    """Draw a finger at earlier instants as thick as it is, each in the color of its line, where that is seen."""
    for backbone, shade in zip(backbones if shows_thickness(finger) else (), shades, strict=False):
        look = {"facecolor": (*shade[:3], 0.1), "edgecolor": (*shade[:3], 0.6), "linewidth": 0.4, "alpha": None}
        draw_body(ax, finger_outline(backbone, finger), **look)


def shows_thickness(finger: Finger) -> bool:
    """Whether the thickness is drawn without an object too: it is wider than a line, or it changes, or tendons do."""
    widest = 2.0 * float(np.max(finger.profile.half_thickness(np.array([0.0, finger.rod.length]))))
    # 0.02: thickness per length that a line of two points shows anyway, in pictures of 4 to 5 inches
    return widest > 0.02 * finger.rod.length or finger.profile.graded or _tendons_change(finger)


def _tendons_change(finger: Finger) -> bool:
    return bool(finger.chambers) or any(channel.shape.constant is None for channel in finger.channels)


def draw_thickness(ax: Axes, backbone: Array, finger: Finger, **style: Any) -> list[Any]:
    """Draw how thick a finger is, and the tendons whose run does not follow from that; returns what was drawn."""
    drawn: list[Any] = [draw_body(ax, finger_outline(backbone, finger), **style)]
    if _tendons_change(finger):
        look: dict[str, Any] = {"color": Color.INK, "linewidth": 0.7, "linestyle": (0, (4, 2)), "zorder": Z.TENDON}
        look |= {key: value for key, value in style.items() if key == "animated"}
        for path in (side_path(tendon, backbone, finger) for tendon in finger.tendon_list):
            drawn += ax.plot(*path.T, **look)
            drawn += ax.plot(*path[-1], "o", markersize=2.5, **{**look, "linestyle": "none"})
        for path in (side_path(chamber, backbone, finger) for chamber in finger.chambers):
            wide = {"linewidth": 3.0, "linestyle": "-", "alpha": 0.35, "solid_capstyle": "butt"}
            drawn += ax.plot(*path.T, **{**look, **wide})
    return drawn


def masses_of(finger: Finger) -> list[float]:
    """Masses of the dots drawn on a finger [kg]: its point masses, and the body at its tip."""
    return [float(m.mass) for m in finger.masses if m.mass > 0] + [b.mass for b in (finger.tip_body,) if b is not None]


def mass_positions(backbone: Array, finger: Finger) -> Array:
    """World positions (masses, 2) on a backbone whose points are evenly spaced from base to tip."""
    line, s, angle = _placed(backbone, finger)
    at = [min(m.at, finger.rod.length) for m in finger.masses if m.mass > 0]
    positions = np.column_stack([np.interp(at, s, line[:, k]) for k in (0, 1)])
    if finger.tip_body is None:
        return positions
    across, along = finger.tip_body.center_of_mass
    c = math.cos(angle[-1])
    s_ = math.sin(angle[-1])
    return np.concatenate([positions, [line[-1] + np.array([[c, -s_], [s_, c]]) @ (across, along)]])


def object_outlines(body: GraspObject, pose: Array) -> list[Array]:
    """World outlines (points, 2) [m] of the parts of an object in a pose (3,): x, y [m] and angle [rad]."""
    c = math.cos(pose[2])
    s = math.sin(pose[2])
    turn = np.array([[c, s], [-s, c]])  # transposed, since points are rows
    return [pose[:2] + np.asarray(part.outline()) @ turn for part in body.parts]


def outlines_at(motion: Any, indices: Any) -> list[list[Array]]:
    """Outlines of the object of a motion or a plan at some of its instants; none without an object."""
    if motion.object_pose is None:
        return []
    return [object_outlines(motion.scene.object, pose) for pose in np.asarray(motion.object_pose)[indices, :3]]


def draw_object(ax: Axes, outlines: Sequence[Array], *, faint: bool = False, **style: Any) -> list[Polygon]:
    """Draw an object by the outlines of its parts: as one body, or faintly as its outlines alone.

    Returns the patches: once over all parts for a faint one, else first the edges of all parts, then their fillings.
    """
    from matplotlib.patches import Polygon

    if faint:
        layers = [{**FAINT, "zorder": Z.FAINT_OBJECT}]
    else:  # all fillings lie on all edges, so that no edge shows where parts overlap
        # 3.0: width of the edge [points], half of which lies under the filling
        edge = {"facecolor": Color.EDGE, "edgecolor": Color.EDGE, "linewidth": 3.0, "joinstyle": "round"}
        layers = [{**edge, "zorder": Z.OBJECT}, {"facecolor": Color.OBJECT, "linewidth": 0.0, "zorder": Z.OBJECT_FILL}]
    drawn = [Polygon(outline, **{**layer, **style}) for layer in layers for outline in outlines]
    for patch in drawn:
        ax.add_patch(patch)
    return drawn


def moved_supports(motion: Any, index: int) -> dict[str, Support]:
    """Supports that move, by name, where they are at an instant of a motion."""
    moved: dict[str, Support] = {}
    for name in getattr(motion.scene, "support_motion", {}):
        support = motion.scene.supports[name]
        column = list(motion.w_names).index(f"{name}_shift_x [m]")
        position = np.array(support.position) + motion.w[index, column : column + 2]
        moved[name] = support.replaced(position=tuple(position.tolist()))
    return moved


def draw_pegs(ax: Axes, supports: Mapping[str, Support], **style: Any) -> list[Circle]:
    """Draw the round ones of supports within the limits of the axes; returns their patches."""
    from matplotlib.patches import Circle

    diagonal = math.hypot(*np.diff([ax.get_xlim(), ax.get_ylim()]).ravel())
    look = {**MATERIAL, "linewidth": 1.2, "edgecolor": Color.INK, "zorder": Z.SUPPORT, **style}
    drawn: list[Circle] = []
    for name, support in supports.items():
        # 0.012: least radius of a peg, as a part of the diagonal: a point peg is still seen
        drawn += [Circle(peg.position, max(peg.radius, 0.012 * diagonal), **look) for peg in support.pegs(name)]
    for patch in drawn:
        ax.add_patch(patch)
    return drawn


def draw_supports(ax: Axes, supports: Mapping[str, Support]) -> list[Array]:
    """Draw supports within the limits of the axes; returns their outlines."""
    from matplotlib.patches import Polygon

    (left, right), (low, high) = ax.get_xlim(), ax.get_ylim()
    diagonal = math.hypot(right - left, high - low)
    # a half-plane ends outside of the picture, wherever its point is in it
    # 0.035: thickness of the hatched material, as a part of the picture: two strokes of the hatching
    far = 2.0 * diagonal
    depth = 0.035 * max(right - left, high - low)
    drawn: list[Array] = []
    for name, support in supports.items():
        for block, face in _blocks(support, name, far, depth):
            ax.add_patch(Polygon(block, zorder=Z.SUPPORT, **MATERIAL))
            ax.plot(*face.T, color=Color.INK, linewidth=1.4, zorder=Z.FACE, scalex=False, scaley=False)
            drawn.append(block)
    return drawn + [np.array(peg.center) + peg.radius * CIRCLE for peg in draw_pegs(ax, supports)]


def _blocks(support: Support, name: str, far: float, depth: float) -> list[tuple[Array, Array]]:
    """Outline of the material and its face, of each straight part; a groove is one, so that its corner is filled."""
    if support.type == "v_groove":
        apex = np.array(support.apex)
        axis = support.axis_angle
        half = 0.5 * support.opening_angle
        face = np.array([apex + far * _direction(axis + half), apex, apex + far * _direction(axis - half)])
        left, right = (_direction(axis + turn) for turn in (half + 0.5 * math.pi, -half - 0.5 * math.pi))
        # the corner of two faces that are both moved outwards by the depth
        corner = apex - depth / math.sin(half) * _direction(axis)
        return [(np.concatenate([face, [face[2] + depth * right, corner, face[0] + depth * left]]), face)]
    blocks = []
    for wall in support.walls(name):
        normal = np.array(wall.normal)
        reach = min(wall.half_length, far)
        face = np.array(wall.point) + np.outer([-reach, reach], [-normal[1], normal[0]])
        blocks.append((np.concatenate([face, face[::-1] - depth * normal]), face))
    return blocks


def _direction(angle: float) -> Array:
    return np.array([math.cos(angle), math.sin(angle)])


def zones_of(scene: Any) -> Mapping[str, Any]:
    """Zones that a plan's or a controller's bounds keep the finger out of, by name; a simulation has none."""
    bounds = getattr(getattr(scene, "controller", scene), "bounds", None)
    return {} if bounds is None else bounds.keep_out


def zone_points(scene: Any) -> list[Array]:
    """World points (n, 2) that a picture should show: the edges of round zones, one point of straight ones."""
    edges = np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])
    return [
        np.array(zone.center) + zone.radius * edges if zone.type == "disc" else np.array([zone.point])
        for zone in zones_of(scene).values()
    ]


def draw_surroundings(
    ax: Axes,
    motion: Any,
    backbone: Array,
    outlines: Sequence[Sequence[Array]] = (),
    *,
    moving: bool = False,
    index: int = 0,
) -> None:
    """Draw the surroundings of a finger into axes whose limits are set: zones, supports, the object, and the clamp.

    The object is drawn at some instants, by its outlines: faintly at all but the last, and there too if it is drawn
    ``moving``. A fixed one, without poses in a controlled run, is drawn where the scene has it. Supports that move are
    drawn at the instant of an ``index``, and not if they are drawn ``moving``.
    """
    scene = motion.scene
    draw_zones(ax, zones_of(scene))
    moved = moved_supports(motion, index)
    draw_supports(ax, {name: support for name, support in scene.supports.items() if name not in moved})
    draw_pegs(ax, {} if moving else moved)
    for k, some in enumerate(outlines):
        draw_object(ax, some, faint=moving or k < len(outlines) - 1)
    if motion.object_pose is None and scene.object is not None:
        draw_object(ax, object_outlines(scene.object, np.asarray(scene.object.pose)))
    draw_clamp(ax, backbone, scene.finger)


def draw_zones(ax: Axes, zones: Mapping[str, Any]) -> None:
    """Draw zones as large as the axes, whose limits are set already."""
    from matplotlib.patches import Circle, Polygon

    for zone in zones.values():
        if zone.type == "disc":
            ax.add_patch(Circle(zone.center, zone.radius, zorder=Z.ZONE, **FORBIDDEN))
            continue
        normal = _direction(zone.normal_angle)
        along = np.array([-normal[1], normal[0]])
        far = 10.0 * (np.ptp(ax.get_xlim()) + np.ptp(ax.get_ylim()))
        edge = [np.array(zone.point) + far * along, np.array(zone.point) - far * along]
        ax.add_patch(Polygon([*edge, edge[1] - far * normal, edge[0] - far * normal], zorder=Z.ZONE, **FORBIDDEN))
