"""What can be grasped: convex shapes and unions of them, with mass and pose."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field, model_validator

from continuum_grasp.scene.parts import (
    Part,
    Point,
    check_convex,
    counter_clockwise,
    farthest,
    polygon_centroid,
    rounded,
)
from continuum_grasp.scene.value import Extent, NonNegative, Real, Value, Vector2

__all__ = [
    "Box",
    "Circle",
    "Ellipse",
    "Freedom",
    "GraspObject",
    "Polygon",
    "RoundedPolygon",
    "Superellipse",
    "Union",
    "UnionPart",
]

Interval = Annotated[tuple[Real, Real], Field(strict=False)]


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
        return max(farthest(part, com) for part in self.parts)

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
        return (rounded(((-w, -h), (w, -h), (w, h), (-w, h)), r),)

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
        return (Part(counter_clockwise(self.vertices)),)

    @property
    def centroid(self) -> Point:
        return polygon_centroid(self.vertices)

    @model_validator(mode="after")
    def _convex(self) -> _PolygonShape:
        check_convex(self.vertices)
        return self


class _RoundedPolygonShape(Value):
    shape: Literal["rounded_polygon"]
    vertices: Annotated[tuple[Vector2, ...], Field(strict=False, min_length=3, max_length=64)]
    """Corners of the sharp convex outline in order, either way round [m]; they are rounded off inside it."""
    corner_radius: Extent
    """Radius of the rounded corners [m]."""

    @property
    def parts(self) -> tuple[Part, ...]:
        return (rounded(counter_clockwise(self.vertices), self.corner_radius),)

    @property
    def centroid(self) -> Point:
        return polygon_centroid(tuple(self.parts[0].outline(720)))

    @model_validator(mode="after")
    def _room(self) -> _RoundedPolygonShape:
        check_convex(self.vertices)
        outline = counter_clockwise(self.vertices)
        core = rounded(outline, self.corner_radius).vertices
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
