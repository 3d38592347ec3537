"""Planar vectors, rotations and linear systems of CasADi scalars.

Scalars may be floats or ``casadi.SX``; CasADi folds sums with a zero and products with a zero or a one.
Inside the model the X axis points along the undeformed backbone, so that the tangent at bending angle phi is
(cos phi, sin phi) and its derivative is the tangent turned by a right angle, ``perp``.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import TypeAlias

import casadi as ca

Scalar: TypeAlias = ca.SX | float


def is_zero(value: Scalar) -> bool:
    """Whether it is a number, and that zero: expressions are never compared."""
    return isinstance(value, float) and value == 0.0


def column(values: Sequence[Scalar]) -> ca.SX:
    """CasADi column of scalars."""
    return ca.vertcat(*[ca.SX(v) for v in values]) if values else ca.SX(0, 1)


def matrix(rows: Sequence[Sequence[Scalar]]) -> ca.SX:
    """CasADi matrix of scalars."""
    return ca.vertcat(*[ca.horzcat(*[ca.SX(v) for v in row]) for row in rows])


def solve_ldl(symmetric: Sequence[Sequence[Scalar]], right: Sequence[Scalar]) -> list[Scalar]:
    """Solve ``symmetric x = right`` for a positive definite matrix as L D L', reading its lower triangle."""
    # Written out in scalars, since CasADi's own linear solvers cannot be expanded to SX and generated as straight code;
    # no pivots are needed for a mass matrix, which is positive definite, and the code then has no branches.
    n = len(right)
    a = [list(row) for row in symmetric]
    inverse: list[Scalar] = [0.0] * n
    factor: list[list[Scalar]] = [[0.0] * n for _ in range(n)]
    y = list(right)
    for j in range(n):
        inverse[j] = 1.0 / a[j][j]  # the only divisions of the dynamics: one per coordinate
        for i in range(j + 1, n):
            factor[i][j] = a[i][j] * inverse[j]
        for i in range(j + 1, n):
            for k in range(j + 1, i + 1):
                a[i][k] -= factor[i][j] * a[k][j]
            y[i] -= factor[i][j] * y[j]
    x: list[Scalar] = [0.0] * n
    for i in range(n - 1, -1, -1):
        x[i] = y[i] * inverse[i]
        for k in range(i + 1, n):
            x[i] -= factor[k][i] * x[k]
    return x


def weighted_sum(weights: Iterable[float], values: Iterable[Scalar], scale: Scalar = 1.0) -> Scalar:
    """Compute ``scale * sum(weight * value)``.

    CasADi does not distribute a product over a sum: a numeric scale is multiplied into the weights here, which saves
    one instruction per sum.
    """
    if not isinstance(scale, (int, float)):
        return scale * weighted_sum(weights, values)
    scaled, terms = [scale * w for w in weights], list(values)
    if not any(isinstance(term, ca.SX) for term in terms):
        return sum((w * v for w, v in zip(scaled, terms, strict=True)), 0.0)
    # The same expression as a loop in Python gives, in a sixth of the time.
    return ca.dot(ca.DM(scaled), ca.vertcat(*terms))


class Vec:
    """A planar vector, zero by default."""

    __slots__ = ("x", "y")

    def __init__(self, x: Scalar = 0.0, y: Scalar = 0.0) -> None:
        self.x = x
        self.y = y

    @staticmethod
    def columns(vectors: Iterable[Vec]) -> ca.SX:
        """Return the vectors as (2, K), also for K = 0."""
        return ca.horzcat(ca.SX(2, 0), *[v.column() for v in vectors])

    def __add__(self, other: Vec) -> Vec:
        return Vec(self.x + other.x, self.y + other.y)

    def __sub__(self, other: Vec) -> Vec:
        return Vec(self.x - other.x, self.y - other.y)

    def scaled(self, factor: Scalar) -> Vec:
        """The vector times a scalar."""
        return Vec(factor * self.x, factor * self.y)

    def dot(self, other: Vec) -> Scalar:
        return self.x * other.x + self.y * other.y

    def cross(self, other: Vec) -> Scalar:
        """Component of the vector product out of the plane."""
        return self.x * other.y - self.y * other.x

    def perp(self) -> Vec:
        """The vector turned by +90 degrees."""
        return Vec(-self.y, self.x)

    def column(self) -> ca.SX:
        """2 x 1 CasADi column."""
        return ca.vertcat(ca.SX(self.x), ca.SX(self.y))


class Rotation:
    """A planar rotation by its cosine and sine; by default, no rotation."""

    __slots__ = ("c", "s")

    def __init__(self, c: Scalar = 1.0, s: Scalar = 0.0) -> None:
        self.c = c
        self.s = s

    def __matmul__(self, other: Rotation) -> Rotation:
        return Rotation(self.c * other.c - self.s * other.s, self.s * other.c + self.c * other.s)

    def apply(self, v: Vec) -> Vec:
        """Components in the outer axes of a vector given in the inner axes."""
        return Vec(self.c * v.x - self.s * v.y, self.s * v.x + self.c * v.y)

    def transposed(self) -> Rotation:
        return Rotation(self.c, -self.s)


def rotated(angle: float) -> Rotation:
    """The rotation by an angle [rad]; by zero it costs no instruction."""
    return Rotation(math.cos(angle), math.sin(angle)) if angle != 0.0 else IDENTITY


ZERO = Vec()
IDENTITY = Rotation()
