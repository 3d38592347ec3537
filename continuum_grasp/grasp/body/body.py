"""The body that a grasp holds: one class for its signed distance in the plane and in space.

A grasp asks a body for nothing else. The certificate takes the exact distances, normals and curvatures of a `Body`; the
problem takes a `DistanceTable` of them, which is smooth enough for a solver.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from continuum_grasp.base import Numbers as Array

_SHARPEST = 1e-9
"""Radius of curvature of sharp edges, per size of the body [1]: so small that a tip 1 mm thick does not tell it from
zero, and so large that squares of its inverse are finite."""


@dataclass(frozen=True)
class NearBody:
    """Nearest places of a body's surface to n points, in d dimensions."""

    distance: Array
    """Signed distances (n,) [m], negative inside."""
    normal: Array
    """Outward unit normals (n, d) at the nearest places: gradients of the distance, except on smoothed meshes."""
    curvature: Array
    """Curvatures of the surface at the nearest places [1/m], positive where it is convex. In the plane (n,). In space
    the shape operators (n, 3, 3): symmetric and zero along the normal; the other eigenvectors and eigenvalues are the
    principal directions and curvatures."""


class Body(ABC):
    """A body in its own frame; d is the number of its dimensions. `body_of` makes the body of an object of a scene.

    If the nearest place is on a sharp edge or a corner, the normal is the direction from there to the point, or the
    normal of one side if the point is on the edge itself. The curvature across the edge is 1e9 / size.
    """

    dimensions: int
    """2 in the plane, 3 in space."""
    size: float
    """Greatest distance of the surface from the origin of the frame, in the plane from the center of mass [m]."""
    deviation: float = 0.0
    """Greatest distance of the surface from the true one [m]; not zero for meshes and for drawn outlines."""
    least_step: float = 0.0
    """Step of a grid [m] below which a table gains no detail; not zero for meshes."""

    @property
    @abstractmethod
    def box(self) -> tuple[Array, Array]:
        """Least and greatest coordinates (d,) of the surface [m], to within 2e-3 of its size."""

    @abstractmethod
    def distance(self, points: Array) -> Array:
        """Return signed distances (n,) of points (n, d) [m], negative inside."""

    @abstractmethod
    def near(self, points: Array) -> NearBody:
        """Return distances, outward normals and curvatures of the surface at the places nearest to points (n, d)."""

    def on_grid(self, axes: tuple[Array, ...]) -> Array:
        """Return the values that tables interpolate, at the places of a grid with d even axes: distances [m].

        A mesh, whose distance is rough, returns a smooth field that is close to the distance.
        """
        grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        return self.distance(grid.reshape(-1, len(axes))).reshape(grid.shape[:-1])

    @property
    def least_radius(self) -> float:
        """Radius of curvature of sharp edges [m]."""
        return _SHARPEST * self.size
