"""Planar vectors and rotations of CasADi scalars.

Scalars may be floats or ``casadi.SX``; sums with a zero and products with a zero or a one cost no instruction.
Inside the model the X axis points along the undeformed backbone, so that the tangent at bending angle phi is
(cos phi, sin phi) and its derivative is the tangent turned by a right angle, ``perp``.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TypeAlias

import casadi as ca

__all__ = ["IDENTITY", "ZERO", "Rotation", "Scalar", "Vec", "combine", "minus", "plus", "times"]

Scalar: TypeAlias = ca.SX | float


def times(a: Scalar, b: Scalar) -> Scalar:
    """Product that folds constants."""
    for u, v in ((a, b), (b, a)):
        if isinstance(u, (int, float)):
            if u == 0.0:
                return 0.0
            if u == 1.0:
                return v
    return a * b


def plus(a: Scalar, b: Scalar) -> Scalar:
    """Sum that folds zeros."""
    if isinstance(a, (int, float)) and a == 0.0:
        return b
    if isinstance(b, (int, float)) and b == 0.0:
        return a
    return a + b


def minus(a: Scalar, b: Scalar) -> Scalar:
    """Difference that folds zeros."""
    if isinstance(b, (int, float)) and b == 0.0:
        return a
    if isinstance(a, (int, float)) and a == 0.0:
        return -b
    return a - b


def combine(scale: Scalar, terms: Iterable[tuple[float, Scalar]]) -> Scalar:
    """``scale * sum(coefficient * value)``, with a numeric scale folded into the coefficients."""
    pairs = [(c, v) for c, v in terms if c != 0.0 and not (isinstance(v, float) and v == 0.0)]
    if isinstance(scale, (int, float)):
        total: Scalar = 0.0
        for c, v in pairs:
            total = plus(total, times(scale * c, v))
        return total
    return times(scale, combine(1.0, pairs))


class Vec:
    """A planar vector."""

    __slots__ = ("x", "y")

    def __init__(self, x: Scalar, y: Scalar) -> None:
        self.x = x
        self.y = y

    def __add__(self, other: Vec) -> Vec:
        return Vec(plus(self.x, other.x), plus(self.y, other.y))

    def __sub__(self, other: Vec) -> Vec:
        return Vec(minus(self.x, other.x), minus(self.y, other.y))

    def scaled(self, factor: Scalar) -> Vec:
        """The vector times a scalar."""
        return Vec(times(factor, self.x), times(factor, self.y))

    def dot(self, other: Vec) -> Scalar:
        """Scalar product."""
        return plus(times(self.x, other.x), times(self.y, other.y))

    def cross(self, other: Vec) -> Scalar:
        """Component of the vector product out of the plane."""
        return minus(times(self.x, other.y), times(self.y, other.x))

    def perp(self) -> Vec:
        """The vector turned by +90 degrees."""
        return Vec(_negative(self.y), self.x)

    def column(self) -> ca.SX:
        """2 x 1 CasADi column."""
        return ca.vertcat(ca.SX(self.x), ca.SX(self.y))


class Rotation:
    """A planar rotation by its cosine and sine."""

    __slots__ = ("c", "s")

    def __init__(self, c: Scalar, s: Scalar) -> None:
        self.c = c
        self.s = s

    def __matmul__(self, other: Rotation) -> Rotation:
        return Rotation(
            minus(times(self.c, other.c), times(self.s, other.s)),
            plus(times(self.s, other.c), times(self.c, other.s)),
        )

    def apply(self, v: Vec) -> Vec:
        """Components in the outer axes of a vector given in the inner axes."""
        return Vec(
            minus(times(self.c, v.x), times(self.s, v.y)),
            plus(times(self.s, v.x), times(self.c, v.y)),
        )

    def transposed(self) -> Rotation:
        """The inverse rotation."""
        return Rotation(self.c, _negative(self.s))


ZERO = Vec(0.0, 0.0)
IDENTITY = Rotation(1.0, 0.0)


def _negative(a: Scalar) -> Scalar:
    return -a if not (isinstance(a, (int, float)) and a == 0.0) else 0.0
