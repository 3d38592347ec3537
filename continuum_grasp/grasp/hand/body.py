"""The surface of a solid object as the hand sees it: distances for the search, and points for pictures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from continuum_grasp.base import Numbers as Array
from continuum_grasp.base import named_value
from continuum_grasp.grasp.hand.frames import PlaneFrame, of_grid
from continuum_grasp.scene import HandScene

_HALVINGS = 50
"""Bisections along a ray: to rounding."""
_NEWTON = 30
"""Steps toward the nearest point of a surface at most; of ellipsoids 5 are enough."""
_CLOSE = 1e-14
"""Step, per size of the object, that ends them."""


def level(shape: str, point: ca.SX, half: ca.SX, edge: ca.SX) -> ca.SX:
    """A function that is zero on the surface of a shape and grows outward: the distance but for ellipsoids.

    ``half`` are half extents (3,) along its axes, ``edge`` the radius of its edges.
    """
    # 1e-24: keeps roots differentiable at the center and on the axis
    if shape == "sphere":
        return ca.sqrt(ca.sumsqr(point) + 1e-24) - half[0]
    if shape == "ellipsoid":
        return half[0] * (ca.sqrt(ca.sumsqr(point / half) + 1e-24) - 1.0)
    if shape == "cylinder":
        across = ca.sqrt(point[0] ** 2 + point[1] ** 2 + 1e-24)
        beyond = ca.vertcat(across - (half[0] - edge), ca.fabs(point[2]) - (half[2] - edge))
    else:
        beyond = ca.fabs(point) - (half - edge)
    outside = ca.fmax(beyond, 0.0)
    return ca.sqrt(ca.sumsqr(outside) + 1e-24) + ca.fmin(ca.mmax(beyond), 0.0) - edge


@lru_cache(maxsize=8)
def levels(shape: str) -> tuple[ca.Function, ca.Function]:
    """``(point, half, edge)``: the level of a shape at points (3, K) of its frame, and its gradient; and these with the
    Hessian.
    """
    point = ca.SX.sym("point", 3)
    half = ca.SX.sym("half", 3)
    edge = ca.SX.sym("edge")
    value = level(shape, point, half, edge)
    bending, gradient = ca.hessian(value, point)
    sought = [value, gradient, ca.densify(bending)]
    once, twice = (ca.Function("level", [point, half, edge], sought[:count]) for count in (2, 3))
    return once, twice


@dataclass(frozen=True)
class Nearby:
    """The object around points: its distance there to second order."""

    distance: Array  # (K,) [m], negative inside
    normal: Array  # (K, 3) outward
    bending: Array  # (K, 3, 3) second derivative of the distance [1/m]
    slope: Array | None = None  # (K, 3) gradient of the distance, where normals are others: of triangles


class BodySurface:
    """The object of a scene."""

    def __init__(self, scene: HandScene) -> None:
        self.solid: Any = scene.object
        self.center = np.array(self.solid.position)
        self.axes = self.solid.axes
        shape = _SHAPES.get(self.solid.shape)
        # None where the shape has a level in closed form.
        self._local: Any = None if shape is None else _local(named_value(f"{__package__}.{shape}"), self.solid)

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
        """Distance (...,) of points (..., 3) [m], of ellipsoids to first order, and the outward normal (..., 3)."""
        local = (points - self.center).reshape(-1, 3) @ self.axes
        if self._local is not None:
            away, normal = self._local.distance(local)
            return away.reshape(points.shape[:-1]), (normal @ self.axes.T).reshape(points.shape)
        once, _ = levels(self.solid.shape)
        value, gradient = (np.array(part).T for part in once(local.T, self.half, self.edge))
        slope = np.maximum(np.linalg.norm(gradient, axis=1), 1e-12)
        normal = (gradient / slope[:, None]) @ self.axes.T
        # The gradient vanishes at the center and on the axis; no point is deeper than the thinnest half.
        away = np.maximum(value.ravel() / slope, -self.half.min())
        return away.reshape(points.shape[:-1]), normal.reshape(points.shape)

    def near(self, points: Array) -> Nearby:
        """Distance of points (K, 3) with its first and second derivative, by the nearest place of the surface."""
        local = (points - self.center) @ self.axes
        if self._local is not None:
            away, normal, bending, *slope = self._local.near(local)
            slopes = slope[0] @ self.axes.T if slope else None
            return Nearby(away, normal @ self.axes.T, self.axes @ bending @ self.axes.T, slopes)
        away = np.zeros(len(local))
        count = len(local)
        value, gradient, bending = self._level(local)
        place = local - (value / (gradient**2).sum(axis=1))[:, None] * gradient
        # Newton's method on place + away gradient = point, level = 0.
        matrix = np.zeros((count, 4, 4))
        rest = np.zeros((count, 4))
        for _ in range(_NEWTON):
            value, gradient, bending = self._level(place)
            rest[:, :3], rest[:, 3] = local - place - away[:, None] * gradient, -value
            matrix[:, :3, :3] = np.eye(3) + away[:, None, None] * bending
            matrix[:, :3, 3], matrix[:, 3, :3] = gradient, gradient
            step = np.linalg.solve(matrix, rest[..., None])[..., 0]
            place = place + step[:, :3]
            away = away + step[:, 3]
            if np.abs(step[:, :3]).max(initial=0.0) < _CLOSE * self.solid.size:
                break
        _, gradient, bending = self._level(place)
        slope = np.linalg.norm(gradient, axis=1)
        normal = gradient / slope[:, None]
        distance = away * slope
        # Curvatures of the surface, then of the parallel surface through the point.
        across = np.eye(3) - normal[:, :, None] * normal[:, None, :]
        curved = across @ bending @ across / slope[:, None, None]
        curved = np.linalg.solve(np.eye(3) + distance[:, None, None] * curved, curved)
        return Nearby(distance, normal @ self.axes.T, self.axes @ curved @ self.axes.T)

    def _level(self, local: Array) -> tuple[Array, Array, Array]:
        """Level (K,), gradient (K, 3) and second derivative (K, 3, 3) at points (K, 3) of the object's frame."""
        _, twice = levels(self.solid.shape)
        value, gradient, bending = (np.array(part) for part in twice(local.T, self.half, self.edge))
        return value.ravel(), gradient.T, bending.T.reshape(-1, 3, 3)

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

    def triangles(self, count: int = 33) -> tuple[Array, Array]:
        """Corners (V, 3) [m] and triangles (T, 3) of its surface as the hand sees it, for pictures."""
        if self._local is not None:
            corners, triangles = self._local.triangles()
            return np.asarray(self.center + corners @ self.axes.T), triangles
        up = np.linspace(0.0, np.pi, count)[::-1, None]
        around = np.linspace(0.0, 2.0 * np.pi, 2 * count)
        local = [np.sin(up) * np.cos(around), np.sin(up) * np.sin(around), np.cos(up) * np.ones_like(around)]
        directions = np.stack(local, axis=-1).reshape(-1, 3) @ self.axes.T
        return of_grid(self._along(directions).reshape(count, 2 * count, 3))

    def edge_distance(self, points: Array) -> Array:
        """Distance (N,) of points (N, 3) from the nearest convex edge of a mesh [m]; infinite for other shapes."""
        if self.solid.shape != "mesh":
            return np.full(len(points), np.inf)
        return np.asarray(self._local.edge_distance((points - self.center) @ self.axes))

    @property
    def convex_parts(self) -> list[Array]:
        """Corners (N, 3) of convex bodies whose union is the solid, in its own frame [m]; empty if no formula gives
        them.
        """
        return self._local.convex_parts() if hasattr(self._local, "convex_parts") else []

    def _along(self, directions: Array) -> Array:
        """Points (K, 3) where rays from the center leave it in directions (K, 3), of shapes in closed form."""
        near = np.zeros(len(directions))
        far = np.full(len(directions), 2.0 * self.solid.size)
        for _ in range(_HALVINGS):
            middle = 0.5 * (near + far)
            inside = self.distance(self.center + middle[:, None] * directions)[0] < 0.0
            near = np.where(inside, middle, near)
            far = np.where(inside, far, middle)
        return np.asarray(self.center + near[:, None] * directions)


_SHAPES = {
    "cone": "swept_surface:TurnedSurface",
    "revolve": "swept_surface:TurnedSurface",
    "extrude": "swept_surface:ExtrudedSurface",
    "superquadric": "superquadric_surface:SuperquadricSurface",
    "mesh": "mesh_surface:MeshSurface",
}
"""Surfaces of shapes that have no level in closed form; only those that are there are imported, with SciPy."""


def _local(shape: Callable[[Any], Any], solid: Any) -> Any:
    """The surface of a solid in its frame; the last one asked for is stored."""
    key = solid.replaced(
        mass=1.0, density=None, center_of_mass=None, position=(0.0, 0.0, 0.0), rotation=(0.0, 0.0, 0.0)
    )
    return _surface(shape, key)


@lru_cache(maxsize=4)
def _surface(shape: Callable[[Any], Any], solid: Any) -> Any:
    return shape(solid)
