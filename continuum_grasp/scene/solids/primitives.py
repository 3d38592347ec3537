"""Solid objects with closed forms: ball, ellipsoid, superquadric, cylinder and box."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field

from continuum_grasp.base import Array
from continuum_grasp.scene.solids.solid_body import Extents, SolidBody
from continuum_grasp.scene.units import Unit
from continuum_grasp.scene.value import Extent

Exponent = Annotated[float, Field(ge=2.0, le=12.0)]


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


class Superquadric(SolidBody):
    """Between an ellipsoid and a box: (|x/a|^p + |y/b|^p)^(q/p) + |z/c|^q = 1, along its own axes."""

    shape: Literal["superquadric"]
    """Between an ellipsoid and a box: (|x/a|^p + |y/b|^p)^(q/p) + |z/c|^q = 1, along its own axes."""
    extents: Annotated[Extents, Unit("m")]
    """Lengths 2 a, 2 b and 2 c along its axes [m]."""
    exponents: Annotated[tuple[Exponent, Exponent], Field(strict=False), Unit("1")]
    """p across the z axis, and q along it [1]: 2 is an ellipse, above it the surface flattens towards a box."""

    @property
    def volume(self) -> float:
        p, q = self.exponents
        across = math.gamma(1.0 + 1.0 / p) ** 2 / math.gamma(1.0 + 2.0 / p)
        along = math.gamma(1.0 + 2.0 / q) * math.gamma(1.0 + 1.0 / q) / math.gamma(1.0 + 3.0 / q)
        return math.prod(self.extents) * across * along

    def outermost(self, direction: Array) -> Array:
        import numpy as np

        # The point with a normal n has its weights in proportion to |a n|^(1 / (p - 1)), level by level.
        (p, q), half = self.exponents, 0.5 * np.array(self.extents)
        along = np.abs(half * direction)
        flat = along[:2] ** (1.0 / (p - 1.0))
        flat = flat / max(float((flat**p).sum()) ** (1.0 / p), 1e-300)
        pair = np.array([float(along[:2] @ flat), along[2]]) ** (1.0 / (q - 1.0))
        pair = pair / float((pair**q).sum()) ** (1.0 / q)
        return np.asarray((half * np.sign(direction) * np.array([*(pair[0] * flat), pair[1]]))[None])

    @property
    def size(self) -> float:
        def corner(a: float, b: float, exponent: float) -> float:
            # Greatest (a^2 s^(2/p) + b^2 t^(2/p))^(1/2) with s + t = 1 (Hoelder's inequality).
            least, most = sorted((a, b))
            if exponent == 2.0:
                return most
            power = 2.0 * exponent / (exponent - 2.0)
            return float(most * (1.0 + (least / most) ** power) ** (1.0 / power))

        p, q = self.exponents
        a, b, c = (0.5 * extent for extent in self.extents)
        return corner(corner(a, b, p), c, q)


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
        # A full cylinder minus the volume that the rounded rims remove (Pappus's theorem).
        r = self.edge_radius
        big = 0.5 * self.diameter
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
