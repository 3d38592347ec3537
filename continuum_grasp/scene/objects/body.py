"""Properties of every object beside its shape: mass, center of mass, and a pose, fixed or to be chosen."""

from __future__ import annotations

import math
from typing import Annotated

from continuum_grasp.scene.parts import Part, Point, farthest
from continuum_grasp.scene.units import Unit
from continuum_grasp.scene.value import Angle, Interval, Mass, Position, Value

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


def pose_bounds(pose: Pose, free: Freedom | None) -> list[tuple[float, float]]:
    """Bounds of x, y [m] and angle [rad] of a pose; both are its own value where it is fixed."""
    bounds = (None,) * 3 if free is None else (free.x, free.y, free.angle)
    return [bound or (coordinate, coordinate) for bound, coordinate in zip(bounds, pose, strict=True)]


def greatest_shift(free: Freedom | None, at: tuple[float, float]) -> float:
    """Greatest distance that a position may move within bounds [m]."""
    if free is None:
        return 0.0
    spans = [max(b[1] - v, v - b[0]) if b else 0.0 for b, v in zip((free.x, free.y), at, strict=True)]
    return math.hypot(*spans)


class ObjectBody(Value):
    """Properties of every object beside its shape, in whose frame they are given."""

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

    @property
    def parts(self) -> tuple[Part, ...]:
        """Parts in the object's frame."""
        raise NotImplementedError

    @property
    def pieces(self) -> tuple[Part, ...]:
        """Convex pieces of all parts."""
        return tuple(piece for part in self.parts for piece in part.pieces)

    @property
    def centroid(self) -> Point:
        """Centroid of the shape in the object's frame [m]."""
        return 0.0, 0.0

    @property
    def com(self) -> Point:
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

    def distance(self, point: Point) -> float:
        """Distance of a world point from the object where it starts [m], negative inside."""
        c, s = math.cos(self.angle), math.sin(self.angle)
        x, y = point[0] - self.position[0], point[1] - self.position[1]
        return min(part.distance((c * x + s * y, c * y - s * x)) for part in self.parts)

    def _check(self) -> None:
        if self.free is not None:
            self.free.check(*self.pose)


class MemberPlace(Value):
    """Pose of a part of a union."""

    position: Position = (0.0, 0.0)
    """Position of the origin of the part's frame, in the object's [m]."""
    angle: Angle = 0.0
    """Angle from the object's axes to the part's [rad]."""
