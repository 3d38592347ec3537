"""Copies of a grasp that differ in their data and share held values, such as tensions.

A copy has all unknowns and all limits of a grasp:

    minimize  sum of the costs of all copies   subject to   limits of each copy,  held(copy k) = held(copy 0)

Held values are in SI units the same in all copies, whose fingers may differ in their units.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from continuum_grasp.base import Array, Indices
from continuum_grasp.grasp.rods import kinds
from continuum_grasp.grasp.rods.problem import GraspRods
from continuum_grasp.nlp import BlockProblem


@dataclass(frozen=True)
class HeldValue:
    """An unknown of a copy that follows one of the first copy: ``ratio`` times that and a ``shift``."""

    own: int
    first: int
    ratio: float = 1.0
    shift: float = 0.0


@dataclass(frozen=True, eq=False)
class RodCopy:
    """A copy of a grasp, and the values that it shares with the first copy."""

    problem: GraspRods
    held: tuple[HeldValue, ...]

    def hold(self, x: Array) -> None:
        """Bound held values to the ones at unknowns of the first copy."""
        for value in self.held:
            given = value.ratio * x[value.first] + value.shift
            self.problem.bound(value.own, given, given)


def held_tensions(first: GraspRods, other: GraspRods, factor: float = 1.0) -> Iterator[HeldValue]:
    """Tensions of a copy: a factor times the tensions of the first copy."""
    for (a, unit, least), (b, own_unit, own_least) in zip(_tensions(first), _tensions(other), strict=True):
        ratio = factor * unit / own_unit
        yield HeldValue(b, a, ratio, ratio * least - own_least)


def held_by_drives(first: GraspRods, other: GraspRods, factor: float = 1.0) -> Iterator[HeldValue]:
    """Yield all that the drives of a copy hold: tensions and loads, times a factor, or lengths of cable."""
    tensions = {value.first: value for value in held_tensions(first, other, factor)}
    for index, (part, drives) in enumerate(zip(first.parts, first.drives, strict=True)):
        if not drives:
            yield from (tensions[at] for at in part.pulls.tolist())
        for drive, same in zip(drives, other.drives[index], strict=True):
            for at, own in zip(drive.held.tolist(), same.held.tolist(), strict=True):
                given = HeldValue(own, at, 1.0 if drive.numbers.locks else factor)
                yield tensions.get(at, given)


def _tensions(problem: GraspRods) -> Iterator[tuple[int, float, float]]:
    """Places of the pulls, and unit and least value of each."""
    for part, finger in zip(problem.parts, problem.numbers.fingers, strict=True):
        for at, pull in zip(part.pulls, finger.section.pulls, strict=True):
            yield int(at), pull.unit, pull.least


class RodCopies(BlockProblem):
    """The problem of a grasp and its copies.

    Parameters
    ----------
    first : GraspRods
        Bounds of held values count in this one alone.
    others : sequence of RodCopy
    """

    def __init__(self, first: GraspRods, others: Sequence[RodCopy]) -> None:
        super().__init__("copies", first.table)
        self.first, self.others = first, tuple(others)
        problems = [first, *(copy.problem for copy in others)]
        self.included = [self.include(f"copy {k}", problem) for k, problem in enumerate(problems)]
        self.links = [self._linked(k, copy) for k, copy in enumerate(others, 1)]

    def _linked(self, k: int, copy: RodCopy) -> Indices:
        """Rows of what a copy holds."""
        first, own = self.included[0].unknowns, self.included[k].unknowns
        row = self.rows(
            f"held by copy {k}",
            "robust",
            "1",
            len(copy.held),
            1.0,
            [[v.shift] for v in copy.held],
            [[v.shift] for v in copy.held],
        )
        for at, value in zip(row.ravel(), copy.held, strict=True):
            self.bound(own[value.own], -np.inf, np.inf)
            self.add(kinds.share_kind(), own[value.own], at, [1.0])
            self.add(kinds.share_kind(), first[value.first], at, [-value.ratio])
        return row.ravel()

    def split(self, x: Array) -> list[Array]:
        """Unknowns of each copy."""
        return [x[part.unknowns] for part in self.included]

    def joined(self, xs: Sequence[Array]) -> Array:
        """Unknowns of all copies by the unknowns of each."""
        return np.concatenate(list(itertools.chain(xs)))
