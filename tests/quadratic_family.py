"""A curvature family of the tests' own; from inside: links, rod properties and quadrature that families are made of.

A curvature family of the tests' own: on each element a quadratic curvature, which may jump between elements.

All that the package needs of a family is in this file and in its line of the table, ``ENTRY``.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.model import Family, Scalar
from continuum_grasp.model.collocated import CollocatedLink
from continuum_grasp.model.family import RodProperties, mean
from continuum_grasp.model.node_counts import node_count
from continuum_grasp.model.quadrature import collocation
from continuum_grasp.scene import Curve
from continuum_grasp.scene.methods import CurvatureFamily

NAME = "quadratic"
ENTRY = CurvatureFamily("tests.quadratic_family:QuadraticFamily", one_turn=True)

_OVERSHOOT = 1.25
"""Greatest value of a quadratic on [0, 1] whose values at 0, 1/2 and 1 are within one."""
_SHAPES = np.array([[1.0, -3.0, 2.0], [0.0, 4.0, -4.0], [0.0, -1.0, 2.0]])
"""Coefficients of 1, u, u^2 in the shapes that are one at 0, 1/2 and 1 in turn."""
_GRAM = np.array([[4.0, 2.0, -1.0], [2.0, 16.0, 2.0], [-1.0, 2.0, 4.0]]) / 30.0
"""Integrals of the products of the shapes over [0, 1]."""
_SIMPSON = np.array([1.0, 4.0, 1.0]) / 6.0


class QuadraticLink(CollocatedLink):
    """Its local coordinates are the curvatures at its start, middle and end [1/m]."""

    def _angles(self, fraction: Scalar, piece: int) -> list[Scalar]:
        u = fraction
        return [u * (a + u * (b / 2 + u * (c / 3))) for a, b, c in _SHAPES.tolist()]

    @property
    def curvatures(self) -> list[Scalar]:
        return self._local


class QuadraticFamily(Family):
    """Curvature quadratic on each element."""

    degree = 2
    continuous = False
    order = 6

    @property
    def size(self) -> int:
        return 3 * self.elements

    @property
    def labels(self) -> list[str]:
        return [f"kappa_{k + 1}_{at} [1/m]" for k in range(self.elements) for at in ("start", "middle", "end")]

    @property
    def default_accuracy(self) -> float:
        return 1e-8

    def local(self, element: int) -> tuple[int, ...]:
        return (3 * element, 3 * element + 1, 3 * element + 2)

    def coordinates(self, bends: Array, curvatures: Array) -> Array:
        rest = [mean(self.mesh, k, self.mesh.rest) for k in range(self.elements)]
        return (curvatures - np.array(rest)[:, None]).ravel()

    def link(self, element: int, local: Sequence[Scalar], rod: RodProperties, end_mass: float) -> QuadraticLink:
        reach = self.mesh.ranges[element]
        nodes = node_count(reach, self.accuracy or self.default_accuracy) + 2
        rest = mean(self.mesh, element, self.mesh.rest) if rod.rest is None else rod.rest
        local, rule = [kappa + rest for kappa in local], collocation(min(nodes, 16))
        length, reach = rod.lengths[element], _OVERSHOOT * reach
        return QuadraticLink(local, length, rod.linear_density, rod.rotary_inertia, reach, rule, end_mass)

    def block(self, element: int, length: Scalar) -> list[list[Scalar]]:
        return [[float(weight) * length for weight in row] for row in _GRAM]

    def work(self, element: int, lengths: Sequence[Scalar], moment: Curve | None = None) -> list[Scalar]:
        found: list[Scalar] = [0.0] * self.size
        value = 1.0 if moment is None else mean(self.mesh, element, moment)
        for a, weight in zip(self.local(element), _SIMPSON.tolist(), strict=True):
            found[a] = value * weight * lengths[element]
        return found

    def shapes_at(self, element: int, s: Array) -> Array:
        u = (s - self.mesh.ends[element]) / self.mesh.lengths[element]
        rest = mean(self.mesh, element, self.mesh.rest)
        return np.vstack([_SHAPES @ np.array([u**0, u, u**2]), np.full(len(s), rest)])

    def curvature_shapes(self, lengths: Sequence[float]) -> Array:
        return np.eye(self.size).reshape(self.elements, 3, self.size)
