"""The object of a hand's scene as the hand sees it: distances for the search, and points for pictures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from continuum_grasp.base import Numbers as Array
from continuum_grasp.grasp.body.bodies import surface_of
from continuum_grasp.grasp.body.mesh_surface import MeshSurface
from continuum_grasp.grasp.hand.frames import PlaneFrame
from continuum_grasp.scene import HandScene


@dataclass(frozen=True)
class Nearby:
    """The object around points: its distance there to second order."""

    distance: Array  # (K,) [m], negative inside
    normal: Array  # (K, 3) outward
    bending: Array  # (K, 3, 3) second derivative of the distance [1/m]
    slope: Array | None = None  # (K, 3) gradient of the distance, where normals are others: of triangles


class BodySurface:
    """The object of a scene at its place."""

    def __init__(self, scene: HandScene) -> None:
        self.solid: Any = scene.object
        self.center = np.array(self.solid.position)
        self.axes = self.solid.axes
        self._local = surface_of(self.solid)

    @property
    def half(self) -> Array:
        """Half extents along its axes (3,) [m]."""
        solid = self.solid
        if solid.shape == "cylinder":
            return 0.5 * np.array([solid.diameter, solid.diameter, solid.height])
        return 0.5 * np.array([solid.diameter] * 3 if solid.shape == "sphere" else solid.extents)

    @property
    def edge(self) -> float:
        """Radius of its edges [m]; zero where it has none."""
        return float(getattr(self.solid, "edge_radius", 0.0))

    def distance(self, points: Array) -> tuple[Array, Array]:
        """Distance (...,) of points (..., 3) [m], for scans, and the outward normal (..., 3)."""
        away, normal = self._local.scan((points - self.center).reshape(-1, 3) @ self.axes)
        return away.reshape(points.shape[:-1]), (normal @ self.axes.T).reshape(points.shape)

    def near(self, points: Array) -> Nearby:
        """Distance of points (K, 3) with its first and second derivative, by the nearest place of the surface."""
        local = (points - self.center) @ self.axes
        slope = None
        if isinstance(self._local, MeshSurface):
            away, normal, bending, slope = self._local.with_slopes(local)
            slope = slope @ self.axes.T
        else:
            away, normal, bending = self._local.to_second_order(local)
        return Nearby(away, normal @ self.axes.T, self.axes @ bending @ self.axes.T, slope)

    def sections(self, frame: PlaneFrame, count: int = 161) -> list[Array]:
        """Closed lines (N, 2) in which a plane cuts it, in the plane's x and y [m]; none where the plane misses it."""
        if self.solid.shape == "mesh":
            from trimesh import Trimesh

            cut = Trimesh(*self.triangles(), process=False).section(frame.axes[:, 2], frame.base)
            lines = [] if cut is None else cut.discrete
            return [np.asarray((line - frame.base) @ frame.axes[:, :2]) for line in lines]
        from contourpy import contour_generator

        middle = (self.center - frame.base) @ frame.axes[:, :2]
        # 1.05: the grid reaches beyond the object
        side = 1.05 * self.solid.size * np.linspace(-1.0, 1.0, count)
        x, y = np.meshgrid(middle[0] + side, middle[1] + side)
        away, _ = self.distance(frame.world(np.stack([x, y, np.zeros_like(x)], axis=-1)))
        return [np.asarray(line) for line in contour_generator(x, y, away).lines(0.0)]

    def triangles(self) -> tuple[Array, Array]:
        """Corners (V, 3) [m] and triangles (T, 3) of its surface as the hand sees it, for pictures."""
        corners, triangles = self._local.triangles()
        return np.asarray(self.center + corners @ self.axes.T), triangles

    def edge_distance(self, points: Array) -> Array:
        """Distance (N,) of points (N, 3) from the nearest convex edge of a mesh [m]; infinite for other shapes."""
        if not isinstance(self._local, MeshSurface):
            return np.full(len(points), np.inf)
        return self._local.edge_distance((points - self.center) @ self.axes)

    @property
    def convex_parts(self) -> list[Array]:
        """Corners (N, 3) of convex bodies whose union is the solid, in its own frame [m]; empty if no formula gives
        them.
        """
        return self._local.convex_parts()
