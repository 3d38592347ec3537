"""Fingers, an object and its supports: the scene of the grasp optimizer."""

from __future__ import annotations

import math
from functools import cached_property
from itertools import combinations, pairwise, product
from typing import Annotated, Literal

from pydantic import Field

from continuum_grasp.scene.consumer import Consumer
from continuum_grasp.scene.curved_parts import SHARE
from continuum_grasp.scene.finger_setup import FingerSetup, is_light
from continuum_grasp.scene.grasp_options import (
    Aim,
    AnyFinger,
    Disturbances,
    GraspContacts,
    GraspFinger,
    GraspGravity,
    GraspSolver,
    ObjectiveWeights,
    Robust,
)
from continuum_grasp.scene.methods import FAMILIES, ONE_TURN
from continuum_grasp.scene.objects import GraspObject
from continuum_grasp.scene.placement import Supported, is_beside
from continuum_grasp.scene.simulate import Fidelity
from continuum_grasp.scene.supports import TOUCHING, Peg, Place, check_name
from continuum_grasp.scene.tendons import Tendons
from continuum_grasp.scene.value import Configuration

_TURNS = 360
"""Number of samples of the distance from a support over the range of a free angle [1]."""


_FINGERS = Consumer.refusals(
    """
    softening: grasps support only linear materials: leave it out
    gyration_radius: grasps need a rod of constant length: leave it out
    stops: grasps do not support this: leave it out
    pressure: grasps support only tendons: leave it out
    tip_body: grasps do not support this: leave it out
    tendons.conduit_bend: must be zero here: tensions of a grasp are those that enter the finger
    fidelity.frequencies: is not for grasps, which do not move
    tendons with no_pair:
        a grasp needs a pair: two tendons of the same limits, the first with a positive offset and the second with the
        same offset on the other side, that end at the same place
    tendons.min_tension without tendons_used=both:
        keeps the antagonist in tension, and tendons_used leaves none: set it to 0
    tendons.drive.arrangement=one_pulley without tendons_used=both:
        one_pulley moves both tendons, and tendons_used leaves one: use per_tendon
    """,
    no_pair=lambda finger: isinstance(finger.tendons, tuple) and not _are_pair(finger),
)
_PLACES = "stations stand in place of middle contacts: give one of them"
(_STATIONS,) = Consumer.refusals(f"contacts.middle with stations: {_PLACES}")


class GraspScene(Configuration, Supported):
    """Fingers that hold an object, alone or against supports."""

    REFUSALS = Consumer.refusals(
        f"""
        fidelity.frequencies: is not for grasps, which do not move
        contacts.middle with setups.stations: {_PLACES}
        upright without leaves_plane: has no effect on forces in the plane of the fingers: leave it out
        """
    )

    finger: AnyFinger | None = None
    """The only finger; the result calls it ``finger``."""
    fingers: Annotated[dict[str, AnyFinger], Field(min_length=1, max_length=4)] | None = None
    """One to four fingers by name, instead of ``finger``."""
    object: GraspObject
    """The object to be held: shape, mass and pose."""
    contacts: GraspContacts
    """Contacts of fingers with the object, and limits of the touching surfaces."""
    gravity: GraspGravity
    """World gravity along x, y and z, z out of the plane of the fingers, toward the viewer [m/s2]. In the plane, it
    bends the fingers, too; weight out of it is carried by friction: there fingers are taken to be stiff."""
    upright: bool = False
    """Whether something else than the contacts, as a face on a palm, bears moments that tilt the object out of the
    plane. Else friction that carries its weight, at the height of its center of mass, must not tilt it; nor, of fingers
    with a ``section``, may a small push."""
    fidelity: Fidelity = Fidelity()
    """Resolution of the fingers' models."""
    objective: Aim | ObjectiveWeights = "least_tension"
    """least_tension: least sum of all tendon tensions; least_normal_force: smallest greatest normal force;
    greatest_disturbance: greatest factor by which the ``disturbances`` may grow; greatest_friction_margin: contacts
    farthest from slipping; greatest_push: greatest push in every direction, as in ``contacts.push``; or weights of
    these."""
    disturbances: Disturbances = Disturbances()
    """Wrenches that the grasp should resist."""
    stability: Literal["require", "ignore"] = "require"
    """require: small motions that the contacts allow must raise the energy, at constant tensions; ignore: an
    equilibrium is enough, as where the drives hold their position or something else steadies the object."""
    friction_states: Literal["any", "pulled"] = "any"
    """Friction states, of tendons and of dry friction in bending, in which the grasp must hold. Pulling starts in the
    unloaded shape of each finger, before weight and contacts bend it, and sections slide one way to the grasp. any: the
    grasp then holds with these tensions whatever the friction states become; pulled: it need only hold as it is
    reached."""
    overlap: Literal["forbid", "allow"] = "forbid"
    """forbid: fingers keep clear of each other in the plane; allow: they lie at different heights and may cross."""
    robust: Robust | None = None
    """Errors that the grasp must tolerate; None: the object is exactly as stated."""
    solver: GraspSolver = GraspSolver()
    """Options of the search."""

    @property
    def named_fingers(self) -> dict[str, GraspFinger]:
        """The fingers by name."""
        if self.fingers is not None:
            return dict(self.fingers)
        return {} if self.finger is None else {"finger": self.finger}

    def with_fingers(self, fingers: dict[str, GraspFinger]) -> GraspScene:
        """A copy with other fingers of the same names, which are not checked against the rest."""
        return self.model_copy(update={"finger": fingers["finger"]} if self.fingers is None else {"fingers": fingers})

    @cached_property
    def setups(self) -> tuple[FingerSetup, ...]:
        """The fingers with everything resolved."""
        fingers = self.named_fingers
        defaults = (self.contacts, self.fidelity)
        releases = self.friction_states == "any"
        return tuple(
            FingerSetup.of(name, finger, self._place_of(name), *defaults, releases=releases)
            for name, finger in fingers.items()
        )

    @property
    def pairs(self) -> tuple[tuple[int, int], ...]:
        """Indices of fingers that must keep clear of each other and could meet, two at a time."""
        fingers = [setup.finger for setup in self.setups]
        two = combinations(range(len(fingers)), 2) if self.overlap == "forbid" else ()
        return tuple((k, m) for k, m in two if _can_meet(fingers[k], fingers[m]))

    @property
    def state_columns(self) -> dict[str, slice]:
        """Columns of each finger's friction states among all those that must not matter; empty where none do."""
        columns = dict[str, slice]()
        start = 0
        for setup in self.setups if self.friction_states == "any" else ():
            if setup.friction_states:
                columns[setup.name] = slice(start, start + setup.friction_states)
                start += setup.friction_states
        return columns

    @property
    def is_robust(self) -> bool:
        """Whether it asks for a grasp that holds for errors or for all friction states of its fingers."""
        return self.robust is not None or bool(self.state_columns)

    @property
    def weights(self) -> ObjectiveWeights:
        """The objective as weights."""
        objective = self.objective
        return objective if isinstance(objective, ObjectiveWeights) else ObjectiveWeights(**{objective: 1.0})

    @property
    def aims(self) -> tuple[str, ...]:
        """The objectives with a weight."""
        return tuple(self.weights.stated())

    @property
    def torque_scale(self) -> float:
        """Length that turns a force into a moment that counts as much [m]."""
        return self.disturbances.torque_scale or self.object.size

    @property
    def wrenches(self) -> tuple[tuple[float, float, float], ...]:
        """The disturbances: world force x, y [N], moment about the center of mass [N m]."""
        if self.disturbances.wrenches is not None:
            return self.disturbances.wrenches
        # Both ways of each axis: friction cones are not symmetric about the wrench that holds the object.
        m = self.torque_scale
        return ((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, m), (0.0, 0.0, -m))

    @property
    def weight(self) -> float:
        """Weight of the object [N]."""
        return self.object.mass * math.hypot(*self.gravity)

    @property
    def unloaded(self) -> bool:
        """Whether the object has no load and the scene no push, so that contacts without force would hold it. Weight,
        disturbances, errors and friction states are loads.
        """
        aimed = {"greatest_disturbance", "greatest_push"} & set(self.aims)
        none = self.contacts.push is None and not (aimed or self.is_robust)
        return none and is_light(self.weight, self.setups)

    @property
    def spatial(self) -> bool:
        """Whether forces act out of the plane of the fingers."""
        return self.gravity[2] != 0.0

    @property
    def leaves_plane(self) -> bool:
        """Whether there are forces or, of fingers with sections, motions out of the plane of the fingers."""
        return self.spatial or all(finger.section is not None for finger in self.named_fingers.values())

    @property
    def balances(self) -> tuple[int, ...]:
        """Balances of the object that a grasp must meet, of six: force along x, y, z, moment about x, y, z.

        In the plane the others are empty; where it is ``upright``, something else bears moments about x and y.
        """
        if not self.spatial:
            return (0, 1, 5)
        return (0, 1, 2, 5) if self.upright else (0, 1, 2, 3, 4, 5)

    def friction(self, contact: str) -> float:
        """Friction coefficient of a contact by its name [1]."""
        if (setup := self._finger_of(contact)) is not None:
            return setup.friction
        body = self.support_of(contact)
        return self.contacts.friction if body is None or body.friction is None else body.friction

    def support_of(self, contact: str) -> Place | None:
        """The wall or peg of a contact by its name; None for a finger's."""
        return next(
            (place for place in self.places if contact in (place.name, f"{place.name}.1", f"{place.name}.2")), None
        )

    def held_friction(self, contact: str) -> float:
        """Friction coefficient minus ``contacts.reserve``, for the search and the certificate [1]."""
        return (1.0 - self.contacts.reserve) * self.friction(contact)

    def normal_force_max(self, contact: str) -> float:
        """Greatest normal force of a contact by its name [N]."""
        setup = self._finger_of(contact)
        return self.contacts.normal_force_max if setup is None else setup.normal_force_max

    def _finger_of(self, contact: str) -> FingerSetup | None:
        return next((setup for setup in self.setups if contact.startswith(f"{setup.name}.")), None)

    @property
    def touching_gap(self) -> float:
        """Greatest gap between the object at rest and a support that it lies against [m]."""
        return TOUCHING * self.object.size

    def gap_range(self, body: Place) -> tuple[float, float]:
        """Least and greatest distance of the object from a support within the bounds of its pose [m], or beyond them.

        Both are exact where only the position is free; a support function changes by no more than the object's extent
        per angle.
        """
        angle = self.object.angle
        extent = max(part.extent for part in self.object.parts)
        *sides, (first, last) = self.object.pose_bounds
        if isinstance(body, Peg):
            gap = self.object.distance(body.position) - body.radius
            slack = self.object.greatest_shift + extent * max(angle - first, last - angle)
            return gap - slack, gap + slack
        heights = [body.height((x, y)) for x, y in product(*sides)]
        step = (last - first) / _TURNS
        facing = [body.normal_angle + math.pi - first - k * step for k in range(_TURNS + 1 if step else 1)]
        reaches = [max(part.support(angle) for part in self.object.parts) for angle in facing]
        return min(heights) - max(reaches) - 0.5 * extent * step, max(heights) - min(reaches) + 0.5 * extent * step

    def _place_of(self, name: str) -> str:
        """Path to a finger in the scene."""
        return "finger" if self.fingers is None else f"fingers.{name}"

    # -- sense -----------------------------------------------------------------------------------------------

    def _check(self) -> None:
        self._check_one_given("finger", "fingers")
        for name in self.named_fingers:
            check_name(name)
        twice = set(self.named_fingers) & set(self.supports)
        if twice:
            raise ValueError(f"a finger and a support share the name {twice.pop()!r}")
        if self.contacts.push and self.is_robust:
            raise ValueError(
                "contacts.push: is not for grasps that hold for errors or for all friction states so far: leave it out"
            )
        for setup in self.setups:
            check_finger(setup, self.fidelity)
            self._check_place(setup, setup.where)
        self._check_bases()
        self._check_supports()

    def _check_place(self, setup: FingerSetup, where: str) -> None:
        finger = setup.finger
        gap = self.object.distance(finger.base.position) - finger.thickness_radius
        # A pose to be chosen only starts there.
        if gap < -self.touching_gap and self.object.free is None and finger.base_free is None:
            raise ValueError(
                f"{where}.base lies {-gap:.4g} m inside the object (half thickness of the finger included)"
            )

    def _check_bases(self) -> None:
        for setup, other in ((self.setups[k], self.setups[m]) for k, m in self.pairs):
            a, b = setup.finger, other.finger
            half = float(a.profile.half_thickness(0.0)) + float(b.profile.half_thickness(0.0))
            gap = math.dist(a.base.position, b.base.position) - half
            if gap < -TOUCHING * half and a.base_free is None and b.base_free is None:
                raise ValueError(
                    f"fingers.{setup.name}.base and fingers.{other.name}.base overlap by {-gap:.4g} m (half "
                    "thicknesses included): move them apart, or set overlap: allow where the fingers lie at different "
                    "heights"
                )

    def _check_supports(self) -> None:
        near = self.touching_gap
        fixed = self.object.free is None
        # Below, a drawing of this size (twice the object's at most) does not say whether it touches.
        nearly = max(2.0 * SHARE * self.object.size, self.object.deviation)
        where, advice = ("and fixed", "; object.against places it") if fixed else ("wherever it may be", "")
        for body in self.places:
            least, greatest = self.gap_range(body)
            # The plane of a finite edge may cut the object outside the edge.
            solid = isinstance(body, Peg) or math.isinf(body.half_length) or body.touch == "on"
            if greatest < -near and solid:
                raise ValueError(f"supports.{body.name} lies {-greatest:.4g} m deep in the object {where}{advice}")
            if body.touch == "on" and least > near:
                raise ValueError(
                    f"supports.{body.name} should touch the object, which is {least:.4g} m away {where}{advice}"
                )
            if fixed and body.touch == "auto" and near < least < nearly and not is_beside(self.object, body):
                raise ValueError(
                    f"supports.{body.name} is {least:.4g} m away from the object, too near to be clear of it, too far "
                    f"to touch it: set object.against: {body.name}, or supports.{body.name}.touch: off"
                )


def check_finger(setup: FingerSetup, of_all: Fidelity) -> None:
    """Refuse, by `ValueError`, a finger that grasps cannot take; its fidelity may be that ``of_all``."""
    finger, where = setup.finger, setup.where
    length = setup.finger.rod.length
    fidelity = finger.fidelity or of_all
    if finger.tendons is None:
        raise ValueError(f"{where}.tendons is needed: the search solves for the tendon tension")
    for feature in _FINGERS:
        feature.check(finger, where)
    if setup.drive is not None and not setup.drive.greatest > 0.0:
        raise ValueError(f"{where}.tendons.drive.torque_max does not exceed coulomb_friction: the motor cannot pull")
    if isinstance(fidelity.elements, tuple):
        raise ValueError(
            f"{setup.key('fidelity', 'elements')} must be a number here: the search chooses the lengths of the elements"
        )
    if all(m == "off" for m in setup.middles) and setup.tip == "off":
        raise ValueError(f"{where}: at least one of middle and tip must be on or auto")
    if setup.stations and setup.elements <= len(setup.stations):
        raise ValueError(
            f"{setup.key('contacts', 'stations')}: {len(setup.stations)} needs fidelity.elements of at least "
            f"{len(setup.stations) + 1}, got {setup.elements}"
        )
    marks = (0, *setup.before, setup.elements)
    if any(b <= a for a, b in pairwise(marks)):
        raise ValueError(
            f"{setup.key('fidelity', 'elements')}: {setup.elements} leave no element of {where} between two middle "
            f"contacts, or next to base or tip: use at least {len(setup.middles) + 1}"
        )
    family = FAMILIES[setup.family]
    finger.check_family(setup.key("fidelity", "family"), setup.family)
    if family.one_turn and setup.bending_range > ONE_TURN:
        wider = " or ".join(name for name, each in FAMILIES.items() if not each.one_turn)
        raise ValueError(
            f"{setup.key('fidelity', 'bending_range')}: elements that bend by {setup.bending_range:.4g} rad are more "
            f"than family {setup.family} can follow (one turn): use more elements, or family: {wider}"
        )
    _STATIONS.check(setup, where, finger)
    high = setup.middle_bounds[1]
    if high >= length:
        raise ValueError(f"{setup.key('contacts', 'middle_range')} ends at {high} m; {where} is {length} m long")


def _can_meet(finger: GraspFinger, other: GraspFinger) -> bool:
    """Whether two fingers are long enough to touch each other, whatever their shapes."""
    if finger.base_free is not None or other.base_free is not None:
        return True
    reach = finger.rod.length + other.rod.length + finger.thickness_radius + other.thickness_radius
    return math.dist(finger.base.position, other.base.position) < reach


def _are_pair(finger: GraspFinger) -> bool:
    """Whether a list of tendons is a pair at opposite offsets."""
    if len(finger.tendon_list) != 2 or len(finger.channels) != 1:
        return False
    first, second = finger.tendon_list
    left, right = finger.channels[0].arms
    same = all(getattr(first, name) == getattr(second, name) for name in Tendons.model_fields if name != "offset")
    return same and left > 0.0 and abs(left + right) <= 1e-12 * left
