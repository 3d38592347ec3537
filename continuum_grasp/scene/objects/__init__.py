"""What can be grasped: convex shapes and unions of them, with mass and pose.

A new shape is a file beside `continuum_grasp.scene.objects.shapes`, and a name in each of the two lists below.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from continuum_grasp.scene.objects.body import Freedom, ObjectBody
from continuum_grasp.scene.objects.shapes import (
    Box,
    BoxMember,
    Circle,
    CircleMember,
    Ellipse,
    EllipseMember,
    Polygon,
    PolygonMember,
    RoundedPolygon,
    RoundedPolygonMember,
    Superellipse,
    SuperellipseMember,
)
from continuum_grasp.scene.objects.stadium import Stadium, StadiumMember
from continuum_grasp.scene.parts import Part

__all__ = [
    "Box",
    "Circle",
    "Ellipse",
    "Freedom",
    "GraspObject",
    "Polygon",
    "RoundedPolygon",
    "Stadium",
    "Superellipse",
    "Union",
    "UnionMember",
]

UnionMember = Annotated[
    CircleMember
    | EllipseMember
    | SuperellipseMember
    | BoxMember
    | PolygonMember
    | RoundedPolygonMember
    | StadiumMember,
    Field(discriminator="shape"),
]


class Union(ObjectBody):
    """Convex parts stuck together, for example a mug with its handle."""

    shape: Literal["union"]
    """Convex parts stuck together."""
    members: Annotated[tuple[UnionMember, ...], Field(strict=False, min_length=2, max_length=12)]
    """The parts; they may overlap."""

    @property
    def parts(self) -> tuple[Part, ...]:
        return tuple(part.placed(m.position, m.angle) for m in self.members for part in m.parts)

    def _check(self) -> None:
        if self.center_of_mass is None:
            raise ValueError("center_of_mass is needed: the parts of a union may overlap and differ in density")


GraspObject = Annotated[
    Circle | Ellipse | Superellipse | Box | Polygon | RoundedPolygon | Stadium | Union, Field(discriminator="shape")
]
"""What can be grasped."""
