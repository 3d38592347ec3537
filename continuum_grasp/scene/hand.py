"""A hand in space: planar fingers around a palm, and the object that they hold."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import cached_property
from itertools import combinations
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from continuum_grasp.scene.consumer import Consumer
from continuum_grasp.scene.finger import Finger
from continuum_grasp.scene.finger_scene import Fidelity
from continuum_grasp.scene.finger_section import FingerSection
from continuum_grasp.scene.finger_setup import FingerSetup, is_light
from continuum_grasp.scene.grasp import check_finger
from continuum_grasp.scene.grasp_options import GraspContacts, GraspFinger, GraspGravity, GraspSolver
from continuum_grasp.scene.hand_supports import (
    LEAST_FRICTION,
    HandPalm,
    HandTable,
    PlaneSupport,
    SupportContact,
    check_support,
    lie_against,
    support_contacts,
)
from continuum_grasp.scene.magnitudes import DENSITY, too_heavy
from continuum_grasp.scene.methods import FAMILIES
from continuum_grasp.scene.solids import Solid, SpatialPosition, Vector3
from continuum_grasp.scene.supports import Switch, check_name
from continuum_grasp.scene.units import Unit
from continuum_grasp.scene.value import PARALLEL, Angle, Configuration, Extent, Positive, Value


class HandFinger(GraspFinger):
    """A finger of a hand, whose base is where the hand has it."""

    REFUSALS = Consumer.refusals(
        """
        contacts.stations: hands touch with middle and tip: leave it out
        contacts.middle with several_middles: a finger of a hand has one middle contact: expected on, off or auto
        fidelity.tolerance: hands have a number of elements: give fidelity.elements
        """,
        several_middles=lambda finger: isinstance(finger.contacts.middle, tuple),
    )

    section: FingerSection | None = None
    """Cross-section of the backbone, similar all along, for its stiffness out of its plane; None: the section of a rod
    with a ``diameter`` everywhere, or with ``thickness`` and ``width``."""

    @cached_property
    def cross_section(self) -> FingerSection:
        """The section, given or of the rod."""
        rod = self.rod
        if self.section is not None:
            return self.section
        if all(part.diameter is not None and part.bending_stiffness is None for part in rod.sections or (rod,)):
            return FingerSection(shape="round")
        if isinstance(rod.thickness, float) and isinstance(rod.width, float):
            return FingerSection(shape="rectangle", thickness=rod.thickness, width=rod.width)
        raise ValueError(
            "section is needed: the stiffness of the finger out of its plane follows from its cross-section (round, "
            "ellipse or rectangle)"
        )

    def _check(self) -> None:
        _ = self.cross_section
        if self.base.pose != (0.0, 0.0, 0.0) or self.base_free is not None:
            raise ValueError("base: the hand has the bases of its fingers: give hand.ring or hand.bases")


def _as_hand_finger(value: Any) -> Any:
    if isinstance(value, Finger) and not isinstance(value, HandFinger):
        return HandFinger(**{name: getattr(value, name) for name in type(value).model_fields})
    return value


AnyHandFinger = Annotated[HandFinger, BeforeValidator(_as_hand_finger)]


class FingerRing(Value):
    """Fingers alike on a circle about the z axis of the hand, which point down along -z and bend inward."""

    count: Annotated[int, Field(ge=2, le=6)]
    """Number of fingers."""
    radius: Extent
    """Radius of the circle of their bases [m]."""
    start: Angle = 0.0
    """Angle of the first finger from the x axis [rad]."""
    tilt: Annotated[float, Field(ge=-1.5, le=1.5), Unit("rad")] = 0.0
    """Outward inclination of the fingers from -z [rad]."""
    twist: Angle = 0.0
    """Rotation of each plane of bending about its finger [rad]; 0: the plane contains the hand's axis."""

    @property
    def bases(self) -> tuple[FingerBase, ...]:
        """The bases one by one."""
        bases = []
        for k in range(self.count):
            angle = self.start + math.tau * k / self.count
            out = (math.cos(angle), math.sin(angle), 0.0)
            side = (-math.sin(angle), math.cos(angle), 0.0)
            c = math.cos(self.tilt)
            s = math.sin(self.tilt)
            along = (s * out[0], s * out[1], -c)
            inward = (-c * out[0], -c * out[1], -s)
            turn = math.cos(self.twist)
            aside = math.sin(self.twist)
            # Inward turned about the finger: along x inward is the side.
            x, y, z = (turn * i + aside * o for i, o in zip(inward, side, strict=True))
            position = (self.radius * out[0], self.radius * out[1], 0.0)
            bases.append(FingerBase(position=position, direction=along, bends_toward=(x, y, z)))
        return tuple(bases)


class FingerBase(Value):
    """Base of one finger in the hand."""

    position: SpatialPosition
    """Position of the base [m]."""
    direction: Annotated[Vector3, Unit("1")]
    """Direction of the straight finger, of any length [1]."""
    bends_toward: Annotated[Vector3, Unit("1")]
    """Direction of the bend when the left tendon pulls, of any length; the component along ``direction`` has no effect
    [1]."""
    finger: AnyHandFinger | None = None
    """Finger of this base if it differs from the common finger."""

    def _check(self) -> None:
        for key in ("direction", "bends_toward"):
            if not math.hypot(*getattr(self, key)) > 0.0:
                raise ValueError(f"{key} must not be zero")
        size = math.hypot(*self.direction) * math.hypot(*self.bends_toward)
        along = sum(a * b for a, b in zip(self.direction, self.bends_toward, strict=True)) / size
        if 1.0 - abs(along) < 0.5 * PARALLEL**2:
            raise ValueError("bends_toward must not be parallel to direction")


class Hand(Value):
    """Fingers around a palm; z points from the object to the palm, and fingers without inclination point along -z."""

    finger: AnyHandFinger
    """The finger, of all bases that have none of their own."""
    ring: FingerRing | None = None
    """Bases on a circle; the fingers are called ``finger_1`` and so on."""
    bases: Annotated[dict[str, FingerBase], Field(min_length=1, max_length=6)] | None = None
    """Bases by the names of their fingers, instead of ``ring``."""
    palm: HandPalm | None = None
    """Palm, which may carry the object and is an obstacle for the fingers; None: no palm."""

    @cached_property
    def named_bases(self) -> dict[str, FingerBase]:
        """The bases by the names of their fingers."""
        if self.ring is None:
            return dict(self.bases or {})
        return {f"finger_{k + 1}": base for k, base in enumerate(self.ring.bases)}

    @property
    def palm_height(self) -> float:
        """Place of the palm along z, as given or where the bases are [m]."""
        given = self.palm.height if self.palm is not None else None
        return given if given is not None else max(base.position[2] for base in self.named_bases.values())

    def _check(self) -> None:
        self._check_one_given("ring", "bases")
        for name in self.named_bases:
            check_name(name)


class HandContacts(GraspContacts):
    """Contacts of a hand's fingers with the object."""

    middle: Switch = "auto"
    """Contact along the finger, tangent to the object: on, off, or auto, if the search decides."""
    tip: Switch = "auto"
    """Contact of the rounded end: on, off, or auto, if the search decides."""
    torsional_friction: Annotated[float, Field(ge=0.0), Unit("m")] = 0.0
    """Greatest moment about the normal per normal force that a contact without other friction bears [m]: for a pad with
    even pressure, two thirds of its radius times ``friction``. Zero: contacts are points."""


class TurnedGravity(Value):
    """Gravity that takes every direction, while the hand turns."""

    any: Annotated[Positive, Unit("m/s2")]
    """Gravity [m/s2]."""
    shift_max: Annotated[Positive, Unit("m")] | None = None
    """Greatest displacement of the object meanwhile, to first order; None: as the fingers yield [m]."""
    turn_max: Annotated[Positive, Unit("rad")] | None = None
    """Greatest turn of the object meanwhile, to first order; None: as the fingers yield [rad]."""


def _of_any_direction(value: Any) -> Any:
    if isinstance(value, TurnedGravity) or (isinstance(value, Mapping) and "any" in value):
        return TurnedGravity.model_validate(value)
    if isinstance(value, str | Mapping) or (isinstance(value, Sequence) and len(value) != 3):
        raise ValueError("expected [x, y, z] as the hand sees it, such as [0, 0, -9.81], or any: 9.81 where it turns")
    return value


AnyGravity = Annotated[GraspGravity | TurnedGravity, BeforeValidator(_of_any_direction)]


class HandScene(Configuration):
    """A hand of planar fingers that holds an object in space."""

    FILES = "continuum_grasp.scene.solids:put_in_files"
    REFUSALS = Consumer.refusals(
        """
        contacts.stations: hands touch with middle and tip: leave it out
        fidelity.frequencies: is not for grasps, which do not move
        fidelity.tolerance: hands have a number of elements: give fidelity.elements
        """
    )

    hand: Hand
    """The fingers and their places."""
    object: Solid
    """The object to be held: shape, mass and pose, as the hand sees them."""
    contacts: HandContacts
    """Contacts of fingers with the object, and limits of the touching surfaces."""
    table: HandTable | None = None
    """Table on which the object may lie, and that is in the fingers' way; None: there is none."""
    gravity: AnyGravity
    """Gravity along x, y and z of the hand [m/s2], or ``any: 9.81``: in every direction, while the hand turns."""
    fidelity: Fidelity = Fidelity()
    """Resolution of the fingers' models."""
    stability: Literal["require", "ignore"] = "require"
    """require: small motions in space that the contacts allow must raise the energy clearly, at tensions or drives that
    stay; ignore: an equilibrium is enough."""
    friction_states: Literal["any", "pulled"] = "any"
    """Friction states of the tendons in which the grasp must hold. pulled: it need only hold as it is reached, by
    pulling from the unloaded shape of each finger, before weight and contacts bend it; any: whatever they become, which
    hands without friction do."""
    solver: GraspSolver = GraspSolver()
    """Options of the search."""

    @cached_property
    def setups(self) -> tuple[FingerSetup, ...]:
        """The fingers with everything resolved, each in its own plane."""
        return tuple(
            FingerSetup.of(
                name,
                base.finger or self.hand.finger,
                f"hand.bases.{name}.finger" if base.finger else "hand.finger",
                self.contacts,
                self.fidelity,
                releases=False,
            )
            for name, base in self.hand.named_bases.items()
        )

    @property
    def turned(self) -> float:
        """Gravity that takes every direction [m/s2]; zero where it has one."""
        return self.gravity.any if isinstance(self.gravity, TurnedGravity) else 0.0

    @property
    def most_motion(self) -> tuple[float, float]:
        """Greatest displacement [m] and turn [rad] that the object may have while its weight takes every direction."""
        allowed = self.gravity if isinstance(self.gravity, TurnedGravity) else TurnedGravity(any=1.0)
        return allowed.shift_max or math.inf, allowed.turn_max or math.inf

    @property
    def acceleration(self) -> tuple[float, float, float]:
        """Gravity of the posture [m/s2]: none where it takes every direction."""
        return (0.0, 0.0, 0.0) if isinstance(self.gravity, TurnedGravity) else self.gravity

    @property
    def weight(self) -> float:
        """Weight of the object [N]."""
        return self.object.weighed * (self.turned or math.hypot(*self.acceleration))

    @property
    def unloaded(self) -> bool:
        """Whether the object has no load and the scene no push, so that contacts without force would hold it."""
        return self.contacts.push is None and is_light(self.weight, self.setups)

    @cached_property
    def supports(self) -> tuple[PlaneSupport, ...]:
        """Palm and table, as far as there are any."""
        found = list[PlaneSupport]()
        palm = self.hand.palm
        table = self.table
        if palm is not None:
            point = (0.0, 0.0, self.hand.palm_height)
            normal = (0.0, 0.0, -1.0)
            found.append(palm.plane("palm", "hand.palm", point, normal, self.contacts.friction, palm.radius))
        if table is not None:
            found.append(table.plane("table", "table", table.point, table.normal, self.contacts.friction))
        return tuple(found)

    @cached_property
    def support_contacts(self) -> tuple[SupportContact, ...]:
        """Points at which the object lies against palm and table, without those that are off."""
        on = (support for support in self.supports if support.touch != "off")
        return tuple(contact for support in on for contact in support_contacts(self.object, support))

    def _check(self) -> None:
        if self.object.weighed > (greatest := DENSITY.most * self.object.volume):
            key = "mass" if self.object.mass is not None else "density"
            self._doubt(f"object.{key}", f"gives {self.object.weighed:.3g} kg: {too_heavy(greatest)}")
        if self.turned and self.table is not None:
            raise ValueError("gravity.any: a table does not turn with the hand: give gravity as [x, y, z], or no table")
        if self.turned and self.contacts.push:
            raise ValueError("contacts.push: is not for a weight of any direction so far: give gravity as [x, y, z]")
        self._check_supports()
        self._check_torsional_friction()
        bases = self.hand.named_bases
        for setup, base in zip(self.setups, bases.values(), strict=True):
            check_finger(setup, self.fidelity)
            self._check_finger(setup, base)
        thick = {setup.name: setup.finger.thickness_radius for setup in self.setups}
        for one, other in combinations(bases, 2):
            gap = math.dist(bases[one].position, bases[other].position)
            if gap < thick[one] + thick[other]:
                raise ValueError(f"hand: the bases of {one} and {other} overlap: {gap:.3g} m apart")

    def _check_torsional_friction(self) -> None:
        """Pads are no larger than the object."""
        given = self.contacts.torsional_friction
        most = max(setup.friction for setup in self.setups)
        if given > most * self.object.size:
            raise ValueError(
                f"contacts.torsional_friction: {given:.3g} m is more than friction times the size of the object, "
                f"{most * self.object.size:.3g} m: is it in meters?"
            )

    def _check_supports(self) -> None:
        if (against := self.object.against) is not None:
            named = {support.name: support for support in self.supports}
            if against not in named:
                raise ValueError(f"object.against: there is no {against}: add {'hand.' * (against == 'palm')}{against}")
            self.__dict__["object"] = lie_against(self.object, named[against])
        for support in self.supports:
            check_support(self.object, support)

    def _check_finger(self, setup: FingerSetup, base: FingerBase) -> None:
        half = setup.finger.thickness_radius
        for support in self.supports:
            if not support.clear_from(base.position, base.direction, half) < setup.finger.rod.length:
                raise ValueError(
                    f"{support.key}: {setup.name} runs into it: its base is "
                    f"{1e3 * support.height(base.position):.4g} mm above it, and the finger must point away"
                )
        if setup.friction < LEAST_FRICTION:
            raise ValueError(
                f"{setup.key('contacts', 'friction')}: {setup.friction:g} for {setup.name}: expected at least "
                f"{LEAST_FRICTION:g}; contacts without friction hold nothing in space"
            )
        if setup.graded and FAMILIES[setup.family].even:
            raise ValueError(
                f"{setup.key('fidelity', 'family')}: elements of family {setup.family} cannot follow a finger that "
                "changes along its length: use matched_clothoid"
            )
        if setup.finger.damping.dry_friction:
            raise ValueError(f"{setup.where}.damping.dry_friction: a hand takes no dry friction in bending so far")
        if setup.friction_states and self.friction_states == "any":
            raise ValueError(
                "friction_states: with friction in its tendons, a hand is certified as it is reached alone, not for "
                "other friction states: state friction_states: pulled"
            )
        if any(mass.at < setup.finger.rod.length for mass in setup.finger.masses):
            raise ValueError(f"{setup.where}.masses: a hand takes only fingers with masses at their tips")
        away = math.dist(self.object.position, base.position)
        reach = setup.finger.rod.length + setup.finger.thickness_radius + self.object.size
        if away > reach:
            raise ValueError(
                f"{setup.name} cannot reach the object: its base is {away:.3g} m from the center, and it reaches "
                f"{reach:.3g} m at most; is object.position in meters, as the hand sees it?"
            )
