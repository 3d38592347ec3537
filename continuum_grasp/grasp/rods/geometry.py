"""Geometry of fingers: a plane, or space. It holds everything in which grasps of both differ.

A finger's state at a node is its place, its direction and the moment that the part beyond exerts. Bodies, contact
forces and the balance of the object have three coordinates in both: a planar grasp lies in the plane z = 0.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.model import StageEquations

Value = Any
"""A number, an array of numbers, or a symbol of CasADi."""
Values = Any
"""A sequence of these."""
Matrix = list[list[Any]]
"""Three rows of three values."""


class Geometry(StageEquations):
    """Sizes and equations of a rod and a pose in a plane, or in space."""

    name: str
    dimensions: int
    """Coordinates of a place, a force or a normal that a finger sees."""
    oriented: int
    """Numbers of a state that say its place and direction; they come first, then the moment."""
    sides: int
    """Stiffnesses of a section out of the plane in which it bends."""
    steps: int
    """Steps of the fourth-order rule of Runge and Kutta in a stage."""
    finer: int
    """Factor on the stages of a search for the grasp that it returns: directions are exact to 5e-7 rad then."""
    pose: int
    """Numbers of an object's pose, the place first."""
    axes: int
    """Numbers of the axes that an object has where its pose has no turn."""

    @property
    def moments(self) -> list[int]:
        """Places of the moment in a state."""
        return list(range(self.oriented, self.state))

    @abstractmethod
    def tangent(self, state: Values) -> Values:
        """Direction of the finger (dimensions,)."""

    @abstractmethod
    def across(self, state: Values) -> Values:
        """Direction across the finger in the plane of bending (dimensions,)."""

    @abstractmethod
    def bent(self, base: Array, x: float, y: float, angle: float, moment: float) -> Array:
        """State (state,) of a finger that bends about one axis, by what its base (oriented,) sees."""

    @abstractmethod
    def turn(self, pose: Values, axes: Values) -> Matrix:
        """Axes of the object as columns."""

    @abstractmethod
    def section_turn(self, state: Values, change: Values) -> list[Any]:
        """Small turn (3,) of a section by the change (oriented,) of its place and direction."""

    @abstractmethod
    def object_turn(self, pose: Values, change: Values) -> list[Any]:
        """Small turn (3,) of the object by the change (pose,) of its pose."""

    @abstractmethod
    def cuts(self, p: Array, q: Array) -> Array:
        """Whether the chords of a line (n, dimensions) cut those of another (m, dimensions): (n - 1, m - 1)."""

    def place(self, pose: Values) -> list[Any]:
        """Place of the object (3,)."""
        return self.in_space([pose[k] for k in range(self.dimensions)])

    def in_space(self, vector: Sequence[Any]) -> list[Any]:
        """Three coordinates of a vector (dimensions,)."""
        return [*vector, *[0.0] * (3 - self.dimensions)]

    def moment(self, vector: Sequence[Any]) -> list[Any]:
        """Components of a moment (3,) that a state has."""
        return [vector[k] for k in range(3 - len(self.moments), 3)]


def library(*values: Value) -> Any:
    """CasADi for symbols, else NumPy."""
    return ca if any(isinstance(value, ca.SX) for value in values) else np


def cross(a: Values, b: Values) -> list[Any]:
    """Cross product of vectors (3,)."""
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def dot(a: Values, b: Values) -> Value:
    """Scalar product."""
    return sum(u * v for u, v in zip(a, b, strict=True))


def turned(matrix: Matrix, vector: Sequence[Any]) -> list[Any]:
    """A matrix times a vector."""
    return [dot(row, vector) for row in matrix]


def transposed(matrix: Matrix) -> Matrix:
    """Columns of a matrix as rows."""
    return [list(column) for column in zip(*matrix, strict=True)]


def exerted(held: Values, n: Values, across: Values) -> list[Any]:
    """Force (3,) of the object on what touches it, by its numbers, the normal and a direction across the finger."""
    a = cross(across, n)
    # 1e-30: no division by zero where both are the same
    size = library(*n).sqrt(dot(a, a) + 1e-30)
    b = cross(n, a)
    return [held[0] * n[k] + (held[1] * a[k] + held[2] * b[k]) / size for k in range(3)]
