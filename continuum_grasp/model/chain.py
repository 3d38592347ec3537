"""A chain of flexible links on a fixed base: kinematics, mass matrix and generalized forces by recursion.

The chain does not know which family a link is from. Vectors are in the base's axes with X along the undeformed
backbone. The recursions are those of a composite rigid body (mass matrix) and of Newton and Euler (velocity products,
gravity, point forces), with the bending coordinates of each link added; the velocity of a link's end is turned into the
axes of the next link, which the appendix of the paper forgets.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca

from continuum_grasp.model.link import Bias, Inertia, LoadedLink, Section
from continuum_grasp.model.planar import IDENTITY, ZERO, Rotation, Scalar, Vec


@dataclass(frozen=True)
class Place:
    """A section of the chain: a link and a fraction of its length."""

    link: int
    fraction: Scalar = 1.0


@dataclass(frozen=True)
class Force:
    """A point force, in the base's axes or, where it follows, in the section's."""

    place: Place
    vector: Vec
    follows: bool = False


@dataclass(frozen=True)
class Moment:
    """A point moment, positive counter-clockwise."""

    place: Place
    value: Scalar


@dataclass(frozen=True)
class _Wrench:
    force: Vec
    moment: Scalar


class Chain:
    """A chain of flexible links.

    Parameters
    ----------
    links : sequence of LoadedLink
        From base to tip.
    coordinates : sequence of tuple of int
        Per link, the global coordinate of each of its local ones; neighbors may share one.
    size : int
        Number of global coordinates.
    """

    def __init__(self, links: Sequence[LoadedLink], coordinates: Sequence[tuple[int, ...]], size: int) -> None:
        self.links = tuple(links)
        self.coordinates = tuple(coordinates)
        self.size = size

    # -- kinematics ----------------------------------------------------------------------------------------------

    @cached_property
    def rotations(self) -> tuple[Rotation, ...]:
        """Rotation of each link's start section, and of the tip."""
        turns = [IDENTITY]
        for link in self.links:
            turns.append(turns[-1] @ link.link.end.rotation)
        return tuple(turns)

    @cached_property
    def spans(self) -> tuple[Vec, ...]:
        """From each link's start to its end."""
        return tuple(r.apply(k.link.end.position) for r, k in zip(self.rotations, self.links, strict=False))

    @cached_property
    def _end_arms(self) -> tuple[tuple[Vec, ...], ...]:
        return tuple(
            tuple(r.apply(arm) for arm in k.link.end.arms) for r, k in zip(self.rotations, self.links, strict=False)
        )

    def _section(self, place: Place) -> tuple[Section, Vec, tuple[Vec, ...]]:
        """Section of a link; its position and arms turned into the base's axes."""
        section = self.links[place.link].link.section(place.fraction)
        if isinstance(place.fraction, float) and place.fraction == 1.0:
            return section, self.spans[place.link], self._end_arms[place.link]
        turn = self.rotations[place.link]
        return section, turn.apply(section.position), tuple(turn.apply(arm) for arm in section.arms)

    def position(self, place: Place) -> Vec:
        """Position of a section from the base."""
        total = self._section(place)[1]
        for span in self.spans[: place.link]:
            total = span + total
        return total

    def rotation(self, place: Place) -> Rotation:
        """Rotation of a section."""
        if isinstance(place.fraction, float) and place.fraction == 1.0:
            return self.rotations[place.link + 1]
        return self.rotations[place.link] @ self.links[place.link].link.section(place.fraction).rotation

    def _spin_after(self, k: int, omega: Scalar, local: Sequence[Scalar]) -> Scalar:
        for angle, rate in zip(self.links[k].link.end.angles, local, strict=True):
            omega += angle * rate
        return omega

    def end_velocities(self, rates: Sequence[Scalar]) -> list[tuple[Vec, Scalar]]:
        """Velocity and angular velocity of the end section of each link.

        Parameters
        ----------
        rates : sequence of scalars
            Rates of the global coordinates.
        """
        found: list[tuple[Vec, Scalar]] = []
        moved = ZERO
        omega: Scalar = 0.0
        for k, span in enumerate(self.spans):
            local = [rates[a] for a in self.coordinates[k]]
            moved += span.scaled(omega)
            for arm, rate in zip(self._end_arms[k], local, strict=True):
                moved += arm.scaled(rate)
            omega = self._spin_after(k, omega, local)
            found.append((moved.perp(), omega))
        return found

    # -- kinetics ------------------------------------------------------------------------------------------------

    @cached_property
    def _inertias(self) -> tuple[Inertia, ...]:
        """Mass integrals of each link about its start, in the base's axes."""
        result = []
        for turn, link in zip(self.rotations, self.links, strict=False):
            local = link.inertia()
            result.append(
                Inertia(
                    local.mass,
                    turn.apply(local.first),
                    local.second,
                    tuple(turn.apply(arm) for arm in local.arms),
                    local.swing,
                    local.matrix,
                )
            )
        return tuple(result)

    @cached_property
    def mass_matrix(self) -> list[list[Scalar]]:
        """Mass matrix by composite bodies; all entries, symmetric."""
        matrix: list[list[Scalar]] = [[0.0] * self.size for _ in range(self.size)]

        def add(a: int, b: int, value: Scalar) -> None:
            matrix[a][b] += value
            if a != b:
                matrix[b][a] = matrix[a][b]

        # Mass, first and second moment of everything beyond the link, about its end: from the tip inwards each link is
        # added once, so the cost grows with the square of the number of links, not with its cube.
        mass: Scalar = 0.0
        first: Vec = ZERO
        second: Scalar = 0.0
        for k in range(len(self.links) - 1, -1, -1):
            own, end, span, arms = self._inertias[k], self.links[k].link.end, self.spans[k], self._end_arms[k]
            here = self.coordinates[k]
            for a in range(len(here)):
                # Momentum of what lies beyond the link, per rate of a; then of the link too, about its start.
                push = arms[a].scaled(mass) + first.scaled(end.angles[a])
                twist = first.dot(arms[a]) + end.angles[a] * second
                for b in range(a + 1):
                    beyond = arms[b].dot(push) + end.angles[b] * twist
                    add(here[b], here[a], own.matrix[a][b] + beyond)
                force = own.arms[a] + push
                moment = own.swing[a] + twist + span.dot(push)
                for j in range(k - 1, -1, -1):
                    inner = self.links[j].link.end.angles
                    for b, arm, angle in zip(self.coordinates[j], self._end_arms[j], inner, strict=True):
                        value = arm.dot(force) + angle * moment
                        add(b, here[a], 2.0 * value if b == here[a] else value)
                    moment += self.spans[j].dot(force)
            second += 2.0 * span.dot(first) + mass * span.dot(span)
            second += own.second
            first = first + span.scaled(mass) + own.first
            mass += own.mass
        return matrix

    def motion_forces(
        self,
        rates: Sequence[Scalar] | None,
        gravity: Vec,
        forces: Sequence[Force] = (),
        moments: Sequence[Moment] = (),
    ) -> list[Scalar]:
        """Generalized forces that velocity products, weight and point loads exert on the coordinates.

        Parameters
        ----------
        rates : sequence or None
            Rates of the global coordinates; None leaves the velocity products out.
        gravity : Vec
            Gravity [m/s2]; ``ZERO`` leaves the weight out.
        forces, moments : sequences
            Point loads.

        Returns
        -------
        list
            Per global coordinate; M qdd = this + other generalized forces.
        """
        weight = gravity is not ZERO
        biases, fields = self._forward(rates, gravity)
        total: list[Scalar] = [0.0] * self.size
        wrench = _Wrench(ZERO, 0.0)
        for k in range(len(self.links) - 1, -1, -1):
            end, turn = self.links[k].link.end, self.rotations[k]
            force, moment = wrench.force, wrench.moment
            extra: list[Scalar] = [0.0] * len(end.arms)
            inner = _Wrench(ZERO, 0.0)
            for load in forces:
                if load.place.link != k:
                    continue
                vector = self.rotation(load.place).apply(load.vector) if load.follows else load.vector
                if isinstance(load.place.fraction, float) and load.place.fraction == 1.0:
                    force += vector
                else:
                    _, at, arms = self._section(load.place)
                    inner = _Wrench(inner.force + vector, inner.moment + at.cross(vector))
                    extra = [q + arm.cross(vector) for q, arm in zip(extra, arms, strict=True)]
            for couple in moments:
                if couple.place.link != k:
                    continue
                if isinstance(couple.place.fraction, float) and couple.place.fraction == 1.0:
                    moment += couple.value
                else:
                    section = self._section(couple.place)[0]
                    inner = _Wrench(inner.force, inner.moment + couple.value)
                    extra = [q + w * couple.value for q, w in zip(extra, section.angles, strict=True)]
            field, bias = fields[k], biases[k]
            if bias is not None:
                inner = _Wrench(inner.force + turn.apply(bias.force), inner.moment + bias.moment)
                extra = [q + g for q, g in zip(extra, bias.generalized, strict=True)]
            if weight or bias is not None:
                own = self._inertias[k]
                inner = _Wrench(inner.force + field.scaled(own.mass), inner.moment + own.first.cross(field))
                extra = [q + arm.cross(field) for q, arm in zip(extra, own.arms, strict=True)]
            for a, arm, angle, q in zip(self.coordinates[k], self._end_arms[k], end.angles, extra, strict=True):
                share = arm.cross(force) + angle * moment + q
                total[a] += share
            wrench = _Wrench(inner.force + force, inner.moment + moment + self.spans[k].cross(force))
        return total

    def _forward(self, rates: Sequence[Scalar] | None, gravity: Vec) -> tuple[list[Bias | None], list[Vec]]:
        """Per link: its velocity-product terms, and gravity less the velocity-product acceleration of its start."""
        biases: list[Bias | None] = []
        fields: list[Vec] = []
        omega: Scalar = 0.0
        field = gravity
        for k, link in enumerate(self.links):
            fields.append(field)
            if rates is None:
                biases.append(None)
                continue
            local = [rates[a] for a in self.coordinates[k]]
            bias = link.bias(omega, local)
            biases.append(bias)
            field += self.rotations[k].apply(bias.end)
            omega = self._spin_after(k, omega, local)
        return biases, fields

    def first_moment(self) -> tuple[Scalar, Vec]:
        """Mass of the chain and its first moment about the base."""
        mass: Scalar = 0.0
        first = ZERO
        for k in range(len(self.links) - 1, -1, -1):
            first = first + self.spans[k].scaled(mass) + self._inertias[k].first
            mass += self._inertias[k].mass
        return mass, first


def column(values: Sequence[Scalar]) -> ca.SX:
    """CasADi column of scalars."""
    return ca.vertcat(*[ca.SX(v) for v in values]) if values else ca.SX(0, 1)
