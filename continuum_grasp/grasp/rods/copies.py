"""Copies of a grasp that differ in their data and share what the drives hold.

A copy has all unknowns and all limits of a grasp. Tensions are in newtons the same in all copies, whose fingers may
differ in their units:

    minimize  sum of the costs of all copies   subject to   limits of each copy,  tensions(copy k) = tensions(copy 0)
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from continuum_grasp.base import Array, Indices
from continuum_grasp.grasp.rods import kinds
from continuum_grasp.grasp.rods.problem import GraspRods
from continuum_grasp.nlp import BlockProblem


class RodCopies(BlockProblem):
    """The problem of copies of a grasp; the first one is the grasp itself.

    Parameters
    ----------
    copies : sequence of GraspRods
        With the same fingers, whose bounds of tensions only count in the first one.
    """

    def __init__(self, copies: Sequence[GraspRods]) -> None:
        super().__init__("copies", copies[0].table)
        self.copies = tuple(copies)
        self.included = [self.include(f"copy {k}", copy) for k, copy in enumerate(copies)]
        self.links = [self._linked(k) for k in range(1, len(copies))]

    def _linked(self, k: int) -> Indices:
        """Rows: a copy has the tensions of the first one, per unit of that."""
        first, other = self.included[0], self.included[k]
        rows = list[Indices]()
        for (a, unit, least), (b, own_unit, own_least) in zip(
            *map(_tensions, (self.copies[0], self.copies[k])), strict=True
        ):
            at, own, ratio = first.unknowns[a], other.unknowns[b], own_unit / unit
            self.bound(own, -np.inf, np.inf)
            shift = ratio * own_least - least
            row = self.rows(f"tension of copy {k}", "tendons", "1", 1, 1.0, shift, shift)
            self.add(kinds.share_kind(), at, row, [1.0])
            self.add(kinds.share_kind(), own, row, [-ratio])
            rows.append(row.ravel())
        return np.concatenate(rows)

    def split(self, x: Array) -> list[Array]:
        """Unknowns of each copy."""
        return [x[part.unknowns] for part in self.included]

    def joined(self, xs: Sequence[Array]) -> Array:
        """Unknowns of all copies by those of each."""
        x = np.zeros(self.size)
        for part, own in zip(self.included, xs, strict=True):
            x[part.unknowns] = own
        return x


def _tensions(problem: GraspRods) -> list[tuple[int, float, float]]:
    """Places of the pulls, and unit and least value of each."""
    pairs = zip(problem.parts, problem.numbers.fingers, strict=True)
    return [
        (int(at), pull.unit, pull.least)
        for part, finger in pairs
        for at, pull in zip(part.pulls, finger.section.pulls, strict=True)
    ]
