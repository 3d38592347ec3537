"""The outline of a part for the search of grasps: distances and walks, many points at once."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

import numpy as np

from continuum_grasp.arrays import Array


@dataclass(frozen=True)
class Frame:
    """A change of coordinates z -> turn * scale * z + shift, with conj(z) in place of z where mirrored."""

    turn: complex = 1.0 + 0.0j  # of modulus one
    shift: complex = 0.0j  # in the new coordinates
    scale: float = 1.0  # new lengths per old ones
    mirrored: bool = False

    def point(self, z: Array | complex) -> Any:
        """New coordinates of points."""
        return self.turn * self.scale * (np.conj(z) if self.mirrored else z) + self.shift

    def angle(self, angle: float | Array) -> Any:
        """New angle of directions [rad]."""
        return math.atan2(self.turn.imag, self.turn.real) + (-angle if self.mirrored else angle)

    def back(self, z: Array | complex) -> Any:
        """Old coordinates of points."""
        old = (z - self.shift) / (self.turn * self.scale)
        return np.conj(old) if self.mirrored else old

    def angle_back(self, angle: float | Array) -> Any:
        """Old angle of directions [rad]."""
        old = angle - math.atan2(self.turn.imag, self.turn.real)
        return -old if self.mirrored else old


@dataclass(frozen=True)
class Walk:
    """Places on a grown outline, and their derivatives with respect to w."""

    point: Array  # complex
    angle: Array  # of the outward normal [rad]
    dpoint: Array  # complex
    dangle: Array


def picked(values: Array, index: Array) -> Array:
    """Entries of values (..., K) at an index (...) each; `numpy.take_along_axis` takes longer for few."""
    flat = values.reshape(-1, values.shape[-1])
    return np.asarray(flat[np.arange(len(flat)), index.ravel()].reshape(index.shape))


class Outline(ABC):
    """A part grown by the fingers' half thickness: distances and walks along its outline, many points at once.

    Planar vectors are complex numbers x + i y. A walk is a number w that runs once round in [0, period): along faces
    it counts meters, on corners it turns the normal while the point stays (or runs along the rounding). So faces and
    corners are one smooth family of contacts.
    """

    center: complex
    extent: float  # no point of the part is farther from the center
    grown: float  # distance of the outline from ``corners``, or from the part where there are none
    corners: Array  # complex centers of the rounded corners; empty for a smooth part
    face_normals: tuple[float, ...] = ()  # angles of the normals of flat faces [rad]
    period: float = math.tau  # of walks
    breaks: Array = np.zeros(0)  # walks at which the normal jumps, at reflex corners
    joints: Array = np.zeros(0)  # walks at which faces and corners join

    @property
    def is_round(self) -> bool:
        """Whether it looks the same from all directions."""
        return len(self.corners) == 1

    @abstractmethod
    def walk(self, w: Array) -> Walk:
        """Places at walks ``w`` (any shape)."""

    @abstractmethod
    def nearest(self, points: Array) -> tuple[Array, Array]:
        """Signed distances of points from the part itself (not grown), and the walks of the nearest places."""

    def distance(self, points: Array) -> Array:
        """Signed distances of points from the part itself (not grown)."""
        return self.nearest(points)[0]

    def rough_distance(self, points: Array) -> Array:
        """Distance to within 1e-5 of the part's size, where that takes less time."""
        return self.distance(points)

    @property
    @abstractmethod
    def rough_numbers(self) -> list[float]:
        """Numbers that `rough_distance` is computed from, as the kernel of the scan reads it."""

    @abstractmethod
    def extremes(self, direction: complex, flat: float) -> list[tuple[complex, float]]:
        """Outermost points of the part in a direction, and how much less far out they are: one, or the two ends of a
        face that is level to within ``flat``.
        """
