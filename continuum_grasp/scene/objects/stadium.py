"""A stadium: what an oval bottle, a pill or a lying capsule looks like in the plane of the fingers."""

from __future__ import annotations

from typing import Literal

from continuum_grasp.scene.objects.body import MemberPlace, ObjectBody
from continuum_grasp.scene.parts import OffsetPolygon, Part
from continuum_grasp.scene.value import Extent, Value


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


class StadiumMember(_StadiumShape, MemberPlace):
    """The same as a member of a union."""
