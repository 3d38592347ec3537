"""Objects to be grasped: shapes and unions of them, with mass and pose.

A new shape is two classes in `continuum_grasp.scene.objects.shapes`, and a name in each of the two lists below.
"""

from __future__ import annotations

from functools import reduce
from operator import or_
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

from pydantic import Field

from continuum_grasp.scene.objects.outline import Outline
from continuum_grasp.scene.objects.shapes import (
    Box,
    Circle,
    Ellipse,
    Freedom,
    MemberPlace,
    ObjectBody,
    OutlineCurve,
    Polygon,
    Stadium,
    Superellipse,
)
from continuum_grasp.scene.parts import Part
from continuum_grasp.scene.value import ListOf

__all__ = [
    "Box",
    "Circle",
    "Ellipse",
    "Freedom",
    "GraspObject",
    "Outline",
    "OutlineCurve",
    "Polygon",
    "Stadium",
    "Superellipse",
    "Union",
    "UnionMember",
]

SHAPES = (Circle, Ellipse, Superellipse, Box, Polygon, Stadium, Outline)


def _member(shape: type[ObjectBody]) -> Any:
    """A shape, whose first base class has its own keys, at a place in a union."""
    namespace = {"__module__": shape.__module__, "__doc__": "The same as a member of a union."}
    return type(f"{shape.__name__}Member", (shape.__bases__[0], MemberPlace), namespace)


if TYPE_CHECKING:
    UnionMember = Any
else:
    UnionMember = Annotated[reduce(or_, map(_member, SHAPES)), Field(discriminator="shape")]


class Union(ObjectBody):
    """Parts stuck together, for example a mug with its handle."""

    shape: Literal["union"]
    """Parts stuck together."""
    members: Annotated[ListOf[UnionMember], Field(min_length=2, max_length=12)]
    """The parts; they may overlap."""

    @property
    def deviation(self) -> float:
        return float(max(member.deviation for member in self.members))

    @property
    def outline_error(self) -> float:
        return float(max(member.outline_error for member in self.members))

    def redrawn(self) -> Self:
        return self.replaced(members=tuple(member.redrawn() for member in self.members))

    @property
    def parts(self) -> tuple[Part, ...]:
        return tuple(part.placed(m.position, m.angle) for m in self.members for part in m.parts)

    def _check(self) -> None:
        if self.center_of_mass is None:
            raise ValueError("center_of_mass is needed: the parts of a union may overlap and differ in density")


GraspObject = Annotated[
    Circle | Ellipse | Superellipse | Box | Polygon | Stadium | Outline | Union, Field(discriminator="shape")
]
"""An object to be grasped."""
