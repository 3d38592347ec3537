"""A flexible link that a table of numbers describes, so that one expression serves every link of a finger.

The numbers are as in ``collocated``, multiplied out: a link then consists of sums of products with cosines and
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

from continuum_grasp.base import Array
from continuum_grasp.model.link import Bias, Inertia, LinkSection
from continuum_grasp.model.planar import Rotation, Scalar, Vec
from continuum_grasp.model.stumpff_functions import rotation


class Directions:
    """Directions along a link or a part of it: of turns from its start to the first node, between nodes, to its end."""

    def __init__(self, turns: Sequence[Rotation]) -> None:
        self._turns, self._count = list(turns), len(turns) - 1

    @cached_property
    def _doubled(self) -> list[Rotation]:
        """Turns from the start and from each node to the second next."""
        return [a @ b for a, b in itertools.pairwise(self._turns)]

    @cached_property
    def _rotations(self) -> list[Rotation]:
        # Products of two turns first: half the depth, so the processor can work on them side by side.
        rotations = [self._turns[0], self._doubled[0]]
        for k in range(2, self._count):
            rotations.append(rotations[k - 2] @ self._doubled[k - 1])
        return rotations

    @cached_property
    def tangents(self) -> list[Vec]:
        """Tangents of the backbone at the nodes."""
        return [Vec(turn.c, turn.s) for turn in self._rotations]

    @cached_property
    def end(self) -> Rotation:
        return self._rotations[-1] @ self._turns[-1]

    @cached_property
    def between(self) -> list[Rotation]:
        """Turns between pairs of nodes, in the order of ``itertools.combinations``."""
        turns: dict[tuple[int, int], Rotation] = {}
        for j, k in itertools.combinations(range(self._count), 2):
            if k - j <= 2:
                turns[j, k] = self._turns[k] if k == j + 1 else self._doubled[j + 1]
            else:
                turns[j, k] = turns[j, k - 2] @ self._doubled[k - 1]
        return list(turns.values())


@dataclass(frozen=True)
class LinkTable:
    """Table of a link of m nodes and L local coordinates: arrays, or in ``filled`` matrices of CasADi.

    Pairs of nodes j < k are in the order of ``itertools.combinations``; before them stands the diagonal.
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

    @property
    def numbers(self) -> Array:
        """All entries, one after the other."""
        return np.concatenate([np.ravel(getattr(self, each.name)) for each in fields(self)])

    def turned(self, local: Sequence[Scalar], rest: Scalar, reach: Sequence[float]) -> list[Rotation]:
        """Turns from node to node at local coordinates, up to ``reach`` [rad], with a factor of those at rest."""
        angles = ca.mtimes(self.turns.T, ca.vertcat(*local)) + rest * self.rest
        return [rotation(angles[k], angle) for k, angle in enumerate(reach)]

    def filled(self, entries: ca.SX | ca.DM) -> LinkTable:
        """A table of the same form, of columns in the order of ``numbers``."""
        at, parts = 0, {}
        for each in fields(self):
            shape = np.shape(getattr(self, each.name))
            size = int(np.prod(shape))
            block = entries[at : at + size]
            parts[each.name] = ca.reshape(block, shape[-1], size // shape[-1]).T if len(shape) == 2 else block
            at += size
        return LinkTable(**parts)


class TabulatedLink:
    """End and kinetics of a link by a table, and by the turns from its start to the nodes, between them and to its end.

    ``length``, ``density`` and ``rotary`` are factors of the length, of the mass and of the rotary inertia.
    """

    def __init__(
        self,
        table: LinkTable,
        turns: Sequence[Rotation],
        length: Scalar = 1.0,
        density: Scalar = 1.0,
        rotary: Scalar = 1.0,
    ) -> None:
        self._table, self._length, self._rotary = table, length, rotary * length
        self._first = density * length * length
        self._second, self._mass = self._first * length, density * length
        self.directions = Directions(turns)

    @cached_property
    def _tangents(self) -> tuple[ca.SX, ca.SX]:
        x, y = zip(*[(at.x, at.y) for at in self.directions.tangents], strict=True)
        return ca.vertcat(*x), ca.vertcat(*y)

    def _weighed(self, weights: ca.SX, scale: Scalar) -> Vec:
        x, y = self._tangents
        return Vec(ca.dot(weights, x), ca.dot(weights, y)).scaled(scale)

    def _rows(self, weights: ca.SX, scale: Scalar) -> tuple[Vec, ...]:
        return tuple(self._weighed(row.T, scale) for row in ca.vertsplit(weights))

    @cached_property
    def end(self) -> LinkSection:
        table, length = self._table, self._length
        position, arms = self._weighed(table.position, length), self._rows(table.arms, length * length)
        return LinkSection(position, self.directions.end, arms, tuple(bend * length for bend in table.bends.elements()))

    @cached_property
    def inertia(self) -> Inertia:
        """Mass integrals."""
        table, length, size = self._table, self._length, len(self._table.bends.elements())
        cosines = ca.vertcat(1.0, *[turn.c for turn in self.directions.between])
        turning, square = table.rotary.elements(), length * length

        def form(row: ca.SX, at: int, scale: Scalar) -> Scalar:
            value: Scalar = scale * (self._second * ca.dot(row, cosines) + self._rotary * turning[at])
            return value

        lower = [(a, b) for a in range(size) for b in range(a + 1)]
        entries = {pair: form(table.matrix[k, :].T, 1 + size + k, square) for k, pair in enumerate(lower)}
        return Inertia(
            mass=self._mass * table.mass.elements()[0],
            first=self._weighed(table.first, self._first),
            second=form(table.second, 0, 1.0),
            arms=self._rows(table.first_arms, self._second),
            swing=tuple(form(table.swing[a, :].T, 1 + a, length) for a in range(size)),
            matrix=tuple(tuple(entries[max(a, b), min(a, b)] for b in range(size)) for a in range(size)),
        )

    def _squares(self, omega: Scalar, rates: Sequence[Scalar]) -> ca.SX:
        """Squared angular velocities of the nodes."""
        spins = omega + ca.mtimes(self._table.shape.T, ca.vertcat(*[self._length * rate for rate in rates]))
        return spins * spins

    def end_bias(self, omega: Scalar, rates: Sequence[Scalar]) -> Vec:
        """Reversed velocity-product acceleration of the end section."""
        return self._weighed(self._table.position * self._squares(omega, rates), self._length)

    def bias(self, omega: Scalar, rates: Sequence[Scalar]) -> Bias:
        """Velocity-product terms."""
        table, squares, count = self._table, self._squares(omega, rates), len(self.directions.tangents)
        loads: list[Scalar] = [0.0] * count
        pairs = zip(itertools.combinations(range(count), 2), self.directions.between, strict=True)
        for at, ((j, k), turn) in enumerate(pairs):
            # sin is odd: what node k exerts on j, j exerts on k with the other sign.
            sine = table.sines[at] * turn.s
            loads[j] += sine * squares[k]
            loads[k] -= sine * squares[j]
        column, turned = ca.vertcat(*loads), self._second * self._length
        return Bias(
            end=self._weighed(table.position * squares, self._length),
            force=self._weighed(table.first * squares, self._first),
            moment=self._second * ca.sum1(column),
            generalized=tuple(turned * ca.dot(row.T, column) for row in ca.vertsplit(table.shape)),
        )
