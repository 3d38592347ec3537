"""Parts of objects in plain numbers: polygons with an offset, and superellipses."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import TypeAlias

PlanePoint: TypeAlias = tuple[float, float]

_DIRECTIONS = 256
"""Directions among which the nearest supporting line of a superellipse is sought: those of an exponent of 12 turn by
a tenth of a radian at its corners."""
_IN_LINE = 1e-9
"""Turn of the normal at a corner [rad] up to which its edges are in line: below, rounding decides its sign."""


class Part(ABC):
    """A part of an object in plain numbers, in the object's frame [m].

    The mathematics that contacts and grasps need of it lies in `continuum_grasp.model.surfaces`.
    """

    @abstractmethod
    def placed(self, position: PlanePoint, angle: float) -> Part:
        """The part after a turn about the origin and a shift."""

    @abstractmethod
    def support(self, angle: float) -> float:
        """Support function [m]: greatest extent from the origin in the direction of an angle [rad]."""

    @abstractmethod
    def outline(self, count: int = 240) -> list[PlanePoint]:
        """Points on the boundary, counter-clockwise [m]."""

    @abstractmethod
    def curvature(self, point: PlanePoint, tolerance: float) -> float:
        """Curvature of the boundary at a point of it [1/m]; infinite at a sharp corner, which is ``tolerance`` wide."""

    @property
    @abstractmethod
    def extent(self) -> float:
        """A distance from the origin that no point of the part exceeds [m]."""

    @property
    def pieces(self) -> tuple[Part, ...]:
        """Convex parts that the part consists of."""
        return (self,)

    def distance(self, point: PlanePoint) -> float:
        """Distance of a point of the object's frame from the boundary [m], negative inside."""
        return _polygon_distance(point, self.outline())


@dataclass(frozen=True)
class OffsetPolygon(Part):
    """Everything within a distance of a simple polygon, of a segment (a stadium), or of a point (a disc)."""

    vertices: tuple[PlanePoint, ...]
    """Counter-clockwise corners of the core; one for a disc, two for a stadium [m]."""
    radius: float = 0.0
    """The part is everything within this distance of the core [m]."""

    def placed(self, position: PlanePoint, angle: float) -> OffsetPolygon:
        return OffsetPolygon(tuple(map(_mover(position, angle), self.vertices)), self.radius)

    def support(self, angle: float) -> float:
        c, s = math.cos(angle), math.sin(angle)
        return max(c * x + s * y for x, y in self.vertices) + self.radius

    def outline(self, count: int = 240) -> list[PlanePoint]:
        if self.radius == 0.0:
            return list(self.vertices)
        # An arc about each corner, from the normal of the edge before it to that of the edge after it; where the corner
        # is reflex, the edges meet.
        points = []
        for (x, y), (low, turn) in zip(self.vertices, self.turns, strict=True):
            steps = max(2, round(count * turn / math.tau))
            # A disc closes on itself: its last point would be its first.
            angles = [low + turn * j / steps for j in range(steps + (len(self.vertices) > 1))]
            reach = self.radius
            if turn < 0.0:
                reach, angles = self.radius / math.cos(0.5 * turn), [low + 0.5 * turn]
            points += [(x + reach * math.cos(t), y + reach * math.sin(t)) for t in angles]
        return points

    @cached_property
    def turns(self) -> tuple[PlanePoint, ...]:
        """At each corner of the core the angle of the outward normal before it, and by how much the normal turns
        there, negative where the corner is reflex [rad].
        """
        return _turns(self.vertices) if len(self.vertices) > 1 else ((0.0, math.tau),)

    @cached_property
    def pieces(self) -> tuple[OffsetPolygon, ...]:
        """Convex parts between corners of the core, which overlap no more than the offset makes them."""
        if all(turn > 0.0 for _, turn in self.turns):
            return (self,)
        return tuple(OffsetPolygon(piece, self.radius) for piece in _convex_pieces(self.vertices))

    def curvature(self, point: PlanePoint, tolerance: float) -> float:
        # On the rounding of a corner no edge is nearer than its ends.
        corners = (corner for corner, (_, turn) in zip(self.vertices, self.turns, strict=True) if turn > 0.0)
        if min(math.dist(point, corner) for corner in corners) > self.radius + tolerance:
            return 0.0
        return 1.0 / self.radius if self.radius > 0.0 else math.inf

    @property
    def extent(self) -> float:
        return max(math.hypot(*v) for v in self.vertices) + self.radius

    def distance(self, point: PlanePoint) -> float:
        return _polygon_distance(point, self.vertices) - self.radius


@dataclass(frozen=True)
class SuperellipsePart(Part):
    """A superellipse |x/a|^p + |y/b|^p <= 1 in axes of its own."""

    semi_axes: PlanePoint
    """Semi-axes a and b [m]."""
    exponent: float = 2.0
    """Exponent p; 2 is an ellipse."""
    center: PlanePoint = (0.0, 0.0)
    angle: float = 0.0
    """From the object's axes to those of the superellipse [rad]."""

    def placed(self, position: PlanePoint, angle: float) -> SuperellipsePart:
        return replace(self, center=_mover(position, angle)(self.center), angle=self.angle + angle)

    def support(self, angle: float) -> float:
        c, s = math.cos(angle), math.sin(angle)
        # Hoelder's inequality: the support function of a p-norm ball is the norm of the dual exponent p / (p - 1).
        (a, b), dual = self.semi_axes, self.exponent / (self.exponent - 1.0)
        u, v = a * abs(math.cos(angle - self.angle)), b * abs(math.sin(angle - self.angle))
        return float(c * self.center[0] + s * self.center[1] + (u**dual + v**dual) ** (1.0 / dual))

    def outline(self, count: int = 240) -> list[PlanePoint]:
        move, power = _mover(self.center, self.angle), 2.0 / self.exponent
        # x = a |cos t|^(2/p) satisfies the equation exactly, with the sign of the quadrant.
        turns = (math.tau * k / count for k in range(count))
        return [
            move(
                (
                    self.semi_axes[0] * math.copysign(abs(math.cos(t)) ** power, math.cos(t)),
                    self.semi_axes[1] * math.copysign(abs(math.sin(t)) ** power, math.sin(t)),
                )
            )
            for t in turns
        ]

    def curvature(self, point: PlanePoint, tolerance: float) -> float:
        c, s = math.cos(self.angle), math.sin(self.angle)
        x, y = point[0] - self.center[0], point[1] - self.center[1]
        (a, b), p = self.semi_axes, self.exponent
        u, v = abs(c * x + s * y) / a, abs(c * y - s * x) / b
        fx, fy = u ** (p - 1.0) / a, v ** (p - 1.0) / b  # a p-th of the gradient of |x/a|^p + |y/b|^p
        fxx = (p - 1.0) * u ** (p - 2.0) / a**2
        fyy = (p - 1.0) * v ** (p - 2.0) / b**2
        # Of an implicit curve f = 0, whose mixed derivative is zero here.
        return float((fxx * fy**2 + fyy * fx**2) / (fx**2 + fy**2) ** 1.5)

    def distance(self, point: PlanePoint) -> float:
        # The farthest supporting line of a convex body is as far as its boundary, from either side.
        def away(angle: float) -> float:
            return math.cos(angle) * point[0] + math.sin(angle) * point[1] - self.support(angle)

        step = math.tau / _DIRECTIONS
        best = max((step * k for k in range(_DIRECTIONS)), key=away)
        low, high = best - step, best + step
        while high - low > 1e-8:  # distances of maxima are exact to the square of an angle
            third = (high - low) / 3.0
            low, high = (low + third, high) if away(low + third) < away(high - third) else (low, high - third)
        return away(0.5 * (low + high))

    @property
    def extent(self) -> float:
        return math.hypot(*self.center) + math.hypot(*self.semi_axes)


@lru_cache(maxsize=256)
def farthest(part: Part, point: PlanePoint) -> float:
    return max(math.dist(point, p) for p in part.outline())


def _mover(position: PlanePoint, angle: float) -> Callable[[PlanePoint], PlanePoint]:
    c, s = math.cos(angle), math.sin(angle)
    return lambda p: (position[0] + c * p[0] - s * p[1], position[1] + s * p[0] + c * p[1])


def _edge_normal(a: PlanePoint, b: PlanePoint) -> float:
    """Angle of the outward normal of an edge of a counter-clockwise polygon [rad]."""
    return math.atan2(a[0] - b[0], b[1] - a[1])


def _turns(vertices: Sequence[PlanePoint]) -> tuple[PlanePoint, ...]:
    """Angle of the outward normal before each corner, and the turn of the normal there, up to half a turn [rad]."""
    turns = []
    for before, here, after in zip((vertices[-1], *vertices), vertices, (*vertices[1:], vertices[0]), strict=False):
        low = _edge_normal(before, here)
        turn = (_edge_normal(here, after) - low) % math.tau
        # The ends of a segment turn by half a turn, but for rounding.
        turns.append((low, turn if turn < math.pi + _IN_LINE else turn - math.tau))
    return tuple(turns)


def _segment_distance(p: PlanePoint, a: PlanePoint, b: PlanePoint) -> float:
    dx, dy = b[0] - a[0], b[1] - a[1]
    # 1e-300: a segment of no length is its start.
    share = ((p[0] - a[0]) * dx + (p[1] - a[1]) * dy) / max(dx * dx + dy * dy, 1e-300)
    share = min(max(share, 0.0), 1.0)
    return math.dist(p, (a[0] + share * dx, a[1] + share * dy))


def _polygon_distance(point: PlanePoint, vertices: Sequence[PlanePoint]) -> float:
    """Distance of a point from a simple polygon, a segment or a point [m], negative inside the polygon."""
    x, y = point
    nearest, inside = math.inf, False
    for a, b in pairwise([*vertices, vertices[0]]):
        nearest = min(nearest, _segment_distance(point, a, b))
        # A ray to the right crosses the outline of what it starts in an odd number of times.
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
    return tuple(corner for corner, (_, turn) in zip(ring, _turns(ring), strict=True) if abs(turn) > _IN_LINE)


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


def _convex_pieces(vertices: tuple[PlanePoint, ...]) -> list[tuple[PlanePoint, ...]]:
    """Convex polygons between the corners of a simple one, at most four times as many as are needed.

    Of the triangles of Delaunay those are joined whose common side no reflex corner needs: S. Hertel and K. Mehlhorn,
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
        if all(turn > _IN_LINE for _, turn in _turns(whole)):
            owner |= dict.fromkeys(pairwise([*whole, whole[0]]), whole)
            del owner[a, b], owner[b, a]
    return list(dict.fromkeys(owner.values()))


def rounded(vertices: tuple[PlanePoint, ...], radius: float) -> OffsetPolygon:
    """The part whose sharp outline is given and whose corners are rounded off inside it, but for reflex ones."""
    if radius == 0.0:
        return OffsetPolygon(vertices)
    core = []
    for (x, y), (low, turn) in zip(vertices, _turns(vertices), strict=True):
        # The center of an arc tangent to both edges is on the bisector, radius / cos(half) inside the corner.
        reach, middle = radius / math.cos(0.5 * turn), low + 0.5 * turn
        core.append((x - reach * math.cos(middle), y - reach * math.sin(middle)))
    return OffsetPolygon(tuple(core), radius)
