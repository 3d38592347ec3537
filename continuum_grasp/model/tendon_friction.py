"""Dry friction of tendons with a memory: cells along the finger, each with a state of its sliding.

By the capstan law (W. Euler and J. A. Eytelwein) the tension changes by the factor exp(-friction bend) along a tendon
that slides towards the base, and by its inverse where it slides the other way; where it sticks, by something between.
Cell k has a state z that says which of these it is (``memory``): it follows the sliding of the tendon at the middle of
the cell, per presliding.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import casadi as ca
import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.model.family import Family
from continuum_grasp.model.planar import Scalar
from continuum_grasp.scene import Channel, Curve, Tendon


@dataclass(frozen=True)
class Cell:
    """A part of an element with one friction state.

    Each sequence has an entry per local coordinate. An entry is an integral along the cell of the curvature that a unit
    of the coordinate causes. All sequences but ``lean`` have one more entry, the integral of the rest curvature, or of
    1 if the rest curvature is a run-time number.

    Attributes
    ----------
    element : int
    share : Scalar
        Length of the cell per length of the finger [1].
    length : Scalar
        Length of the cell [m].
    bends : sequence of sequences
        Integral of the curvature, one sequence per smooth part of the cell: at a jump of the rest curvature the finger
        may begin to bend to the other side.
    work : sequence
        Integral of the curvature times the shape of the tendon's moment.
    lean : sequence
        As ``work``, times the distance from the middle of the cell per its length; divided by ``most``.
    late : sequence
        As ``work``, over the half of the cell next to the tip.
    most : float
        Greatest of the integrals of ``lean`` [m].
    """

    element: int
    share: Scalar  # length per that of the finger [1]
    length: Scalar  # [m]
    bends: Sequence[Sequence[Scalar]]
    work: Sequence[Scalar]
    lean: Sequence[Scalar]
    late: Sequence[Scalar]
    most: float = 1.0  # [m]


@dataclass(frozen=True)
class SlidingSet:
    """Tendons that slide alike, to and fro, at the same distance from the backbone along the finger."""

    tendons: tuple[int, ...]
    sides: tuple[float, ...]  # sign of each one's arm
    presliding: float  # [m]
    conduit_bend: float  # of a sheath before the finger [rad]
    has_friction: bool = True


def sliding_sets(channels: Sequence[Channel], tendons: Sequence[Tendon], *, frictional: bool) -> list[SlidingSet]:
    """Group tendons, with a channel each, by how they slide; ``frictional``: all have friction."""
    groups: dict[tuple[Curve, float, object], list[int]] = {}
    for k, (channel, tendon) in enumerate(zip(channels, tendons, strict=True)):
        properties = tendon.friction, tendon.friction_cells, tendon.presliding_length, tendon.conduit_bend
        has_friction = frictional or tendon.friction > 0.0
        groups.setdefault((channel.shape, abs(channel.arms[k]), properties if has_friction else None), []).append(k)
    sets = []
    for (*_, friction), group in groups.items():
        first, has_friction = tendons[group[0]], friction is not None
        sides = tuple(1.0 if channels[k].arms[k] > 0.0 else -1.0 for k in group)
        conduit = first.conduit_bend if has_friction else 0.0
        sets.append(SlidingSet(tuple(group), sides, first.presliding_length, conduit, has_friction))
    return sets


@dataclass(frozen=True)
class CellSet(SlidingSet):
    """A set of tendons and the parts of the finger along them: where they have friction, one state per cell serves
    them all. Where the conduit's bend is not zero, the first state is that of the conduit.
    """

    cells: tuple[Cell, ...] = ()

    @property
    def states(self) -> int:
        """Number of friction states."""
        return (len(self.cells) + (self.conduit_bend > 0.0)) * self.has_friction

    def names(self, number: int) -> list[str]:
        """Name and unit of each state; ``number`` counts the sets from one."""
        inside = [f"friction_{number}_{k + 1} [1]" for k in range(len(self.cells))]
        return [f"friction_{number}_conduit [1]"] * (self.conduit_bend > 0.0) + inside


def tendon_sets(
    family: Family, channels: Sequence[Channel], tendons: Sequence[Tendon], *, frictional: bool, unit_rest: bool
) -> tuple[CellSet, ...]:
    """Sets of tendons with a channel each; one cell per element for those without friction.

    ``frictional``: all have friction. ``unit_rest``: integrals are of a rest curvature of one.
    """
    sets = []
    for alike in sliding_sets(channels, tendons, frictional=frictional):
        first = alike.tendons[0]
        count = tendons[first].friction_cells if alike.has_friction else 1
        sets.append(CellSet(**vars(alike), cells=_cells(family, channels[first], count, unit_rest)))
    return tuple(sets)


def _cells(family: Family, channel: Channel, count: int, unit_rest: bool) -> tuple[Cell, ...]:
    mesh, cells = family.mesh, list[Cell]()
    for element in range(family.elements):
        start, end = mesh.ends[element], min(mesh.ends[element + 1], channel.to)
        if end - start <= 1e-9 * mesh.ends[-1]:
            break
        bounds = pairwise(np.linspace(start, end, count + 1).tolist())
        cells += [_cell(family, channel.shape, element, a, b, unit_rest) for a, b in bounds]
    return tuple(cells)


def _cell(family: Family, shape: Curve, element: int, a: float, b: float, unit_rest: bool) -> Cell:
    mesh, middle = family.mesh, 0.5 * (a + b)

    def parts(s: Array) -> Array:
        bent = family.shapes_at(element, s)
        bent[-1] = 1.0 if unit_rest else bent[-1]
        return np.stack([bent, bent * shape(s), bent * shape(s) * (s - middle) / (b - a)])

    curves = mesh.stiffness, mesh.rest, shape
    early, late = (mesh.integral(*half, parts, *curves) for half in ((a, middle), (middle, b)))
    _, work, lean = early + late
    along = mesh.stiffness, mesh.linear_density, mesh.rotary_inertia, mesh.rest, shape
    ends = sorted({a, b, *(at for curve in along for at in curve.breaks if a < at < b)})
    bends = [mesh.integral(*part, parts, *curves)[0].tolist() for part in pairwise(ends)]
    lean = np.where(np.abs(lean) > 1e-12 * np.abs(work[:-1]).max(), lean, 0.0)[:-1]
    # Of two nodes they often differ by their sign alone: one product serves both.
    greatest_lean = max(lean.tolist(), key=abs) or 1.0
    leaning = [round(each / greatest_lean, 12) for each in lean.tolist()]
    share = (b - a) / mesh.ends[-1]
    return Cell(element, share, b - a, bends, work.tolist(), leaning, late[1].tolist(), greatest_lean)


def rounded(bend: Scalar, share: Scalar) -> Scalar:
    """A bend [rad] without sign, smooth when straight: b^2 / sqrt(b^2 + (1e-3 rad share)^2)."""
    # 1e-3: bend of the whole finger below which the capstan law is rounded off to stay smooth [rad]: with a coefficient
    # of 0.5 the tension is off by a share of 5e-4 at most
    square, rounding = bend * bend, 1e-3 * share
    return square / ca.sqrt(square + rounding * rounding)


@dataclass(frozen=True)
class Shares:
    """Shares of the tensions at the drives of tendons that slide alike: with half the loss of each cell in logarithms.

    Per tendon ``middle`` has those in the middle of the cells, and ``mean`` those along them on average.
    """

    halves: list[Scalar]
    middle: list[list[Scalar]]
    mean: list[list[Scalar]]


def shares(halves: Sequence[Scalar], conduit: Scalar | None, sides: Sequence[float]) -> Shares:
    """Shares by half the losses across the cells, in logarithms, and by the loss across a conduit before them.

    All are for a tendon on the -X side; on the other one friction acts the other way.
    """
    gained: list[Scalar] = []
    passed: Scalar = 0.0 if conduit is None else conduit
    for k, half in enumerate(halves):
        passed = passed + (half if k == 0 else halves[k - 1] + half)
        gained.append(ca.exp(passed))
    middle = [[1.0 / share for share in gained] if side > 0.0 else gained for side in sides]
    # sinh(x / 2) / (x / 2): the mean of the exponential over its value in the middle.
    swell = [1.0 + half * half * (1.0 / 6.0) for half in halves]
    mean = [[a * b for a, b in zip(swell, row, strict=True)] for row in middle]
    return Shares(list(halves), middle, mean)
