"""Solid objects that a planar outline sweeps: about an axis, or along it."""

from __future__ import annotations

import math
from functools import cached_property
from typing import Literal

from continuum_grasp.base import Array
from continuum_grasp.scene.objects import UnionMember
from continuum_grasp.scene.parts import Face, OffsetPolygon
from continuum_grasp.scene.polygons import polygon_centroid
from continuum_grasp.scene.solids.boundary import (
    boundary,
    few,
    growth,
    inset,
    integral,
    length,
    outermost,
    points_of,
    whole_section,
)
from continuum_grasp.scene.solids.solid_body import SolidBody
from continuum_grasp.scene.value import Distance, Extent


class TurnedBody(SolidBody):
    """A solid of revolution about its z axis."""

    @property
    def section(self) -> tuple[Face, ...]:
        """Boundary of the section through the axis, counter-clockwise, with x across and y along the axis. For a ring,
        only one side of the section.
        """
        raise NotImplementedError

    @cached_property
    def _moments(self) -> tuple[float, float]:
        """Volume [m3], and its moment along the axis [m4], by Pappus's theorem."""
        ring = min(x for x, _ in points_of(self.section)) > 0.0
        turn = math.tau if ring else math.pi  # both halves of a whole section sweep the same
        volume = turn * integral(self.section, lambda x, y: 0.5 * x * abs(x))
        return volume, turn * integral(self.section, lambda x, y: 0.5 * x * abs(x) * y)

    @property
    def volume(self) -> float:
        return self._moments[0]

    @property
    def centroid(self) -> tuple[float, float, float]:
        return 0.0, 0.0, self._moments[1] / self._moments[0]

    @cached_property
    def size(self) -> float:
        return max(math.hypot(*point) for point in points_of(self.section, 0.01))

    def outermost(self, direction: Array) -> Array:
        import numpy as np

        across = math.hypot(direction[0], direction[1])
        places = np.array(outermost(self.section, math.atan2(direction[2], across)))
        # Four points of each circle, including the farthest one.
        turn = math.atan2(direction[1], direction[0]) + 0.5 * math.pi * np.arange(4)
        circles = [
            np.column_stack([x * np.cos(turn), x * np.sin(turn), np.full(4, z)]) for x, z in places[places[:, 0] >= 0]
        ]
        return few(np.concatenate(circles), direction, self.size)


class Cone(TurnedBody):
    """A round cone about its z axis, cut off above, with rounded rims; the frame's origin is at half its height."""

    shape: Literal["cone"]
    """A round cone about its z axis, cut off above, with rounded rims; the frame's origin is at half its height."""
    diameter_below: Distance
    """Diameter of the lower end of the sharp outline [m]; it may be zero."""
    diameter_above: Distance
    """Diameter of the upper end of the sharp outline [m]; it may be zero."""
    height: Extent
    """Length of the sharp outline along the axis [m]."""
    edge_radius: Extent
    """Radius of both rims, inside the sharp outline [m]."""

    @cached_property
    def section(self) -> tuple[Face, ...]:
        return boundary(self._part)

    @property
    def _part(self) -> OffsetPolygon:
        a = 0.5 * self.diameter_below
        b = 0.5 * self.diameter_above
        h = 0.5 * self.height
        r = self.edge_radius
        lean = math.hypot(b - a, 2.0 * h) / (2.0 * h)
        ends = list[list[tuple[float, float]]]()
        # The core is one radius inside the side and both ends; it ends in a cap if its sides meet before an end.
        for z in (r - h, h - r):
            across = a + (b - a) * (z + h) / (2.0 * h) - r * lean
            tip = (0.0, 2.0 * h * (r * lean - a) / (b - a) - h if a != b else z)
            ends.append([(-across, z), (across, z)] if across > 1e-9 * h else [tip])
        return OffsetPolygon((*ends[0], *ends[1][::-1]), r)

    def _check(self) -> None:
        a = 0.5 * self.diameter_below
        b = 0.5 * self.diameter_above
        h = 0.5 * self.height
        if not max(a, b) > 0.0:
            raise ValueError("diameter_below and diameter_above are both zero")
        # The greatest ball inside touches the wider end and the side.
        most = min(h, max(a, b) * 2.0 * h / (math.hypot(b - a, 2.0 * h) + abs(b - a)))
        self._check_edges(self.edge_radius, (0.99 * most,))


class Revolved(TurnedBody):
    """A planar outline turned about its y axis, which is the z axis of the object's frame."""

    shape: Literal["revolve"]
    """A planar outline turned about its y axis, which is the z axis of the object's frame."""
    profile: UnionMember
    """Section through the axis x = 0 of the profile's frame: the whole section, symmetric about the axis, its half at x
    > 0, or a section that does not reach the axis and sweeps a ring. The frame of an outline from a file has its origin
    at the centroid, so that a silhouette is symmetric; ``position`` of the profile shifts it."""

    @cached_property
    def section(self) -> tuple[Face, ...]:
        parts = self.profile.parts
        return whole_section(parts[0].placed(self.profile.position, self.profile.angle))

    def _check(self) -> None:
        _ = self.section


class Extruded(SolidBody):
    """A planar outline, drawn along its normal, with rounded edges; the frame's origin is at half its height."""

    shape: Literal["extrude"]
    """A planar outline, drawn along its normal, with rounded edges; the frame's origin is at half its height."""
    outline: UnionMember
    """Outline across the z axis of the object's frame."""
    height: Extent
    """Length along the z axis [m]."""
    edge_radius: Extent
    """Radius of all convex edges [m]."""

    @cached_property
    def core_part(self) -> OffsetPolygon:
        """Outline whose offset by ``edge_radius`` is the solid."""
        part = self.outline.parts[0].placed(self.outline.position, self.outline.angle)
        return inset(part, self.edge_radius)

    @cached_property
    def core(self) -> tuple[Face, ...]:
        """Boundary of the core, x and y, counter-clockwise."""
        return boundary(self.core_part)

    @property
    def core_pieces(self) -> list[tuple[Face, ...]]:
        """Boundaries of the convex pieces of the core."""
        return [boundary(piece) for piece in self.core_part.pieces]

    @property
    def half_height(self) -> float:
        """Half the height of the core [m]."""
        return 0.5 * self.height - self.edge_radius

    @property
    def volume(self) -> float:
        r = self.edge_radius
        area = integral(self.core, lambda x, y: x)
        around, more = length(self.core), growth(self.core)
        # Slices are all that is within sqrt(r^2 - z^2) of the core, z beyond its height.
        rims = 2.0 * (area * r + around * math.pi * r * r / 4.0 + more * 2.0 * r**3 / 3.0)
        return 2.0 * self.half_height * (area + around * r + more * r * r) + rims

    @property
    def centroid(self) -> tuple[float, float, float]:
        return *polygon_centroid(tuple(points_of(self.core, 0.01))), 0.0

    @cached_property
    def size(self) -> float:
        return max(math.hypot(x, y, self.half_height) for x, y in points_of(self.core, 0.01)) + self.edge_radius

    def outermost(self, direction: Array) -> Array:
        import numpy as np

        flat = np.array(outermost(self.core, math.atan2(direction[1], direction[0])))
        ends = [np.column_stack([flat, np.full(len(flat), z)]) for z in (-self.half_height, self.half_height)]
        return few(np.concatenate(ends) + self.edge_radius * direction, direction, self.size)

    def _check(self) -> None:
        _ = self.core
        self._check_edges(self.edge_radius, (0.5 * self.height,))
