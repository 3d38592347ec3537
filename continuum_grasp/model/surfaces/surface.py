"""Interface of contacts, grasp problem and grasp search to the surface of a part of any form: expressions, and the
outline with distances and walks of many points at once.

The state of a surface only determines the structure of its expressions, so that problems of equal structure share one
compiled solver; the numbers of a part are arguments.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, ClassVar, Generic, TypeVar

import casadi as ca
import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.model.planar import Scalar, Vec
from continuum_grasp.scene import Part


@dataclass(frozen=True)
class Walk:
    """Places on an outline, and their derivatives with respect to w."""

    point: Array  # complex
    angle: Array  # of the outward normal [rad]
    dpoint: Array  # complex
    dangle: Array


def picked(values: Array, index: Array) -> Array:
    """Entries of values (..., K) at an index (...) each; `numpy.take_along_axis` takes longer for few."""
    flat = values.reshape(-1, values.shape[-1])
    return np.asarray(flat[np.arange(len(flat)), index.ravel()].reshape(index.shape))


class PartOutline(ABC):
    """The outline of a part: distances and walks along it, many points at once.

    Planar vectors are complex numbers x + i y. A walk is a number w that runs once round in [0, period): along faces
    it counts meters, on corners it turns the normal while the point stays (or runs along the rounding). So faces and
    corners are one smooth family of contacts.
    """

    is_round: bool = False  # whether it looks the same from all directions
    face_normals: tuple[float, ...] = ()  # angles of the normals of flat faces [rad]
    period: float = math.tau  # of walks
    breaks: Array = np.zeros(0)  # walks to jumps of the normal, at reflex corners

    @abstractmethod
    def walk(self, w: Array) -> Walk:
        """Places at walks ``w`` (any shape)."""

    @abstractmethod
    def nearest(self, points: Array) -> tuple[Array, Array]:
        """Signed distances of points from the part, and the walks of the nearest places."""

    def distance(self, points: Array) -> Array:
        """Signed distances of points from the part."""
        return self.nearest(points)[0]

    def rough_distance(self, points: Array) -> Array:
        """Return the distance to within 1e-5 of the part's size, if this is faster."""
        return self.distance(points)

    @property
    @abstractmethod
    def rough_numbers(self) -> list[float]:
        """Numbers that `rough_distance` is computed from, as `curves.c` of the grasp reads it."""

    @abstractmethod
    def extremes(self, direction: complex, flat: float) -> list[tuple[complex, float]]:
        """Outermost points of the part in a direction, and how much less far out they are: one, or the two ends of a
        face that is level to within ``flat``.
        """


P = TypeVar("P", bound=Part)

ROUND = 1e-9
"""Radius of a sharp corner, in a unit of lengths: its distance is off by that much."""
TINY = 1e-30
"""Keeps roots and powers of a square differentiable at zero [unit of the square]; far below rounding."""


@dataclass(frozen=True)
class TouchingCircle:
    """Osculating circle of a surface at the place nearest to a point.

    The point's distances from circle and surface differ by the third power of the motion of the nearest place along the
    surface. The circle is exact for discs and corners, and for faces, whose curvature is zero.
    """

    SIZE: ClassVar[int] = 5
    """Numbers of a circle."""

    numbers: Any  # expressions (5,), or an array (5, K): x, y, normal x, normal y, curvature

    @property
    def is_corner(self) -> Any:
        """Whether it stands for a sharp corner; of arrays (K,)."""
        return self.numbers[4] >= 1.0 / ROUND

    def distance(self, point: ca.SX) -> ca.SX:
        """Distance (1, K) of points (2, K), each from a circle of its own (5, K)."""
        off = point - self.numbers[:2, :]
        normal = self.numbers[2:4, :]
        bend = self.numbers[4, :]
        along = ca.sum1(off * normal)
        across = off[1, :] * normal[0, :] - off[0, :] * normal[1, :]
        # |x - c| - r without a difference of large numbers; TINY: differentiable at the center.
        reach = ca.sqrt((1.0 + bend * along) ** 2 + (bend * across) ** 2 + TINY)
        away: ca.SX = (bend * ca.sum1(off**2) + 2.0 * along) / (1.0 + reach)
        return away


# -- contact in motion -------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Nearest:
    """Signed distance from a surface [m], negative inside, and the outward normal at the nearest point."""

    distance: Scalar
    normal: Vec


def length(v: Vec) -> ca.SX:
    """Return the length of a vector, with a finite derivative at zero."""
    return ca.sqrt(v.dot(v) + TINY)


def chosen(condition: ca.SX | bool, first: Vec, second: Vec) -> Vec:
    """The first vector where a condition holds, else the second."""
    # One product instead of two if_else: the condition is 0 or 1, and both vectors are finite.
    return second + (first - second).scaled(ca.SX(condition))


# -- contact of a grasp ------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class SurfacePoint:
    """A point on a part, as expressions in the object's frame."""

    point: ca.SX  # (2, 1)
    normal: ca.SX  # (2, 1) outward
    on_surface: ca.SX  # zero on the surface; empty if the construction ensures it
    curvature: ca.SX | None = None  # of the surface; None if it is a number of the feature


@dataclass(frozen=True)
class Feature:
    """Part of an outline along which a contact may slide in one run of the solver: numbers and bounds."""

    numbers: tuple[float, ...]  # of `Surface.point`; lengths in m
    lower: tuple[float, ...]  # bounds of the unknowns of the contact's place
    upper: tuple[float, ...]
    curvature: float = 0.0  # [1/m]: 0 on a face or if it depends on the place, large on a sharp corner
    piece: int = 0  # number of the piece of the outline in its middle
    grown: float = 0.0  # radius of the round body that touches there [m]


class Surface(ABC, Generic[P]):
    """The surface of one kind of part.

    In the expressions of the grasp problem, ``place`` are the unknowns of a contact, ``feature`` the numbers of the
    feature that it sits on, and ``numbers`` the numbers of the part.
    """

    place_count: int  # unknowns of a contact's place
    number_count: int  # of a part
    feature_count: int  # numbers of a feature

    # -- contact in motion

    @abstractmethod
    def nearest(self, part: P, at: Vec) -> Nearest:
        """Distance of a point of the object's frame [m], and the normal at the nearest point of the surface."""

    @abstractmethod
    def lowest_points(self, part: P, direction: Vec) -> list[Vec]:
        """Return points that include the farthest one in a direction (a unit vector)."""

    # -- contact of a grasp

    @abstractmethod
    def point(self, place: ca.SX, feature: ca.SX) -> SurfacePoint:
        """The surface point of a contact."""

    @abstractmethod
    def wall_clearance(self, normal: ca.SX, point: ca.SX, angle: ca.SX, pose: ca.SX, numbers: ca.SX) -> list[ca.SX]:
        """Heights above a wall, through a point with a normal in the direction of an angle, that must not be
        negative.
        """

    @abstractmethod
    def numbers(self, part: P, unit: float) -> list[float]:
        """The numbers of a part, lengths in a unit [m]."""

    @abstractmethod
    def feature_numbers(self, feature: Feature, unit: float) -> list[float]:
        """The numbers of a feature, lengths in a unit [m]."""

    @abstractmethod
    def feature(self, part: P, piece: int, grown: float) -> Feature:
        """The feature about a piece of the outline, for a round body of radius ``grown`` [m]."""

    @abstractmethod
    def near(self, part: P, point: tuple[float, float], normal_angle: float, grown: float) -> Feature:
        """Return the best feature for a surface point with this outward normal, as in `feature`."""

    @abstractmethod
    def place(self, part: P, feature: Feature, point: tuple[float, float], normal_angle: float) -> tuple[float, ...]:
        """The unknowns of a contact on a feature, next to a point of the object's frame [m]."""

    def beyond(self, part: P, feature: Feature, side: int) -> tuple[Feature, tuple[float, ...]] | None:
        """Return the feature after (+1) or before (-1) another one, and the unknowns at their common end.

        None if a contact cannot roll or slide on to it.
        """
        return None

    def nearest_places(self, part: P, points: Array) -> tuple[Array, Array, Array]:
        """Angles (K,) of the outward normals [rad] at the surface points nearest to points (K, 2) of the object's
        frame, the distances (K,) [m], negative inside, and the curvatures (K,) there [1/m], infinite at a sharp corner.
        """
        outline = self.outline(part)
        distances, walks = outline.nearest(points[:, 0] + 1j * points[:, 1])
        at = outline.walk(walks)
        with np.errstate(divide="ignore"):
            return at.angle, distances, at.dangle / np.abs(at.dpoint)

    def circles(self, part: P, points: Array, unit: float) -> tuple[Array, Array]:
        """Numbers (5, K) of circles that stand for the surface near points (K, 2) of the object's frame, and their
        distances (K,), in a unit [m]; see `TouchingCircle`.
        """
        angles, distances, curvatures = self.nearest_places(part, points)
        normals = np.stack([np.cos(angles), np.sin(angles)])
        foot = (points.T - distances * normals) / unit
        return np.vstack([foot, normals, np.minimum(curvatures * unit, 1.0 / ROUND)]), distances / unit

    # -- search of a grasp

    @abstractmethod
    def new_outline(self, part: P) -> PartOutline:
        """Make the outline of a part in the object's frame."""

    def outline(self, part: P) -> PartOutline:
        """The outline of a part in the object's frame, made once."""
        return _outline(self, part)


@lru_cache(maxsize=256)
def _outline(surface: Surface[P], part: P) -> PartOutline:
    return surface.new_outline(part)
