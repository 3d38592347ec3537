"""The surface of a solid object as the hand sees it: distances for the search, and points for pictures."""

from __future__ import annotations

from typing import Any

import numpy as np

from continuum_grasp.base import Numbers as Array
from continuum_grasp.grasp.hand.frames import PlaneFrame
from continuum_grasp.grasp.hand.problem import levels
from continuum_grasp.scene import HandScene

_HALVINGS = 50
"""Bisections along a ray: to rounding."""


class BodySurface:
    """The object of a scene."""

    def __init__(self, scene: HandScene) -> None:
        self.solid: Any = scene.object
        self.center, self.axes = np.array(self.solid.position), self.solid.axes

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
        value, gradient = (np.array(part) for part in levels(self.solid.shape)(local.T, self.half, self.edge))
        slope = np.maximum(np.linalg.norm(gradient, axis=0), 1e-12)
        normal = (gradient / slope).T @ self.axes.T
        return (value.ravel() / slope).reshape(points.shape[:-1]), normal.reshape(points.shape)

    def along(self, start: Array, directions: Array) -> Array:
        """Points (K, 3) where rays from a point inside leave it in directions (K, 3)."""
        near, far = np.zeros(len(directions)), np.full(len(directions), 2.0 * self.solid.size)
        for _ in range(_HALVINGS):
            middle = 0.5 * (near + far)
            inside = self.distance(start + middle[:, None] * directions)[0] < 0.0
            near, far = np.where(inside, middle, near), np.where(inside, far, middle)
        return np.asarray(start + near[:, None] * directions)

    def section(self, frame: PlaneFrame, count: int = 181) -> Array:
        """Section of it with a plane, in the plane's x and y (count, 2) [m]; empty where the plane misses it."""
        normal = frame.axes[:, 2]
        inside = self.center - normal * float(normal @ (self.center - frame.base))
        if self.distance(inside[None])[0][0] >= 0.0:
            return np.zeros((0, 2))
        turn = np.linspace(0.0, 2.0 * np.pi, count)
        directions = np.cos(turn)[:, None] * frame.axes[:, 0] + np.sin(turn)[:, None] * frame.axes[:, 1]
        return np.asarray((self.along(inside, directions) - frame.base) @ frame.axes[:, :2])

    def mesh(self, count: int = 33) -> Array:
        """Points of its surface on a grid (count, 2 count, 3) [m], for pictures."""
        up, around = np.linspace(0.0, np.pi, count)[:, None], np.linspace(0.0, 2.0 * np.pi, 2 * count)
        local = [np.sin(up) * np.cos(around), np.sin(up) * np.sin(around), np.cos(up) * np.ones_like(around)]
        directions = np.stack(local, axis=-1).reshape(-1, 3) @ self.axes.T
        return self.along(self.center, directions).reshape(count, 2 * count, 3)
