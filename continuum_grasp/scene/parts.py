"""Convex parts of objects: rounded polygons and superellipses, in plain numbers."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import TypeAlias

__all__ = ["Part", "Point", "check_convex", "counter_clockwise", "farthest", "polygon_centroid", "rounded"]

Point: TypeAlias = tuple[float, float]


@dataclass(frozen=True)
class Part:
    """A convex part of an object, in the object's frame: a rounded polygon, or a superellipse.

    Attributes
    ----------
    vertices : tuple of (float, float)
        Counter-clockwise corners of the core; one for a disc, two for a slot; none for a superellipse [m].
    radius : float
        The part is everything within this distance of the core [m].
    semi_axes : (float, float)
        Of a superellipse |x/a|^p + |y/b|^p <= 1 in its own axes [m]; (0, 0) otherwise.
    exponent : float
        p of it.
    center : (float, float)
        Centre of the superellipse [m].
    angle : float
        From the object's axes to the superellipse's [rad].
    """

    vertices: tuple[Point, ...] = ()
    radius: float = 0.0
    semi_axes: Point = (0.0, 0.0)
    exponent: float = 2.0
    center: Point = (0.0, 0.0)
    angle: float = 0.0

    @property
    def is_superellipse(self) -> bool:
        """Whether it is a superellipse rather than a rounded polygon."""
        return not self.vertices

    def placed(self, position: Point, angle: float) -> Part:
        """The part after a turn about the origin and a shift."""
        move = _mover(position, angle)
        return Part(
            tuple(move(v) for v in self.vertices),
            self.radius,
            self.semi_axes,
            self.exponent,
            move(self.center),
            self.angle + angle,
        )

    def support(self, angle: float) -> float:
        """Support function [m]: greatest extent from the origin in the direction of an angle [rad]."""
        c, s = math.cos(angle), math.sin(angle)
        if not self.is_superellipse:
            return max(c * x + s * y for x, y in self.vertices) + self.radius
        (a, b), dual = self.semi_axes, self.exponent / (self.exponent - 1.0)
        u, v = a * abs(math.cos(angle - self.angle)), b * abs(math.sin(angle - self.angle))
        return float(c * self.center[0] + s * self.center[1] + (u**dual + v**dual) ** (1.0 / dual))

    def outline(self, count: int = 240) -> list[Point]:
        """Points on the boundary, counter-clockwise [m]."""
        if self.is_superellipse:
            move, power = _mover(self.center, self.angle), 2.0 / self.exponent
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
        if self.radius == 0.0:
            return list(self.vertices)
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
            angles = [low + turn * j / steps for j in range(steps + (size > 1))]
            points += [(x + self.radius * math.cos(t), y + self.radius * math.sin(t)) for t in angles]
        return points

    def distance(self, point: Point) -> float:
        """Distance of a point of the object's frame from the boundary [m], negative inside."""
        core = self.outline() if self.is_superellipse else list(self.vertices)
        if len(core) == 1:
            return math.dist(point, core[0]) - self.radius
        edges = list(pairwise([*core, core[0]]))
        nearest = min(_segment_distance(point, a, b) for a, b in edges)
        inside = len(core) > 2 and all(_cross(a, b, point) >= 0.0 for a, b in edges)
        return (-nearest if inside else nearest) - self.radius


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
    share = ((p[0] - a[0]) * dx + (p[1] - a[1]) * dy) / max(dx * dx + dy * dy, 1e-300)
    share = min(max(share, 0.0), 1.0)
    return math.dist(p, (a[0] + share * dx, a[1] + share * dy))


def _area(vertices: tuple[Point, ...]) -> float:
    return 0.5 * sum(a[0] * b[1] - a[1] * b[0] for a, b in pairwise([*vertices, vertices[0]]))


def counter_clockwise(vertices: tuple[Point, ...]) -> tuple[Point, ...]:
    return vertices if _area(vertices) > 0.0 else vertices[::-1]


def polygon_centroid(vertices: tuple[Point, ...]) -> Point:
    x = y = 0.0
    for a, b in pairwise([*vertices, vertices[0]]):
        weight = (a[0] * b[1] - a[1] * b[0]) / 6.0
        x, y = x + weight * (a[0] + b[0]), y + weight * (a[1] + b[1])
    area = _area(vertices)
    return x / area, y / area


def check_convex(vertices: tuple[Point, ...]) -> None:
    ring = [*vertices, *vertices[:2]]
    turns = [_cross(ring[k], ring[k + 1], ring[k + 2]) for k in range(len(vertices))]
    scale = max(math.dist(a, b) for a, b in pairwise([*vertices, vertices[0]]))
    whole = sum(
        math.remainder(_edge_normal(ring[k + 1], ring[k + 2]) - _edge_normal(ring[k], ring[k + 1]), math.tau)
        for k in range(len(vertices))
    )
    flat = 1e-9 * scale**2
    same_way = all(t > flat for t in turns) or all(t < -flat for t in turns)
    if not same_way or abs(abs(whole) - math.tau) > 1e-6:
        raise ValueError(
            "vertices must be the corners of a convex polygon, in order, no three in line; take a union otherwise"
        )


def rounded(vertices: tuple[Point, ...], radius: float) -> Part:
    """The part whose sharp outline is given and whose corners are rounded off inside it."""
    if radius == 0.0:
        return Part(vertices)
    core = []
    for k, (x, y) in enumerate(vertices):
        low = _edge_normal(vertices[k - 1], (x, y))
        high = _edge_normal((x, y), vertices[(k + 1) % len(vertices)])
        half = 0.5 * ((high - low) % math.tau)
        reach, middle = radius / math.cos(half), low + half
        core.append((x - reach * math.cos(middle), y - reach * math.sin(middle)))
    return Part(tuple(core), radius)
