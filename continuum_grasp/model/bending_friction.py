"""Dry friction in bending, with a memory: branches of springs that slide at a moment, in cells along the finger.

A branch of stiffness k resists the curvature by the moment k (kappa - slid), and slides where that would exceed its
moment M: a stop operator, and several of them the law of W. D. Iwan (1966, doi:10.1115/1.3625199). Its state follows
the mean curvature of the cell as those of tendon friction follow their sliding (``tendon_friction``),

    z' = kappa' k / M - (z - clip(z)) / time,    moment M clip(z),

and the energy that it stores per length, M^2/k (z clip(z) - clip(z)^2 / 2), falls short of the work done by
M^2/k (|z| - 1) / time where it slides, which is never negative: no time step aside, friction creates no energy.

Branches go with the stiffness of the section, as the damping of the material does: the curvature at which they slide is
the same everywhere, and the mean over a cell is weighted by the stiffness.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import casadi as ca
import numpy as np

from continuum_grasp.model.family import Array, Family, nodes_of
from continuum_grasp.model.parameters import Parameters
from continuum_grasp.model.planar import Scalar
from continuum_grasp.model.tendon_friction import RETURN_TIME, clipped, state_rate


@dataclass(frozen=True)
class BendingCell:
    """A part of an element along which the branches have one state each."""

    element: int
    length: float  # of a uniform finger; the integral of the stiffness per that at the base [m]
    weights: Array  # integral of the same times the shapes of the element's coordinates


def bending_cells(family: Family, count: int) -> tuple[BendingCell, ...]:
    """The cells of all elements, ``count`` on each; one where the curvature is constant."""
    mesh, found = family.mesh, []
    count = count if family.degree else 1
    base = float(mesh.stiffness(0.0))
    for element in range(family.elements):
        bounds = np.linspace(mesh.ends[element], mesh.ends[element + 1], count + 1)
        panels = mesh.panels(element, mesh.stiffness, mesh.rest)
        for a, b in pairwise(bounds.tolist()):
            inside = [(max(low, a), min(high, b)) for low, high in panels if low < b and high > a]
            length, weights = 0.0, np.zeros(len(family.local(element)))
            for s, w in nodes_of(inside):
                share = w * mesh.stiffness(s) / base
                length += float(share.sum())
                weights += family.shapes_at(element, s)[:-1] @ share
            # What is rounding would cost an instruction.
            weights[np.abs(weights) < 1e-12 * np.abs(weights).max()] = 0.0
            found.append(BendingCell(element, length, weights))
    return tuple(found)


class BendingFriction:
    """Generalized forces of dry friction in bending, and the rates of its states: cell by cell, branch by branch.

    Parameters
    ----------
    family : Family
    cells : sequence of BendingCell
    parameters : Parameters
    lengths : sequence of Scalar
        Of the elements [m].
    full : sequence of Scalar
        Full coordinates.
    states : sequence of Scalar
        One per cell and branch.
    moved : Scalar, optional
        At rest a number h, by which friction acts as ``clip(state + h bent)`` of the curvature above rest, per that at
        which the branch slides.
    """

    def __init__(
        self,
        family: Family,
        cells: Sequence[BendingCell],
        parameters: Parameters,
        lengths: Sequence[Scalar],
        full: Sequence[Scalar],
        states: Sequence[Scalar],
        moved: Scalar | None = None,
    ) -> None:
        self._family, self._cells, self._lengths = family, cells, lengths
        self._full, self._states, self._moved = full, states, moved
        branches = parameters.branches
        self.branches: list[tuple[Scalar, Scalar]] = [
            (parameters[f"dry_friction_{k + 1}_stiffness"], parameters[f"dry_friction_{k + 1}_moment"])
            for k in range(branches)
        ]
        self._variable = parameters.is_runtime("element_lengths")

    @property
    def stiffness(self) -> Scalar:
        """Of all branches while they stick [N m2], at the base."""
        return sum((stiffness for stiffness, _ in self.branches), 0.0)

    def _stretched(self, cell: BendingCell) -> tuple[Scalar, list[Scalar]]:
        """Length and weights of a cell, whose element may have another length at run time."""
        if not self._variable:
            return cell.length, [float(w) for w in cell.weights]
        nominal = self._family.mesh.lengths
        ratio = self._lengths[cell.element] / nominal[cell.element]
        own, usual = (self._family.work(cell.element, lengths) for lengths in (self._lengths, nominal))
        local = self._family.local(cell.element)
        return cell.length * ratio, [
            own[a] * (float(w) / float(usual[a])) for a, w in zip(local, cell.weights, strict=True)
        ]

    def _mean(self, cell: BendingCell, values: Sequence[Scalar]) -> Scalar:
        """Mean curvature, or rate, of a cell [1/m]."""
        length, weights = self._stretched(cell)
        local = self._family.local(cell.element)
        return sum(((w / length) * values[a] for a, w in zip(local, weights, strict=True) if not _is_zero(w)), 0.0)

    @property
    def bent(self) -> list[Scalar]:
        """Curvature above rest per that at which the branch slides, per state."""
        return [
            stiffness / moment * kappa
            for kappa in [self._mean(cell, self._full) for cell in self._cells]
            for stiffness, moment in self.branches
        ]

    @property
    def _ways(self) -> list[Scalar]:
        if self._moved is None:
            return [clipped(z) for z in self._states]
        return [clipped(z + self._moved * bent) for z, bent in zip(self._states, self.bent, strict=True)]

    @property
    def on_elements(self) -> list[list[Scalar]]:
        """Generalized forces on the local coordinates of every element, against the bending."""
        total: list[list[Scalar]] = [[0.0] * len(self._family.local(k)) for k in range(self._family.elements)]
        ways = iter(self._ways)
        for cell in self._cells:
            moment = sum((limit * next(ways) for _, limit in self.branches), 0.0)
            _, weights = self._stretched(cell)
            for i, weight in enumerate(weights):
                if not _is_zero(weight):
                    total[cell.element][i] += weight * moment
        return total

    @property
    def force(self) -> list[Scalar]:
        """Generalized forces on all coordinates, against the bending."""
        total: list[Scalar] = [0.0] * self._family.size
        for k, forces in enumerate(self.on_elements):
            for a, force in zip(self._family.local(k), forces, strict=True):
                total[a] += force
        return total

    def state_rates(self, rates: Sequence[Scalar], part: Scalar = 0.0) -> list[Scalar]:
        """Rates of the states [1/s] at rates of the coordinates; ``part`` [s]: of a step that is implicit in it."""
        means = [self._mean(cell, rates) for cell in self._cells]
        bending = [stiffness / moment * rate for rate in means for stiffness, moment in self.branches]
        found = [state_rate(z, rate) for z, rate in zip(self._states, bending, strict=True)]
        if isinstance(part, float) and part == 0.0:
            return found
        # What is beyond its range returns to it.
        return [
            rate / (1.0 + part / RETURN_TIME * (ca.fabs(z) > 1.0)) for rate, z in zip(found, self._states, strict=True)
        ]

    @property
    def stored_energy(self) -> Scalar:
        """Energy in the springs of the branches [J]."""
        total: Scalar = 0.0
        states = iter(self._states)
        for cell in self._cells:
            length, _ = self._stretched(cell)
            for stiffness, moment in self.branches:
                z = next(states)
                y = clipped(z)
                total += length * moment * moment / stiffness * (z * y - 0.5 * (y * y))
        return total


def _is_zero(value: Scalar) -> bool:
    return isinstance(value, float) and value == 0.0
