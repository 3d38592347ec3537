"""A flexible link of any smooth curvature, by Gauss-Legendre collocation of its bending angle.

With the tangents t_k = (cos phi_k, sin phi_k) at the nodes, kinetic energy is a double sum over the nodes with a
constant kernel K,

    T = 1/2 sum_jk K_jk phid_j phid_k cos(phi_j - phi_k),

which determines mass matrix and bias exactly: the node equations are
sum_k K_jk [cos(phi_j - phi_k) phidd_k + sin(phi_j - phi_k) phid_k^2]. So the discrete link is a mechanical system of
its own that conserves energy, whatever the number of nodes.
"""

from __future__ import annotations

import itertools
from abc import abstractmethod
from collections.abc import Sequence
from functools import cached_property

import casadi as ca
import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.model.link import Bias, Inertia, Link, LinkSection, is_end
from continuum_grasp.model.planar import ZERO, Rotation, Scalar, Vec
from continuum_grasp.model.quadrature import Collocation
from continuum_grasp.model.stumpff_functions import rotation
from continuum_grasp.model.tabulated import Directions, LinkTable, TabulatedLink


class CollocatedLink(Link):
    """A link of any smooth curvature, which depends linearly on the ``local`` coordinates.

    Length [m], linear density and rotary inertia, each times its value in the ``rule``, may be run-time numbers;
    ``angle_range`` is the greatest length times curvature [rad]. An ``end_mass`` [kg] is folded into the constants,
    which needs a numeric length and density.
    """

    def __init__(
        self,
        local: Sequence[Scalar],
        length: Scalar,
        linear_density: Scalar,
        rotary_inertia: Scalar,
        angle_range: float,
        rule: Collocation,
        end_mass: float = 0.0,
    ) -> None:
        self._local = list(local)
        self._length = length
        self._angle_range = angle_range
        self.rule = rule
        places = zip(rule.piece, rule.nodes.tolist(), strict=True)
        self._shape = np.array([self._angles(u, piece) for piece, u in places]).T
        # Numbers enter the table; expressions are factors of its values.
        properties = (length, linear_density, rotary_inertia)
        self._numbers = [value if isinstance(value, float) else 1.0 for value in properties]
        self._factors: list[Scalar] = [1.0 if isinstance(value, float) else value for value in properties]
        self._end_mass = end_mass

    @abstractmethod
    def _angles(self, fraction: Scalar, piece: int) -> Sequence[Scalar]:
        """Per local coordinate, the bending angle at a fraction of the length on a piece of the rule, per length."""

    def _rest(self, fraction: Scalar, piece: int) -> Scalar:
        """The bending angle [rad] there with all coordinates at zero."""
        return 0.0

    def _reaches(self, fraction: Scalar) -> list[Scalar]:
        """Per piece of the rule, the share of it that a part of the link has."""
        if len(self.rule.pieces) == 1 or is_end(fraction):
            return [fraction for _ in self.rule.pieces]
        return [ca.fmin(ca.fmax((fraction - a) / (b - a), 0.0), 1.0) for a, b in self.rule.pieces]

    def _places(self, fraction: Scalar) -> list[tuple[Scalar, int]]:
        """Nodes of a part of the link: fractions of the length, and pieces of the rule."""
        reaches, nodes = self._reaches(fraction), zip(self.rule.nodes.tolist(), self.rule.piece, strict=True)
        starts = [a for a, _ in self.rule.pieces]
        return [(starts[piece] + reaches[piece] * (u - starts[piece]), piece) for u, piece in nodes]

    def _ends(self, fraction: Scalar) -> list[tuple[Scalar, Scalar]]:
        """Start and end of each piece of a part of the link."""
        spans = zip(self.rule.pieces, self._reaches(fraction), strict=True)
        return [(a, b if is_end(reach) else a + reach * (b - a)) for (a, b), reach in spans]

    def _turned(self, fraction: Scalar) -> tuple[list[Scalar], Scalar]:
        """Per local coordinate the bending angle at the end of a part of the link, per length; the rest angle [rad]."""
        angles: list[Scalar] = [0.0 for _ in self._local]
        rest: Scalar = 0.0
        for piece, (start, end) in enumerate(self._ends(fraction)):
            steps = zip(angles, self._angles(start, piece), self._angles(end, piece), strict=True)
            angles = [total + (after - before) for total, before, after in steps]
            rest += self._rest(end, piece) - self._rest(start, piece)
        return angles, rest

    def bend(self, fraction: Scalar) -> Scalar:
        angles, rest = self._turned(fraction)
        return sum((phi * self._length * q for phi, q in zip(angles, self._local, strict=True)), rest)

    def _turns(self, fraction: Scalar) -> list[Scalar]:
        """Bending angles from node to node of a part of the link [rad], from its start and to its end."""
        # Stop by stop what each coordinate adds; between pieces, to the end of one and from the start of the next.
        steps: list[list[Scalar]] = [[0.0 for _ in range(len(self._local) + 1)]]
        places = self._places(fraction)
        for piece, (start, end) in enumerate(self._ends(fraction)):
            stops = [start, *(at for at, on in places if on == piece), end]
            rows = [[*self._angles(at, piece), self._rest(at, piece)] for at in stops]
            turns = [[b - a for a, b in zip(*pair, strict=True)] for pair in itertools.pairwise(rows)]
            joined = [a + b for a, b in zip(steps[-1], turns[0], strict=True)]
            steps = [*steps[:-1], joined, *turns[1:]]
        return [
            sum((self._length * step * q for step, q in zip(shapes, self._local, strict=True)), rest)
            for *shapes, rest in steps
        ]

    @property
    def count(self) -> int:
        """Number of nodes."""
        return len(self.rule.nodes)

    def table(self, count: int, *, straight: bool) -> LinkTable:
        """The link as numbers, which its length and densities must be, as if it had ``count`` nodes.

        The coordinates must be zero. A ``straight`` one has as rest what a curvature [1/m] bends that is one all along.
        """
        rest = self._numbers[0] * self.rule.steps if straight else np.array(self._turns(1.0), dtype=float)
        return self._table(rest, count - self.count)

    def _table(self, rest: Array, more: int = 0) -> LinkTable:
        """The link as numbers, with further nodes, and bends at rest from node to node [rad]."""
        (h, density, rotary), rule, end = self._numbers, self.rule, self._end_mass
        bends = np.array([phi * h for phi in self._turned(1.0)[0]], dtype=float)
        basis, w = np.vstack([np.ones(self.count), h * self._shape]), rule.weights
        # Further nodes are where the last one is, and have nothing.
        shape = np.pad(h * self._shape, [(0, 0), (0, more)], mode="edge")
        weights = np.pad(h * w, (0, more))
        mean = np.pad(density * h**2 * rule.mean_weights + end * h * w, (0, more))
        # The end moves with the integral of all nodes' tangents: its kinetic energy is one more kernel, w w'.
        kernel = np.pad(density * h**3 * rule.kernel + end * h**2 * np.outer(w, w), (0, more))
        turning = (rotary * h * rule.rotary_weights * basis) @ basis.T
        pairs, ones = list(itertools.combinations(range(len(weights)), 2)), np.ones(len(weights))
        lower = [(a, b) for a in range(len(shape)) for b in range(a + 1)]

        def form(f: Array, g: Array) -> Array:
            # cos is even: each pair once, with the weights of both orders.
            whole = np.outer(f, g) * kernel
            return np.array([np.trace(whole), *[whole[j, k] + whole[k, j] for j, k in pairs]])

        return LinkTable(
            turns=np.diff(np.column_stack([np.zeros(len(bends)), shape, bends]), axis=1),
            rest=np.concatenate([rest[:-1], np.zeros(more), rest[-1:]]),
            shape=shape,
            bends=bends,
            position=weights,
            arms=shape * weights,
            mass=np.array([density * h * rule.mass + end]),
            first=mean,
            first_arms=shape * mean,
            second=form(ones, ones),
            swing=np.array([form(ones, f) for f in shape]),
            matrix=np.array([form(shape[a], shape[b]) for a, b in lower]),
            sines=np.array([kernel[pair] for pair in pairs]),
            rotary=np.array([*turning[0], *[turning[1 + a, 1 + b] for a, b in lower]]),
        )

    def reach(self, count: int) -> list[float]:
        """Greatest turns from node to node [rad], as if there were ``count`` nodes."""
        *steps, last = (self._angle_range * float(step) for step in self.rule.steps)
        return [*steps, *[0.0] * (count - self.count), last]

    # -- kinematics ----------------------------------------------------------------------------------------------

    @cached_property
    def _whole(self) -> TabulatedLink:
        made = self._table(np.zeros(self.count + 1))
        return TabulatedLink(made.filled(ca.DM(made.numbers)), self._rotations(1.0), *self._factors)

    def _rotations(self, fraction: Scalar) -> list[Rotation]:
        """Turns from node to node of a part of the link, from its start and to its end."""
        # Each node is turned from the one before: turns between neighbors are small, so their series are short, and the
        # mass matrix needs them anyway.
        steps = zip(self._turns(fraction), self.rule.steps, strict=True)
        return [rotation(ca.SX(angle), self._angle_range * float(step)) for angle, step in steps]

    @property
    def end(self) -> LinkSection:
        return self._whole.end

    def section(self, fraction: Scalar) -> LinkSection:
        return self.end if is_end(fraction) else self._section(fraction, Directions(self._rotations(fraction)))

    def _section(self, fraction: Scalar, nodes: Directions) -> LinkSection:
        shapes = zip(*[self._angles(at, piece) for at, piece in self._places(fraction)], strict=True)
        ones = [1.0 for _ in self.rule.nodes]
        return LinkSection(
            position=self._integral(fraction, ones, nodes.tangents, self._length),
            rotation=nodes.end,
            arms=tuple(self._integral(fraction, s, nodes.tangents, self._length * self._length) for s in shapes),
            angles=tuple(phi * self._length for phi in self._turned(fraction)[0]),
        )

    def _integral(self, fraction: Scalar, factors: Sequence[Scalar], tangents: Sequence[Vec], scale: Scalar) -> Vec:
        """Scale times the integral of factor times tangent over the fractions of a part of the link."""
        total, first = ZERO, 0
        for piece, reach in enumerate(self._reaches(fraction)):
            last = first + self.rule.piece.count(piece)
            part = slice(first, last)
            whole = reach * scale
            constant, weighed = whole if isinstance(whole, float) else 1.0, ZERO
            # The scalars meet first.
            for w, factor, tangent in zip(self.rule.weights[part].tolist(), factors[part], tangents[part], strict=True):
                weighed += tangent.scaled(w * constant * factor)
            total = total + (weighed if isinstance(whole, float) else weighed.scaled(whole))
            first = last
        return total

    def section_bias(self, fraction: Scalar, omega: Scalar, rates: Sequence[Scalar]) -> Vec:
        if is_end(fraction):
            return self._whole.end_bias(omega, rates)
        nodes = Directions(self._rotations(fraction))
        squares: list[Scalar] = []  # of angular velocities
        for at, piece in self._places(fraction):
            turning = zip(rates, self._angles(at, piece), strict=True)
            spin = sum((phi * self._length * rate for rate, phi in turning), omega)
            squares.append(spin * spin)
        return self._integral(fraction, squares, nodes.tangents, self._length)

    # -- kinetics ------------------------------------------------------------------------------------------------

    @property
    def inertia(self) -> Inertia:
        return self._whole.inertia

    def bias(self, omega: Scalar, rates: Sequence[Scalar]) -> Bias:
        return self._whole.bias(omega, rates)
