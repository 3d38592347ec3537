"""What tendons that have a tension of their own exert: those with friction, and those that are wound up."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from continuum_grasp.model.planar import Scalar
from continuum_grasp.model.structure import Structure
from continuum_grasp.model.tendon_friction import (
    Array,
    Cell,
    CellSet,
    Shares,
    clipped,
    direction,
    rounded,
    shares,
    state_rate,
)


class TendonForces:
    """Generalized forces of the tendons of a model, and the rates of their friction states.

    Parameters
    ----------
    structure : Structure
    lengths : sequence of Scalar
        Of the elements [m].
    full, rates : sequence of Scalar
        Full coordinates and their rates.
    tensions : sequence of Scalar
        Of each tendon at the base [N].
    states : sequence of Scalar
        Friction states.
    moved : Scalar, optional
        At rest a number h, by which friction acts as ``clip(state + h u / presliding)`` of the sliding u from the
        straight finger on. States alone are frictions that stay; h = 1 alone is that of a finger that was bent from
        straight to where it is.
    """

    def __init__(
        self,
        structure: Structure,
        lengths: Sequence[Scalar],
        full: Sequence[Scalar],
        rates: Sequence[Scalar],
        tensions: Sequence[Scalar],
        states: Sequence[Scalar],
        moved: Scalar | None = None,
    ) -> None:
        self._made, self._par, self._lengths = structure, structure.parameters, lengths
        self._full, self._rates, self._tensions, self._states, self._moved = full, rates, tensions, states, moved

    # -- geometry -------------------------------------------------------------------------------------------------

    def _scale(self, element: int) -> list[Scalar]:
        """Factors of the integrals of an element's shapes: not one where lengths are run-time arguments."""
        local, made = self._made.family.local(element), self._made
        if not self._par.is_runtime("element_lengths"):
            return [1.0] * len(local)
        own, nominal = (made.family.work(element, lengths) for lengths in (self._lengths, made.lengths))
        return [own[a] / float(nominal[a]) for a in local]

    def _on(self, cell: Cell, values: Sequence[Scalar], weights: Array) -> Scalar:
        local, scale = self._made.family.local(cell.element), self._scale(cell.element)
        terms = zip(weights.tolist(), scale, [values[a] for a in local], strict=True)
        return sum(((w * k) * v for w, k, v in terms if w != 0.0), 0.0)

    def _rest(self, cell: Cell, numeric: float, part: float = 1.0) -> Scalar:
        """A bend of the rest curvature, which may be a run-time argument, as may the lengths."""
        if not (self._par.is_runtime("rest_curvature") or self._par.is_runtime("element_lengths")):
            return numeric
        whole, nominal = self._lengths[cell.element], self._made.lengths[cell.element]
        return self._par["rest_curvature"] * whole * (part * cell.length / nominal)

    def arm(self, tendon: int) -> Scalar:
        """Signed distance of a tendon from the backbone at the base [m]."""
        arm = self._made.own_tendons[tendon].arms[tendon]
        return np.sign(arm) * self._par["tendon_offset"] if self._par.is_runtime("tendon_offset") else arm

    def _arm_size(self, cells: CellSet) -> Scalar:
        return cells.sides[0] * self.arm(cells.tendons[0])

    @cached_property
    def _friction(self) -> list[Scalar]:
        """Coefficient of each set."""
        if self._par.is_runtime("tendon_friction"):
            return [self._par["tendon_friction"] for _ in self._made.cell_sets]
        return [self._made.finger.tendon_list[each.tendons[0]].friction for each in self._made.cell_sets]

    @cached_property
    def _bends(self) -> list[list[Scalar]]:
        """Bend of each cell [rad], with that at rest, without sign."""
        return [
            [rounded(self._on(c, self._full, c.bend) + self._rest(c, c.rest_bend), c.share) for c in each.cells]
            for each in self._made.cell_sets
        ]

    def _beyond(self, cells: CellSet, values: Sequence[Scalar], *, rest: bool) -> list[Scalar]:
        """Per state the integral of the tendon's shape times a curvature, from the middle of the cell on."""
        found: list[Scalar] = []
        beyond: Scalar = 0.0
        for cell in reversed(cells.cells):
            late, whole = (self._on(cell, values, weights) for weights in (cell.late, cell.work))
            if rest:
                late += self._rest(cell, cell.rest_late, 0.5)
                whole += self._rest(cell, cell.rest_work)
            found.append(beyond + late)
            beyond = beyond + whole
        return [*([beyond] if cells.conduit_bend else []), *reversed(found)]

    # -- friction -------------------------------------------------------------------------------------------------

    @cached_property
    def slid(self) -> list[Scalar]:
        """Sliding of the tendons per presliding since the finger was straight, per friction state."""
        found: list[Scalar] = []
        for cells in self._made.cell_sets:
            per_path = self._arm_size(cells) / cells.presliding
            found += [per_path * u for u in self._beyond(cells, self._full, rest=True)]
        return found

    @cached_property
    def directions(self) -> list[list[Scalar]]:
        """Which way friction acts, per set and state; of tendons on the other side the other way."""
        ways = [direction(z) for z in self._states]
        if self._moved is not None:
            ways = [clipped(z + self._moved * slid) for z, slid in zip(self._states, self.slid, strict=True)]
        found, entry = [], 0
        for cells in self._made.cell_sets:
            found.append(ways[entry : entry + cells.states])
            entry += cells.states
        return found

    @cached_property
    def shares(self) -> dict[int, Shares]:
        """Shares of the tension at the base, per tendon with friction."""
        found = {}
        for cells, mu, bends, ways in zip(
            self._made.cell_sets, self._friction, self._bends, self.directions, strict=True
        ):
            inside = ways[-len(bends) :]
            losses = [way * (mu * bend) for way, bend in zip(inside, bends, strict=True)]
            conduit = ways[0] * (mu * cells.conduit_bend) if cells.conduit_bend else None
            for tendon, side in zip(cells.tendons, cells.sides, strict=True):
                turned = None if conduit is None else side * conduit
                found[tendon] = shares([side * loss for loss in losses], turned)
        return found

    @cached_property
    def state_rates(self) -> list[Scalar]:
        """Rates of the friction states [1/s]."""
        rates, entry = list[Scalar](), 0
        for cells in self._made.cell_sets:
            arm = self._arm_size(cells)
            for slid in self._beyond(cells, self._rates, rest=False):
                rates.append(state_rate(self._states[entry], arm * slid, cells.presliding))
                entry += 1
        return rates

    # -- forces ---------------------------------------------------------------------------------------------------

    @cached_property
    def on_elements(self) -> list[list[Scalar]]:
        """Generalized forces on the local coordinates of each element."""
        made = self._made
        total: list[list[Scalar]] = [[0.0] * len(made.family.local(k)) for k in range(len(made.lengths))]
        for tendon, source in made.own_tendons.items():
            pull = self.arm(tendon) * self._tensions[tendon]
            if tendon not in self.shares:
                for k, forces in enumerate(total):
                    work = made.family.work(k, self._lengths, source.shape)
                    for i, a in enumerate(made.family.local(k)):
                        forces[i] += pull * work[a]
        for cells in made.cell_sets:
            pulls = [self.arm(tendon) * self._tensions[tendon] for tendon in cells.tendons]
            own = [self.shares[tendon] for tendon in cells.tendons]
            for k, cell in enumerate(cells.cells):
                # Of all tendons of the set together: they bend by the same shapes.
                mean = sum((pull * each.mean[k] for pull, each in zip(pulls, own, strict=True)), 0.0)
                lean: Scalar = 0.0
                if cell.lean.any():
                    lean = sum(
                        (pull * (each.middle[k] * each.loss[k]) for pull, each in zip(pulls, own, strict=True)), 0.0
                    )
                forces, scale = total[cell.element], self._scale(cell.element)
                for i, (work, first) in enumerate(zip(cell.work.tolist(), cell.lean.tolist(), strict=True)):
                    forces[i] += scale[i] * work * mean
                    if first != 0.0:
                        forces[i] -= scale[i] * first * lean
        return total

    @cached_property
    def actuation(self) -> list[Scalar]:
        """Generalized forces on all coordinates."""
        total: list[Scalar] = [0.0] * self._made.family.size
        for k, forces in enumerate(self.on_elements):
            for a, force in zip(self._made.family.local(k), forces, strict=True):
                total[a] += force
        return total
