"""Surfaces of solids in space: bodies whose distance is known to second order."""

from __future__ import annotations

from abc import abstractmethod

import numpy as np

from continuum_grasp.base import Numbers as Array
from continuum_grasp.grasp.body.body import Body, NearBody


class SolidSurface(Body):
    """A solid in space, in its own frame."""

    dimensions = 3

    @abstractmethod
    def to_second_order(self, points: Array) -> tuple[Array, Array, Array]:
        """Return distances (n,) of points (n, 3) [m], normals (n, 3), and derivatives of these (n, 3, 3) [1/m].

        The derivatives are symmetric: the Hessians of the distance, except on smoothed meshes.
        """

    def scan(self, points: Array) -> tuple[Array, Array]:
        """Return distances (n,) and outward normals (n, 3) of many points quickly, exact for most shapes."""
        return self.to_second_order(points)[:2]

    @abstractmethod
    def triangles(self) -> tuple[Array, Array]:
        """Return corners (V, 3) [m] and triangles (T, 3) of the surface, for pictures."""

    def convex_parts(self) -> list[Array]:
        """Return corners (N, 3) of convex bodies whose union is the solid [m]; none if no formula gives them."""
        return []

    @property
    def box(self) -> tuple[Array, Array]:
        corners = self.triangles()[0]
        return corners.min(axis=0), corners.max(axis=0)

    def distance(self, points: Array) -> Array:
        return self.scan(np.reshape(points, (-1, 3)))[0]

    def near(self, points: Array) -> NearBody:
        distance, normal, bending = self.to_second_order(np.reshape(points, (-1, 3)))
        levels, axes = np.linalg.eigh(bending)
        # From the parallel surface through the point to the surface.
        grown = np.maximum(1.0 - distance[:, None] * levels, self.least_radius * np.abs(levels))
        return NearBody(distance, normal, np.einsum("nij,nj,nkj->nik", axes, levels / grown, axes))


def of_grid(grid: Array) -> tuple[Array, Array]:
    """Corners (V, 3) and triangles (T, 3) between the points of a grid (A, B, 3)."""
    a, b = grid.shape[:2]
    number = np.arange(a * b).reshape(a, b)
    first, second, third, fourth = (
        part.ravel() for part in (number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1])
    )
    triangles = np.concatenate([np.column_stack([first, second, third]), np.column_stack([first, third, fourth])])
    return grid.reshape(-1, 3), triangles
