"""A flexible link of any smooth curvature, by Gauss-Legendre collocation of its bending angle.

With the tangents t_k = (cos phi_k, sin phi_k) at the nodes, kinetic energy is a double sum over the nodes with a
constant kernel K,

    T = 1/2 sum_jk K_jk phid_j phid_k cos(phi_j - phi_k),

from which mass matrix and bias follow exactly: the node equations are
sum_k K_jk [cos(phi_j - phi_k) phidd_k + sin(phi_j - phi_k) phid_k^2]. So the discrete link is a mechanical system of
its own that conserves energy, whatever the number of nodes.
"""

from __future__ import annotations

import itertools
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from continuum_grasp.model.link import Bias, Inertia, Link, Section, is_end
from continuum_grasp.model.planar import ZERO, Rotation, Scalar, Vec, weighted_sum
from continuum_grasp.model.quadrature import collocation
from continuum_grasp.model.stumpff import rotation
from continuum_grasp.model.tabulated import LinkTable


@dataclass(frozen=True)
class _Nodes:
    """Directions along a link or the first part of it."""

    tangents: list[Vec]  # at the nodes
    turns: list[Rotation]  # from each node to the next
    doubled: list[Rotation]  # from each node to the second next
    end: Rotation  # of the end section


class CollocatedLink(Link):
    """A link of any smooth curvature, which depends linearly on the ``local`` coordinates.

    Length [m], rho A [kg/m] and rho I [kg m] may be run-time numbers; ``angle_range`` is the greatest length times
    curvature [rad]. An ``end_mass`` [kg] is folded into the constants, which needs a numeric length and density.
    """

    def __init__(
        self,
        local: Sequence[Scalar],
        length: Scalar,
        linear_density: Scalar,
        rotary_inertia: Scalar,
        angle_range: float,
        nodes: int,
        end_mass: float = 0.0,
    ) -> None:
        self._local = list(local)
        self._length = length
        self._rotary_inertia = rotary_inertia
        self._angle_range = angle_range
        self._rule = collocation(nodes)
        u = self._rule.nodes
        self._shape = np.array([self._angles(float(v)) for v in u]).T
        self._mass = linear_density * length
        self._first_scale = self._mass * length
        self._kernel_scale = self._first_scale * length
        self._kernel, self._mean = self._rule.kernel, self._rule.mean_weights
        if isinstance(length, float) and isinstance(self._mass, float):
            # The end moves with the integral of all nodes' tangents: its kinetic energy is one more kernel, w w'.
            w = self._rule.weights
            self._kernel = self._kernel * self._kernel_scale + end_mass * length**2 * np.outer(w, w)
            self._mean = self._mean * self._first_scale + end_mass * length * w
            self._mass += end_mass
            self._first_scale = self._kernel_scale = 1.0

    @abstractmethod
    def _angles(self, fraction: Scalar) -> Sequence[Scalar]:
        """Per local coordinate, the bending angle at a fraction of the length, per that length."""

    def _turns(self, fraction: Scalar) -> list[Scalar]:
        """Bending angles from node to node of a part of the link [rad], from its start and to its end."""
        places = [0.0, *self._rule.nodes.tolist(), 1.0]
        angles = [self._angles(fraction * u) for u in places]
        return [
            sum((self._length * (b - a) * q for a, b, q in zip(before, after, self._local, strict=True)), 0.0)
            for before, after in itertools.pairwise(angles)
        ]

    @property
    def table(self) -> LinkTable:
        """The link as numbers, without rotary inertia; its length and density must be numbers."""
        h, rule = float(self._length), self._rule
        places = h * np.array([self._angles(float(u)) for u in (0.0, *rule.nodes, 1.0)]).T
        return LinkTable.of(places, h * rule.weights, self._kernel, self._mean, float(self._mass))

    @property
    def reach(self) -> list[float]:
        """Greatest turns from node to node [rad]."""
        return [self._angle_range * float(step) for step in self._rule.steps]

    # -- kinematics ----------------------------------------------------------------------------------------------

    @cached_property
    def _whole(self) -> _Nodes:
        return self._nodes_up_to(1.0)

    def _nodes_up_to(self, fraction: Scalar) -> _Nodes:
        """Directions at the nodes of a part of the link."""
        # Each is turned from the one before: turns between neighbors are small, so their series are short, and the
        # mass matrix needs them anyway.
        turns = [
            rotation(ca.SX(angle), self._angle_range * float(step))
            for angle, step in zip(self._turns(fraction), self._rule.steps, strict=True)
        ]
        # Products of two turns first: half the depth, so the processor can work on them side by side.
        doubled = [a @ b for a, b in itertools.pairwise(turns)]
        rotations = [turns[0], doubled[0]]
        for k in range(2, len(turns) - 1):
            rotations.append(rotations[k - 2] @ doubled[k - 1])
        return _Nodes([Vec(r.c, r.s) for r in rotations], turns[1:-1], doubled[1:], rotations[-1] @ turns[-1])

    @cached_property
    def end(self) -> Section:
        return self._section(1.0, self._whole)

    def section(self, fraction: Scalar) -> Section:
        if is_end(fraction):
            return self.end
        return self._section(fraction, self._nodes_up_to(fraction))

    @property
    def waypoints(self) -> tuple[tuple[float, Vec], ...]:
        rows, tangents = self._rule.running, self._whole.tangents
        return tuple(
            (float(u), _weigh(row, tangents, self._length)) for u, row in zip(self._rule.nodes, rows, strict=True)
        )

    def _section(self, fraction: Scalar, nodes: _Nodes) -> Section:
        reach = fraction * self._length
        weights, tangents = self._rule.weights, nodes.tangents
        shapes = zip(*[self._angles(fraction * float(u)) for u in self._rule.nodes], strict=True)
        return Section(
            position=_weigh(weights, tangents, reach),
            rotation=nodes.end,
            arms=tuple(_weigh_products(weights, s, tangents, reach * self._length) for s in shapes),
            angles=tuple(phi * self._length for phi in self._angles(fraction)),
        )

    def section_bias(self, fraction: Scalar, omega: Scalar, rates: Sequence[Scalar]) -> Vec:
        nodes = self._whole if is_end(fraction) else self._nodes_up_to(fraction)
        spins = [self._spin(fraction * float(u), omega, rates) for u in self._rule.nodes]
        return _weigh_products(self._rule.weights, spins, nodes.tangents, fraction * self._length)

    def _spin(self, fraction: Scalar, omega: Scalar, rates: Sequence[Scalar]) -> Scalar:
        """Squared angular velocity of the section at a fraction of the length."""
        total = omega
        for rate, phi in zip(rates, self._angles(fraction), strict=True):
            total += phi * self._length * rate
        return total * total

    # -- kinetics ------------------------------------------------------------------------------------------------

    @cached_property
    def _differences(self) -> dict[tuple[int, int], Rotation]:
        """Per pair of nodes j < k, the turn from the tangent at j to that at k."""
        nodes, count = self._whole, len(self._rule.nodes)
        found: dict[tuple[int, int], Rotation] = {}
        for j in range(count):
            for k in range(j + 1, count):
                if k == j + 1:
                    found[j, k] = nodes.turns[j]
                elif k == j + 2:
                    found[j, k] = nodes.doubled[j]
                else:
                    found[j, k] = found[j, k - 2] @ nodes.doubled[k - 2]
        return found

    def _form(self, f: NDArray[np.float64], g: NDArray[np.float64], scale: Scalar) -> Scalar:
        """sum_jk f_j K_jk g_k cos(phi_j - phi_k)."""
        # cos is even: each pair of nodes once, with the weights of both orders; on the diagonal it is one.
        kernel = np.outer(f, g) * self._kernel
        kernel += kernel.T
        weights = [0.5 * float(np.trace(kernel)), *[float(kernel[pair]) for pair in self._differences]]
        return weighted_sum(weights, [1.0, *[turn.c for turn in self._differences.values()]], scale)

    @cached_property
    def inertia(self) -> Inertia:
        h, scale, shape, weights = self._length, self._kernel_scale, self._shape, self._rule.weights
        one = np.ones(len(weights))
        rotary = self._rotary_inertia * h
        # Sections turn by the shapes of the bending angle: rho I times the integrals of these and of their products.
        rotary_swing = [float(f @ weights) * rotary * h for f in shape]
        rotary_matrix = [[float(f * weights @ g) * rotary * h * h for g in shape] for f in shape]
        tangents = self._whole.tangents
        return Inertia(
            mass=self._mass,
            first=_weigh(self._mean, tangents, self._first_scale),
            second=self._form(one, one, scale) + rotary,
            arms=tuple(_weigh(self._mean * f, tangents, self._first_scale * h) for f in shape),
            swing=tuple(self._form(one, f, scale * h) + r for f, r in zip(shape, rotary_swing, strict=True)),
            matrix=tuple(
                tuple(self._form(f, g, scale * h * h) + r for g, r in zip(shape, row, strict=True))
                for f, row in zip(shape, rotary_matrix, strict=True)
            ),
        )

    def bias(self, omega: Scalar, rates: Sequence[Scalar]) -> Bias:
        nodes, tangents = range(len(self._rule.nodes)), self._whole.tangents
        spins = [self._spin(float(u), omega, rates) for u in self._rule.nodes]
        loads: list[Scalar] = [0.0 for _ in nodes]
        for (j, k), turn in self._differences.items():
            # sin is odd: what node k exerts on j, j exerts on k with the other sign.
            sine = float(self._kernel[j, k]) * turn.s
            loads[j] += sine * spins[k]
            loads[k] -= sine * spins[j]
        scale, h = self._kernel_scale, self._length
        return Bias(
            end=_weigh_products(self._rule.weights, spins, tangents, h),
            force=_weigh_products(self._mean, spins, tangents, self._first_scale),
            moment=weighted_sum([1.0 for _ in nodes], loads, scale),
            generalized=tuple(weighted_sum(map(float, f), loads, scale * h) for f in self._shape),
        )


def _weigh(weights: NDArray[np.float64], vectors: Sequence[Vec], scale: Scalar) -> Vec:
    """Scale * sum of weight times vector."""
    numbers: list[float] = weights.tolist()
    return Vec(
        weighted_sum(numbers, [v.x for v in vectors], scale), weighted_sum(numbers, [v.y for v in vectors], scale)
    )


def _weigh_products(
    weights: NDArray[np.float64], factors: Sequence[Scalar], vectors: Sequence[Vec], scale: Scalar
) -> Vec:
    """Scale * sum of weight times factor times vector; the scalars meet first."""
    constant = scale if isinstance(scale, float) else 1.0
    total = ZERO
    for w, factor, vector in zip(weights, factors, vectors, strict=True):
        total += vector.scaled(float(w) * constant * factor)
    return total if isinstance(scale, float) else total.scaled(scale)
