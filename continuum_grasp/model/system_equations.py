"""The equations of motion of a finger together with the object that it touches."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import casadi as ca

from continuum_grasp.model.body import Body
from continuum_grasp.model.chain import Load, Place
from continuum_grasp.model.equations import Equations
from continuum_grasp.model.layout import place_at
from continuum_grasp.model.planar import Scalar, Vec
from continuum_grasp.model.structure import Structure
from continuum_grasp.model.touching import Pair, Station, pairs_around, rates_around
from continuum_grasp.scene.surroundings import Surroundings

OBJECT_PARAMETERS = {"object_mass": "kg", "friction_factor": "1", "object_x": "m", "object_y": "m"}
"""What of an object can be a run-time argument, and its unit: mass, if it moves; a factor of all its friction
coefficients; where it is, if it is fixed."""
CONTACT_FRICTION = "contact_friction_"
"""Before the name of a station, ``1`` and so on or ``tip``, a run-time argument too: friction there as a share of its
limit [1], along the object's normal turned by +90 degrees on the finger, in place of the law of its states."""


def friction_parameter(station: str) -> str:
    """Name of the run-time argument that has the friction at a station, ``finger.1`` and so on or ``finger.tip``."""
    return CONTACT_FRICTION + station.removeprefix("finger.")


class SystemEquations(Equations):
    """Equations of a finger and of its object, if there is one; its state follows that of the finger.

    Those of ``OBJECT_PARAMETERS`` that are ``runtime`` are at the end of ``p``. ``pressed``: run-time numbers ``press``
    [m], one per contact, make the gaps smaller.
    """

    def __init__(
        self,
        structure: Structure,
        surroundings: Surroundings | None,
        runtime: Sequence[str] = (),
        *,
        pressed: bool = False,
    ) -> None:
        super().__init__(structure)
        self._around, self._pressed = surroundings, pressed
        self._shares: dict[str, ca.SX] = {}
        self.press = ca.SX(0, 1)
        self.body: Body | None = None
        if surroundings is None or surroundings.object is None:
            return
        symbols = {name: ca.SX.sym(name) for name in runtime}
        self.p = ca.vertcat(self.p, *symbols.values())
        self._shares = {name: value for name, value in symbols.items() if name.startswith(CONTACT_FRICTION)}
        self.body = Body(surroundings.object, surroundings, symbols)
        self.x = ca.vertcat(self.x, self.body.pose, self.body.rates, *[pair.z for pair in self.pairs])
        self.w = ca.vertcat(self.w, self.body.wrench)
        if self._pressed:
            self.press = ca.vertcat(*[pair.press for pair in self.pairs])

    @cached_property
    def _stations(self) -> list[tuple[Place, Station]]:
        """Where the finger may touch."""
        made = self._structure
        named = [(f"finger.{k + 1}", at, place_at(at, made.lengths)) for k, at in enumerate(made.contacts)]
        half = made.finger.profile.half_thickness
        motions = self.chain.end_velocities(self.full_rates)
        found = []
        for name, at, place in [*named, ("finger.tip", made.length, made.tip)]:
            center, (velocity, spin) = self.to_world(self.chain.position(place)), motions[place.link]
            # Without the couple of its force, a matched tip must not turn in the slip either, or power would appear.
            rolls = not (made.matched and place is made.tip)
            found.append(
                (place, Station(name, center, float(half(at)), self.turn.apply(velocity), spin if rolls else 0.0))
            )
        return found

    @cached_property
    def pairs(self) -> list[Pair]:
        """What can touch: stations of the finger first, then supports, then the table."""
        if self._around is None or self.body is None:
            return []
        stations = [station for _, station in self._stations]
        shares = [self._shares.get(friction_parameter(station.name)) for station in stations]
        pairs = pairs_around(self.body, self._around, stations, shares)
        return [pair.pressed() for pair in pairs] if self._pressed else pairs

    @cached_property
    def contact_loads(self) -> list[Load]:
        """Contact forces on the finger, with their couples about the center line where the tip is free."""
        back, loads = self.turn.transposed(), []
        # Stations come first among the pairs; supports and table do not touch the finger.
        for (place, station), pair in zip(self._stations, self.pairs, strict=False):
            # A couple at a matched tip would set the curvature that it depends on.
            free = not (self._structure.matched and place is self._structure.tip)
            couple = (pair.point - station.center).cross(pair.force) if free else 0.0
            loads.append(Load(place, back.apply(pair.force), couple))
        return loads

    @cached_property
    def _world_gravity(self) -> Vec:
        return Vec(*self._par.vector("gravity"))

    @property
    def sweeps(self) -> bool:
        """Contact forces depend on the motion of all elements: a finger with an object is solved densely."""
        return super().sweeps and self.body is None

    @cached_property
    def state_rate(self) -> list[Scalar]:
        """Derivative of the state."""
        rates = list(super().state_rate)
        if self.body is None:
            return rates
        return rates + rates_around(self.body, self.pairs, self._world_gravity)

    @cached_property
    def energies(self) -> tuple[Scalar, Scalar]:
        """Kinetic and potential energy [J], with those of the object and of the surfaces pressed in; without w."""
        kinetic, potential = self.kinetic_energy, self.potential_energy
        if self.body is not None:
            moving, weight = self.body.energy(self._world_gravity)
            kinetic, potential = kinetic + moving, potential + weight
            for pair in self.pairs:
                potential += pair.stored_energy
        # The table, whose height is in w, is at rest at height zero.
        kinetic, potential = ca.substitute([ca.SX(kinetic), ca.SX(potential)], [self.w], [ca.SX.zeros(self.w.shape)])
        return kinetic, potential
