"""From a grasp to what a controller has to know and do.

1. Of the contacts of each finger take the one whose force is followed, by `controller.held`.
2. Make the controller's scene: its own elements, the object fixed where the grasp has it, the drives of the mission.
3. Find the posture before the touch: tensions grow towards the grasp's until the free finger is close.
4. Turn tensions into commands of the drives: those that hold, those that squeeze with all of the reserve, and limits.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from continuum_grasp.addons.mission.assignment import LARGEST, Assignment
from continuum_grasp.addons.mission.budget import lowered_by_pulls, promised
from continuum_grasp.addons.mission.causes import CLEAR
from continuum_grasp.addons.mission.on_pads import standing
from continuum_grasp.addons.mission.plant import PlantVariation
from continuum_grasp.addons.mission.scene import MissionScene
from continuum_grasp.base import Array, InputError, Interrupted, SolverError
from continuum_grasp.grasp import GraspResult, Resistance, optimize_grasp
from continuum_grasp.model import DriveCommands, FingerModel
from continuum_grasp.scene import ControlScene
from continuum_grasp.simulation import equilibrium_under

_START_CALLS = 3
"""Calls over which a start is spread [1]: its first one integrates a motion of a stiff model, which takes as long as
four linearizations. The longest call of configs/mission/mug.yaml takes 0.61 instead of 1.11 ms, with commands within
0.09 N."""
_MARGIN = 1.5
"""Greatest curvature per curvature of the free finger under the greatest tension: contact forces bend it further."""
_SLIP_SPEED = 0.005
"""Slip speed of the controller's contacts with an object that is turned [m/s]: friction without a state, which is
enough for horizons below a second. Below this speed the model creeps where the plant sticks, and the controller waits
for a motion that does not come: with 0.01 m/s 3 of 12 plants of configs/mission/turn_block.yaml end 2 degrees short or
more. At 0.003 m/s friction follows the noise of the estimated speed while the object is held: the estimated force is
restless, and one of nine plants dropped the block.
"""
_DENSE = 60
"""Places along the finger whose distance is looked at."""


def assign(mission: MissionScene, grasp: GraspResult | None = None) -> tuple[Assignment, ...]:
    """Optimize the grasp of a mission, where it has not been found already, and say what each controller has to do.

    Raises a SolverError where there is no verified grasp, an InputError where a mission cannot carry it out.
    """
    result = optimize_grasp(mission.grasp) if grasp is None else grasp
    if grasp is None and result.statistics["interrupted"]:
        raise Interrupted("interrupted while the grasp was optimized")
    if not result.solved:
        message = f"no grasp to carry out: {result.message}"
        raise SolverError(message, status=result.status.value, advice=result.advice, result=result)
    resistance = promised(result)
    assigned = tuple(_Task(mission, result, setup.name).assignment(resistance) for setup in mission.grasp.setups)
    if mission.slip is None:
        return assigned
    more = standing(assigned)
    gives = [lowered.distance for lowered in lowered_by_pulls(assigned, PlantVariation())]
    return tuple(replace(each, standing=more, gives=max([0.0, *gives])) for each in assigned)


class _Task:
    """A finger of a grasp on its way to an assignment."""

    def __init__(self, mission: MissionScene, grasp: GraspResult, name: str) -> None:
        self.mission = mission
        self.grasp = grasp
        self.name = name
        self.setup = next(setup for setup in mission.grasp.setups if setup.name == name)
        self.posture = grasp.fingers[name]
        x, y, angle = self.posture.base.tolist()
        self.placed = self.setup.finger.replaced(base={"position": (x, y), "angle": angle})
        self.finger = self.placed
        if mission.tendons is not None:
            self.finger = self.finger.replaced(tendons=mission.tendons)
        if mission.drive_tension is not None:
            self.finger = self.finger.with_tendons(max_tension=mission.drive_tension)
        x, y, angle = grasp.object_pose.tolist()
        self.object_pose = (x, y, angle)
        self.body = mission.grasp.object.moved_to(self.object_pose, free=None)
        self.tensions = np.array(self.posture.tensions)
        self.least = np.array([tendon.min_tension for tendon in self.placed.tendon_list])
        self.greatest = np.array([tendon.max_tension for tendon in self.finger.tendon_list])
        self._find_contacts()
        self.control = self._control_scene()
        # Bending angles of the controller's elements, whose ends are not the stations of the grasp.
        length = self.finger.rod.length
        self.edges = np.minimum(np.cumsum([0.0, *np.asarray(self.control.fidelity.elements)]), length)
        line = self.posture.backbone
        self.ends = np.interp(self.edges, line[:, 0], np.unwrap(line[:, 3]))

    def assignment(self, resistance: Resistance) -> Assignment:
        """The task, with drives that hold as ``resistance`` says."""
        mission = self.mission
        tensions = self.tensions
        before, angles, _ = self._about_to_touch(moved=False)
        if mission.turn is not None:
            _check_start(self.control, self._about_to_touch(moved=True)[2])
        commands = DriveCommands(self.finger, self.edges)
        factors = np.minimum(np.asarray(resistance.factors), LARGEST)
        rise = np.maximum(tensions - before, 0.0)
        reserve = float(np.min((self.greatest - tensions)[rise > 0.0] / rise[rise > 0.0], initial=math.inf))
        reserve = max(0.0, reserve) if math.isfinite(reserve) else 0.0
        return Assignment(
            mission=mission,
            grasp=self.grasp,
            name=self.name,
            control=self.control,
            object_pose=self.object_pose,
            tensions=tensions,
            held=commands.of(tensions, self.ends),
            tight=commands.of(tensions + reserve * rise, self.ends),
            reserve=reserve,
            before=commands.of(before, angles),
            rest=np.array(self.control.rest_input),
            holding=self._limits(commands),
            bends=np.diff(angles),
            posture=np.diff(self.ends),
            forces=dict(self.held),
            middles=self.middles,
            resisted=resistance,
            pulls=mission.pull_share * factors[:, None] * np.asarray(resistance.wrenches),
        )

    def _find_contacts(self) -> None:
        """Find contacts of the finger in the grasp, from its base on, and the forces that are held."""
        contacts = {c.name: c for c in self.grasp.contacts if c.name.startswith(f"{self.name}.")}
        tip = contacts.pop(self.setup.tip_name, None)
        if tip is None:
            raise InputError(f"a mission needs a contact of the tip of {self.name}", key="grasp.contacts")
        along = [contact for contact in contacts.values() if not np.isnan(contact.station)]
        along.sort(key=lambda contact: contact.station)
        self.middles = tuple(contact.name for contact in along)
        self.stations = tuple(contact.station for contact in along)
        forces = {f"finger.{k + 1}": contact.normal_force for k, contact in enumerate(along)}
        hardest = max(forces, key=lambda contact: forces[contact], default="finger.tip")
        forces["finger.tip"] = tip.normal_force
        asked = self.mission.controller.held
        one = hardest if asked == "middle" else "finger.tip"
        self.held = forces if asked == "all" else {one: forces[one]}

    def _limits(self, commands: DriveCommands) -> tuple[Array, Array]:
        """Least and greatest commands (nu) while the object is held.

        The tendon that closes the finger keeps a share of its tension, the others stay loose.
        """
        retained = self.mission.controller.retained
        tensions, angles = self.tensions, self.ends
        least, greatest = self.least, self.greatest
        pulls = tensions > least + 1.0  # [N]: the tendon that closes the finger
        firm = commands.of(np.where(pulls, retained * tensions, least), angles)
        # 3.0: tension that the other tendon may have meanwhile beyond its least tension [N]
        loose = commands.of(np.where(pulls, greatest, np.minimum(greatest, least + 3.0)), angles)
        closing = commands.closing(pulls)
        highest = np.where(closing > 0.0, np.inf, np.where(closing < 0.0, firm, loose))
        return np.where(closing > 0.0, firm, -np.inf), highest

    def _base_parameters(self) -> tuple[str, ...]:
        """Parameters that make fingers of one kind share the compiled code of their controllers: where they stand.

        None for a finger that is the only one of its kind.
        """
        finger = self.setup.finger
        setups = self.mission.grasp.setups
        alike = [other.name for other in setups if other.finger.replaced(base=finger.base) == finger]
        if len(alike) == 1:
            return ()
        angles = {float(self.grasp.fingers[name].base[2]) for name in alike}
        return ("base_position", "base_angle") if len(angles) > 1 else ("base_position",)

    def _control_scene(self) -> ControlScene:
        mission = self.mission
        finger, body = self.finger, self.body
        stations, held = self.stations, self.held
        asked = mission.controller
        before, after = asked.elements
        between = [b - a for a, b in pairwise(stations)]
        if stations:
            first = stations[0]
            last = finger.rod.length - stations[-1]
            lengths = (*[first / before] * before, *between, *[last / after] * after)
        else:
            lengths = (finger.rod.length / (before + after),) * (before + after)
        edges = np.cumsum([0.0, *lengths])
        free = [
            length * self._greatest_curvature(a, b) for length, a, b in zip(lengths, edges, edges[1:], strict=False)
        ]
        reach = min(_MARGIN * max(free), max(lengths) * finger.curvature_limit, mission.plant.fidelity.WIDEST)
        turn = mission.turn
        cost: dict[str, Any] = {
            "bending": asked.posture,
            "contact_force": {"running": asked.force, "of": tuple(held)},
            "speed": asked.speed or None,
            "effort": asked.effort,
            "input_rate": asked.input_rate,
        }
        reference: dict[str, Any] = {"contact_force": tuple(held.values())}
        if turn is not None:
            cost |= {"object_angle": asked.object_angle, "gap": {"running": asked.gap, "of": ("finger.tip",)}}
            reference |= {"object_angle": (body.angle,), "gap": (0.0,)}
        estimated = frozenset(mission.estimator.disturbances.stated())
        adapted = set[str]()
        if mission.estimator.adapt is not None:
            adapted = set(mission.estimator.adapt.spreads)
        parameters = sorted(({"bending_stiffness", "tendon_friction"} & estimated) | adapted)
        # As a file of a closed loop has them.
        keys: dict[str, Any] = {
            "name": mission.name,
            "finger": finger,
            "gravity": mission.grasp.gravity[:2],
            "contacts": stations,
            **self._surroundings(),
            "fidelity": {
                "family": finger.usual_family,
                "elements": lengths,
                "bending_range": reach,
            },
            "parameters": (*parameters, *self._base_parameters()),
            "controller": {
                "period": asked.period,
                "horizon": asked.horizon,
                "cost": cost,
                "input": asked.input,
                "bounds": asked.bounds,
                "start_calls": _START_CALLS,
                "deadline": asked.deadline,
            },
            "reference": reference,
            "estimator": mission.estimator,
            "initial": {"pose": "straight"},
            "plant": mission.plant,
        }
        return ControlScene(**keys)

    def _surroundings(self) -> dict[str, Any]:
        """Object and surroundings as the controller knows them, by keys of its scene.

        It stays where the grasp has it, and is touched by the finger alone; where it is turned first, it begins where
        it stands before that, moves, and is pushed on a table and against supports.
        """
        mission, body = self.mission, self.body
        law, turn = mission.contact_law, mission.turn
        if turn is None:
            # An estimate of friction needs its limit; without one contacts are taken to be smooth.
            unknown_friction = mission.estimator.disturbances.contact_friction is not None
            return {"object": body, "contact_law": law if unknown_friction else law.replaced(friction=0.0)}
        if law.slip_speed is None:
            law = law.replaced(presliding=None, slip_speed=_SLIP_SPEED)
        return {
            "object": body.replaced(
                position=turn.position, angle=body.angle - turn.angle, mass=mission.object_mass or body.mass
            ),
            "object_moves": True,
            "contact_law": law,
            "supports": mission.grasp.supports,
            "out_of_plane_gravity": mission.gravity,
            "table": {
                "friction": mission.table_friction,
                "friction_radius": mission.table_friction_radius,
                "stays": True,
            },
        }

    def _greatest_curvature(self, start: float, end: float) -> float:
        """Greatest curvature of the free finger between two positions, under all tension of one side [1/m]."""
        finger = self.finger
        s = np.linspace(start, end, _DENSE)
        moments = np.zeros((2, _DENSE))  # of the tendons on either side
        for channel in finger.channels:
            arms = np.array(channel.arms)
            shape = channel.shape(s)
            moments[0] += np.maximum(arms, 0.0) @ self.greatest * shape
            moments[1] += np.maximum(-arms, 0.0) @ self.greatest * shape
        return float(np.max(moments.max(axis=0) / finger.profile.bending_stiffness(s)))

    def _about_to_touch(self, *, moved: bool) -> tuple[Array, Array, float]:
        """Tensions [N], towards the grasp's, at which the free finger comes close to the object, angles of its sections
        at the edges [rad], and the place that is nearest [m]: negative where the finger overlaps the object
        without them, infinite where it never comes close. ``moved``: the object stands where the mission begins.
        """
        control = self.control
        body = control.body if moved else self.body
        finger = self.placed.with_tendons(
            time_constant=None, drive_order=2, drive=None, axial_stiffness=None, series_stiffness=None
        )
        family = finger.usual_family if finger.has_tendon_friction else control.fidelity.family
        free = FingerModel(
            finger,
            gravity=control.gravity,
            family=family,
            elements=control.fidelity.elements,
            bending_range=control.fidelity.bending_range,
            tip_force=False,
            input_rates=False,  # nothing moves
        )
        places = np.linspace(0.0, finger.rod.length, _DENSE + 1)[1:]
        half = finger.profile.half_thickness(places)
        away = self.tensions - self.least
        pulls = away > 0.0
        farthest = float(np.min((self.greatest - self.least)[pulls] / away[pulls]))
        before = self.least
        q = np.zeros(free.n)
        nearest = math.inf
        # 200: shares of the grasp's tensions that are tried
        for share in np.linspace(0.0, farthest, 200 + 1):
            u = self.least + share * away
            shape = equilibrium_under(free, u, [], guess=q)
            points = shape.backbone(_DENSE + 1)[1:]
            gaps = [body.distance((float(x), float(y))) - h for (x, y), h in zip(points, half, strict=True)]
            if min(gaps) < CLEAR:
                overlaps = share == 0.0 and min(gaps) < 0.0
                nearest = float(places[int(np.argmin(gaps))]) * (-1.0 if overlaps else 1.0)
                break
            before = u
            q = shape.q
        angles = [float(free.orientation(q, before, edge, free.p_nominal)) for edge in self.edges]
        return before, np.array(angles), nearest


def _check_start(control: ControlScene, nearest: float) -> None:
    """Refuse a turn that begins inside a support or the finger, or that the fingertip cannot begin.

    ``nearest`` is the place of the finger that first comes close to the object, as `_about_to_touch` has it.
    """
    body = control.body
    length = control.finger.rod.length
    key = "turn.position"
    for wall in control.walls:
        down = wall.normal_angle + math.pi - body.angle
        deep = max(part.support(down) for part in body.parts) - wall.height(body.position)
        # Beside an edge of finite length it may stand lower.
        # 1e-4: depth in a support up to which an object stands beside it [m]: it is pressed in by as much
        if deep > 1e-4 and math.isinf(wall.half_length):
            raise InputError(f"before its turn, the object lies {1e3 * deep:.3g} mm inside {wall.name}", key=key)
    if nearest < 0.0:
        raise InputError("before its turn, the object overlaps the straight finger", key=key)
    if math.isinf(nearest):
        raise InputError("before its turn, the object is out of the finger's reach", key=key)
    if nearest < length - control.finger.profile.half_thickness(length) - length / _DENSE:
        raise InputError(
            f"before its turn, the object meets the finger first at {nearest:.3g} m of its length, not at the tip "
            f"({length:.3g} m)",
            key=key,
        )
