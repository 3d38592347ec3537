"""The shapes of objects and of the members of a union: what all have, fields, checks and geometry of each."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cached_property
from typing import Annotated, Any, Literal, Self

from pydantic import Field

from continuum_grasp.scene.curved_parts import curved
from continuum_grasp.scene.parts import OffsetPolygon, Part, SuperellipsePart, farthest, rounded
from continuum_grasp.scene.polygons import PlanePoint, check_simple, corners_of, polygon_centroid
from continuum_grasp.scene.units import Unit
from continuum_grasp.scene.value import Angle, Distance, Extent, Interval, ListOf, Mass, Position, Value

Pose = tuple[float, float, float]


class Freedom(Value):
    """Bounds of a pose that may be chosen, in the world; the pose's own values are where the search starts."""

    x: Annotated[Interval, Unit("m")] | None = None
    """Least and greatest x [m]; None: fixed."""
    y: Annotated[Interval, Unit("m")] | None = None
    """Least and greatest y [m]; None: fixed."""
    angle: Annotated[Interval, Unit("rad")] | None = None
    """Least and greatest angle [rad]; None: fixed."""

    def check(self, x: float, y: float, angle: float) -> None:
        """Refuse a pose beyond the bounds, by `ValueError`."""
        for name, bounds, value in (("x", self.x, x), ("y", self.y, y), ("angle", self.angle, angle)):
            if bounds is not None and not bounds[0] <= value <= bounds[1]:
                raise ValueError(f"free.{name} = {list(bounds)} does not hold the given {value}")

    def bounds(self, pose: Pose) -> list[tuple[float, float]]:
        """Return the bounds of x, y [m] and angle [rad] of a pose; the two bounds of a fixed coordinate are equal."""
        bounds = (self.x, self.y, self.angle)
        return [bound or (coordinate, coordinate) for bound, coordinate in zip(bounds, pose, strict=True)]

    def greatest_shift(self, pose: Pose) -> float:
        """Greatest distance that the position of a pose may move [m]."""
        spans = [max(b[1] - v, v - b[0]) for b, v in zip(self.bounds(pose)[:2], pose[:2], strict=True)]
        return math.hypot(*spans)


class MaybeDrawn(Value):
    """A shape, of an object or of a member of a union, that may stand for a drawing."""

    @property
    def deviation(self) -> float:
        """Greatest distance of its polygons from the drawings that they stand for [m]."""
        return 0.0

    @property
    def outline_error(self) -> float:
        """Distance of the outline from the true one that the noise of its measured points explains [m]."""
        return 0.0

    def redrawn(self) -> Self:
        """Return a copy with polygons nearer to the drawings, and larger by their `outline_error`."""
        return self


class ObjectBody(MaybeDrawn):
    """Properties that every object has in addition to its shape, in the frame of the shape."""

    mass: Mass
    """Mass [kg]."""
    center_of_mass: Position | None = None
    """Center of mass in the object's frame [m]; None: the centroid of the shape."""
    position: Position
    """World position of the origin of the object's frame [m]."""
    angle: Angle = 0.0
    """Angle from the world's axes to the object's [rad]."""
    free: Freedom | None = None
    """Bounds within which the pose may be chosen; None: it is fixed."""
    against: Annotated[str | ListOf[str] | None, Field(examples=["palm"])] = None
    """Support that the object lies against, or two of them, by name: the object moves from ``position`` along their
    normals until it touches, and does not turn. One support leaves the coordinate along it as ``position`` has it; two,
    and a groove alone, fix both. With ``free`` the search starts there. None: ``position`` is exact."""

    @property
    def parts(self) -> tuple[Part, ...]:
        """Parts in the object's frame."""
        raise NotImplementedError

    @property
    def pieces(self) -> tuple[Part, ...]:
        """Convex pieces of all parts."""
        return tuple(piece for part in self.parts for piece in part.pieces)

    @property
    def centroid(self) -> PlanePoint:
        """Centroid of the shape in the object's frame [m]."""
        return 0.0, 0.0

    @property
    def com(self) -> PlanePoint:
        """Center of mass in the object's frame [m]."""
        return self.centroid if self.center_of_mass is None else self.center_of_mass

    @property
    def size(self) -> float:
        """Greatest distance of the boundary from the center of mass [m]."""
        com = self.com
        return max(farthest(part, com) for part in self.parts)

    @property
    def pose(self) -> tuple[float, float, float]:
        """World x, y [m] and angle [rad]."""
        return *self.position, self.angle

    @property
    def pose_bounds(self) -> list[tuple[float, float]]:
        """Least and greatest x, y [m] and angle [rad]; the two are equal for a fixed coordinate."""
        return (self.free or Freedom()).bounds(self.pose)

    @property
    def greatest_shift(self) -> float:
        """Greatest distance that its position may move [m]."""
        return (self.free or Freedom()).greatest_shift(self.pose)

    def moved_to(self, pose: Pose, **fields: Any) -> Self:
        """A copy that stands at a pose, whatever it lay ``against``, with other values of some ``fields``."""
        return self.replaced(position=(pose[0], pose[1]), angle=pose[2], against=None, **fields)

    def standing(self, pose: Pose, free: Mapping[str, tuple[float, float]] | None, **fields: Any) -> Self:
        """Return a copy at a pose, without another check; the pose may be chosen within bounds, if any."""
        bounds = None if free is None else Freedom.model_validate(free)
        place = {"position": (pose[0], pose[1]), "angle": pose[2], "free": bounds, "against": None}
        return self.model_copy(update=place | fields)

    def distance(self, point: PlanePoint) -> float:
        """Return the distance of a world point from the object at its start pose [m], negative inside."""
        c, s = math.cos(self.angle), math.sin(self.angle)
        x, y = point[0] - self.position[0], point[1] - self.position[1]
        return min(part.distance((c * x + s * y, c * y - s * x)) for part in self.parts)

    def _check(self) -> None:
        if self.free is not None:
            self.free.check(*self.pose)


class MemberPlace(MaybeDrawn):
    """Pose of a part of a union."""

    position: Position = (0.0, 0.0)
    """Position of the origin of the part's frame, in the object's [m]."""
    angle: Angle = 0.0
    """Angle from the object's axes to the part's [rad]."""


class _CircleShape(Value):
    shape: Literal["circle"]
    """A disc."""
    diameter: Annotated[Extent, Field(examples=[0.08, "80 mm"])]
    """Outer diameter [m]; the frame's origin is the center."""

    @property
    def parts(self) -> tuple[Part, ...]:
        return (OffsetPolygon(((0.0, 0.0),), 0.5 * self.diameter),)


class Circle(_CircleShape, ObjectBody):
    """A disc in the plane of the fingers, for example a mug seen along its axis."""

    @property
    def radius(self) -> float:
        """Half the diameter [m]."""
        return 0.5 * self.diameter


class _Rectangle(Value):
    shape: str
    width: Annotated[Extent, Field(examples=[0.05, "50 mm"])]
    """Extent along the object's x axis [m]; the frame's origin is the center."""
    height: Annotated[Extent, Field(examples=[0.09, "90 mm"])]
    """Extent along the object's y axis [m]."""


class _EllipseShape(_Rectangle):
    shape: Literal["ellipse"]
    """An ellipse."""

    @property
    def parts(self) -> tuple[Part, ...]:
        return (SuperellipsePart((0.5 * self.width, 0.5 * self.height)),)


class Ellipse(_EllipseShape, ObjectBody):
    """An ellipse."""


class _SuperellipseShape(_Rectangle):
    shape: Literal["superellipse"]
    """Between an ellipse and a box."""
    exponent: Annotated[float, Field(ge=2.0, le=12.0, examples=[3.0]), Unit("1")]
    """p in |x/a|^p + |y/b|^p = 1 [1]; 2 is an ellipse, above it flattens towards a box."""

    @property
    def parts(self) -> tuple[Part, ...]:
        return (SuperellipsePart((0.5 * self.width, 0.5 * self.height), self.exponent),)


class Superellipse(_SuperellipseShape, ObjectBody):
    """A superellipse, between an ellipse and a box."""


class _BoxShape(_Rectangle):
    shape: Literal["box"]
    """A rectangle, with rounded corners where a radius is given."""
    corner_radius: Distance = 0.0
    """Radius of the rounded corners [m]."""

    @property
    def parts(self) -> tuple[Part, ...]:
        w, h, r = 0.5 * self.width, 0.5 * self.height, self.corner_radius
        return (rounded(((-w, -h), (w, -h), (w, h), (-w, h)), r),)

    def _check(self) -> None:
        if 2 * self.corner_radius >= min(self.width, self.height):
            raise ValueError(
                f"corner_radius = {self.corner_radius} m leaves no flat face; expected less than half a side"
            )


class Box(_BoxShape, ObjectBody):
    """A rectangle, with rounded corners where a radius is given."""


class OutlineCurve(Value):
    """Curve that a polygon stands for, with the distance between both; files of outlines give it."""

    deviation: Distance
    """Greatest distance of the polygon from the curve [m]."""
    error: Distance = 0.0
    """Greatest distance of the curve from the true one that the noise of its measured points explains [m]."""
    vertices: Annotated[ListOf[Position], Field(min_length=3, max_length=1024)]
    """Corners of a polygon nearer to the curve, and larger by its error on all sides; reports measure the effect of
    both [m].
    """

    @property
    def off(self) -> float:
        """Greatest distance of the polygon from the true curve [m]."""
        return self.deviation + self.error


class _PolygonShape(MaybeDrawn):
    shape: Literal["polygon"]
    """A simple polygon; with a radius, all corners but the reflex ones are rounded."""
    vertices: Annotated[ListOf[Position], Field(min_length=3, max_length=1024)]
    """Corners of the sharp outline, a simple polygon, in order, either way round [m]; a search takes longer with more
    than a hundred."""
    corner_radius: Distance = 0.0
    """Radius of the rounded corners, inside the sharp outline [m]."""
    drawn: OutlineCurve | None = None
    """Curve of a drawing that the polygon stands for; None: the polygon is exact."""

    @cached_property
    def parts(self) -> tuple[Part, ...]:
        return (curved(rounded(corners_of(self.vertices), self.corner_radius)),)

    @cached_property
    def centroid(self) -> PlanePoint:
        return polygon_centroid(tuple(self.parts[0].outline(720)))

    def _check(self) -> None:
        check_simple(self.vertices)
        outline = corners_of(self.vertices)
        core = rounded(outline, self.corner_radius).vertices
        edges = zip(outline, core, [*outline[1:], outline[0]], [*core[1:], core[0]], strict=True)
        if any((b[0] - a[0]) * (d[0] - c[0]) + (b[1] - a[1]) * (d[1] - c[1]) <= 0.0 for a, c, b, d in edges):
            raise ValueError(
                f"corner_radius = {self.corner_radius} m is too large: an edge would have no flat part left"
            )
        check_simple(core, f"corner_radius = {self.corner_radius} m is too large: the middles of its arcs")

    @property
    def deviation(self) -> float:
        return 0.0 if self.drawn is None else self.drawn.off

    @property
    def outline_error(self) -> float:
        return 0.0 if self.drawn is None else self.drawn.error

    def redrawn(self) -> Self:
        return self if self.drawn is None else self.replaced(vertices=self.drawn.vertices, drawn=None)


class Polygon(_PolygonShape, ObjectBody):
    """A simple polygon; with a radius, all corners but the reflex ones are rounded."""


class _StadiumShape(Value):
    shape: Literal["stadium"]
    """Two half discs with a rectangle between them."""
    length: Extent
    """Length of the straight sides, along the object's x axis [m]; the frame's origin is the center."""
    radius: Extent
    """Radius of the round ends [m]; the whole is ``length + 2 radius`` long and ``2 radius`` wide."""

    @property
    def parts(self) -> tuple[Part, ...]:
        half = 0.5 * self.length
        return (OffsetPolygon(((-half, 0.0), (half, 0.0)), self.radius),)


class Stadium(_StadiumShape, ObjectBody):
    """Two half discs with a rectangle between them: everything within a radius of a segment."""
