"""Fixed surfaces in the way of a finger as data of blocks: planes, and posts, which are pegs or finite walls."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.grasp.rods import kinds
from continuum_grasp.grasp.rods.geometry import Geometry
from continuum_grasp.nlp import BlockKind


@dataclass(frozen=True, eq=False)
class FingerObstacle(ABC):
    """A surface that a finger keeps clear of, in units of the finger."""

    first: float  # place along the finger from which on it keeps clear
    emerging: float | None
    """Height that the finger's center line keeps clear of before its first contact, if its base is in the obstacle."""
    name: str

    @abstractmethod
    def kind(self, geometry: Geometry) -> BlockKind:
        """Kind of the row of a place of a stage."""

    @property
    @abstractmethod
    def data(self) -> list[float]:
        """Numbers of the surface."""

    @abstractmethod
    def height(self, points: Array) -> Array:
        """Distances (n,) of points (n, dimensions) from the surface."""

    @property
    @abstractmethod
    def shares(self) -> tuple[float, ...]:
        """Shares of each stage at which there are rows from the beginning."""

    def emerges(self, before: bool) -> bool:
        """Whether only the center line keeps clear at a place that is before the first contact or not."""
        return before and self.emerging is not None


@dataclass(frozen=True, eq=False)
class PlaneObstacle(FingerObstacle):
    """A half space."""

    normal: Array
    level: float  # place along the normal

    shares = (1.0,)

    def kind(self, geometry: Geometry) -> BlockKind:
        """Kind of the row of a place of a stage."""
        return kinds.wall_kind(geometry)

    @property
    def data(self) -> list[float]:
        """Normal and place along it."""
        return [*self.normal, self.level]

    def height(self, points: Array) -> Array:
        """Heights of points above the plane."""
        return np.asarray(points @ self.normal - self.level)


@dataclass(frozen=True, eq=False)
class PostObstacle(FingerObstacle):
    """A segment with a radius: a peg has no length, a finite wall no radius."""

    begin: Array
    end: Array
    radius: float

    # A peg may be smaller than a stage.
    shares = (0.5, 1.0)

    def kind(self, geometry: Geometry) -> BlockKind:
        """Kind of the row of a place of a stage."""
        return kinds.post_kind(geometry)

    @property
    def data(self) -> list[float]:
        """Ends and radius."""
        return [*self.begin, *self.end, self.radius]

    def height(self, points: Array) -> Array:
        """Distances of points from the post."""
        along = self.end - self.begin
        # 1e-12: no division by zero where a post has no length
        share = np.clip((points - self.begin) @ along / (along @ along + 1e-12), 0.0, 1.0)
        return np.asarray(np.linalg.norm(points - self.begin - share[:, None] * along, axis=1) - self.radius)
