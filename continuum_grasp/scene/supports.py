"""Supports of an object: fixed walls, points, edges and grooves."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from continuum_grasp.scene.parts import OffsetPolygon
from continuum_grasp.scene.units import Unit
from continuum_grasp.scene.value import WRITTEN, Angle, Distance, Friction, Position, Value

TOUCHING = WRITTEN
"""Greatest gap between a support and an object at rest that lies against it, per size of the object [1]."""
# Names become parts of contact names, as in left.middle_1, and of columns in tables.
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,30}")
_Choice = Literal["on", "off", "auto"]


def _word(value: Any) -> Any:
    """Take true and false for the words on and off, which YAML 1.1 reads and writes as booleans."""
    return {True: "on", False: "off"}[value] if isinstance(value, bool) else value


Switch = Annotated[_Choice, BeforeValidator(_word, json_schema_input_type=_Choice | bool)]


@dataclass(frozen=True)
class Wall:
    """A straight, fixed surface."""

    name: str
    point: tuple[float, float]
    """A world point on it [m]."""
    normal_angle: float
    """World angle of its normal, out of the material [rad]."""
    half_length: float
    """Half length: the wall reaches this far from ``point`` to both sides [m]; infinite for a half plane."""
    friction: float | None
    touch: Switch

    @property
    def normal(self) -> tuple[float, float]:
        """Unit normal, out of the material."""
        return math.cos(self.normal_angle), math.sin(self.normal_angle)

    @property
    def ends(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Ends of a finite surface, the material on the right from the first to the second [m]."""
        (nx, ny), (x, y), half = self.normal, self.point, self.half_length
        return (x + ny * half, y - nx * half), (x - ny * half, y + nx * half)

    @property
    def part(self) -> OffsetPolygon | None:
        """The surface as a convex part of the world; None of a half plane."""
        return OffsetPolygon(self.ends) if math.isfinite(self.half_length) else None

    def height(self, point: tuple[float, float]) -> float:
        """Distance of a world point from the surface [m], positive outside the material."""
        nx, ny = self.normal
        return nx * (point[0] - self.point[0]) + ny * (point[1] - self.point[1])


@dataclass(frozen=True)
class Peg:
    """A fixed, round support."""

    name: str
    position: tuple[float, float]
    """World position of its center [m]."""
    radius: float
    """Radius of the peg [m]; zero for a point."""
    friction: float | None
    touch: Switch

    @property
    def part(self) -> OffsetPolygon:
        """The peg as a convex part of the world."""
        return OffsetPolygon((self.position,), self.radius)


class _Support(Value):
    friction: Friction | None = None
    """Friction coefficient between it and the object [1]; None: ``contacts.friction``."""
    touch: Switch = "auto"
    """Whether the object touches the support. auto: if it lies against the support; with a free pose, whichever is
    better."""

    def walls(self, name: str) -> tuple[Wall, ...]:
        """Straight surfaces of the support."""
        return ()

    def pegs(self, name: str) -> tuple[Peg, ...]:
        """Round surfaces of the support."""
        return ()


class Palm(_Support):
    """A fixed half plane."""

    type: Literal["palm"] = "palm"
    point: Position
    """A world point on its surface [m]."""
    normal_angle: Angle
    """World angle of the surface normal, which points away from the material [rad]; 0 is +x."""

    def walls(self, name: str) -> tuple[Wall, ...]:
        return (Wall(name, self.point, self.normal_angle, math.inf, self.friction, self.touch),)


class Line(_Support):
    """A fixed straight edge of finite length; the object may lie on its left, walking from start to end."""

    type: Literal["line"]
    start: Position
    """World position of its start [m]."""
    end: Position
    """World position of its end [m]."""

    def walls(self, name: str) -> tuple[Wall, ...]:
        (x0, y0), (x1, y1) = self.start, self.end
        # The direction turned to its left, where the object may lie.
        angle = math.atan2(x1 - x0, y0 - y1)
        half = 0.5 * math.dist(self.start, self.end)
        return (Wall(name, (0.5 * (x0 + x1), 0.5 * (y0 + y1)), angle, half, self.friction, self.touch),)

    def _check(self) -> None:
        # A nanometer: shorter edges have a direction of rounding errors.
        if math.dist(self.start, self.end) < 1e-9:
            raise ValueError("start and end are the same point")


class Point(_Support):
    """A fixed point or round peg."""

    type: Literal["point"]
    position: Position
    """World position of its center [m]."""
    radius: Distance = 0.0
    """Radius [m]."""

    def pegs(self, name: str) -> tuple[Peg, ...]:
        return (Peg(name, self.position, self.radius, self.friction, self.touch),)


class VGroove(_Support):
    """Two fixed half planes that meet in a line."""

    type: Literal["v_groove"]
    apex: Position
    """World position of the line between both sides [m]."""
    opening_angle: Annotated[float, Field(ge=1e-3, le=3.14), Unit("rad")]
    """Angle between the two walls [rad]."""
    axis_angle: Angle
    """World angle of the opening direction [rad]."""

    def walls(self, name: str) -> tuple[Wall, ...]:
        """The walls on the left and on the right of the axis, seen from the apex."""
        # Each wall's normal is a right angle from the wall, into the opening.
        half = 0.5 * self.opening_angle
        left, right = self.axis_angle + half - 0.5 * math.pi, self.axis_angle - half + 0.5 * math.pi
        sides = ((f"{name}.left", left), (f"{name}.right", right))
        return tuple(Wall(n, self.apex, a, math.inf, self.friction, self.touch) for n, a in sides)


Place = Wall | Peg
"""A support's surface."""

Support = Annotated[Palm | Line | Point | VGroove, Field(discriminator="type")]
"""A support of the object."""


def check_name(name: str) -> None:
    """Refuse, by `ValueError`, what cannot be the name of a finger or a support."""
    if not _NAME.fullmatch(name):
        raise ValueError(f"{name!r:.40} is not a valid name: use letters, digits and _, beginning with a letter")
