"""Distance and outward normal from the surface of a solid, by numpy, and of meshes by trimesh, alone."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.grasp.hand.surface_distances import TriangleDistance, loop_distance, superquadric_distance
from continuum_grasp.scene import HandScene

_STEPS = 100
"""Newton steps toward the nearest point of an ellipsoid at most; twenty bring a point near it to rounding."""
_FAR, _TURNS = 10.0, 14
"""Distance of a plane from the object, per its size, and projections: the place moves by a tenth of the time before at
each, and its height by a hundredth."""


@dataclass(frozen=True)
class NearestPlaces:
    """Places of a surface nearest to n points."""

    distance: Array  # (n,) from the surface [m], negative inside
    point: Array  # (n, 3) of the surface [m]
    normal: Array  # (n, 3) outward unit normal there


class PlacedSolid:
    """The surface of a scene's object, as the hand sees it."""

    def __init__(self, scene: HandScene) -> None:
        self._body: Any = scene.object
        self._position = np.array(self._body.position, dtype=float)
        self._axes = self._body.axes

    def nearest(self, points: Array) -> NearestPlaces:
        """Places of the surface nearest to points (n, 3) [m]."""
        points = np.asarray(points, dtype=float).reshape(-1, 3)
        distance, normal = self._local((points - self._position) @ self._axes)
        normal = normal @ self._axes.T
        return NearestPlaces(distance, points - distance[:, None] * normal, normal)

    def height(self, point: Array, normal: Array) -> float:
        """Least distance of the surface from a plane through a point [m], negative behind it.

        By turns, the place of the surface nearest to a point of a plane far off, and the point of that plane nearest to
        the place, from several points.
        """
        if self._body.shape == "mesh":
            corners = self._position + self._body.surface.corners @ self._axes.T
            return float(((corners - point) @ normal).min())
        far = _FAR * self._body.size
        side = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
        spread = np.stack(np.meshgrid(*[[-1.0, -0.5, 0.0, 0.5, 1.0]] * 2), axis=-1).reshape(-1, 2) * self._body.size
        center = self._position - (normal @ (self._position - point) + far) * normal
        points = center + spread @ np.stack([side, np.cross(normal, side)]) / np.linalg.norm(side)
        for _ in range(_TURNS):
            places = self.nearest(points).point
            heights = (places - point) @ normal
            points = places - (heights + far)[:, None] * normal
        return float(heights.min())

    def distance(self, points: Array) -> Array:
        """Distances (n,) of points (n, 3) from the surface [m]."""
        if self._body.shape != "mesh":
            return self.nearest(points).distance
        return self._triangles.distance((np.asarray(points, dtype=float).reshape(-1, 3) - self._position) @ self._axes)

    def _local(self, points: Array) -> tuple[Array, Array]:
        """Distances (n,) and normals (n, 3) in the frame of the shape."""
        body = self._body
        match body.shape:
            case "sphere":
                return _grown_box(points, np.zeros(3), 0.5 * body.diameter)
            case "ellipsoid":
                return _ellipsoid(points, 0.5 * np.array(body.extents))
            case "superquadric":
                return superquadric_distance(points, 0.5 * np.array(body.extents), body.exponents)
            case "box":
                return _grown_box(points, 0.5 * np.array(body.extents) - body.edge_radius, body.edge_radius)
            case "mesh":
                return self._triangles.nearest(points)
            case "extrude":
                return _extruded(points, body)
            case _:
                return _turned(points, body)

    @cached_property
    def _triangles(self) -> TriangleDistance:
        return TriangleDistance(self._body.surface)


def _turned(points: Array, body: Any) -> tuple[Array, Array]:
    """Distances and normals from a solid of revolution, found in the half plane of its axis."""
    radial = np.hypot(points[:, 0], points[:, 1])
    flat = np.column_stack([radial, points[:, 2]])
    if body.shape == "cylinder":  # a rounded box there
        half = np.array([0.5 * body.diameter, 0.5 * body.height]) - body.edge_radius
        distance, normal = _grown_box(flat, half, body.edge_radius)
    else:
        distance, normal = loop_distance(flat, body.section)
    out = np.where(radial[:, None] > 0.0, points[:, :2] / np.maximum(radial, 1e-300)[:, None], [1.0, 0.0])
    return distance, np.column_stack([normal[:, :1] * out, normal[:, 1]])


def _extruded(points: Array, body: Any) -> tuple[Array, Array]:
    """Distances and normals from an extruded outline: in the plane of its core's normal and its axis, the core is a
    quadrant.
    """
    across, flat = loop_distance(points[:, :2], body.core)
    quadrant = np.column_stack([across, np.abs(points[:, 2]) - 0.5 * body.height + body.edge_radius])
    # Both coordinates are at least -large: everything within a box whose other sides are far away.
    far = 2.0 * body.size
    distance, normal = _grown_box(np.maximum(quadrant, -far) + far, np.full(2, far), body.edge_radius)
    up = np.copysign(normal[:, 1], points[:, 2])
    return distance, np.column_stack([normal[:, :1] * flat, up])


def _grown_box(points: Array, half: Array, radius: float) -> tuple[Array, Array]:
    """Distances and normals from everything within a radius of a box of half extents (k,), which may be zero."""
    beyond = np.abs(points) - half
    outside = np.maximum(beyond, 0.0)
    away = np.linalg.norm(outside, axis=1)
    # Inside of the box the nearest face belongs to the axis along which the least is missing.
    face = np.eye(half.size)[beyond.argmax(axis=1)]
    normal = np.where(away[:, None] > 0.0, outside / np.maximum(away, 1e-300)[:, None], face)
    return away + np.minimum(beyond.max(axis=1), 0.0) - radius, normal * np.copysign(1.0, points)


def _ellipsoid(points: Array, half: Array) -> tuple[Array, Array]:
    """Distances and normals from an ellipsoid: the nearest point is a^2 p / (a^2 + t), with t the greatest root of
    F(t) = sum (a p / (a^2 + t))^2 - 1 (D. Eberly, "Distance from a Point to an Ellipse, an Ellipsoid, or a
    Hyperellipsoid", 2013).
    """
    # 1e-12: a center, from which several places are nearest, becomes a point beside it.
    p = np.copysign(np.maximum(np.abs(points), 1e-12 * half), points)
    squares = half**2
    # Beyond the greatest pole F is convex and falls: from where it is positive, Newton's method never passes the root.
    t = (half * np.abs(p) - squares).max(axis=1)
    for _ in range(_STEPS):
        shares = (half * p / (squares + t[:, None])) ** 2
        step = (shares.sum(axis=1) - 1.0) / (2.0 * (shares / (squares + t[:, None])).sum(axis=1))
        t = t + np.maximum(step, 0.0)
        if not (step > 1e-16 * squares.max()).any():
            break
    normal = p / (squares + t[:, None])
    place = squares * normal
    normal = normal / np.linalg.norm(normal, axis=1)[:, None]
    return ((points - place) * normal).sum(axis=1), normal
