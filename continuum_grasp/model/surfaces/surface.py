"""What contacts, grasp problem and grasp search ask of the surface of a convex part, whatever its form.

A surface is stateless but for what decides how its expressions look, so that problems of equal structure share one
compiled solver; the numbers of a part are handed in.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from continuum_grasp.model.planar import Scalar, Vec
from continuum_grasp.model.surfaces.outline import Frame, Outline
from continuum_grasp.scene.parts import Part

Array = NDArray[Any]
P = TypeVar("P", bound=Part)

CORNERS = 3
"""Corners of a polygon that a place must stay clear of: the nearest one and its two neighbors, which the search renews;
the others cannot be nearest before it looks again."""
TINY = 1e-30
"""Keeps the root of a squared distance differentiable at zero [m2]; far below rounding."""


# -- contact in motion -------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Nearest:
    """Signed distance from a surface [m], negative inside, and the outward normal at the nearest point."""

    distance: Scalar
    normal: Vec


def length(v: Vec) -> ca.SX:
    """Length of a vector, with a finite derivative where it is zero."""
    return ca.sqrt(v.dot(v) + TINY)


def chosen(condition: ca.SX | bool, first: Vec, second: Vec) -> Vec:
    """The first vector where a condition holds, else the second."""
    # One product in place of two if_else: the condition is 0 or 1, and both vectors are finite.
    return second + (first - second).scaled(ca.SX(condition))


# -- contact of a grasp ------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class SurfacePoint:
    """A point on a part, as expressions in the object's frame."""

    point: ca.SX  # (2, 1)
    normal: ca.SX  # (2, 1) outward
    on_surface: ca.SX  # zero on the surface; empty where that is so by construction
    curvature: ca.SX | None = None  # of the surface; None where it is a number of the feature


@dataclass(frozen=True)
class Feature:
    """A face, a corner, or a whole smooth part: numbers and bounds of a contact on it."""

    numbers: tuple[float, ...]  # of `Surface.point`; lengths in m
    lower: tuple[float, float]  # bounds of the two unknowns of the contact's place
    upper: tuple[float, float]
    curvature: float = 0.0  # [1/m]: 0 on a face or where it depends on the place, large on a sharp corner


class Surface(ABC, Generic[P]):
    """The surface of one kind of part.

    In the expressions of the grasp problem, ``place`` are the two unknowns of a contact, ``feature`` the numbers of the
    feature that it sits on, ``numbers`` those of the part, and ``beta`` is the angle of a separating line's normal
    [rad], empty where the surface has no such directions.
    """

    number_count: int  # of a part
    feature_count: int  # numbers of a feature
    is_smooth = False  # whether it is one feature, of which each place has its own normal
    has_directions = True  # whether a place that must stay clear needs a separating line's angle as an unknown
    looks_at_corners = False  # whether a place must stay clear of the nearest corners alone

    @classmethod
    @abstractmethod
    def of(cls, part: P) -> Surface[P]:
        """The surface of a part."""

    # -- contact in motion

    @abstractmethod
    def nearest(self, part: P, at: Vec) -> Nearest:
        """Distance of a point of the object's frame [m], and the normal at the nearest point of the surface."""

    @abstractmethod
    def lowest_points(self, part: P, direction: Vec) -> list[Vec]:
        """Points that may reach farthest in a direction (a unit vector), one of which does."""

    # -- contact of a grasp

    @abstractmethod
    def point(self, place: ca.SX, feature: ca.SX) -> SurfacePoint:
        """The surface point of a contact."""

    @abstractmethod
    def clearance(self, point: ca.SX, beta: ca.SX, numbers: ca.SX, near: ca.SX | None) -> ca.SX:
        """Lengths that are all at most the distance of a point, and equal to it in the best direction.

        ``near`` are the nearest corners, where the surface looks at these.
        """

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
    def features(self, part: P) -> list[Feature]:
        """What contacts can sit on, counter-clockwise."""

    @abstractmethod
    def place(self, part: P, feature: Feature, point: tuple[float, float], normal_angle: float) -> tuple[float, float]:
        """The unknowns of a contact on a feature, next to a point of the object's frame [m]."""

    def nearest_feature(self, part: P, point: tuple[float, float], normal_angle: float) -> int:
        """Index among the features of that on which a surface point with this outward normal lies best."""
        return 0

    @abstractmethod
    def nearest_places(self, part: P, points: Array) -> tuple[Array, Array]:
        """Angles (K,) of the outward normals [rad] at the surface points nearest to points (K, 2) of the object's
        frame, and the distances (K,) [m], negative inside.
        """

    def near_corners(self, part: P, points: Array) -> Array:
        """Nearest corner of the core to each point (K, 2) and its neighbors, x and y one after the other
        (K, 2 * CORNERS) [m]; zeros where the surface does not look at corners.
        """
        return np.zeros((len(points), 2 * CORNERS))

    # -- search of a grasp

    @abstractmethod
    def outline(self, part: P, frame: Frame, grown: float) -> Outline:
        """The outline in other coordinates, grown by a distance of these coordinates."""


def separation(point: ca.SX, beta: ca.SX, corners: ca.SX) -> ca.SX:
    """Heights (M,) of a point above lines through the corners (2, M) whose normal is in direction ``beta``.

    A point x is at least d away from a convex part if there is a direction n(beta) with n . x - H(beta) >= d, where H
    is the part's support function; the distance itself is the greatest of these. So beta is an unknown of the problem,
    one per place that must stay clear. For an offset polygon H is the greatest of n . v + r over its corners v.
    """
    normal = ca.vertcat(ca.cos(beta), ca.sin(beta))
    return ca.vertcat(*(ca.dot(normal, point - corners[:, k]) for k in range(corners.shape[1])))
