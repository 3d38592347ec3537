"""Surroundings of a finger: a body, and contacts with it: laws of gaps and slips, with states of friction."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import casadi as ca

from continuum_grasp.model.body import RigidBody
from continuum_grasp.model.contact_law import TouchLaw, touch_law_of
from continuum_grasp.model.planar import Scalar, Vec
from continuum_grasp.model.stations import Station, Touched
from continuum_grasp.model.touching import SHIFTED, Pair, disc_pair, support_pairs, table_pairs
from continuum_grasp.scene import Rod, Scene, Surroundings

OBJECT_PARAMETERS = {"object_mass": "kg", "friction_factor": "1", "object_x": "m", "object_y": "m"}
"""Numbers of an object that can be run-time arguments, with units: mass, if it moves; a factor of all its friction
coefficients; position, if it is fixed."""
CONTACT_FRICTION = "contact_friction_"
"""Before the name of a station, ``1`` and so on or ``tip``, a run-time argument too: friction there as a share of its
limit [1], along the object's normal turned by +90 degrees on the finger, in place of the law of its states."""


class Contacts(Touched):
    """The body of some surroundings, and all contacts with it; nothing where they have no object.

    Contacts at ``stations``, where the finger may touch, come first, then contacts of supports, then of the table.
    ``given`` are run-time arguments by name, of ``OBJECT_PARAMETERS`` and of `friction_parameter`. Where contacts are
    ``pressed``, gaps are smaller by run-time numbers ``press`` [m], one per contact. ``rod`` is the finger's.
    """

    @staticmethod
    def friction_parameter(station: str) -> str:
        """Name of the run-time argument for the friction at a station, ``finger.1`` and so on or ``finger.tip``."""
        return CONTACT_FRICTION + station.removeprefix("finger.")

    def __init__(
        self,
        around: Surroundings | None,
        stations: Sequence[Station],
        given: Mapping[str, Scalar],
        pressed: bool = False,
        *,
        rod: Rod,
    ) -> None:
        super().__init__()
        self._stations = stations
        self._body: RigidBody | None = None
        if around is None or around.object is None:
            return
        self._body = body = RigidBody(around.object, around, given)
        motions = {name: ca.SX.sym(name, len(SHIFTED)) for name in around.moving_supports}
        if around.contact_law is not None:
            law = touch_law_of(around.contact_law, rod)
            self.pairs = list(_pairs_of(body, around, law, stations, given, motions))
        if pressed:
            self.pairs = [pair.pressed() for pair in self.pairs]
        self.press = ca.vertcat(ca.SX(0, 1), *[pair.press for pair in self.pairs])
        self.states = ca.vertcat(body.pose, body.rates, *[pair.z for pair in self.pairs])
        self.names = [*body.x_names, *(name for pair in self.pairs for name in pair.z_names)]
        self.wrench, self.start = ca.vertcat(body.wrench, *motions.values()), body.start
        self.w_names = [*body.w_names, *(f"{name}_{part}" for name in motions for part in SHIFTED)]

    @staticmethod
    def of_finger(scene: Scene, places: Sequence[float], motion: ca.SX, given: Mapping[str, Scalar]) -> Contacts:
        """Contacts of the finger of a scene at places along it [m], the last one being the tip.

        Columns of ``motion`` (6, K) are position, velocity, angle and spin of each place.
        """
        half, stations = scene.finger.profile.half_thickness, list[Station]()
        names = [*(f"finger.{k + 1}" for k in range(len(places) - 1)), "finger.tip"]
        for k, name in enumerate(names):
            x, y, vx, vy, _, spin = ca.vertsplit(motion[:, k])
            stations.append(Station(name, Vec(x, y), float(half(places[k])), Vec(vx, vy), spin))
        return Contacts(scene, stations, given, rod=scene.finger.rod)

    @property
    def on_stations(self) -> list[tuple[Vec, Scalar]]:
        """World force [N] on each station, and its couple about the center where that bends the finger [N m]."""
        # Supports and table, which come after the stations, do not touch the finger.
        pairs = zip(self._stations, self.pairs, strict=False)
        return [(p.force, (p.point - at.center).cross(p.force) if at.turns else 0.0) for at, p in pairs]

    def rates(self, gravity: Vec) -> list[Scalar]:
        """Rates of the states, under gravity in the plane [m/s2]."""
        if self._body is None:
            return []
        forces = [(pair.point, pair.force.scaled(-1.0)) for pair in self.pairs]
        moments = [pair.moment for pair in self.pairs if pair.arm]
        rates = self._body.state_rate(gravity, forces, moments, [pair.lift for pair in self.pairs])
        return rates + [rate for pair in self.pairs for rate in pair.z_rate]

    def energy(self, gravity: Vec) -> tuple[Scalar, Scalar]:
        """Kinetic energy, and potential of weight and springs [J], of table and supports where they are without w."""
        if self._body is None:
            return 0.0, 0.0
        kinetic, potential = self._body.energy(gravity)
        potential += sum((pair.stored_energy for pair in self.pairs), 0.0)
        return kinetic, ca.substitute(ca.SX(potential), self.wrench, ca.SX.zeros(self.wrench.shape))


def _pairs_of(
    body: RigidBody,
    around: Surroundings,
    law: TouchLaw,
    stations: Sequence[Station],
    parameters: Mapping[str, Scalar],
    motions: Mapping[str, ca.SX],
) -> Iterator[Pair]:
    """Contact pairs of an object: stations of a finger first, then supports, then the table."""
    for station in stations:
        yield disc_pair(body, law, station, share=parameters.get(Contacts.friction_parameter(station.name)))
    yield from support_pairs(body, law, around.walls, around.pegs, motions)
    if around.table is not None:
        yield from table_pairs(body, law, around.table)
