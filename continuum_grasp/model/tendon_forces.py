"""What tendons that have a tension of their own exert: those with friction, and those that are wound up."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from continuum_grasp.model.family import nodes_of
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
from continuum_grasp.model.winches import compliance, soft, soft_integral, stiffnesses

_LITTLE = 1e-3
"""Tension that keeps a mean over slack tendons finite [N]."""


@dataclass(frozen=True)
class Pulls:
    """What drives give the tendons: tensions at the base [N], or cable that is wound up [m] and its rates.

    Tensions may be a function of the compliances of the tendons [m/N] and of their paths, drawn in by the bend [m].
    """

    tensions: Sequence[Scalar] | Callable[[Sequence[Scalar], Sequence[Scalar]], Sequence[Scalar]] = ()
    wound: Sequence[Scalar] = ()
    rates: Sequence[Scalar] = ()


class TendonForces:
    """Generalized forces of the tendons of a model, and the rates of their friction states.

    Parameters
    ----------
    structure : Structure
    lengths : sequence of Scalar
        Of the elements [m].
    full, rates : sequence of Scalar
        Full coordinates and their rates.
    pulls : Pulls
        Of each tendon, at its drive.
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
        pulls: Pulls,
        states: Sequence[Scalar],
        moved: Scalar | None = None,
    ) -> None:
        self._made, self._par, self._lengths = structure, structure.parameters, lengths
        self._full, self._rates, self._pulls, self._states, self._moved = full, rates, pulls, states, moved

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

    def _presliding(self, cells: CellSet) -> Scalar:
        return self._par["tendon_presliding"] if self._par.is_runtime("tendon_presliding") else cells.presliding

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
            per_path = self._arm_size(cells) / self._presliding(cells)
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
    def _frictional(self) -> set[int]:
        return {tendon for cells in self._made.cell_sets for tendon in cells.tendons}

    @cached_property
    def shares(self) -> list[Shares]:
        """Shares of the tensions at the drives, per set."""
        found = []
        for cells, mu, bends, ways in zip(
            self._made.cell_sets, self._friction, self._bends, self.directions, strict=True
        ):
            inside = ways[-len(bends) :]
            halves = [(-0.5 * mu) * (way * bend) for way, bend in zip(inside, bends, strict=True)]
            conduit = ways[0] * (-cells.conduit_bend * mu) if cells.conduit_bend else None
            found.append(shares(halves, conduit, cells.sides))
        return found

    # -- winches --------------------------------------------------------------------------------------------------

    def _path(self, tendon: int, values: Sequence[Scalar], *, rest: bool) -> Scalar:
        """How much a tendon is drawn in by a curvature [m]; equal for both of a pair but for its sign."""
        made, shape = self._made, self._made.own_tendons[tendon].shape
        works = [made.family.work(k, self._lengths, shape) for k in range(len(self._lengths))]
        drawn = sum((sum(column) * value for column, value in zip(zip(*works, strict=True), values, strict=True)), 0.0)
        if rest:
            drawn += self._drawn_at_rest(tendon)
        return self.arm(tendon) * drawn

    def _drawn_at_rest(self, tendon: int) -> Scalar:
        mesh, shape = self._made.mesh, self._made.own_tendons[tendon].shape
        runtime = self._par.is_runtime("rest_curvature")
        total: Scalar = 0.0
        for k, length in enumerate(self._lengths):
            own = 0.0
            for s, weights in nodes_of(mesh.panels(k, mesh.rest, shape)):
                own += float(((1.0 if runtime else mesh.rest(s)) * shape(s)) @ weights)
            total += own * (length / mesh.lengths[k] if self._par.is_runtime("element_lengths") else 1.0)
        return self._par["rest_curvature"] * total if runtime else total

    @cached_property
    def _slack(self) -> list[Scalar]:
        """Cable wound up beyond taut, per tendon [m]."""
        return [y - self._path(k, self._full, rest=True) for k, y in enumerate(self._pulls.wound)]

    def _elongations(self, tendon: int) -> tuple[Scalar, list[Scalar]]:
        """Elongation of the tendon along each of its cells per tension at the base, as a factor [m/N] and shares."""
        own, passed = next(
            each for each in zip(self._made.cell_sets, self.shares, strict=True) if tendon in each[0].tendons
        )
        unit, found = own.cells[0].length, list[Scalar]()
        stiffness, _ = stiffnesses(self._made.finger.tendon_list[tendon], self._par)
        for cell, swell, middle in zip(own.cells, passed.swell, passed.middle[own.tendons.index(tendon)], strict=True):
            share = swell * middle
            if abs(cell.length - unit) > 1e-12 * unit:
                share *= cell.length / unit
            if self._par.is_runtime("element_lengths"):
                share *= self._lengths[cell.element] / self._made.lengths[cell.element]
            found.append(share)
        return unit / stiffness, found

    @cached_property
    def compliances(self) -> list[Scalar]:
        """Elongation of each tendon per tension at its drive [m/N]."""
        found: list[Scalar] = []
        for k, tendon in enumerate(self._made.finger.tendon_list):
            if k in self._frictional:
                unit, shares = self._elongations(k)
                found.append(unit * sum(shares) + 1.0 / stiffnesses(tendon, self._par)[1])
            else:
                found.append(compliance(tendon, self._made.length, self._par))
        return found

    @cached_property
    def _stiffnesses(self) -> list[Scalar]:
        return [1.0 / c for c in self.compliances]

    @cached_property
    def tensions(self) -> Sequence[Scalar]:
        """Of each tendon at its drive [N]."""
        given = self._pulls.tensions
        if callable(given):
            paths = [self._path(tendon, self._full, rest=True) for tendon in self._made.own_tendons]
            return given(self.compliances, paths)
        return given or [k * soft(slack) for slack, k in zip(self._slack, self._stiffnesses, strict=True)]

    def drawn(self, tendon: int, tension: Scalar) -> Scalar:
        """Cable that a taut tendon of a tension [N] is drawn in [m]."""
        return self._path(tendon, self._full, rest=True) + self.compliances[tendon] * tension

    @cached_property
    def along(self) -> list[list[Scalar]]:
        """Per tendon its tension [N] in the middle of its friction cells, or the one that it has all along."""
        found: list[list[Scalar]] = [[tension] for tension in self.tensions]
        for cells, passed in zip(self._made.cell_sets, self.shares, strict=True):
            for tendon, middle in zip(cells.tendons, passed.middle, strict=True):
                found[tendon] = [self.tensions[tendon] * share for share in middle]
        return found

    @cached_property
    def stored_energy(self) -> Scalar:
        """Energy of the elongated tendons [J], exactly where they have no friction."""
        slacks = zip(self._slack, self.compliances, strict=True)
        return sum((soft_integral(slack) / c for slack, c in slacks), 0.0)

    def _elongating(self, cells: CellSet) -> list[Scalar]:
        """Per state of a set the sliding by elongation beyond it per presliding [1/s]: on average, by tensions."""
        # Nothing elongates where a tendon is slack: there its tension, and with it the weight, is none.
        least = 1.0 / (sum(self.tensions[tendon] for tendon in cells.tendons) + _LITTLE)
        each: list[list[Scalar]] = []
        for tendon, side in zip(cells.tendons, cells.sides, strict=True):
            moving = self._pulls.rates[tendon] - self._path(tendon, self._rates, rest=False)
            unit, shares = self._elongations(tendon)
            weight = (side * unit / self._presliding(cells)) * (least * self.tensions[tendon])
            rate = weight * (self._stiffnesses[tendon] * moving)
            each.append([rate * share for share in shares])
        found: list[Scalar] = []
        beyond: Scalar = 0.0
        for grown in reversed([sum(parts) for parts in zip(*each, strict=True)]):
            found.append(beyond + 0.5 * grown)
            beyond = beyond + grown
        return [*([beyond] if cells.conduit_bend else []), *reversed(found)]

    @cached_property
    def state_rates(self) -> list[Scalar]:
        """Rates of the friction states [1/s]."""
        rates, entry = list[Scalar](), 0
        for cells in self._made.cell_sets:
            # Per presliding, which saves products.
            arm = self._arm_size(cells) / self._presliding(cells)
            sliding = [arm * slid for slid in self._beyond(cells, self._rates, rest=False)]
            if self._pulls.wound:
                sliding = [u + v for u, v in zip(sliding, self._elongating(cells), strict=True)]
            for slid in sliding:
                rates.append(state_rate(self._states[entry], slid))
                entry += 1
        return rates

    # -- forces ---------------------------------------------------------------------------------------------------

    @cached_property
    def on_elements(self) -> list[list[Scalar]]:
        """Generalized forces on the local coordinates of each element."""
        made = self._made
        total: list[list[Scalar]] = [[0.0] * len(made.family.local(k)) for k in range(len(made.lengths))]
        for tendon, source in made.own_tendons.items():
            pull = self.arm(tendon) * self.tensions[tendon]
            if tendon not in self._frictional:
                for k, forces in enumerate(total):
                    work = made.family.work(k, self._lengths, source.shape)
                    for i, a in enumerate(made.family.local(k)):
                        forces[i] += pull * work[a]
        for cells, passed in zip(made.cell_sets, self.shares, strict=True):
            size = self._arm_size(cells)
            pulls = [size * self.tensions[tendon] for tendon in cells.tendons]
            for k, cell in enumerate(cells.cells):
                # Of all tendons of the set together: they bend by the same shapes.
                parts = [pull * own[k] for pull, own in zip(pulls, passed.middle, strict=True)]
                mean = passed.swell[k] * sum(side * part for side, part in zip(cells.sides, parts, strict=True))
                lean = passed.halves[k] * sum(parts)
                forces, scale = total[cell.element], self._scale(cell.element)
                for i, (work, first) in enumerate(zip(cell.work.tolist(), cell.lean.tolist(), strict=True)):
                    forces[i] += scale[i] * work * mean
                    if first != 0.0:
                        forces[i] += (2.0 * first * scale[i]) * lean
        return total

    @cached_property
    def actuation(self) -> list[Scalar]:
        """Generalized forces on all coordinates."""
        total: list[Scalar] = [0.0] * self._made.family.size
        for k, forces in enumerate(self.on_elements):
            for a, force in zip(self._made.family.local(k), forces, strict=True):
                total[a] += force
        return total
