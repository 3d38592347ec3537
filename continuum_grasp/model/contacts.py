"""What a finger touches: a body, and contacts with it: laws of gaps and slips, with states of friction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import casadi as ca

from continuum_grasp.model.body import Body
from continuum_grasp.model.planar import Scalar, Vec
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


class Contacts:
    """The body of some surroundings, and all contacts with it.

    Parameters
    ----------
    around : Surroundings
        They have an object.
    stations : sequence of Station
        Where the finger may touch; their contacts come first, then those of supports, then of the table.
    given : mapping
        Run-time arguments by name, of ``OBJECT_PARAMETERS`` and of ``friction_parameter``.
    pressed : bool
        Whether the gaps are smaller by run-time numbers ``press`` [m], one per contact.
    """

    def __init__(
        self, around: Surroundings, stations: Sequence[Station], given: Mapping[str, Scalar], *, pressed: bool
    ) -> None:
        if around.object is None:
            raise TypeError("surroundings without an object")
        self._stations = stations
        self.body = Body(around.object, around, given)
        shares = [given.get(friction_parameter(station.name)) for station in stations]
        pairs = pairs_around(self.body, around, stations, shares)
        self.pairs: list[Pair] = [pair.pressed() for pair in pairs] if pressed else pairs
        self.press = ca.vertcat(*[pair.press for pair in self.pairs])
        self.states = ca.vertcat(self.body.pose, self.body.rates, *[pair.z for pair in self.pairs])
        self.names = [*self.body.x_names, *(name for pair in self.pairs for name in pair.z_names)]

    @property
    def on_stations(self) -> list[tuple[Vec, Scalar]]:
        """World force [N] on each station, and its couple about the center where that bends the finger [N m]."""
        # Supports and table, which come after the stations, do not touch the finger.
        found = zip(self._stations, self.pairs, strict=False)
        return [(p.force, (p.point - at.center).cross(p.force) if at.turns else 0.0) for at, p in found]

    def rates(self, gravity: Vec) -> list[Scalar]:
        """Rates of the states, under gravity in the plane [m/s2]."""
        return rates_around(self.body, self.pairs, gravity)

    def energy(self, gravity: Vec) -> tuple[Scalar, Scalar]:
        """Kinetic energy, and potential of weight and springs [J], of a table at height zero, whose height is in w."""
        kinetic, potential = self.body.energy(gravity)
        potential += sum((pair.stored_energy for pair in self.pairs), 0.0)
        return kinetic, ca.substitute(ca.SX(potential), self.body.wrench, ca.SX.zeros(self.body.wrench.shape))
