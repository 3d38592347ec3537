"""What can be grasped: convex shapes and unions of them, with mass and pose."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Annotated, Literal, TypeAlias

from pydantic import Field, model_validator

from continuum_grasp.scene.value import Extent, NonNegative, Real, Value, Vector2

__all__ = [
    "Box",
    "Circle",
    "Ellipse",
    "Freedom",
    "GraspObject",
    "Part",
    "Polygon",
    "RoundedPolygon",
    "Superellipse",
    "Union",
    "UnionPart",
]

Point: TypeAlias = tuple[float, float]
Interval = Annotated[tuple[Real, Real], Field(strict=False)]


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


class Freedom(Value):
    """What of a pose may be chosen: bounds, in the world; the pose's own values are where the search starts."""

    x: Interval | None = None
    """[m]"""
    y: Interval | None = None
    """[m]"""
    angle: Interval | None = None
    """[rad]"""

    @model_validator(mode="after")
    def _ordered(self) -> Freedom:
        for name, bounds in (("x", self.x), ("y", self.y), ("angle", self.angle)):
            if bounds is not None and bounds[0] >= bounds[1]:
                raise ValueError(f"{name} must increase, got {list(bounds)}")
        return self

    def check(self, x: float, y: float, angle: float) -> None:
        """Whether a pose lies within the bounds.

        Raises
        ------
        ValueError
            If it does not.
        """
        for name, bounds, value in (("x", self.x, x), ("y", self.y, y), ("angle", self.angle, angle)):
            if bounds is not None and not bounds[0] <= value <= bounds[1]:
                raise ValueError(f"free.{name} = {list(bounds)} does not hold the given {value}")


class _Thing(Value):
    """What every object has; the frame of the object is that of its shape."""

    mass: NonNegative
    """Mass [kg]."""
    center_of_mass: Vector2 | None = None
    """Centre of mass in the object's frame [m]; None: the centroid of the shape."""
    position: Vector2
    """World position of the origin of the object's frame [m]."""
    angle: Real = 0.0
    """Angle from the world's axes to the object's [rad]."""
    free: Freedom | None = None
    """Bounds within which the pose may be chosen; None: it is fixed."""

    @property
    def parts(self) -> tuple[Part, ...]:
        """Convex parts in the object's frame."""
        raise NotImplementedError

    @property
    def centroid(self) -> Point:
        """Centroid of the shape in the object's frame [m]."""
        return 0.0, 0.0

    @property
    def com(self) -> Point:
        """Centre of mass in the object's frame [m]."""
        return self.centroid if self.center_of_mass is None else self.center_of_mass

    @property
    def size(self) -> float:
        """Greatest distance of the boundary from the centre of mass [m]."""
        com = self.com
        return max(_farthest(part, com) for part in self.parts)

    @property
    def pose(self) -> tuple[float, float, float]:
        """World x, y [m] and angle [rad]."""
        return *self.position, self.angle

    def distance(self, point: Point) -> float:
        """Distance of a world point from the object where it starts [m], negative inside."""
        c, s = math.cos(self.angle), math.sin(self.angle)
        x, y = point[0] - self.position[0], point[1] - self.position[1]
        return min(part.distance((c * x + s * y, c * y - s * x)) for part in self.parts)

    @model_validator(mode="after")
    def _pose_within_bounds(self) -> _Thing:
        if self.free is not None:
            self.free.check(*self.pose)
        return self


class _CircleShape(Value):
    shape: Literal["circle"]
    diameter: Extent
    """Outer diameter [m]; the frame's origin is the centre."""

    @property
    def parts(self) -> tuple[Part, ...]:
        return (Part(((0.0, 0.0),), 0.5 * self.diameter),)


class _EllipseShape(Value):
    shape: Literal["ellipse"]
    width: Extent
    """Extent along the object's x axis [m]; the frame's origin is the centre."""
    height: Extent
    """Extent along the object's y axis [m]."""

    @property
    def parts(self) -> tuple[Part, ...]:
        return (Part(semi_axes=(0.5 * self.width, 0.5 * self.height)),)


class _SuperellipseShape(Value):
    shape: Literal["superellipse"]
    width: Extent
    """Extent along the object's x axis [m]; the frame's origin is the centre."""
    height: Extent
    """Extent along the object's y axis [m]."""
    exponent: Annotated[float, Field(ge=2.0, le=12.0)]
    """p in |x/a|^p + |y/b|^p = 1 [1]; 2 is an ellipse, above it flattens towards a box."""

    @property
    def parts(self) -> tuple[Part, ...]:
        return (Part(semi_axes=(0.5 * self.width, 0.5 * self.height), exponent=self.exponent),)


class _BoxShape(Value):
    shape: Literal["box"]
    width: Extent
    """Extent along the object's x axis [m]; the frame's origin is the centre."""
    height: Extent
    """Extent along the object's y axis [m]."""
    corner_radius: NonNegative = 0.0
    """Radius of the rounded corners [m]."""

    @property
    def parts(self) -> tuple[Part, ...]:
        w, h, r = 0.5 * self.width, 0.5 * self.height, self.corner_radius
        return (_rounded(((-w, -h), (w, -h), (w, h), (-w, h)), r),)

    @model_validator(mode="after")
    def _room(self) -> _BoxShape:
        if 2 * self.corner_radius >= min(self.width, self.height):
            raise ValueError(
                f"corner_radius = {self.corner_radius} m leaves no flat face; expected less than half a side"
            )
        return self


class _PolygonShape(Value):
    shape: Literal["polygon"]
    vertices: Annotated[tuple[Vector2, ...], Field(strict=False, min_length=3, max_length=64)]
    """Corners of a convex polygon in order, either way round [m]."""

    @property
    def parts(self) -> tuple[Part, ...]:
        return (Part(_counter_clockwise(self.vertices)),)

    @property
    def centroid(self) -> Point:
        return _polygon_centroid(self.vertices)

    @model_validator(mode="after")
    def _convex(self) -> _PolygonShape:
        _check_convex(self.vertices)
        return self


class _RoundedPolygonShape(Value):
    shape: Literal["rounded_polygon"]
    vertices: Annotated[tuple[Vector2, ...], Field(strict=False, min_length=3, max_length=64)]
    """Corners of the sharp convex outline in order, either way round [m]; they are rounded off inside it."""
    corner_radius: Extent
    """Radius of the rounded corners [m]."""

    @property
    def parts(self) -> tuple[Part, ...]:
        return (_rounded(_counter_clockwise(self.vertices), self.corner_radius),)

    @property
    def centroid(self) -> Point:
        return _polygon_centroid(tuple(self.parts[0].outline(720)))

    @model_validator(mode="after")
    def _room(self) -> _RoundedPolygonShape:
        _check_convex(self.vertices)
        outline = _counter_clockwise(self.vertices)
        core = _rounded(outline, self.corner_radius).vertices
        edges = zip(outline, core, [*outline[1:], outline[0]], [*core[1:], core[0]], strict=True)
        if any((b[0] - a[0]) * (d[0] - c[0]) + (b[1] - a[1]) * (d[1] - c[1]) <= 0.0 for a, c, b, d in edges):
            raise ValueError(
                f"corner_radius = {self.corner_radius} m is too large: an edge would have no flat part left"
            )
        return self


class _Placed(Value):
    """Where a part of a union sits."""

    position: Vector2 = (0.0, 0.0)
    """Of the origin of the part's frame, in the object's [m]."""
    angle: Real = 0.0
    """Angle from the object's axes to the part's [rad]."""


class Circle(_CircleShape, _Thing):
    """A disc in the plane of the fingers, for example a mug seen along its axis."""

    @property
    def radius(self) -> float:
        """Half the diameter [m]."""
        return 0.5 * self.diameter


class Ellipse(_EllipseShape, _Thing):
    """An ellipse."""


class Superellipse(_SuperellipseShape, _Thing):
    """A superellipse, between an ellipse and a box."""


class Box(_BoxShape, _Thing):
    """A rectangle, with rounded corners where a radius is given."""


class Polygon(_PolygonShape, _Thing):
    """A convex polygon with sharp corners."""


class RoundedPolygon(_RoundedPolygonShape, _Thing):
    """A convex polygon whose corners are rounded off."""


class _CirclePart(_CircleShape, _Placed):
    pass


class _EllipsePart(_EllipseShape, _Placed):
    pass


class _SuperellipsePart(_SuperellipseShape, _Placed):
    pass


class _BoxPart(_BoxShape, _Placed):
    pass


class _PolygonPart(_PolygonShape, _Placed):
    pass


class _RoundedPolygonPart(_RoundedPolygonShape, _Placed):
    pass


UnionPart = Annotated[
    _CirclePart | _EllipsePart | _SuperellipsePart | _BoxPart | _PolygonPart | _RoundedPolygonPart,
    Field(discriminator="shape"),
]


class Union(_Thing):
    """Convex parts stuck together, for example a mug with its handle."""

    shape: Literal["union"]
    members: Annotated[tuple[UnionPart, ...], Field(strict=False, min_length=2, max_length=12)]
    """The parts; they may overlap."""

    @property
    def parts(self) -> tuple[Part, ...]:
        return tuple(part.placed(m.position, m.angle) for m in self.members for part in m.parts)

    @model_validator(mode="after")
    def _weighed(self) -> Union:
        if self.center_of_mass is None:
            raise ValueError("center_of_mass is needed: the parts of a union may overlap and differ in density")
        return self


GraspObject = Annotated[
    Circle | Ellipse | Superellipse | Box | Polygon | RoundedPolygon | Union, Field(discriminator="shape")
]
"""What can be grasped."""


@lru_cache(maxsize=256)
def _farthest(part: Part, point: Point) -> float:
    return max(math.dist(point, p) for p in part.outline())


def _mover(position: Point, angle: float):  # type: ignore[no-untyped-def]
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


def _counter_clockwise(vertices: tuple[Point, ...]) -> tuple[Point, ...]:
    return vertices if _area(vertices) > 0.0 else vertices[::-1]


def _polygon_centroid(vertices: tuple[Point, ...]) -> Point:
    x = y = 0.0
    for a, b in pairwise([*vertices, vertices[0]]):
        weight = (a[0] * b[1] - a[1] * b[0]) / 6.0
        x, y = x + weight * (a[0] + b[0]), y + weight * (a[1] + b[1])
    area = _area(vertices)
    return x / area, y / area


def _check_convex(vertices: tuple[Point, ...]) -> None:
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


def _rounded(vertices: tuple[Point, ...], radius: float) -> Part:
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
