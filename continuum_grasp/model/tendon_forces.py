"""Forces of tendons that have a tension of their own: those with friction, and those that are wound up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import islice

from continuum_grasp.model.cables import Cables, soft_integral
from continuum_grasp.model.family import gathered
from continuum_grasp.model.memory import Instant
from continuum_grasp.model.planar import Scalar, is_zero
from continuum_grasp.model.structure import Structure
from continuum_grasp.model.tendon_friction import Cell, CellSet, Shares, rounded, shares
from continuum_grasp.model.winches import Motor, Winch, stiffnesses


@dataclass(frozen=True)
class Held:
    """A winch, and by what its drum is known: its states; at rest its command, or the tension of its first tendon."""

    winch: Winch
    command: Scalar | None
    states: Sequence[Scalar] = ()
    pulled: Scalar = 0.0

    def drum(self, cables: Cables) -> Scalar:
        """Position of what winds up."""
        if self.states:
            return self.winch.drum(self.states, cables)
        if self.command is not None:
            return self.winch.drum_at_rest(self.command, cables)
        return self.winch.position([cables.paths[0] + cables.compliances[0] * self.pulled], [1.0])

    @property
    def tensions(self) -> list[Scalar]:
        """Tensions of its tendons that the command alone gives [N]; none where they depend on where the drum is."""
        return [] if self.states or self.command is None else self.winch.given_at_rest(self.command)


class TendonForces:
    """Generalized forces of the tendons of a model, and the rates of their friction ``states``.

    ``pulls`` are the tension of each tendon at its drive [N], or the winches that hold them.
    """

    def __init__(
        self, structure: Structure, at: Instant, pulls: Sequence[Scalar] | Sequence[Held], states: Sequence[Scalar]
    ) -> None:
        self._made, self._par, self._lengths = structure, structure.parameters, at.lengths
        self._full, self._rates, self._memory, self._states = at.full, at.rates, at.memory, states
        self._sets = structure.tendon_sets
        self.held = [pull for pull in pulls if isinstance(pull, Held)]
        self._given = [pull for pull in pulls if not isinstance(pull, Held)]

    # -- geometry -------------------------------------------------------------------------------------------------

    def _scale(self, element: int) -> list[Scalar]:
        return self._made.family.length_factors(element, self._lengths)

    def _rest(self, cell: Cell, bent: Scalar) -> Scalar:
        """An integral of the rest curvature, which may be a run-time argument, as may the lengths."""
        if self._par.is_runtime("rest_curvature"):
            bent = self._par["rest_curvature"] * bent
        if self._par.is_runtime("element_lengths"):
            bent = bent * (self._lengths[cell.element] / self._made.lengths[cell.element])
        return bent

    def _arm_size(self, cells: CellSet) -> Scalar:
        """Distance of the tendons from the backbone at the base [m]."""
        tendon = cells.tendons[0]
        arm = abs(self._made.own_tendons[tendon].arms[tendon])
        return self._par["tendon_offset"] if self._par.is_runtime("tendon_offset") else arm

    def _presliding(self, cells: CellSet) -> Scalar:
        return self._par["tendon_presliding"] if self._par.is_runtime("tendon_presliding") else cells.presliding

    @cached_property
    def _friction(self) -> list[Scalar]:
        """Coefficient of each set."""
        if self._par.is_runtime("tendon_friction"):
            return [self._par["tendon_friction"] for _ in self._sets]
        return [self._made.finger.tendon_list[each.tendons[0]].friction for each in self._sets]

    def _bent(
        self, rows: Sequence[tuple[Cell, Sequence[Scalar]]], values: Sequence[Scalar], factor: Scalar, *, rest: bool
    ) -> Scalar:
        """Factor times what integrals along cells give together of a curvature, and of that at rest."""
        weights: dict[int, Scalar] = {}
        total: Scalar = 0.0
        for cell, (*integrals, bent) in rows:
            total += factor * self._rest(cell, bent) if rest else 0.0
            for a, w, k in zip(
                self._made.family.local(cell.element), integrals, self._scale(cell.element), strict=True
            ):
                # Neighbors share coordinates: one product for all cells.
                weights[a] = weights.get(a, 0.0) + factor * w * k
        return sum((w * values[a] for a, w in weights.items() if not is_zero(w)), total)

    def _sliding(self, cells: CellSet, values: Sequence[Scalar], grown: Sequence[Scalar] = ()) -> list[Scalar]:
        """Return the sliding per presliding from a change of curvature, per state, of a tendon on the -X side.

        It is taken at the middle of the cell: the integral of the tendon's shape times the change ``values`` of the
        coordinates from there on, and the length ``grown`` in the half cells there.
        """
        per_path = self._arm_size(cells) / self._presliding(cells)
        halves: list[tuple[Cell, Sequence[Scalar]]] = []  # from base to tip
        for cell in cells.cells:
            halves += [
                (cell, [each - late for each, late in zip(cell.work, cell.late, strict=True)]),
                (cell, cell.late),
            ]
        slidings: list[Scalar] = []
        slid: Scalar = 0.0
        # One step per cell: the halves on both sides of a boundary at once.
        for k in range(len(cells.cells), -1, -1):
            change = self._bent(halves[max(2 * k - 1, 0) : 2 * k + 1], values, per_path, rest=False)
            slid = slid + (change + sum(grown[max(k - 1, 0) : k + 1]))
            slidings.append(slid)
        return slidings[::-1] if cells.conduit_bend else slidings[-2::-1]

    # -- friction -------------------------------------------------------------------------------------------------

    @cached_property
    def slid(self) -> list[Scalar]:
        """Return the sliding of the tendons since the unloaded shape, per presliding, for each friction state."""
        return [slid for cells in self._made.cell_sets for slid in self._sliding(cells, self._full)]

    @cached_property
    def directions(self) -> list[list[Scalar]]:
        """Direction of friction, per set and state; tendons on the other side have the opposite one."""
        ways = iter(self._memory.ways(self._states, lambda: self.slid, eased=True))
        return [list(islice(ways, cells.states)) for cells in self._sets]

    @cached_property
    def shares(self) -> list[Shares]:
        """Shares of the tensions at the drives, per set."""
        per_set = []
        for cells, mu, ways in zip(self._sets, self._friction, self.directions, strict=True):
            # Half of a coefficient that is a number goes into the weights of the bend.
            scale, factor = (0.5 * mu, 1.0) if isinstance(mu, float) else (0.5, mu)
            halves: list[Scalar] = [0.0 for _ in cells.cells]
            if cells.has_friction:
                inside = zip(ways[-len(cells.cells) :], cells.cells, strict=True)
                halves = [factor * (way * self._turned(cell, scale)) for way, cell in inside]
            conduit = ways[0] * (cells.conduit_bend * mu) if cells.conduit_bend else None
            per_set.append(shares(halves, conduit, cells.sides))
        return per_set

    def _turned(self, cell: Cell, scale: Scalar) -> Scalar:
        """Return the unsigned bend of a cell, including the bend at rest, times a scale."""
        bends = [self._bent([(cell, bend)], self._full, scale, rest=True) for bend in cell.bends]
        return sum((rounded(bend, scale * cell.share) for bend in bends[1:]), rounded(bends[0], scale * cell.share))

    # -- winches --------------------------------------------------------------------------------------------------

    def _drawn(self, values: Sequence[Scalar], *, rest: bool) -> list[Scalar]:
        """Length of each tendon that a curvature draws in [m]; both of a pair differ in sign alone."""
        drawn: dict[int, Scalar] = {}
        for cells in self._sets:
            bent = self._bent([(cell, cell.work) for cell in cells.cells], values, 1.0, rest=rest)
            path = self._arm_size(cells) * bent
            drawn |= {k: path if side > 0.0 else -path for k, side in zip(cells.tendons, cells.sides, strict=True)}
        return [drawn[tendon] for tendon in sorted(drawn)]

    @cached_property
    def _path_rates(self) -> list[Scalar]:
        """Rates of the path lengths of the tendons [m/s]."""
        return self._drawn(self._rates, rest=False)

    @cached_property
    def _cables(self) -> list[Cables]:
        paths = self._drawn(self._full, rest=True)
        return [held.winch.cables(self.compliances, paths) for held in self.held]

    @cached_property
    def drums(self) -> list[Scalar]:
        """Position of what winds up, per winch."""
        return [held.drum(cables) for held, cables in zip(self.held, self._cables, strict=True)]

    @cached_property
    def _wound_rates(self) -> list[Scalar]:
        """Rate of the cable wound up, per tendon [m/s]."""
        rates: list[Scalar] = []
        for held, drum, cables in zip(self.held, self.drums, self._cables, strict=True):
            rate = held.winch.drum_rate(held.states, drum, cables, held.winch.of_its(self._path_rates))
            rates += [(side * held.winch.radius) * rate for side in held.winch.sides]
        return rates

    @cached_property
    def _slacks(self) -> list[list[Scalar]]:
        """Cable wound up beyond slack, per winch and tendon of it [m]."""
        return [cables.slacks(drum) for cables, drum in zip(self._cables, self.drums, strict=True)]

    def _lengths_of(self, cells: CellSet) -> tuple[float, list[Scalar]]:
        """Length of the first cell [m], and the lengths of all as its multiples."""
        lengths, multiples = [float(cell.length) for cell in cells.cells], list[Scalar]()
        unit = lengths[0]
        for cell, length in zip(cells.cells, lengths, strict=True):
            share: Scalar = length / unit if abs(length - unit) > 1e-12 * unit else 1.0
            if self._par.is_runtime("element_lengths"):
                share *= self._lengths[cell.element] / self._made.lengths[cell.element]
            multiples.append(share)
        return unit, multiples

    @cached_property
    def compliances(self) -> list[Scalar]:
        """Elongation of each tendon per tension at its drive [m/N]."""
        tendons = self._made.finger.tendon_list
        compliances: list[Scalar] = [0.0 for _ in tendons]
        for cells, passed in zip(self._sets, self.shares, strict=True):
            unit, lengths = self._lengths_of(cells)
            for tendon, means in zip(cells.tendons, passed.mean, strict=True):
                axial, series = stiffnesses(tendons[tendon], self._par)
                passing = sum(a * b for a, b in zip(lengths, means, strict=True))
                compliances[tendon] = (unit / axial) * passing + 1.0 / series
        return compliances

    @cached_property
    def tensions(self) -> Sequence[Scalar]:
        """Tension of each tendon at its drive [N]."""
        tensions = list(self._given)
        for k, held in enumerate(self.held):
            tensions += held.tensions or self._cables[k].tensions(self._slacks[k])
        return tensions

    @property
    def drive_rates(self) -> list[Scalar]:
        """Rates of the states of the winches."""
        rates: list[Scalar] = []
        for held in self.held:
            if held.command is not None:
                rates += held.winch.rates(held.states, held.command, held.winch.of_its(self.tensions))
        return rates

    @property
    def motors(self) -> list[tuple[Scalar, Scalar, Scalar, Scalar]]:
        """Angle, rate, torque without dry friction [N m] and inertia [kg m2] of each motor."""
        motors = []
        for held in self.held:
            if isinstance(held.winch, Motor) and held.command is not None:
                torque = held.winch.balance(held.states, held.command, held.winch.of_its(self.tensions))
                motors.append((held.states[0], held.states[1], torque, held.winch.inertia))
        return motors

    @property
    def kinetic_energy(self) -> Scalar:
        """Kinetic energy of motors [J]."""
        return sum((held.winch.kinetic_energy(held.states) for held in self.held), 0.0)

    @property
    def drives_at_rest(self) -> list[Scalar]:
        """States of the winches where they are held at rest."""
        states: list[Scalar] = []
        for held, drum in zip(self.held, self.drums, strict=True):
            states += held.winch.at(drum, held.winch.of_its(self.tensions), held.command)
        return states

    @cached_property
    def along(self) -> list[list[Scalar]]:
        """Per tendon its tension [N] in the middle of its friction cells, or the one that it has all along."""
        tensions: list[list[Scalar]] = [[tension] for tension in self.tensions]
        for cells, passed in zip(self._sets, self.shares, strict=True):
            for tendon, middle in zip(cells.tendons, passed.middle if cells.states else (), strict=False):
                tensions[tendon] = [self.tensions[tendon] * share for share in middle]
        return tensions

    @property
    def stored_energy(self) -> Scalar:
        """Energy of elongated tendons and gears [J], exactly where tendons have no friction."""
        if not self.held:
            return 0.0
        slacks = [
            (slack, held.winch.onset)
            for held, of_winch in zip(self.held, self._slacks, strict=True)
            for slack in of_winch
        ]
        gears = [held.winch.gear_energy(held.states, drum) for held, drum in zip(self.held, self.drums, strict=True)]
        return sum(
            (soft_integral(*slack) / c for slack, c in zip(slacks, self.compliances, strict=True)), sum(gears, 0.0)
        )

    @cached_property
    def _pulled(self) -> list[list[list[Scalar]]]:
        """Mean tension [N] along each cell, per set and tendon of it."""
        return [
            [
                [self.tensions[tendon] * mean for mean in means]
                for tendon, means in zip(cells.tendons, passed.mean, strict=True)
            ]
            for cells, passed in zip(self._sets, self.shares, strict=True)
        ]

    @property
    def _slight_tension(self) -> float:
        """Tension that keeps a mean over slack tendons finite [N]."""
        rod = self._made.finger.rod
        # 1/200: 1e-3 N of a hand's finger
        return rod.stiffness / rod.length**2 / 200.0

    def _elongating(self, cells: CellSet, pulled: Sequence[Sequence[Scalar]]) -> list[Scalar]:
        """Per cell the sliding by elongation of half of it per presliding [1/s]: on average, by tensions."""
        unit, lengths = self._lengths_of(cells)
        # Nothing elongates where a tendon is slack: there its tension, and with it the weight, is none.
        weight = (0.5 * unit / self._presliding(cells)) / (
            sum(self.tensions[tendon] for tendon in cells.tendons) + self._slight_tension
        )
        rates: list[Scalar] = [0.0] * len(cells.cells)
        for tendon, side, tensions in zip(cells.tendons, cells.sides, pulled, strict=True):
            axial, _ = stiffnesses(self._made.finger.tendon_list[tendon], self._par)
            moving = self._wound_rates[tendon] - self._path_rates[tendon]
            # Of the tension at the base, per itself and second.
            rate = ((1.0 / axial) * weight) * (moving / self.compliances[tendon])
            for k, tension in enumerate(tensions):
                rates[k] = rates[k] + rate * tension if side > 0.0 else rates[k] - rate * tension
        return [grown * length for grown, length in zip(rates, lengths, strict=True)]

    @cached_property
    def state_rates(self) -> list[Scalar]:
        """Rates of the friction states [1/s]."""
        sliding: list[Scalar] = []
        for cells, pulled in zip(self._sets, self._pulled, strict=True):
            if not cells.states:
                continue
            grown = self._elongating(cells, pulled) if self.held else ()
            sliding += self._sliding(cells, self._rates, grown)
        return [self._memory.rate(z, slid) for z, slid in zip(self._states, sliding, strict=True)]

    # -- forces ---------------------------------------------------------------------------------------------------

    @cached_property
    def on_elements(self) -> list[list[Scalar]]:
        """Generalized forces on the local coordinates of each element."""
        made = self._made
        total: list[list[Scalar]] = [[0.0] * len(made.family.local(k)) for k in range(len(made.lengths))]
        for cells, passed, pulled in zip(self._sets, self.shares, self._pulled, strict=True):
            size = self._arm_size(cells)
            for k, (cell, half) in enumerate(zip(cells.cells, passed.halves, strict=True)):
                # Of all tendons of the set together: they bend by the same shapes.
                parts = [tensions[k] for tensions in pulled]
                mean = sum(side * part for side, part in zip(cells.sides, parts, strict=True))
                lean = half * sum(parts)
                forces, scale = total[cell.element], self._scale(cell.element)
                for i, (work, first) in enumerate(zip(cell.work, cell.lean, strict=False)):
                    forces[i] += (size * work * scale[i]) * mean
                    if not is_zero(first):
                        forces[i] += first * scale[i] * ((-2.0 * cell.most * size) * lean)
        return total

    @cached_property
    def actuation(self) -> list[Scalar]:
        """Generalized forces on all coordinates."""
        return gathered(self._made.family, self.on_elements)
