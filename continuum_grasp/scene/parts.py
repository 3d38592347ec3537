"""Convex parts of objects in plain numbers: polygons with an offset, and superellipses."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from typing import TypeAlias

Point: TypeAlias = tuple[float, float]


class Part(ABC):
    """A convex part of an object in plain numbers, in the object's frame [m].

    The mathematics that contacts and grasps need of it lies in `continuum_grasp.model.surfaces`.
    """

    @abstractmethod
    def placed(self, position: Point, angle: float) -> Part:
        """The part after a turn about the origin and a shift."""

    @abstractmethod
    def support(self, angle: float) -> float:
        """Support function [m]: greatest extent from the origin in the direction of an angle [rad]."""

    @abstractmethod
    def outline(self, count: int = 240) -> list[Point]:
        """Points on the boundary, counter-clockwise [m]."""

    @abstractmethod
    def curvature(self, point: Point, tolerance: float) -> float:
        """Curvature of the boundary at a point of it [1/m]; infinite at a sharp corner, which is ``tolerance`` wide."""

    @property
    @abstractmethod
    def extent(self) -> float:
        """A distance from the origin that no point of the part exceeds [m]."""

    def distance(self, point: Point) -> float:
        """Distance of a point of the object's frame from the boundary [m], negative inside."""
        return _polygon_distance(point, self.outline())


@dataclass(frozen=True)
class OffsetPolygon(Part):
    """Everything within a distance of a convex polygon, of a segment (a stadium), or of a point (a disc)."""

    vertices: tuple[Point, ...]
    """Counter-clockwise corners of the core; one for a disc, two for a stadium [m]."""
    radius: float = 0.0
    """The part is everything within this distance of the core [m]."""

    def placed(self, position: Point, angle: float) -> OffsetPolygon:
        return OffsetPolygon(tuple(map(_mover(position, angle), self.vertices)), self.radius)

    def support(self, angle: float) -> float:
        c, s = math.cos(angle), math.sin(angle)
        return max(c * x + s * y for x, y in self.vertices) + self.radius

    def outline(self, count: int = 240) -> list[Point]:
        if self.radius == 0.0:
            return list(self.vertices)
        # An arc about each corner, from the normal of the edge before it to that of the edge after it.
        points = []
        size = len(self.vertices)
        for k, (x, y) in enumerate(self.vertices):
            low, turn = 0.0, math.tau
            if size > 1:
                low, high = (
                    _edge_normal(self.vertices[k - 1], (x, y)),
                    _edge_normal((x, y), self.vertices[(k + 1) % size]),
                )
                turn = (high - low) % math.tau
            steps = max(2, round(count * turn / math.tau))
            # A disc closes on itself: its last point would be its first.
            angles = [low + turn * j / steps for j in range(steps + (size > 1))]
            points += [(x + self.radius * math.cos(t), y + self.radius * math.sin(t)) for t in angles]
        return points

    def curvature(self, point: Point, tolerance: float) -> float:
        # On the rounding of a corner no edge is nearer than its ends.
        if min(math.dist(point, corner) for corner in self.vertices) > self.radius + tolerance:
            return 0.0
        return 1.0 / self.radius if self.radius > 0.0 else math.inf

    @property
    def extent(self) -> float:
        return max(math.hypot(*v) for v in self.vertices) + self.radius

    def distance(self, point: Point) -> float:
        return _polygon_distance(point, self.vertices) - self.radius


@dataclass(frozen=True)
class SuperellipsePart(Part):
    """A superellipse |x/a|^p + |y/b|^p <= 1 in axes of its own."""

    semi_axes: Point
    """a and b [m]."""
    exponent: float = 2.0
    """p; 2 is an ellipse."""
    center: Point = (0.0, 0.0)
    angle: float = 0.0
    """From the object's axes to those of the superellipse [rad]."""

    def placed(self, position: Point, angle: float) -> SuperellipsePart:
        return replace(self, center=_mover(position, angle)(self.center), angle=self.angle + angle)

    def support(self, angle: float) -> float:
        c, s = math.cos(angle), math.sin(angle)
        # Hoelder's inequality: the support function of a p-norm ball is the norm of the dual exponent p / (p - 1).
        (a, b), dual = self.semi_axes, self.exponent / (self.exponent - 1.0)
        u, v = a * abs(math.cos(angle - self.angle)), b * abs(math.sin(angle - self.angle))
        return float(c * self.center[0] + s * self.center[1] + (u**dual + v**dual) ** (1.0 / dual))

    def outline(self, count: int = 240) -> list[Point]:
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

    def curvature(self, point: Point, tolerance: float) -> float:
        c, s = math.cos(self.angle), math.sin(self.angle)
        x, y = point[0] - self.center[0], point[1] - self.center[1]
        (a, b), p = self.semi_axes, self.exponent
        u, v = abs(c * x + s * y) / a, abs(c * y - s * x) / b
        fx, fy = u ** (p - 1.0) / a, v ** (p - 1.0) / b  # a p-th of the gradient of |x/a|^p + |y/b|^p
        fxx = (p - 1.0) * u ** (p - 2.0) / a**2
        fyy = (p - 1.0) * v ** (p - 2.0) / b**2
        # Of an implicit curve f = 0, whose mixed derivative is zero here.
        return float((fxx * fy**2 + fyy * fx**2) / (fx**2 + fy**2) ** 1.5)

    @property
    def extent(self) -> float:
        return math.hypot(*self.center) + math.hypot(*self.semi_axes)


@lru_cache(maxsize=256)
def farthest(part: Part, point: Point) -> float:
    return max(math.dist(point, p) for p in part.outline())


def _mover(position: Point, angle: float) -> Callable[[Point], Point]:
    c, s = math.cos(angle), math.sin(angle)
    return lambda p: (position[0] + c * p[0] - s * p[1], position[1] + s * p[0] + c * p[1])


def _edge_normal(a: Point, b: Point) -> float:
    """Angle of the outward normal of an edge of a counter-clockwise polygon [rad]."""
    return math.atan2(a[0] - b[0], b[1] - a[1])


def _cross(a: Point, b: Point, p: Point) -> float:
    return (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])


def _segment_distance(p: Point, a: Point, b: Point) -> float:
    dx, dy = b[0] - a[0], b[1] - a[1]
    # 1e-300: a segment of no length is its start.
    share = ((p[0] - a[0]) * dx + (p[1] - a[1]) * dy) / max(dx * dx + dy * dy, 1e-300)
    share = min(max(share, 0.0), 1.0)
    return math.dist(p, (a[0] + share * dx, a[1] + share * dy))


def _polygon_distance(point: Point, vertices: Sequence[Point]) -> float:
    """Distance of a point from a convex polygon, a segment or a point [m], negative inside the polygon."""
    if len(vertices) == 1:
        return math.dist(point, vertices[0])
    edges = list(pairwise([*vertices, vertices[0]]))
    nearest = min(_segment_distance(point, a, b) for a, b in edges)
    # A segment has no inside, though every point on its line would pass.
    inside = len(vertices) > 2 and all(_cross(a, b, point) >= 0.0 for a, b in edges)
    return -nearest if inside else nearest


def polygon_moments(vertices: Sequence[Point], about: Point = (0.0, 0.0)) -> tuple[float, Point, float]:
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


def counter_clockwise(vertices: tuple[Point, ...]) -> tuple[Point, ...]:
    return vertices if polygon_moments(vertices)[0] > 0.0 else vertices[::-1]


def polygon_centroid(vertices: tuple[Point, ...]) -> Point:
    area, (x, y), _ = polygon_moments(vertices)
    return x / area, y / area


def check_convex(vertices: tuple[Point, ...]) -> None:
    ring = [*vertices, *vertices[:2]]
    turns = [_cross(ring[k], ring[k + 1], ring[k + 2]) for k in range(len(vertices))]
    scale = max(math.dist(a, b) for a, b in pairwise([*vertices, vertices[0]]))
    # A pentagram turns the same way at all corners too, but by two turns.
    whole = sum(
        math.remainder(_edge_normal(ring[k + 1], ring[k + 2]) - _edge_normal(ring[k], ring[k + 1]), math.tau)
        for k in range(len(vertices))
    )
    # Three corners in line to 1e-9 of the size have no edge normal that rounding leaves.
    flat = 1e-9 * scale**2
    same_way = all(t > flat for t in turns) or all(t < -flat for t in turns)
    if not same_way or abs(abs(whole) - math.tau) > 1e-6:
        raise ValueError(
            "vertices must be the corners of a convex polygon, in order, no three in line; take a union otherwise"
        )


def rounded(vertices: tuple[Point, ...], radius: float) -> OffsetPolygon:
    """The part whose sharp outline is given and whose corners are rounded off inside it."""
    if radius == 0.0:
        return OffsetPolygon(vertices)
    core = []
    for k, (x, y) in enumerate(vertices):
        low = _edge_normal(vertices[k - 1], (x, y))
        high = _edge_normal((x, y), vertices[(k + 1) % len(vertices)])
        # The center of an arc tangent to both edges is on the bisector, radius / cos(half) inside the corner.
        half = 0.5 * ((high - low) % math.tau)
        reach, middle = radius / math.cos(half), low + half
        core.append((x - reach * math.cos(middle), y - reach * math.sin(middle)))
    return OffsetPolygon(tuple(core), radius)
