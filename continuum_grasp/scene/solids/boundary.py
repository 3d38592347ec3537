"""Boundaries of planar outlines as lines and arcs: of sections of solids of revolution, and of extruded solids."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import pairwise

from continuum_grasp.base import Array
from continuum_grasp.scene.curved_parts import SHARE, curved, hollowed
from continuum_grasp.scene.parts import Face, OffsetPolygon, Part
from continuum_grasp.scene.polygons import PlanePoint, corners_of, edge_normal

_FINE = 720
"""Points of the outline of a superellipse; arcs pass through them."""
_PANEL = 0.1
"""Greatest turn of a piece of an arc over which integrals have one rule of Gauss [rad]."""
_ALIKE = 0.02
"""Difference between the halves of a symmetric section, per size [1]: pixels of a silhouette."""
_NODES = ((-math.sqrt(0.6), 5.0 / 18.0), (0.0, 8.0 / 18.0), (math.sqrt(0.6), 5.0 / 18.0))
"""Places and weights of Gauss's rule with three nodes on [-1, 1], weights summing up to one."""


def boundary(part: Part) -> tuple[Face, ...]:
    """Lines and arcs around a part, counter-clockwise; arcs about a center outside turn by a negative angle."""
    if not isinstance(part, OffsetPolygon):
        part = curved(OffsetPolygon(tuple(part.outline(_FINE))))
    return hollowed(part) if part.radius == 0.0 else _grown(part)


def _grown(part: OffsetPolygon) -> tuple[Face, ...]:
    """The boundary of a part with an offset, whose core has straight edges."""
    core, r = part.vertices, part.radius
    if len(core) == 1:
        (x, y), angle = core[0], 0.0
        return (Face((x + r, y), (x + r, y), angle, math.tau, r),)
    ends = list[tuple[PlanePoint, PlanePoint]]()
    arcs = list[Face | None]()
    for (x, y), (low, turn) in zip(core, part.turns, strict=True):
        if turn > 0.0:
            a, b = ((x + r * math.cos(t), y + r * math.sin(t)) for t in (low, low + turn))
            ends.append((a, b))
            arcs.append(Face(a, b, low, turn, r))
        else:  # the edges meet before they are as long
            reach = r / math.cos(0.5 * turn)
            middle = low + 0.5 * turn
            met = (x + reach * math.cos(middle), y + reach * math.sin(middle))
            ends.append((met, met))
            arcs.append(None)
    faces = list[Face]()
    edges = pairwise((*core, core[0]))
    for k, (a, b) in enumerate(edges):
        faces += [arc] if (arc := arcs[k]) is not None else []
        start = ends[k][1]
        end = ends[(k + 1) % len(core)][0]
        if math.dist(start, end) > 1e-9 * part.extent:
            faces.append(Face(start, end, edge_normal(a, b)))
    return tuple(faces)


def inset(part: Part, radius: float) -> OffsetPolygon:
    """The core of a part whose convex corners are rounded by a radius, so that it is the core grown by it.

    Raises
    ------
    ValueError
        Nothing is left, or more than one piece.
    """
    import shapely

    if isinstance(part, OffsetPolygon) and part.radius > radius:
        return OffsetPolygon(part.vertices, part.radius - radius)
    if isinstance(part, OffsetPolygon) and part.radius == radius and len(part.vertices) > 2:
        return OffsetPolygon(part.vertices)
    faces = boundary(part)
    whole = shapely.Polygon(points_of(faces, 0.5 * _PANEL))
    core = whole.buffer(-radius, join_style="mitre", mitre_limit=10.0)
    if core.is_empty or core.geom_type != "Polygon":
        raise ValueError(f"edge_radius = {radius:g} m is too large: the outline is not as wide everywhere")
    ring = [(float(x), float(y)) for x, y in core.exterior.coords[:-1]]
    return curved(OffsetPolygon(corners_of(ring)))


def points_of(faces: Sequence[Face], turn: float = _PANEL) -> list[PlanePoint]:
    """Points of a boundary, with arcs divided so that they turn by no more than an angle [rad]."""
    points = list[PlanePoint]()
    for face in faces:
        count = max(1, math.ceil(abs(face.turn) / turn - 1e-9))
        points += [at(face, k / count) for k in range(count)]
    return points


def at(face: Face, share: float) -> PlanePoint:
    """Point of a face at a share of its length."""
    if face.turn == 0.0 or face.radius == 0.0:
        (ax, ay), (bx, by) = face.start, face.end
        return ax + share * (bx - ax), ay + share * (by - ay)
    (x, y), angle = face.center, face.normal + share * face.turn
    return x + face.radius * math.cos(angle), y + face.radius * math.sin(angle)


def integral(faces: Sequence[Face], of: Callable[[float, float], float]) -> float:
    """Integral of a function of x and y over dy, counter-clockwise along a boundary."""
    total = 0.0
    for face in faces:
        count = max(1, math.ceil(abs(face.turn) / _PANEL))
        size = math.dist(face.start, face.end) if face.turn == 0.0 else face.radius * face.turn
        for k in range(count):
            for node, weight in _NODES:
                share = (k + 0.5 + 0.5 * node) / count
                # The tangent is the normal turned to the left: dy = cos(normal) ds.
                slope = math.cos(face.normal + share * face.turn)
                total += weight / count * size * slope * of(*at(face, share))
    return total


def length(faces: Sequence[Face]) -> float:
    """Length of a boundary [m]."""
    return sum(math.dist(f.start, f.end) if f.turn == 0.0 else f.radius * f.turn for f in faces)


def growth(faces: Sequence[Face]) -> float:
    """Coefficient c of the area ``A + length * r + c r^2`` of the points within r of the area inside."""
    total = 0.0
    for before, face in zip((faces[-1], *faces[:-1]), faces, strict=True):
        corner = math.remainder(face.normal - before.normal - before.turn, math.tau) if len(faces) > 1 else 0.0
        # At a reflex corner strips overlap.
        total += 0.5 * face.turn + (0.5 * corner if corner > 0.0 else math.tan(0.5 * corner))
    return total


def whole_section(part: Part) -> tuple[Face, ...]:
    """Boundary of the section through the axis x = 0 of a solid of revolution, given as the whole or a half.

    For a ring, return only the section on one side of the axis, at x > 0.

    Raises
    ------
    ValueError
        The part crosses the axis and is not symmetric about it.
    """
    import shapely
    from shapely import affinity

    faces = boundary(part)
    points = points_of(faces, 0.25 * _PANEL)
    x, y = zip(*points, strict=True)
    size = max(max(x) - min(x), max(y) - min(y))
    left = min(x)
    near = SHARE * size
    if left > near:
        return faces
    if left < -near:
        drawn = shapely.Polygon(points)
        off = drawn.exterior.hausdorff_distance(affinity.scale(drawn, xfact=-1.0, origin=(0.0, 0.0)).exterior)
        if off > _ALIKE * size:
            raise ValueError(
                f"profile: left and right of the axis x = 0 it differs by {off:.3g} m; give the half at x > 0 alone, "
                "or shift the profile by its position"
            )
        if off <= 1e-9 * size or not isinstance(part, OffsetPolygon):
            return faces
    if not isinstance(part, OffsetPolygon) or part.radius > 0.0:
        raise ValueError("profile: half of a section must be a polygon without corner_radius, or an outline of a file")
    # The half at x > 0 and its image.
    area = shapely.box(0.0, min(y) - size, 2.0 * size, max(y) + size).intersection(shapely.Polygon(part.vertices))
    if area.geom_type != "Polygon":
        raise ValueError("profile: the part at x > 0 must be one piece")
    ring = [(0.0 if abs(a) <= near else float(a), float(b)) for a, b in area.exterior.coords[:-1]]
    both = shapely.union(shapely.Polygon(ring), shapely.Polygon([(-a, b) for a, b in ring]))
    if both.geom_type != "Polygon" or len(both.interiors):
        raise ValueError("profile: the part at x > 0 must touch the axis x = 0 along one line, or not at all")
    return boundary(curved(OffsetPolygon(corners_of([(float(a), float(b)) for a, b in both.exterior.coords[:-1]]))))


def outermost(faces: Sequence[Face], angle: float) -> list[PlanePoint]:
    """Return points of a boundary that include the farthest ones in the direction of an angle [rad]: corners, and
    points of arcs with this normal.
    """
    points = [face.start for face in faces]
    for face in faces:
        off = math.remainder(angle - face.normal, math.tau) % math.tau
        if face.turn > 0.0 and off < face.turn:
            points.append(at(face, off / face.turn))
    return points


def few(points: Array, direction: Array, size: float) -> Array:
    """Points (K, 3) of a face across a direction that reach farthest along it and, of these, to eight sides."""
    import numpy as np

    heights = points @ direction
    face = points[heights >= heights.max() - 1e-6 * size]
    side = np.cross(direction, np.eye(3)[np.abs(direction).argmin()])
    turn = 0.25 * np.pi * np.arange(8)
    ways = np.cos(turn)[:, None] * side + np.sin(turn)[:, None] * np.cross(direction, side)
    return np.asarray(face[np.unique((ways @ face.T).argmax(axis=1))])
