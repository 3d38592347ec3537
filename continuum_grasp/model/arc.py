"""A circular arc as a flexible link: one local coordinate, its bending angle.

With v running along the arc from 0 to 1 and t(v) = (cos v theta, sin v theta), every integral that the chain needs is a
combination of Stumpff functions; the table of the project's design (section 2.2) and its derivatives give

    moments     J_j = int v^j t dv,        G_j = int (1 - v) v^j t dv           (j = 0, 1, 2)
    products    int Y_i . Y_j dv and int Y_i x Y_j dv  with  Y_j(v) = int_0^v s^j t(s) ds.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.model.family import Family, RodProperties, mean
from continuum_grasp.model.graded import CurvatureShapes, GradedLink, measured_rule
from continuum_grasp.model.link import Bias, Inertia, Link, LinkSection, is_end
from continuum_grasp.model.planar import Rotation, Scalar, Vec, weighted_sum
from continuum_grasp.model.stumpff_functions import ROUNDING, stumpff
from continuum_grasp.scene import Curve

_MOMENTS = ((1.0,), (1.0, -1.0), (1.0, -2.0, 2.0))
"""Weights of c_1, c_2, ... in the cosine part of J_0, J_1, J_2, by integration by parts."""
_MEANS = ((1.0,), (1.0, -2.0), (1.0, -4.0, 6.0))
"""Weights of c_2, c_3, ... in the cosine part of G_0, G_1, G_2."""


@dataclass(frozen=True, eq=False)
class Arc(Link):
    """A circular arc."""

    theta: Scalar  # [rad]
    length: Scalar  # [m]
    linear_density: Scalar  # rho A [kg/m]
    rotary_inertia: Scalar  # rho I [kg m]
    angle_range: float  # greatest angle with the required accuracy of the series [rad]
    accuracy: float  # truncation error up to it

    @cached_property
    def _c(self) -> list[Scalar]:
        # All integrals are combinations of these few: no sine, no division, and exact at theta = 0.
        return stumpff(self.theta, self.angle_range, self.accuracy)

    @cached_property
    def end(self) -> LinkSection:
        return LinkSection(
            position=self._moment(0, self.length),
            rotation=Rotation(self._c[0], self.theta * self._c[1]),
            arms=(self._moment(1, self.length),),
            angles=(1.0,),
        )

    def section(self, fraction: Scalar) -> LinkSection:
        if is_end(fraction):
            return self.end
        # Part of an arc is an arc, whose angle is the fraction of the whole one: the chain rule gives its factor.
        part = self._part(fraction).end
        return LinkSection(part.position, part.rotation, (part.arms[0].scaled(fraction),), (fraction,))

    def bend(self, fraction: Scalar) -> Scalar:
        return self.theta if is_end(fraction) else fraction * self.theta

    @property
    def curvatures(self) -> list[Scalar]:
        return [self.theta / self.length]

    def section_bias(self, fraction: Scalar, omega: Scalar, rates: Sequence[Scalar]) -> Vec:
        if is_end(fraction):
            return self._weighted(self.length, omega, rates[0], self._moment)
        return self._part(fraction).section_bias(1.0, omega, [fraction * rates[0]])

    def _part(self, fraction: Scalar) -> Arc:
        return replace(self, theta=fraction * self.theta, length=fraction * self.length)

    @cached_property
    def inertia(self) -> Inertia:
        mass = self.linear_density * self.length
        per_length = mass * self.length
        per_square = per_length * self.length
        rotary = self.rotary_inertia * self.length
        # Per rho A L^3: int |r|^2 = 2 c_3, int r . arm = c_3 - c_4, int |arm|^2 = 2 c_4 - 4 c_5.
        return Inertia(
            mass=mass,
            first=self._mean(0, per_length),
            second=self._sum(3, (2.0,), per_square) + rotary,
            arms=(self._mean(1, per_length),),
            swing=(self._sum(3, (1.0, -1.0), per_square) + 0.5 * rotary,),
            # Rotary inertia: integrals of v and v^2, since the section at v turns by v theta.
            matrix=((self._sum(4, (2.0, -4.0), per_square) + 1.0 / 3.0 * rotary,),),
        )

    def bias(self, omega: Scalar, rates: Sequence[Scalar]) -> Bias:
        theta, rate = self.theta, rates[0]
        per_length = self.linear_density * self.length * self.length
        per_square = per_length * self.length * theta
        square = rate * rate
        # Y_i x Y_j per theta: odd in the angle, so they vanish on the straight finger without a branch.
        y0y1 = self._sum(4, (1.0, -3.0))
        y0y2 = self._sum(4, (1.0, -4.0, 4.0))
        y1y2 = self._sum(5, (1.0, -6.0, 10.0))
        whirl, mixed = omega * omega, 2.0 * (omega * rate)
        return Bias(
            end=self._weighted(self.length, omega, rate, self._moment),
            force=self._weighted(per_length, omega, rate, self._mean),
            moment=per_square * (mixed * y0y1 + square * y0y2),
            generalized=(per_square * (square * y1y2 - whirl * y0y1),),
        )

    def _weighted(self, scale: Scalar, omega: Scalar, rate: Scalar, moment: Callable[[int, Scalar], Vec]) -> Vec:
        """Integral of (omega + v rate)^2 t with the weights of a family of moments."""
        total = moment(2, 1.0).scaled(rate * rate)
        total = total + moment(1, 1.0).scaled(2.0 * (omega * rate)) + moment(0, 1.0).scaled(omega * omega)
        return total.scaled(scale)

    def _moment(self, j: int, scale: Scalar) -> Vec:
        return self._pair(1, _MOMENTS[j], scale)

    def _mean(self, j: int, scale: Scalar) -> Vec:
        """G_j times a scale."""
        return self._pair(2, _MEANS[j], scale)

    def _pair(self, first: int, weights: Sequence[float], scale: Scalar) -> Vec:
        """An integral of the tangent, whose sine part is the cosine part with every index one higher, times theta."""
        return Vec(self._sum(first, weights, scale), self.theta * self._sum(first + 1, weights, scale))

    def _sum(self, first: int, weights: Sequence[float], scale: Scalar = 1.0) -> Scalar:
        """Scale * (w_0 c_first + w_1 c_first+1 + ...)."""
        return weighted_sum(weights, self._c[first : first + len(weights)], scale)


class ArcFamily(Family):
    """Constant curvature on each element; the coordinates are the bending angles above those at rest [rad]."""

    degree = 0
    continuous = False
    order = 2
    force_unit = "N m"

    @property
    def size(self) -> int:
        return self.elements

    @property
    def default_accuracy(self) -> float:
        return ROUNDING

    @property
    def labels(self) -> list[str]:
        return [f"theta_{k + 1} [rad]" for k in range(self.elements)]

    def local(self, element: int) -> tuple[int, ...]:
        return (element,)

    def coordinate_size(self, bend: Any, length: float) -> Any:
        return bend

    def coordinates(self, bends: Array, curvatures: Array) -> Array:
        rest = [h * mean(self.mesh, k, self.mesh.rest) for k, h in enumerate(self.mesh.lengths)]
        return np.asarray(bends - np.array(rest))

    def link(self, element: int, local: Sequence[Scalar], rod: RodProperties, end_mass: float) -> Link:
        mesh, reach, h = self.mesh, self.mesh.ranges[element], rod.lengths[element]
        density, rotary = (mesh.constant(curve, element) for curve in (mesh.linear_density, mesh.rotary_inertia))
        if density is None or rotary is None:
            shapes = self._shapes(element)
            # 1e-6: accuracy of the evaluation of arcs whose mass is spread unevenly, where none is asked for: a
            # thousandth of what 8 arcs are off by
            rule = measured_rule(shapes, reach, self.accuracy or 1e-6)
            return GradedLink(local, shapes, rod, reach, rule, 0.0)
        rest = mean(mesh, element, mesh.rest) if rod.rest is None else rod.rest
        theta, accuracy = local[0] + h * rest, self.accuracy or self.default_accuracy
        return Arc(theta, h, density * rod.linear_density, rotary * rod.rotary_inertia, reach, accuracy)

    def _shapes(self, element: int) -> CurvatureShapes:
        """The shape of an arc whose mass is spread unevenly."""
        # With its mean, the first frequency of a cone of 1:4 is off by 5 % on four arcs; with the mass where it is, by
        # 0.4 %.
        mesh, (start, end) = self.mesh, self.mesh.span(element)
        value, whole = 1.0 / (end - start), mesh.ends[-1]
        densities = mesh.linear_density, mesh.rotary_inertia
        one, rest = Curve.along(whole, 1.0), Curve.along(whole, mean(mesh, element, mesh.rest))
        parts = mesh.panels(element, *densities)
        return CurvatureShapes(start, end, one, rest, parts, ((value, value),), (None,), *densities)

    def block(self, element: int, length: Scalar) -> list[list[Scalar]]:
        # The mean of the energy. The harmonic mean, of the flexibility, is 10 to 20 times worse on a smooth taper.
        return [[mean(self.mesh, element, self.mesh.stiffness) / length]]

    def work(self, element: int, lengths: Sequence[Scalar], moment: Curve | None = None) -> list[Scalar]:
        value = 1.0 if moment is None else mean(self.mesh, element, moment)
        return [value if k == element else 0.0 for k in range(self.elements)]

    def shapes_at(self, element: int, s: Array) -> Array:
        h, rest = self.mesh.lengths[element], mean(self.mesh, element, self.mesh.rest)
        return np.array([[1.0 / h] * len(s), [rest] * len(s)])

    def curvature_shapes(self, lengths: Sequence[float]) -> Array:
        return np.diag([1.0 / h for h in lengths])[:, None]
