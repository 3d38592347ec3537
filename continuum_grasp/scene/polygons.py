"""Geometry of simple polygons: normals, turns, distances, moments and convex pieces."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from itertools import pairwise
from typing import TypeAlias

from continuum_grasp.scene.value import SAME

PlanePoint: TypeAlias = tuple[float, float]


def edge_normal(a: PlanePoint, b: PlanePoint) -> float:
    """Angle of the outward normal of an edge of a counter-clockwise polygon [rad]."""
    return math.atan2(a[0] - b[0], b[1] - a[1])


def turns_of(vertices: Sequence[PlanePoint]) -> tuple[PlanePoint, ...]:
    """Angle of the outward normal before each corner, and the turn of the normal there, up to half a turn [rad]."""
    turns = []
    for before, here, after in zip((vertices[-1], *vertices), vertices, (*vertices[1:], vertices[0]), strict=False):
        low = edge_normal(before, here)
        turn = (edge_normal(here, after) - low) % math.tau
        # The ends of a segment turn by half a turn, up to rounding.
        turns.append((low, turn if turn < math.pi + SAME else turn - math.tau))
    return tuple(turns)


def segment_distance(p: PlanePoint, a: PlanePoint, b: PlanePoint) -> float:
    dx, dy = b[0] - a[0], b[1] - a[1]
    # A segment of no length is its start.
    share = ((p[0] - a[0]) * dx + (p[1] - a[1]) * dy) / max(dx * dx + dy * dy, sys.float_info.min)
    share = min(max(share, 0.0), 1.0)
    return math.dist(p, (a[0] + share * dx, a[1] + share * dy))


def polygon_distance(point: PlanePoint, vertices: Sequence[PlanePoint]) -> float:
    """Distance of a point from a simple polygon, a segment or a point [m], negative inside the polygon."""
    x, y = point
    nearest, inside = math.inf, False
    for a, b in pairwise([*vertices, vertices[0]]):
        nearest = min(nearest, segment_distance(point, a, b))
        # A ray to the right from an inner point crosses the outline an odd number of times.
        inside ^= (a[1] > y) != (b[1] > y) and x < a[0] + (y - a[1]) / (b[1] - a[1]) * (b[0] - a[0])
    return -nearest if inside else nearest


def polygon_moments(vertices: Sequence[PlanePoint], about: PlanePoint = (0.0, 0.0)) -> tuple[float, PlanePoint, float]:
    """Area [m2], first moments [m3] and polar second moment [m4] about a point; negative for clockwise corners."""
    area = x = y = second = 0.0
    points = [(px - about[0], py - about[1]) for px, py in vertices]
    # Green's theorem: each edge spans a triangle with the point.
    for (ax, ay), (bx, by) in pairwise([*points, points[0]]):
        cross = ax * by - ay * bx
        area += 0.5 * cross
        x, y = x + cross / 6.0 * (ax + bx), y + cross / 6.0 * (ay + by)
        second += cross * (ax * ax + ax * bx + bx * bx + ay * ay + ay * by + by * by) / 12.0
    return area, (x, y), second


def polygon_centroid(vertices: tuple[PlanePoint, ...]) -> PlanePoint:
    area, (x, y), _ = polygon_moments(vertices)
    return x / area, y / area


def corners_of(vertices: Sequence[PlanePoint]) -> tuple[PlanePoint, ...]:
    """The corners of a simple polygon counter-clockwise, without those in line with their neighbors."""
    ring = tuple(vertices) if polygon_moments(vertices)[0] > 0.0 else tuple(vertices[::-1])
    return tuple(corner for corner, (_, turn) in zip(ring, turns_of(ring), strict=True) if abs(turn) > SAME)


def check_simple(vertices: Sequence[PlanePoint], key: str = "vertices") -> None:
    """Refuse an outline that crosses or touches itself, at a key."""
    import shapely

    reason = shapely.is_valid_reason(shapely.Polygon(vertices))
    if reason != "Valid Geometry" or len(set(vertices)) < len(vertices):
        what, _, place = reason.removeprefix("Ring ").partition("[")
        where = f" at ({', '.join(f'{float(c):.4g}' for c in place[:-1].split())}) m" if place else ""
        raise ValueError(
            f"{key} must be the corners of a simple polygon, in order, each once: "
            f"{what.lower() if place else 'a corner is there twice'}{where}"
        )


def convex_pieces(vertices: tuple[PlanePoint, ...]) -> list[tuple[PlanePoint, ...]]:
    """Divide a simple polygon into convex ones between its corners, at most four times as many as necessary.

    Neighboring Delaunay triangles are joined unless a reflex corner needs their common side: S. Hertel and K. Mehlhorn,
    "Fast triangulation of simple polygons", Foundations of Computation Theory, 1983.
    """
    import shapely

    triangles = shapely.constrained_delaunay_triangles(shapely.Polygon(vertices)).geoms
    pieces = [corners_of([(x, y) for x, y in triangle.exterior.coords[:-1]]) for triangle in triangles]
    owner = {side: piece for piece in pieces for side in pairwise([*piece, piece[0]])}
    sides = [(a, b) for a, b in owner if (b, a) in owner and a < b]
    for a, b in sorted(sides, key=lambda side: -math.dist(*side)):
        polygon, other = owner[a, b], owner[b, a]
        k, j = polygon.index(b), other.index(a)
        whole = (*polygon[k:], *polygon[:k], *other[j + 1 :], *other[:j])[:-1]
        if all(turn > SAME for _, turn in turns_of(whole)):
            owner |= dict.fromkeys(pairwise([*whole, whole[0]]), whole)
            del owner[a, b], owner[b, a]
    return list(dict.fromkeys(owner.values()))
