"""A link whose bending angle is a polynomial of the arc length, by Gauss-Legendre collocation.

The bending angle at the nodes is phi_k = sum_a Phi_a(u_k) q_a, the tangents are t_k = (cos phi_k, sin phi_k), and kinetic
energy is a double sum over the nodes with a constant kernel K,

    T = 1/2 sum_jk K_jk phid_j phid_k cos(phi_j - phi_k),

from which mass matrix and bias follow exactly: the node equations are
sum_k K_jk [cos(phi_j - phi_k) phidd_k + sin(phi_j - phi_k) phid_k^2]. So the discrete link is a mechanical system of its
own that conserves energy, whatever the number of nodes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from continuum_grasp.model.link import Bias, Inertia, Link, Section
from continuum_grasp.model.planar import Rotation, Scalar, Vec, combine, minus, plus, times
from continuum_grasp.model.quadrature import collocation
from continuum_grasp.model.stumpff import rotation

__all__ = ["CLOTHOID_BASIS", "CollocatedLink"]

Basis = Sequence[Callable[[Scalar], Scalar]]

CLOTHOID_BASIS: Basis = (lambda u: u * (1.0 - 0.5 * u), lambda u: 0.5 * (u * u))
"""Bending angle per length and curvature at the start and at the end of a clothoid."""


class CollocatedLink(Link):
    """A link with curvature in the span of a polynomial basis.

    Parameters
    ----------
    coordinates : sequence of casadi.SX
        Local coordinates, curvatures [1/m].
    basis : sequence of callables
        Per coordinate, its bending angle at a fraction of a link of length one.
    length : float or casadi.SX
        Length [m].
    linear_density, rotary_inertia : float or casadi.SX
        rho A [kg/m] and rho I [kg m].
    angle_range, accuracy : float
        Range of length times curvature and truncation error of the trigonometric series over it.
    nodes : int
        Number of collocation nodes.
    end_mass : float
        Point mass at the end [kg]; costs nothing.
    """

    def __init__(
        self,
        coordinates: Sequence[Scalar],
        basis: Basis,
        length: Scalar,
        linear_density: Scalar,
        rotary_inertia: Scalar,
        angle_range: float,
        accuracy: float,
        nodes: int,
        end_mass: float = 0.0,
    ) -> None:
        self._q = tuple(coordinates)
        self._basis = basis
        self._length = length
        self._linear_density = linear_density
        self._rotary_inertia = rotary_inertia
        self._angle_range = angle_range
        self._accuracy = accuracy
        self._rule = collocation(nodes)
        self._shape = np.array([[float(phi(u)) for u in self._rule.nodes] for phi in basis])
        self._scales(end_mass)

    def _scales(self, end_mass: float) -> None:
        """Constant kernel and weights, with every numeric factor folded in; the rest is left as a symbolic scale."""
        h, density, rule = self._length, self._linear_density, self._rule
        self._kernel, self._mean = rule.kernel, rule.mean_weights
        self._mass = times(density, h)
        self._first_scale = times(self._mass, h)
        self._kernel_scale = times(self._first_scale, h)
        if isinstance(h, float) and isinstance(density, float):
            w = rule.weights
            self._kernel = rule.kernel * self._kernel_scale + end_mass * h**2 * np.outer(w, w)
            self._mean = rule.mean_weights * self._first_scale + end_mass * h * w
            self._mass = self._mass + end_mass
            self._first_scale = self._kernel_scale = 1.0
        elif end_mass:
            raise ValueError("an end mass is folded in only where length and density are numbers")

    @cached_property
    def _tangents(self) -> list[Vec]:
        return self._tangents_up_to(1.0)

    def _tangents_up_to(self, fraction: Scalar) -> list[Vec]:
        tangents = []
        for u in self._rule.nodes:
            turn = self._turn(times(fraction, float(u)), self._angle_range * float(u))
            tangents.append(Vec(turn.c, turn.s))
        return tangents

    def _turn(self, fraction: Scalar, angle_range: float) -> Rotation:
        """Rotation of the section at a fraction of the length."""
        angle: Scalar = 0.0
        for q, phi in zip(self._q, self._basis, strict=True):
            angle = plus(angle, times(times(phi(fraction), self._length), q))
        return rotation(ca.SX(angle), angle_range, self._accuracy)

    @cached_property
    def end(self) -> Section:
        return self._section(1.0, self._tangents)

    def section(self, fraction: Scalar) -> Section:
        if isinstance(fraction, float) and fraction == 1.0:
            return self.end
        return self._section(fraction, self._tangents_up_to(fraction))

    def _section(self, fraction: Scalar, tangents: list[Vec]) -> Section:
        reach = times(fraction, self._length)
        weights = self._rule.weights
        arms = []
        for phi in self._basis:
            at_nodes = [phi(times(fraction, float(u))) for u in self._rule.nodes]
            scale = times(reach, self._length)
            if all(isinstance(p, float) for p in at_nodes):
                arms.append(_weigh(weights * np.array(at_nodes, dtype=float), tangents, scale))
            else:
                arms.append(_weigh(weights, [t.scaled(p) for t, p in zip(tangents, at_nodes, strict=True)], scale))
        return Section(
            position=_weigh(weights, tangents, reach),
            rotation=self._turn(fraction, self._angle_range),
            arms=tuple(arms),
            angles=tuple(times(phi(fraction), self._length) for phi in self._basis),
        )

    def section_bias(self, fraction: Scalar, omega: Scalar, rates: Sequence[Scalar]) -> Vec:
        whole = isinstance(fraction, float) and fraction == 1.0
        tangents = self._tangents if whole else self._tangents_up_to(fraction)
        squares = [
            self._spin(times(fraction, float(u)), omega, rates) for u in self._rule.nodes
        ]
        turned = [t.scaled(s) for t, s in zip(tangents, squares, strict=True)]
        return _weigh(self._rule.weights, turned, times(fraction, self._length))

    def _spin(self, fraction: Scalar, omega: Scalar, rates: Sequence[Scalar]) -> Scalar:
        """Squared angular velocity of the section at a fraction of the length."""
        total = omega
        for rate, phi in zip(rates, self._basis, strict=True):
            total = plus(total, times(times(phi(fraction), self._length), rate))
        return times(total, total)

    @cached_property
    def _pairs(self) -> list[tuple[int, int]]:
        count = len(self._rule.nodes)
        return [(j, k) for j in range(count) for k in range(j + 1, count)]

    @cached_property
    def _cosines(self) -> list[Scalar]:
        return [self._tangents[j].dot(self._tangents[k]) for j, k in self._pairs]

    def _form(self, f: NDArray[np.float64], g: NDArray[np.float64], scale: Scalar) -> Scalar:
        """sum_jk f_j K_jk g_k cos(phi_j - phi_k)."""
        kernel = np.outer(f, g) * self._kernel
        kernel = kernel + kernel.T
        terms: list[tuple[float, Scalar]] = [(0.5 * float(np.trace(kernel)), 1.0)]
        terms += [(float(kernel[j, k]), c) for (j, k), c in zip(self._pairs, self._cosines, strict=True)]
        return combine(scale, terms)

    @cached_property
    def inertia(self) -> Inertia:
        one = np.ones(len(self._rule.nodes))
        h, scale = self._length, self._kernel_scale
        rotary = times(self._rotary_inertia, h)
        rule, shape = self._rule, self._shape
        arm_scale, matrix_scale = times(scale, h), times(times(scale, h), h)
        means = shape @ rule.weights
        products = (shape * rule.weights) @ shape.T
        size = range(len(self._q))
        return Inertia(
            mass=self._mass,
            first=_weigh(self._mean, self._tangents, self._first_scale),
            second=plus(self._form(one, one, scale), rotary),
            arms=tuple(
                _weigh(self._mean * shape[a], self._tangents, times(self._first_scale, h)) for a in size
            ),
            swing=tuple(
                plus(self._form(one, shape[a], arm_scale), times(times(float(means[a]), rotary), h)) for a in size
            ),
            matrix=tuple(
                tuple(
                    plus(
                        self._form(shape[a], shape[b], matrix_scale),
                        times(times(times(float(products[a, b]), rotary), h), h),
                    )
                    for b in size
                )
                for a in size
            ),
        )

    def bias(self, omega: Scalar, rates: Sequence[Scalar]) -> Bias:
        nodes = range(len(self._rule.nodes))
        spins = [self._spin(float(u), omega, rates) for u in self._rule.nodes]
        turned = [t.scaled(s) for t, s in zip(self._tangents, spins, strict=True)]
        loads: list[Scalar] = [0.0 for _ in nodes]
        for j, k in self._pairs:
            sine = times(float(self._kernel[j, k]), self._tangents[j].cross(self._tangents[k]))
            loads[j] = plus(loads[j], times(sine, spins[k]))
            loads[k] = minus(loads[k], times(sine, spins[j]))
        scale, h = self._kernel_scale, self._length
        return Bias(
            end=_weigh(self._rule.weights, turned, h),
            force=_weigh(self._mean, turned, self._first_scale),
            moment=combine(scale, [(1.0, load) for load in loads]),
            generalized=tuple(
                combine(times(scale, h), [(float(self._shape[a, k]), loads[k]) for k in nodes])
                for a in range(len(self._q))
            ),
        )


def _weigh(weights: NDArray[np.float64], vectors: Sequence[Vec], scale: Scalar) -> Vec:
    """scale * sum of weight times vector."""
    pairs = [(float(w), v) for w, v in zip(weights, vectors, strict=True)]
    return Vec(
        combine(scale, [(w, v.x) for w, v in pairs]),
        combine(scale, [(w, v.y) for w, v in pairs]),
    )
