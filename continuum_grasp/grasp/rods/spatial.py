"""Fingers and objects in space."""

from __future__ import annotations

from typing import Any

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.grasp.rods.geometry import Geometry, Matrix, Value, Values, cross, dot


class Spatial(Geometry):
    """Space: states (place, unit quaternion q, moment M) in the hand's frame; poses (place, turn by Cayley's map).

        p' = t,  q' = q (0, o) / 2,  M' = -t x F,
        o = (M.e / (l B), M.t / (g B), k)

    e, t and z are the axes of the section, the columns of the rotation of q: across the finger in its plane, along it,
    and the axis of bending, about which the curvature is k. l B and g B are the stiffness to the side and the torsional
    stiffness. The rotation of a turn c (3,) is (1 + [c]) (1 - [c])^-1 with [c] v = c x v (A. Cayley, 1846).
    """

    name = "space"
    dimensions, state, oriented, sides, pose, axes = 3, 10, 7, 2, 6, 9
    steps, finer, compiled = 1, 2, True

    def tangent(self, state: Values) -> Values:
        """Direction of the finger (3,)."""
        return columns(state[3:7])[1]

    def bending(self, state: Values) -> Value:
        """Moment about the axis of bending of the section."""
        return dot(columns(state[3:7])[2], state[7:10])

    def rates(self, state: Values, force: Values, curvature: Value, stiffness: Value, sides: Values) -> Values:
        """Derivatives (10,) of a state along the finger."""
        e, t, _ = columns(state[3:7])
        moment = state[7:10]
        x, y = dot(e, moment) / (sides[0] * stiffness), dot(t, moment) / (sides[1] * stiffness)
        rate = [0.0, x, y, curvature]
        turning = [0.5 * part for part in multiplied(state[3:7], rate)]
        return [*t, *turning, *cross(force, t)]

    def bent(self, base: Array, x: float, y: float, angle: float, moment: float) -> Array:
        """State (10,) by what the base (7,) sees; the finger stays in the plane across its axis of bending."""
        e, t, z = (np.array(column) for column in columns(base[3:7]))
        about = [np.cos(0.5 * angle), 0.0, 0.0, np.sin(0.5 * angle)]
        return np.concatenate([base[:3] + x * e + y * t, multiplied(base[3:7], about), moment * z])

    def turn(self, pose: Values, axes: Values) -> Matrix:
        """Axes of the object as columns."""
        a, b, c = (pose[k] for k in (3, 4, 5))
        skew = [[0.0, -c, b], [c, 0.0, -a], [-b, a, 0.0]]
        square = [[dot(row, column) for column in zip(*skew, strict=True)] for row in skew]
        size = 2.0 / (1.0 + a * a + b * b + c * c)
        cayley = [[float(i == j) + size * (skew[i][j] + square[i][j]) for j in range(3)] for i in range(3)]
        given = [[axes[3 * i + j] for j in range(3)] for i in range(3)]
        return [[dot(row, column) for column in zip(*given, strict=True)] for row in cayley]

    def section_turn(self, state: Values, change: Values) -> list[Any]:
        """Small turn (3,) of a section by the change (7,) of its place and direction."""
        a, b, c, d = (state[k] for k in range(3, 7))
        return [2.0 * part for part in multiplied([change[k] for k in range(3, 7)], [a, -b, -c, -d])[1:]]

    def object_turn(self, pose: Values, change: Values) -> list[Any]:
        """Small turn (3,) of the object by the change (6,) of its pose."""
        turn, rate = [pose[k] for k in (3, 4, 5)], [change[k] for k in (3, 4, 5)]
        size = 2.0 / (1.0 + dot(turn, turn))
        return [size * (a + b) for a, b in zip(rate, cross(turn, rate), strict=True)]

    def cuts(self, p: Array, q: Array) -> Array:
        """Chords in space do not cut: fingers are in each other before that."""
        return np.zeros((len(p) - 1, len(q) - 1), dtype=bool)


def columns(q: Values) -> tuple[Values, Values, Values]:
    """Columns of the rotation of a unit quaternion (4,), the real part first."""
    a, b, c, d = (q[k] for k in range(4))
    return (
        [a * a + b * b - c * c - d * d, 2.0 * (b * c + a * d), 2.0 * (b * d - a * c)],
        [2.0 * (b * c - a * d), a * a - b * b + c * c - d * d, 2.0 * (c * d + a * b)],
        [2.0 * (b * d + a * c), 2.0 * (c * d - a * b), a * a - b * b - c * c + d * d],
    )


def multiplied(p: Values, q: Values) -> Values:
    """Product of quaternions (4,)."""
    a, v = p[0], [p[k] for k in (1, 2, 3)]
    b, w = q[0], [q[k] for k in (1, 2, 3)]
    both = cross(v, w)
    return [a * b - dot(v, w), *(a * w[k] + b * v[k] + both[k] for k in range(3))]


def quaternion_of(rotation: Array) -> Array:
    """Unit quaternion (4,) of a rotation matrix (3, 3)."""
    from scipy.spatial.transform import Rotation

    x, y, z, real = Rotation.from_matrix(rotation).as_quat()
    return np.array([real, x, y, z])


SPACE = Spatial()
"""The geometry of hands."""
