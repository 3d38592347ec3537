"""Fingers and objects in a plane."""

from __future__ import annotations

from typing import Any

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.grasp.rods.geometry import Geometry, Matrix, Values, library
from continuum_grasp.model import PlaneRod


class Planar(PlaneRod, Geometry):
    """The plane: states (x, y, a, M) with the direction (-sin a, cos a), poses (x, y, angle)."""

    name = "plane"
    dimensions, oriented, sides, pose, axes = 2, 3, 0, 3, 0
    steps, finer, compiled = 4, 1, False

    def tangent(self, state: Values) -> Values:
        """Direction of the finger (2,)."""
        lib = library(state[2])
        return [-lib.sin(state[2]), lib.cos(state[2])]

    def bent(self, base: Array, x: float, y: float, angle: float, moment: float) -> Array:
        """State (4,) by what the base (3,) sees."""
        cosine, sine = np.cos(base[2]), np.sin(base[2])
        return np.array([base[0] + cosine * x - sine * y, base[1] + sine * x + cosine * y, base[2] + angle, moment])

    def turn(self, pose: Values, axes: Values) -> Matrix:
        """Axes of the object as columns."""
        lib = library(pose[2])
        cosine, sine = lib.cos(pose[2]), lib.sin(pose[2])
        return [[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]]

    def section_turn(self, state: Values, change: Values) -> list[Any]:
        """Small turn (3,) of a section by the change (3,) of its place and direction."""
        return [0.0, 0.0, change[2]]

    def object_turn(self, pose: Values, change: Values) -> list[Any]:
        """Small turn (3,) of the object by the change (3,) of its pose."""
        return [0.0, 0.0, change[2]]

    def cuts(self, p: Array, q: Array) -> Array:
        """Whether the chords of two lines cut each other."""
        a, b, c, d = p[:-1, None], p[1:, None], q[None, :-1], q[None, 1:]
        apart = (
            _crossed(b - a, c - a) * _crossed(b - a, d - a) < 0,
            _crossed(d - c, a - c) * _crossed(d - c, b - c) < 0,
        )
        return np.asarray(apart[0] & apart[1])


def _crossed(a: Array, b: Array) -> Array:
    """Cross products (...,) of vectors of the plane (..., 2)."""
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


PLANE = Planar()
"""The geometry of planar scenes."""
