"""Objects that lie against supports: the gaps between them, and the position of contact."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from pydantic import Field

from continuum_grasp.base import nearest
from continuum_grasp.scene.magnitudes import DENSITY, too_heavy
from continuum_grasp.scene.objects.shapes import ObjectBody
from continuum_grasp.scene.parts import OffsetPolygon
from continuum_grasp.scene.supports import Peg, Place, Support, Wall, check_name
from continuum_grasp.scene.value import PARALLEL, Value

if TYPE_CHECKING:
    from continuum_grasp.scene.objects import GraspObject

_TOUCHES = 1e-10
"""Greatest gap of an object that touches, per size of the object [1]: the rounding of positions a million sizes
away."""
_BY_CORNERS = 5e-5
"""Greatest gap of an object that touches with corners of a curve, per size of the object [1]: arcs pass as near."""
_STEP = 1e-6
"""Shift of the difference quotient for the slope of a gap, per size of the object [1]."""
_STEPS = 50
"""Steps of Newton's method; gaps to walls take one, to a peg as many as the nearest place on the object changes."""


class Supported(Value):
    """A scene whose object may touch supports."""

    FILES = "continuum_grasp.scene.objects.outline_files:put_in_object"

    supports: dict[str, Support] = Field(default_factory=dict, max_length=8)
    """Fixed walls, edges, points and grooves by name, which the object may touch."""

    def _check(self) -> None:
        for name in self.supports:
            check_name(name)
        body = getattr(self, "object", None)
        if body is None:
            return
        # The height out of the plane is unknown, so the reference is a solid cube around the outline.
        if body.mass > (greatest := DENSITY.most * (2.0 * body.size) ** 3):
            self._doubt("object.mass", f"= {body.mass:g} kg: {too_heavy(greatest)}")
        on = () if body.against is not None else _by_corners(body, self.walls)
        if body.against is not None:
            self.__dict__["object"] = lie_against(body, self.places)
        elif 0 < len(on) <= 2:
            # The positions refer to corners; the curves between corners reach a little farther.
            self.__dict__["object"] = lie_against(body.replaced(against=on), self.places).replaced(against=None)

    def laid_against(self, body: GraspObject, names: Collection[str]) -> GraspObject:
        """A copy of an object, moved along the normals of the supports of some names until it touches all of them."""
        return lie_against(body.replaced(against=tuple(sorted(names))), self.places)

    @property
    def places(self) -> tuple[Place, ...]:
        """All walls and pegs."""
        return (*self.walls, *self.pegs)

    @property
    def walls(self) -> tuple[Wall, ...]:
        """All straight supports."""
        return tuple(wall for name, support in self.supports.items() for wall in support.walls(name))

    @property
    def pegs(self) -> tuple[Peg, ...]:
        """All round supports."""
        return tuple(peg for name, support in self.supports.items() for peg in support.pegs(name))


def lie_against(body: GraspObject, places: Sequence[Place]) -> GraspObject:
    """Move an object along the normals of the supports that it lies ``against``, until it touches all of them.

    Raises
    ------
    ValueError
        There are no such supports, or it cannot touch them.
    """
    surfaces = _chosen(body, places)
    x, y = body.position
    for _ in range(_STEPS):
        gaps = [gap(body, surface, (x, y)) for surface in surfaces]
        if max(map(abs, gaps)) <= _TOUCHES * body.size:
            break
        dx, dy = _shift(gaps, [_slope(body, surface, (x, y)) for surface in surfaces])
        x, y = x + dx, y + dy
    else:
        raise ValueError(f"object.against: no place near object.position touches {_names(surfaces)}: give another one")
    placed = body.model_copy(update={"position": (x, y)})
    for wall in surfaces:
        if is_beside(placed, wall):
            raise ValueError(f"object.against: at object.position the object passes beside the ends of {wall.name}")
    if placed.free is not None:
        placed.free.check(*placed.pose)
    return placed


def gap(body: ObjectBody, place: Place, position: tuple[float, float] | None = None) -> float:
    """Return the distance of an object, moved to a position, from a support [m]; negative inside the support."""
    x, y = body.position if position is None else position
    if isinstance(place, Wall):
        facing = place.normal_angle + math.pi - body.angle
        return place.height((x, y)) - max(part.support(facing) for part in body.parts)
    back = x - body.position[0], y - body.position[1]
    return body.distance((place.position[0] - back[0], place.position[1] - back[1])) - place.radius


def _by_corners(body: ObjectBody, walls: Sequence[Wall]) -> tuple[str, ...]:
    """Return the names of the walls that an object touches, up to rounding, with corners of curves.

    Walls from which the object's pose is free to move do not count.
    """
    if not any(isinstance(part, OffsetPolygon) and part.bends for part in body.parts):
        return ()
    straight = [replace(part, bends=()) if isinstance(part, OffsetPolygon) else part for part in body.parts]
    names, (x, y, _) = [], body.pose_bounds
    for wall in walls:
        if any(n and high > low for n, (low, high) in zip(wall.normal, (x, y), strict=True)):
            continue
        facing = wall.normal_angle + math.pi - body.angle
        off = wall.height(body.position) - max(part.support(facing) for part in straight)
        if abs(off) <= _BY_CORNERS * body.size:
            names.append(wall.name)
    return tuple(names)


def is_beside(body: ObjectBody, place: Place) -> bool:
    """Whether what of an object is nearest to a finite wall is beyond its ends."""
    if isinstance(place, Peg) or math.isinf(place.half_length):
        return False
    facing, step = place.normal_angle + math.pi - body.angle, 1e-7
    reach = max(part.support(facing) for part in body.parts)
    # The slope of a support function is how far to the side the outermost point is: a face has two of them.
    sides = [(max(part.support(facing + turn) for part in body.parts) - reach) / turn for turn in (step, -step)]
    (nx, ny), (px, py) = place.normal, place.point
    at = (body.position[1] - py) * nx - (body.position[0] - px) * ny
    low, high = at - max(sides), at - min(sides)
    slack = 1e-6 * body.size
    return high < -place.half_length - slack or low > place.half_length + slack


def _chosen(body: GraspObject, places: Sequence[Place]) -> list[Place]:
    names = (body.against,) if isinstance(body.against, str) else body.against or ()
    surfaces: list[Place] = []
    for name in names:
        found = [place for place in places if place.name == name or place.name.startswith(f"{name}.")]
        if not found:
            known = list(dict.fromkeys(place.name.partition(".")[0] for place in places))
            raise ValueError(f"object.against: no support {name!r}{nearest(name, known)}")
        surfaces += [place for place in found if place not in surfaces]
    if len(surfaces) > 2:
        raise ValueError(
            f"object.against: {_names(surfaces)} are more than the two surfaces that fix a position: name two of them"
        )
    return surfaces


def _names(surfaces: Sequence[Place]) -> str:
    return " and ".join(surface.name for surface in surfaces)


def _slope(body: ObjectBody, place: Place, at: tuple[float, float]) -> tuple[float, float]:
    """Derivative of a gap by the object's position."""
    if isinstance(place, Wall):
        return place.normal
    h, (x, y) = _STEP * body.size, at
    across, up = (
        gap(body, place, (x + dx, y + dy)) - gap(body, place, (x - dx, y - dy)) for dx, dy in ((h, 0.0), (0.0, h))
    )
    return across / (2.0 * h), up / (2.0 * h)


def _shift(gaps: Sequence[float], slopes: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """The shortest shift that closes one or two gaps, to first order."""
    (a, b), *other = slopes
    if not other:
        size = a * a + b * b
        return -gaps[0] * a / size, -gaps[0] * b / size
    ((c, d),) = other
    area = a * d - b * c
    if abs(area) < PARALLEL:
        raise ValueError("object.against: the two supports are parallel: the object can slide along them")
    return (b * gaps[1] - d * gaps[0]) / area, (c * gaps[0] - a * gaps[1]) / area
