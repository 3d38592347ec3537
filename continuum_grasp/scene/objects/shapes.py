"""The shapes of objects and, elsewhere placed, of the members of a union: fields, checks and geometry."""

from __future__ import annotations

from functools import cached_property
from typing import Annotated, Literal

from pydantic import Field

from continuum_grasp.scene.objects.body import ObjectBody
from continuum_grasp.scene.parts import (
    OffsetPolygon,
    Part,
    Point,
    SuperellipsePart,
    check_simple,
    corners_of,
    polygon_centroid,
    rounded,
)
from continuum_grasp.scene.units import Unit
from continuum_grasp.scene.value import Distance, Extent, Position, Value


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


class _PolygonShape(Value):
    shape: Literal["polygon"]
    """A simple polygon, with rounded corners, but for reflex ones, where a radius is given."""
    vertices: Annotated[tuple[Position, ...], Field(strict=False, min_length=3, max_length=1024)]
    """Corners of the sharp outline, a simple polygon, in order, either way round [m]; a search takes longer with more
    than a hundred."""
    corner_radius: Distance = 0.0
    """Radius of the rounded corners, inside the sharp outline [m]."""

    @cached_property
    def parts(self) -> tuple[Part, ...]:
        return (rounded(corners_of(self.vertices), self.corner_radius),)

    @cached_property
    def centroid(self) -> Point:
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


class Polygon(_PolygonShape, ObjectBody):
    """A simple polygon, with rounded corners, but for reflex ones, where a radius is given."""


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
