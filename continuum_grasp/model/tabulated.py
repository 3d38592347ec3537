"""A flexible link that a table of numbers describes, so that one expression serves every link of a finger.

The numbers are those of ``collocated``, multiplied out: what is left of a link is sums of products with cosines and
sines. Entries that are the same for all links become constants of the code, all others its arguments.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from continuum_grasp.model.link import Bias, Inertia, Section
from continuum_grasp.model.planar import Rotation, Scalar, Vec
from continuum_grasp.model.stumpff import rotation

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LinkTable:
    """What describes a link of m nodes and L local coordinates; entries are numbers or, in ``filled``, symbols.

    Pairs of nodes j < k are in the order of ``itertools.combinations``; before them stands what is on the diagonal.
    """

    turns: Any  # (L, m + 1) bend from node to node, from the start to the end, per local coordinate
    rest: Any  # (m + 1,) the same at rest
    shape: Any  # (L, m) bending angle of the nodes
    bends: Any  # (L,) of the end
    position: Any  # (m,) end position per tangent of the nodes
    arms: Any  # (L, m) the same of its derivatives
    mass: Any  # (1,)
    first: Any  # (m,) first moment of mass per tangent
    first_arms: Any  # (L, m)
    second: Any  # (1 + m (m - 1) / 2,) second moment per cosine of the turn between two nodes
    swing: Any  # (L, 1 + ...)
    matrix: Any  # (L (L + 1) / 2, 1 + ...) lower triangle by rows
    sines: Any  # (m (m - 1) / 2,) kernel of the kinetic energy
    rotary: Any  # (1 + L + L (L + 1) / 2,) rotary inertia: integrals of 1, of the shapes and of their products

    @staticmethod
    def of(
        places: Array, rest: Array, weights: Array, kernel: Array, mean: Array, mass: float, rotary: Array
    ) -> LinkTable:
        """The table of bends ``places`` (L, m + 2) at the start, the nodes and the end, and of those at rest (m + 1,).

        ``weights`` (m,) [m] integrate along the link, ``kernel`` (m, m) [kg m2] and ``mean`` (m,) [kg m] are those of
        its kinetic energy and of its first moment, ``rotary`` (1 + L, 1 + L) [kg m2] the rotary inertia.
        """
        shape, pairs = places[:, 1:-1], list(itertools.combinations(range(len(weights)), 2))
        one = np.ones(len(weights))

        def form(f: Array, g: Array) -> Array:
            # cos is even: each pair once, with the weights of both orders.
            whole = np.outer(f, g) * kernel
            return np.array([np.trace(whole), *[whole[j, k] + whole[k, j] for j, k in pairs]])

        lower = [(a, b) for a in range(len(shape)) for b in range(a + 1)]
        return LinkTable(
            turns=np.diff(places, axis=1),
            rest=rest,
            shape=shape,
            bends=places[:, -1],
            position=weights,
            arms=shape * weights,
            mass=np.array([mass]),
            first=mean,
            first_arms=shape * mean,
            second=form(one, one),
            swing=np.array([form(one, f) for f in shape]),
            matrix=np.array([form(shape[a], shape[b]) for a, b in lower]),
            sines=np.array([kernel[pair] for pair in pairs]),
            rotary=np.array([*rotary[0], *[rotary[1 + a, 1 + b] for a, b in lower]]),
        )

    @property
    def numbers(self) -> Array:
        """All entries, one after the other."""
        return np.concatenate([np.ravel(getattr(self, each.name)) for each in fields(self)])

    def filled(self, entries: ca.SX) -> LinkTable:
        """A table of the same form, of expressions (rows, columns) in the order of ``numbers``."""
        at, parts = 0, {}
        for each in fields(self):
            shape = np.shape(getattr(self, each.name))
            size = int(np.prod(shape))
            block = entries[at : at + size]
            parts[each.name] = ca.reshape(block, shape[-1], size // shape[-1]).T if len(shape) == 2 else block
            at += size
        return LinkTable(**parts)


class TabulatedLink:
    """A link of the ``local`` coordinates, as far as its end and its kinetics go; see ``Link``.

    ``reach`` (m + 1,) [rad] are the greatest turns from node to node; ``density``, ``rotary`` and ``rest`` factors of
    the mass, of the rotary inertia and of the bend at rest.
    """

    def __init__(
        self,
        local: Sequence[Scalar],
        table: LinkTable,
        reach: Sequence[float],
        density: Scalar,
        rotary: Scalar,
        rest: Scalar,
    ) -> None:
        self._table, self._density, self._rotary = table, density, rotary
        turns = ca.mtimes(table.turns.T, ca.vertcat(*local)) + rest * table.rest
        self.whole_bend = ca.dot(table.bends, ca.vertcat(*local)) + rest * ca.sum1(table.rest)
        self._turns = [rotation(turns[k], angle) for k, angle in enumerate(reach)]
        self._count = len(reach) - 1
        self._size = len(local)

    @cached_property
    def _doubled(self) -> list[Rotation]:
        """Turns from the start and from each node to the second next."""
        return [a @ b for a, b in itertools.pairwise(self._turns)]

    @cached_property
    def _rotations(self) -> list[Rotation]:
        """Rotations of the nodes and of the end."""
        # Products of two turns first: half the depth, so the processor can work on them side by side.
        found = [self._turns[0], self._doubled[0]]
        for k in range(2, self._count):
            found.append(found[k - 2] @ self._doubled[k - 1])
        return [*found, found[-1] @ self._turns[-1]]

    @cached_property
    def _tangents(self) -> tuple[ca.SX, ca.SX]:
        nodes = self._rotations[:-1]
        return ca.vertcat(*[r.c for r in nodes]), ca.vertcat(*[r.s for r in nodes])

    def _weighed(self, weights: ca.SX) -> Vec:
        x, y = self._tangents
        return Vec(ca.dot(weights, x), ca.dot(weights, y))

    def _rows(self, weights: ca.SX) -> tuple[Vec, ...]:
        return tuple(self._weighed(weights[a, :].T) for a in range(self._size))

    @cached_property
    def end(self) -> Section:
        """The end section."""
        table = self._table
        bends = tuple(table.bends[a] for a in range(self._size))
        return Section(self._weighed(table.position), self._rotations[-1], self._rows(table.arms), bends)

    @cached_property
    def _between(self) -> list[Rotation]:
        """Turns between the pairs of nodes."""
        found: dict[tuple[int, int], Rotation] = {}
        for j, k in itertools.combinations(range(self._count), 2):
            if k - j <= 2:
                found[j, k] = self._turns[k] if k == j + 1 else self._doubled[j + 1]
            else:
                found[j, k] = found[j, k - 2] @ self._doubled[k - 1]
        return list(found.values())

    @cached_property
    def inertia(self) -> Inertia:
        """Mass integrals."""
        table, size = self._table, self._size
        cosines = ca.vertcat(1.0, *[turn.c for turn in self._between])
        turning = self._rotary * table.rotary

        def form(row: ca.SX, at: int) -> Scalar:
            value: ca.SX = self._density * ca.dot(row, cosines) + turning[at]
            return value

        lower = [(a, b) for a in range(size) for b in range(a + 1)]
        entries = {pair: form(table.matrix[k, :].T, 1 + size + k) for k, pair in enumerate(lower)}
        return Inertia(
            mass=self._density * table.mass,
            first=self._weighed(table.first).scaled(self._density),
            second=form(table.second, 0),
            arms=tuple(arm.scaled(self._density) for arm in self._rows(table.first_arms)),
            swing=tuple(form(table.swing[a, :].T, 1 + a) for a in range(size)),
            matrix=tuple(tuple(entries[max(a, b), min(a, b)] for b in range(size)) for a in range(size)),
        )

    def bias(self, omega: Scalar, rates: Sequence[Scalar]) -> Bias:
        """Velocity-product terms."""
        table, count = self._table, self._count
        spins = omega + ca.mtimes(table.shape.T, ca.vertcat(*rates))
        squares = spins * spins
        loads: list[Scalar] = [0.0] * count
        for at, ((j, k), turn) in enumerate(zip(itertools.combinations(range(count), 2), self._between, strict=True)):
            # sin is odd: what node k exerts on j, j exerts on k with the other sign.
            sine = table.sines[at] * turn.s
            loads[j] += sine * squares[k]
            loads[k] -= sine * squares[j]
        column = self._density * ca.vertcat(*loads)
        return Bias(
            end=self._weighed(table.position * squares),
            force=self._weighed(table.first * squares).scaled(self._density),
            moment=ca.sum1(column),
            generalized=tuple(ca.dot(table.shape[a, :].T, column) for a in range(self._size)),
        )
