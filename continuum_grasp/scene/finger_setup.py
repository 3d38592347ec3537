"""A finger of a grasp with all defaults resolved, as the problem of the grasp takes it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, cast

from continuum_grasp.scene.drives import DriveLaw
from continuum_grasp.scene.finger_scene import Fidelity
from continuum_grasp.scene.grasp_options import GraspContacts, GraspFinger
from continuum_grasp.scene.methods import FAMILIES, ONE_TURN
from continuum_grasp.scene.objects import GraspObject
from continuum_grasp.scene.reach import Reach
from continuum_grasp.scene.supports import Switch
from continuum_grasp.scene.tendons import Tendons

_RELEASED = 1.4
"""Factor on the default bend of an element where friction may let go: with tendons that slide back, at tensions that
stay, it bent by 1.8, 2.7 and 3.6 rad at friction 0.05, 0.1 and 0.15, pulled by 1.3 rad (mug)."""


_LIGHT = 1e-3
"""A weight below this, per greatest force at the tip of a finger, is negligible [1]: a grasp that bears it alone
presses with less than a thousandth of the possible force, which is less than the error of models."""


@dataclass(frozen=True)
class FingerSetup:
    """A finger of a scene with all defaults resolved."""

    name: str
    finger: GraspFinger
    where: str
    """Path to the finger in the scene."""
    middles: tuple[Switch, ...]
    """Middle contacts from base to tip."""
    tip: Switch
    before: tuple[int, ...]
    """Per middle contact, the number of elements between it and the base."""
    elements: int
    family: str
    bending_range: float
    """Greatest bend of an element [rad]; for clothoids its length times its greatest curvature."""
    accuracy: float | None
    """Relative accuracy of the model's evaluation."""
    middle_bounds: tuple[float, float]
    """Least and greatest position of middle contacts along the finger [m]."""
    stations: tuple[float, ...]
    """Positions of stations along the finger, which touch up to half of their distance off [m]; empty: there
    are middle contacts.
    """
    friction: float
    held_friction: float
    """``friction`` less the reserve: what grasps are sought and certified with."""
    normal_force_max: float
    """Greatest normal force of the contact [N]."""

    @staticmethod
    def of(
        name: str, finger: GraspFinger, where: str, of_all: GraspContacts, fidelity: Fidelity, *, releases: bool
    ) -> FingerSetup:
        """The setup of a finger at a path, with what a scene has for all where the finger has none of its own.

        ``releases``: its friction may let go, and bend it further than tensions that rise.
        """
        contacts: dict[str, Any] = {**dict(of_all), **finger.contacts.stated()}
        fidelity = finger.fidelity or fidelity
        middle = contacts["middle"]
        middles: tuple[Switch, ...] = (cast(Switch, middle),) if isinstance(middle, str) else middle
        places: Any = contacts["stations"] or 0
        middles = ("auto",) * places or middles
        elements = fidelity.elements
        # Two per segment between base, contacts and tip at least.
        count = elements if isinstance(elements, int) else max(8, 2 * (len(middles) + 1))
        length = finger.rod.length
        # A contact at base or tip would leave an element of no length.
        low, high = contacts["middle_range"] or (0.05 * length, 0.95 * length)
        stations = tuple(low + (high - low) * k / (places - 1) for k in range(places))
        # All elements together may bend by two turns, and each by 120 degrees at least; tapered ones, of which the
        # greatest curvature counts, by 180.
        bends = max(4 * math.pi / count, (1.0 if _is_graded(finger) else 2.0 / 3.0) * math.pi)
        if releases and finger.has_friction:
            bends = max(bends, min(_RELEASED * bends, ONE_TURN))
        # As in models: half of the range remains beyond the shape at rest.
        preshaped = max(map(abs, finger.profile.rest_curvature.extremes)) * length / count
        stated = fidelity.bending_range
        if stated is not None:
            bends = stated
        if preshaped >= (0.5 * bends if stated is None else bends):
            bends = preshaped + 0.5 * bends
        return FingerSetup(
            name=name,
            finger=finger,
            where=where,
            middles=middles,
            tip=contacts["tip"],
            before=tuple(round(count * (k + 1) / (len(middles) + 1)) for k in range(len(middles))),
            elements=count,
            family=fidelity.family or finger.usual_family,
            bending_range=bends,
            accuracy=fidelity.accuracy,
            middle_bounds=(low, high),
            stations=stations,
            friction=contacts["friction"],
            held_friction=(1.0 - of_all.reserve) * contacts["friction"],
            normal_force_max=contacts["normal_force_max"],
        )

    def key(self, part: str, name: str) -> str:
        """Path to a key of ``contacts`` or ``fidelity``: of the finger if it states it, else of the scene."""
        own = getattr(self.finger, part)
        # The fidelity of a finger replaces the scene's; its contacts replace the scene's key by key.
        stated = own is not None and (part == "fidelity" or getattr(own, name) is not None)
        return f"{self.where}.{part}.{name}" if stated else f"{part}.{name}"

    @property
    def tendons(self) -> Tendons:
        """The finger's tendons, a pair which every finger of a grasp has; the offset is that at the base."""
        if isinstance(self.finger.tendons, Tendons):
            return self.finger.tendons
        tendon = self.finger.tendon_list[0]
        # The arm has the cosine of tendons that are inclined.
        return Tendons(
            offset=self.finger.channels[0].arms[0],
            **{name: getattr(tendon, name) for name in Tendons.model_fields if name != "offset"},
        )

    @property
    def tip_force(self) -> float:
        """Transverse force at the tip whose moment at the base equals the moment of the greatest tension [N]."""
        return self.max_tension * self.tendons.offset / self.finger.rod.length

    @property
    def drive(self) -> DriveLaw | None:
        """Drive that winds up the tendons; None where tensions are commanded."""
        return self.finger.drive_law

    @property
    def max_tension(self) -> float:
        """Greatest tension that a tendon bears and that its own motor pulls up [N]."""
        law = self.drive
        limit = self.tendons.max_tension
        return limit if law is None or law.pulley else min(limit, law.greatest)

    @property
    def graded(self) -> bool:
        """Whether something of the finger changes along it."""
        return _is_graded(self.finger)

    @property
    def tendon_friction_states(self) -> int:
        """Number of friction states of its tendons, which run alike."""
        return self.elements * self.tendons.friction_cells if self.tendons.friction > 0.0 else 0

    @property
    def bending_cells(self) -> int:
        """Cells per element along which dry friction in bending has one state of each branch; 0 without it."""
        if not self.finger.damping.dry_friction:
            return 0
        return 1 if FAMILIES[self.family].even else self.finger.damping.friction_cells

    @property
    def friction_states(self) -> int:
        """Number of all friction states, first the tendons', then those in bending."""
        branches = len(self.finger.damping.dry_friction)
        return self.tendon_friction_states + self.elements * self.bending_cells * branches

    @cached_property
    def stiffness(self) -> float:
        """E I of the uniform rod whose tip a couple turns as far [N m2]: the harmonic mean, a scale of moments."""
        profile = self.finger.profile
        curve = self.finger.profile.bending_stiffness
        if curve.constant is not None:
            return curve.constant
        return profile.length / float(profile.moments(lambda s: 1.0 / curve(s), (0.0, profile.length))[0, 0])

    @property
    def switches(self) -> dict[str, Switch]:
        """Whether contacts are on, by their names: the middle ones and the tip."""
        return dict(zip((*self.middle_names, self.tip_name), (*self.middles, self.tip), strict=True))

    @property
    def middle_places(self) -> tuple[float, ...]:
        """Positions of middle contacts that do not touch [m]: the stations, or spread as the elements are."""
        return self.stations or tuple(self.finger.rod.length * count / self.elements for count in self.before)

    @property
    def middle_names(self) -> tuple[str, ...]:
        """Names of the middle contacts: ``<finger>.middle``, or ``<finger>.middle_1`` and so on; of stations
        ``<finger>.station_1`` and so on.
        """
        if self.stations:
            return tuple(f"{self.name}.station_{k + 1}" for k in range(len(self.stations)))
        if len(self.middles) == 1:
            return (f"{self.name}.middle",)
        return tuple(f"{self.name}.middle_{k + 1}" for k in range(len(self.middles)))

    @property
    def contact_bounds(self) -> tuple[tuple[float, float], ...]:
        """Least and greatest position of each middle contact or station along the finger [m]."""
        low, high = self.middle_bounds
        if not self.stations:
            return (self.middle_bounds,) * len(self.middles)
        half = 0.5 * (high - low) / (len(self.stations) - 1)
        return tuple((max(low, at - half), min(high, at + half)) for at in self.stations)

    def check_reach(self, key: str, position: tuple[float, float], body: GraspObject) -> None:
        """Refuse a position of an object, below a key, that the finger cannot reach."""
        Reach(self.finger, body=body).check(key, {"position": position})

    @property
    def tip_name(self) -> str:
        """Name of the tip contact."""
        return f"{self.name}.tip"


def is_light(weight: float, setups: Sequence[FingerSetup]) -> bool:
    """Whether a weight [N] is negligible to the fingers."""
    return weight <= _LIGHT * max(setup.tip_force for setup in setups)


def _is_graded(finger: GraspFinger) -> bool:
    """Whether something of a finger that matters to grasps changes along it."""
    profile = finger.profile
    shapes = [channel.shape for channel in finger.channels]
    curves = (profile.rest_curvature, profile.half_thickness, profile.half_depth, *shapes)
    return not profile.uniform or any(curve is not None and curve.constant is None for curve in curves)
