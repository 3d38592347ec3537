"""Properties of every solid object that a hand holds: mass and pose."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field

from continuum_grasp.base import Array
from continuum_grasp.scene.magnitudes import ANGLE, DENSITY
from continuum_grasp.scene.units import Unit
from continuum_grasp.scene.value import Extent, Mass, Positive, SpatialPosition, Value, Vector3

Extents = Annotated[tuple[Extent, Extent, Extent], Field(strict=False)]
_SHARP = 1e-3
"""Least radius of an edge, per size of the object [1]: a sharper one has no normal to press along."""


class SolidBody(Value):
    """Properties that every solid has in addition to its shape."""

    mass: Mass | None = None
    """Mass [kg]; None: the mass of the shape by its ``density``."""
    density: Annotated[Positive, Unit("kg/m3"), DENSITY] | None = None
    """Density [kg/m3], instead of ``mass``."""
    center_of_mass: SpatialPosition | None = None
    """Center of mass in the object's frame [m]; None: the centroid of the shape."""
    position: SpatialPosition
    """Position of the origin of the object's frame, the center of symmetric shapes, as the hand sees it [m]."""
    rotation: Annotated[Vector3, Unit("rad"), ANGLE] = (0.0, 0.0, 0.0)
    """Rotation vector from the hand's axes to the object's: the axis of the turn times its angle [rad]."""

    against: Literal["palm", "table"] | None = None
    """Palm or table that the object lies against: it moves from ``position`` along the normal until it touches; None:
    ``position`` is exact."""

    @property
    def volume(self) -> float:
        """Volume [m3]."""
        raise NotImplementedError

    @property
    def centroid(self) -> tuple[float, float, float]:
        """Centroid of the shape in the object's frame [m]."""
        return 0.0, 0.0, 0.0

    @property
    def size(self) -> float:
        """Greatest distance of the surface from the origin of the object's frame [m]."""
        raise NotImplementedError

    @property
    def deviation(self) -> float:
        """Greatest distance between the surface and the true one [m]; zero except for meshes."""
        return 0.0

    def outermost(self, direction: Array) -> Array:
        """Return points (K, 3) in the object's frame that include the farthest ones along a unit direction of this
        frame; for a flat face, a few of its corners.
        """
        raise NotImplementedError

    @property
    def weighed(self) -> float:
        """Mass, given or by the density [kg]."""
        return self.mass if self.mass is not None else (self.density or 0.0) * self.volume

    @property
    def local_com(self) -> tuple[float, float, float]:
        """Center of mass in the object's frame, given or of the shape [m]."""
        return self.centroid if self.center_of_mass is None else self.center_of_mass

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

        return np.asarray(np.array(self.position) + self.axes @ np.array(self.local_com))

    def _check(self) -> None:
        if (self.mass is None) is (self.density is None):
            raise ValueError("give mass, or density")
        if self.center_of_mass is not None and math.hypot(*self.center_of_mass) > self.size:
            raise ValueError(f"center_of_mass lies outside the object, which reaches {self.size:.4g} m from its origin")

    def _check_edges(self, radius: float, half: tuple[float, ...]) -> None:
        if not _SHARP * self.size <= radius <= min(half):
            raise ValueError(
                f"edge_radius = {radius:g} m: expected {_SHARP * self.size:.3g} to {min(half):.3g} m, half of the "
                "least extent"
            )
