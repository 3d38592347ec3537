"""A chain of flexible links on a fixed base: kinematics, mass matrix and generalized forces by recursion.

The chain does not know which family a link is from. Vectors are in the base's axes with X along the undeformed
backbone. The recursions follow a composite rigid body (mass matrix) and Newton and Euler (velocity products,
gravity, point forces), with the bending coordinates of each link added; the velocity of a link's end is turned into the
axes of the next link, which the appendix of the paper forgets.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from continuum_grasp.model.link import Bias, Inertia, LinkSection, LoadedLink, is_end
from continuum_grasp.model.planar import IDENTITY, ZERO, Rotation, Scalar, Vec


@dataclass(frozen=True)
class ChainPlace:
    """A section of the chain: a link and a fraction of its length."""

    link: int
    fraction: Scalar = 1.0


@dataclass(frozen=True)
class Load:
    """A point force, in the base's axes or, if it follows, in the section's; and a couple, counter-clockwise."""

    place: ChainPlace
    force: Vec = ZERO
    couple: Scalar = 0.0
    follows: bool = False


@dataclass(frozen=True, eq=False)
class Chain:
    """A chain of flexible links, from base to tip."""

    links: Sequence[LoadedLink]
    coordinates: Sequence[tuple[int, ...]]  # per link the global one of each local one; neighbors may share one
    size: int  # number of global coordinates

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

    def _section(self, place: ChainPlace) -> tuple[LinkSection, Vec, tuple[Vec, ...]]:
        """Section of a link; its position and arms turned into the base's axes."""
        section = self.links[place.link].link.section(place.fraction)
        if is_end(place.fraction):
            return section, self.spans[place.link], self._end_arms[place.link]
        turn = self.rotations[place.link]
        return section, turn.apply(section.position), tuple(turn.apply(arm) for arm in section.arms)

    def position(self, place: ChainPlace) -> Vec:
        """Position of a section from the base."""
        total = self._section(place)[1]
        for span in self.spans[: place.link]:
            total = span + total
        return total

    def rotation(self, place: ChainPlace) -> Rotation:
        if is_end(place.fraction):
            return self.rotations[place.link + 1]
        return self.rotations[place.link] @ self.links[place.link].link.section(place.fraction).rotation

    def _spin_after(self, k: int, omega: Scalar, local: Sequence[Scalar]) -> Scalar:
        for angle, rate in zip(self.links[k].link.end.angles, local, strict=True):
            omega += angle * rate
        return omega

    def end_velocities(self, rates: Sequence[Scalar]) -> list[tuple[Vec, Scalar]]:
        """Velocity and angular velocity of the end section of each link, of rates of the global coordinates."""
        velocities: list[tuple[Vec, Scalar]] = []
        moved = ZERO
        omega: Scalar = 0.0
        for k, span in enumerate(self.spans):
            local = [rates[a] for a in self.coordinates[k]]
            moved += span.scaled(omega)
            for arm, rate in zip(self._end_arms[k], local, strict=True):
                moved += arm.scaled(rate)
            omega = self._spin_after(k, omega, local)
            # Arms are stored before their right angle: one turn at the end does for all of them.
            velocities.append((moved.perp(), omega))
        return velocities

    def velocity(self, place: ChainPlace, rates: Sequence[Scalar]) -> tuple[Vec, Scalar]:
        """Velocity and angular velocity of a section, of rates of the global coordinates."""
        velocity, omega = self.end_velocities(rates)[place.link - 1] if place.link else (ZERO, 0.0)
        section, at, arms = self._section(place)
        local, moved = [rates[a] for a in self.coordinates[place.link]], at.scaled(omega)
        for arm, angle, rate in zip(arms, section.angles, local, strict=True):
            moved += arm.scaled(rate)
            omega += angle * rate
        return velocity + moved.perp(), omega

    # -- kinetics ------------------------------------------------------------------------------------------------

    @cached_property
    def _inertias(self) -> tuple[Inertia, ...]:
        """Mass integrals of each link about its start, in the base's axes."""
        # The tip has a rotation of its own, in addition to those of the links.
        pairs = zip(self.rotations, (link.inertia() for link in self.links), strict=False)
        return tuple(
            replace(k, first=turn.apply(k.first), arms=tuple(turn.apply(arm) for arm in k.arms)) for turn, k in pairs
        )

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
            inertia, end, span, arms = self._inertias[k], self.links[k].link.end, self.spans[k], self._end_arms[k]
            here = self.coordinates[k]
            for a in range(len(here)):
                # Momentum of what lies beyond the link, per rate of a; then of the link too, about its start.
                push = arms[a].scaled(mass) + first.scaled(end.angles[a])
                twist = first.dot(arms[a]) + end.angles[a] * second
                for b in range(a + 1):
                    beyond = arms[b].dot(push) + end.angles[b] * twist
                    add(here[b], here[a], inertia.matrix[a][b] + beyond)
                force = inertia.arms[a] + push
                moment = inertia.swing[a] + twist + span.dot(push)
                for j in range(k - 1, -1, -1):
                    inner = self.links[j].link.end.angles
                    for b, arm, angle in zip(self.coordinates[j], self._end_arms[j], inner, strict=True):
                        value = arm.dot(force) + angle * moment
                        # A coordinate that neighbors share meets itself: both orders of the pair on the diagonal.
                        add(b, here[a], 2.0 * value if b == here[a] else value)
                    moment += self.spans[j].dot(force)
            second += 2.0 * span.dot(first) + mass * span.dot(span)
            second += inertia.second
            first = first + span.scaled(mass) + inertia.first
            mass += inertia.mass
        return matrix

    def motion_forces(self, rates: Sequence[Scalar] | None, gravity: Vec, loads: Sequence[Load] = ()) -> list[Scalar]:
        """Generalized forces that velocity products, weight and point loads exert on the global coordinates.

        M qdd = these + other generalized forces. ``rates`` of None leave the velocity products out, a gravity that is
        ``ZERO`` the weight [m/s2].
        """
        weight = gravity is not ZERO
        biases, fields = self._forward(rates, gravity)
        total: list[Scalar] = [0.0] * self.size
        # Newton-Euler, inwards from the tip: force and moment that the part beyond the link hands to its end section.
        force = ZERO
        moment: Scalar = 0.0
        for k in range(len(self.links) - 1, -1, -1):
            end, turn = self.links[k].link.end, self.rotations[k]
            # Forces within the link: their moment about its start, and their effect on its own coordinates.
            inner = ZERO
            inner_moment: Scalar = 0.0
            extra: list[Scalar] = [0.0] * len(end.arms)
            for load in (load for load in loads if load.place.link == k):
                vector = self.rotation(load.place).apply(load.force) if load.follows else load.force
                if is_end(load.place.fraction):
                    force, moment = force + vector, moment + load.couple
                    continue
                section, at, arms = self._section(load.place)
                inner, inner_moment = inner + vector, inner_moment + at.cross(vector) + load.couple
                extra = [
                    q + arm.cross(vector) + w * load.couple
                    for q, arm, w in zip(extra, arms, section.angles, strict=True)
                ]
            field, bias = fields[k], biases[k]
            if bias is not None:
                inner, inner_moment = inner + turn.apply(bias.force), inner_moment + bias.moment
                extra = [q + g for q, g in zip(extra, bias.generalized, strict=True)]
            if weight or bias is not None:
                inertia = self._inertias[k]
                inner, inner_moment = inner + field.scaled(inertia.mass), inner_moment + inertia.first.cross(field)
                extra = [q + arm.cross(field) for q, arm in zip(extra, inertia.arms, strict=True)]
            for a, arm, angle, q in zip(self.coordinates[k], self._end_arms[k], end.angles, extra, strict=True):
                total[a] += arm.cross(force) + angle * moment + q
            force, moment = inner + force, inner_moment + moment + self.spans[k].cross(force)
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
