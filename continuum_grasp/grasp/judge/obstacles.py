"""The exact object of a scene and its supports in the world; all other files of the certificate ask these."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod

import numpy as np

from continuum_grasp.base import Numbers as Array
from continuum_grasp.grasp.hand.surfaces import PlacedSolid
from continuum_grasp.grasp.judge.held import HeldRods, HeldSupport
from continuum_grasp.grasp.judge.surfaces import PlacedObject
from continuum_grasp.scene import GraspScene, HandScene, Peg, Wall

_ALONG = np.linspace(0.0, 1.0, 41)
"""Places along a finite line at which its distance from the object is sampled; it is then sought closer and closer."""
_ROUNDS = 6
"""Rounds of that search, each twenty times as fine."""


class ExactObject(ABC):
    """The object of a scene where a grasp has it."""

    @staticmethod
    def of(scene: GraspScene | HandScene, held: HeldRods) -> ExactObject:
        """The object of a scene."""
        return _PlaneObject(scene, held) if isinstance(scene, GraspScene) else _SolidObject(scene, held)

    @abstractmethod
    def near(self, points: Array) -> tuple[Array, Array]:
        """Signed distances (n,) of points (n, 3) [m], negative inside, and outward normals (n, 3)."""

    @abstractmethod
    def height(self, point: Array, normal: Array) -> float:
        """Least height of the object above a plane by a point and the normal (3,) [m], negative behind it."""

    def distance(self, points: Array) -> Array:
        """Signed distances (n,) of points (n, 3) [m], negative inside."""
        return self.near(points)[0]

    def normal(self, point: Array) -> Array:
        """Outward normal (3,) at a point (3,) [m]."""
        return np.asarray(self.near(point[None])[1][0])


class _PlaneObject(ExactObject):
    """A prism along z over the outline of a planar scene."""

    def __init__(self, scene: GraspScene, held: HeldRods) -> None:
        angle = math.atan2(held.axes[1, 0], held.axes[0, 0])
        self._body = PlacedObject(scene.object, np.array([*held.position[:2], angle]))

    def near(self, points: Array) -> tuple[Array, Array]:
        flat = points[:, :2]
        each = [self._body.nearest(flat, part) for part in self._body.parts]
        distances, normals = np.stack([spot.distance for spot in each]), np.stack([spot.normal for spot in each])
        nearest = distances.argmin(axis=0), np.arange(len(flat))
        return distances[nearest], np.column_stack([normals[nearest], np.zeros(len(flat))])

    def distance(self, points: Array) -> Array:
        return self._body.distance(points[:, :2])

    def height(self, point: Array, normal: Array) -> float:
        return float(((self._body.farthest(-normal[:2]) - point[:2]) @ normal[:2]).min())


class _SolidObject(ExactObject):
    """The solid of a hand's scene, which stands where the scene has it: places are moved there."""

    def __init__(self, scene: HandScene, held: HeldRods) -> None:
        self._body = PlacedSolid(scene)
        self._own, self._held = np.array(scene.object.position), held.position
        self._turn = scene.object.axes @ held.axes.T

    def near(self, points: Array) -> tuple[Array, Array]:
        found = self._body.nearest(self._moved(points))
        return found.distance, found.normal @ self._turn

    def distance(self, points: Array) -> Array:
        return self._body.distance(self._moved(points))

    def height(self, point: Array, normal: Array) -> float:
        return self._body.height(self._moved(point), self._turn @ normal)

    def _moved(self, points: Array) -> Array:
        return np.asarray(self._own + (points - self._held) @ self._turn.T)


class Obstacle(ABC):
    """A fixed surface that may carry the object and that fingers keep clear of."""

    def __init__(self, name: str, touch: str, friction: float) -> None:
        self.name, self.touch = name, touch
        self.friction = friction
        """Coefficient with which contacts are certified [1]."""
        self.curvature = 0.0
        """Curvature of the surface, convex positive [1/m]."""

    @staticmethod
    def each(scene: GraspScene | HandScene) -> list[Obstacle]:
        """The obstacles of a scene."""
        if isinstance(scene, GraspScene):
            walls = (_Flat(w.name, w.touch, scene.held_friction(w.name), _in_space(w), thin=True) for w in scene.walls)
            return [*walls, *(_Round(peg, scene.held_friction(peg.name)) for peg in scene.pegs)]
        return [
            _Flat(
                plane.name,
                plane.touch,
                (1.0 - scene.contacts.reserve) * plane.friction,
                (np.array(plane.point), np.array(plane.normal), plane.radius),
                thin=False,
            )
            for plane in scene.supports
        ]

    @abstractmethod
    def distance(self, points: Array) -> Array:
        """Distances (n,) of points (n, 3) from the material [m], negative inside."""

    @abstractmethod
    def depth_of(self, body: ExactObject) -> float:
        """Depth of the object in it [m], negative where they are apart."""

    @abstractmethod
    def touched(self, contact: HeldSupport, body: ExactObject) -> tuple[Array, float]:
        """Outward normal (3,) of the object at a contact, and by how much its position misses both surfaces [m]."""


def _in_space(wall: Wall) -> tuple[Array, Array, float]:
    return np.array([*wall.point, 0.0]), np.array([*wall.normal, 0.0]), wall.half_length


class _Flat(Obstacle):
    """A half space, the pillar behind a disc, or a line without material behind it."""

    def __init__(
        self, name: str, touch: str, friction: float, plane: tuple[Array, Array, float], *, thin: bool
    ) -> None:
        super().__init__(name, touch, friction)
        self._point, self._normal, self._radius = plane
        self._thin = thin and math.isfinite(self._radius)

    def distance(self, points: Array) -> Array:
        heights, beside = self._parts(points)
        if self._thin:
            return np.hypot(heights, np.maximum(beside, 0.0))
        outside = np.hypot(np.maximum(heights, 0.0), np.maximum(beside, 0.0))
        return np.asarray(outside + np.minimum(np.maximum(heights, beside), 0.0))

    def depth_of(self, body: ExactObject) -> float:
        if not self._thin:
            return -body.height(self._point, self._normal)
        across = np.array([-self._normal[1], self._normal[0], 0.0])
        low, high = -self._radius, self._radius
        for _ in range(_ROUNDS):
            places = low + _ALONG * (high - low)
            away = body.distance(self._point + places[:, None] * across)
            k = int(away.argmin())
            low, high = places[max(k - 1, 0)], places[min(k + 1, _ALONG.size - 1)]
        return -float(away[k])

    def touched(self, contact: HeldSupport, body: ExactObject) -> tuple[Array, float]:
        place = contact.position[None]
        heights, beside = self._parts(place)
        off = math.hypot(float(heights[0]), max(float(beside[0]), 0.0))
        return -self._normal, max(abs(float(body.distance(place)[0])), off)

    def _parts(self, points: Array) -> tuple[Array, Array]:
        """Heights of points above the plane, and distances along it beyond its end or rim [m]."""
        away = points - self._point
        heights = away @ self._normal
        return heights, np.linalg.norm(away - heights[:, None] * self._normal, axis=1) - self._radius


class _Round(Obstacle):
    """A peg of a planar scene."""

    def __init__(self, peg: Peg, friction: float) -> None:
        super().__init__(peg.name, peg.touch, friction)
        self._center, self._radius = np.array([*peg.position, 0.0]), peg.radius
        self.curvature = 1.0 / peg.radius if peg.radius else np.inf

    def distance(self, points: Array) -> Array:
        return np.asarray(np.linalg.norm(points - self._center, axis=1) - self._radius)

    def depth_of(self, body: ExactObject) -> float:
        return self._radius - float(body.distance(self._center[None])[0])

    def touched(self, contact: HeldSupport, body: ExactObject) -> tuple[Array, float]:
        distance, normal = body.near(self._center[None])
        place = self._center - self._radius * normal[0]
        off = float(np.linalg.norm(place - contact.position))
        return normal[0], max(abs(float(distance[0]) - self._radius), off)
