"""Solid objects in space, which a hand holds: shapes with closed forms, their mass and their pose."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field

from continuum_grasp.base import Array
from continuum_grasp.scene.units import Unit
from continuum_grasp.scene.value import Extent, Mass, Positive, Real, Value

Vector3 = Annotated[tuple[Real, Real, Real], Field(strict=False)]
SpatialPosition = Annotated[Vector3, Unit("m")]
Extents = Annotated[tuple[Extent, Extent, Extent], Field(strict=False)]
_SHARP = 1e-3
"""Least radius of an edge, per size of the object [1]: a sharper one has no normal to press along."""


class SolidBody(Value):
    """Properties of every solid beside its shape, which is symmetric about the origin of its frame."""

    mass: Mass | None = None
    """Mass [kg]; None: that of the shape by its ``density``."""
    density: Annotated[Positive, Unit("kg/m3")] | None = None
    """Density [kg/m3], in place of ``mass``."""
    center_of_mass: SpatialPosition = (0.0, 0.0, 0.0)
    """Center of mass in the object's frame [m]."""
    position: SpatialPosition
    """Position of the center of the shape, as the hand sees it [m]."""
    rotation: Annotated[Vector3, Unit("rad")] = (0.0, 0.0, 0.0)
    """Rotation vector from the hand's axes to the object's: the axis of the turn times its angle [rad]."""
    against: Literal["palm", "table"] | None = None
    """Palm or table that the object lies against: it moves from ``position`` along the normal until it touches; None:
    ``position`` is exact."""

    @property
    def volume(self) -> float:
        """Volume [m3]."""
        raise NotImplementedError

    @property
    def size(self) -> float:
        """Greatest distance of the surface from the center of the shape [m]."""
        raise NotImplementedError

    @property
    def weighed(self) -> float:
        """Mass, given or by the density [kg]."""
        return self.mass if self.mass is not None else (self.density or 0.0) * self.volume

    @property
    def axes(self) -> Array:
        """Rotation matrix (3, 3), whose columns are the object's axes as the hand sees them."""
        import numpy as np

        angle = math.hypot(*self.rotation)
        if angle == 0.0:
            return np.eye(3)
        x, y, z = (component / angle for component in self.rotation)
        skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        return np.asarray(np.eye(3) + math.sin(angle) * skew + (1.0 - math.cos(angle)) * skew @ skew)

    @property
    def com(self) -> Array:
        """Center of mass as the hand sees it (3,) [m]."""
        import numpy as np

        return np.asarray(np.array(self.position) + self.axes @ np.array(self.center_of_mass))

    def _check(self) -> None:
        if (self.mass is None) is (self.density is None):
            raise ValueError("give mass, or density")
        if math.hypot(*self.center_of_mass) > self.size:
            raise ValueError(f"center_of_mass lies outside the object, which reaches {self.size:.4g} m from its center")

    def _check_edges(self, radius: float, half: tuple[float, ...]) -> None:
        if not _SHARP * self.size <= radius <= min(half):
            raise ValueError(
                f"edge_radius = {radius:g} m: expected {_SHARP * self.size:.3g} to {min(half):.3g} m, half of the "
                "least extent"
            )


class Sphere(SolidBody):
    """A ball."""

    shape: Literal["sphere"]
    """A ball."""
    diameter: Extent
    """Diameter [m]."""

    @property
    def volume(self) -> float:
        return math.pi / 6.0 * self.diameter**3

    @property
    def size(self) -> float:
        return 0.5 * self.diameter


class Ellipsoid(SolidBody):
    """An ellipsoid along its own axes."""

    shape: Literal["ellipsoid"]
    """An ellipsoid along its own axes."""
    extents: Annotated[Extents, Unit("m")]
    """Diameters along its axes [m]."""

    @property
    def volume(self) -> float:
        return math.pi / 6.0 * math.prod(self.extents)

    @property
    def size(self) -> float:
        return 0.5 * max(self.extents)


class Cylinder(SolidBody):
    """A round cylinder about its z axis, with rounded rims."""

    shape: Literal["cylinder"]
    """A round cylinder about its z axis, with rounded rims."""
    diameter: Extent
    """Diameter [m]."""
    height: Extent
    """Length along its axis [m]."""
    edge_radius: Extent
    """Radius of both rims [m]."""

    @property
    def volume(self) -> float:
        # A full cylinder less what the rims leave out of it (Pappus's theorem).
        r, big = self.edge_radius, 0.5 * self.diameter
        cut = (2.0 - 0.5 * math.pi) * r * r
        centroid = big - r * (10.0 - 3.0 * math.pi) / (12.0 - 3.0 * math.pi)
        return math.pi * big**2 * self.height - 2.0 * math.pi * centroid * cut

    @property
    def size(self) -> float:
        r = self.edge_radius
        return math.hypot(0.5 * self.diameter - r, 0.5 * self.height - r) + r

    def _check(self) -> None:
        self._check_edges(self.edge_radius, (0.5 * self.diameter, 0.5 * self.height))


class RoundedBox(SolidBody):
    """A box along its own axes, with rounded edges and corners."""

    shape: Literal["box"]
    """A box along its own axes, with rounded edges and corners."""
    extents: Annotated[Extents, Unit("m")]
    """Lengths along its axes [m]."""
    edge_radius: Extent
    """Radius of edges and corners [m]."""

    @property
    def volume(self) -> float:
        # A box of the centers of the corners, grown by the radius (Steiner's formula).
        a, b, c = (extent - 2.0 * self.edge_radius for extent in self.extents)
        r = self.edge_radius
        return (
            a * b * c + 2.0 * r * (a * b + b * c + c * a) + math.pi * r * r * (a + b + c) + 4.0 / 3.0 * math.pi * r**3
        )

    @property
    def size(self) -> float:
        r = self.edge_radius
        return math.hypot(*(0.5 * extent - r for extent in self.extents)) + r

    def _check(self) -> None:
        self._check_edges(self.edge_radius, tuple(0.5 * extent for extent in self.extents))


Solid = Annotated[Sphere | Ellipsoid | Cylinder | RoundedBox, Field(discriminator="shape")]
"""A solid object to be held by a hand."""
