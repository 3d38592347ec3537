"""Structure of the equations of a grasp; two scenes of one structure share one compiled solver."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

from continuum_grasp.grasp.problem.curves import curves_of
from continuum_grasp.grasp.starts.values import ContactStart
from continuum_grasp.model import CurvesSpec, Surface, surface_of
from continuum_grasp.scene import Finger, FingerSetup, GraspScene, Peg, PointMass

_RANGES = (1.0, 2.1, 3.15, 4.5, 6.3)
"""Bending ranges of models [rad]: a scene takes the next larger one, so that many scenes share a solver."""

_NEAREST = 4
"""Most pieces of the object that a place must clear at once: in a notch two faces are near, each of one piece or,
next to a cut, of two."""


@dataclass(frozen=True)
class DriveSpec:
    """Structure of the equations of drives."""

    pulley: bool  # whether one drive moves both tendons
    locks: bool  # whether it holds a position; False: a torque

    @property
    def winds(self) -> bool:
        """Whether the angle of the drive is an unknown: of a pulley under a torque."""
        return self.pulley and not self.locks

    @staticmethod
    def of(setup: FingerSetup) -> DriveSpec | None:
        """The structure of a finger's drives; None where its tensions can be chosen and stay."""
        law = setup.drive
        return DriveSpec(law.pulley, law.locks) if law is not None and (law.pulley or law.locks) else None


@dataclass(frozen=True)
class FingerSpec:
    """Structure of a finger's equations; all else are numbers."""

    name: str
    family: str
    elements: int
    before: tuple[int, ...]  # elements between the base and each middle contact
    touching: tuple[bool, ...]  # which middle contacts are on
    stations: bool  # whether the middle contacts are stations
    tip: bool  # whether the tip touches
    friction_cells: int  # per element; 0: the tendons have no friction
    bending_cells: int  # per element, of dry friction in bending; 0: there is none
    branches: int  # of dry friction in bending
    friction_states: int
    weighs: bool  # whether its own weight acts
    preshaped: bool  # whether it is curved at rest
    tip_heavy: bool  # whether there is a mass on the tip
    masses: int  # point masses elsewhere, where the finger weighs
    strained: bool  # whether there is a strain limit
    free: bool  # whether the base may move
    bending_range: float  # [rad]
    accuracy: float | None
    curves: CurvesSpec  # along the finger
    drive: DriveSpec | None  # what winds up the tendons; None where each tension is given, or follows from a torque
    wound: bool  # whether there are drives at all
    pulley: bool  # and one moves both tendons
    in_error: bool = False  # whether the drives are where they are, and the tensions follow

    @property
    def emerging(self) -> int:
        """Elements before the first contact along the finger, which may come out of a support."""
        return next((n for n, on in zip(self.before, self.touching, strict=True) if on), self.before[0])

    @property
    def held(self) -> str:
        """Name of the unknowns that stay while friction or the object change: tensions, or what drives hold."""
        return "pulls" if self.drive is None else "command"

    @property
    def lands(self) -> bool:
        """Whether its tip stays where it met an object that yields: of a finger that slides along it, it does not."""
        return not any(self.touching)

    @property
    def tapered(self) -> bool:
        """Whether the thickness changes along the finger."""
        return any(curve.name == "thickness" and curve.panels * (curve.degree + 1) > 1 for curve in self.curves.curves)

    @property
    def probes(self) -> int:
        """Guarded places per element, where it is deepest: long elements can enter an object at two places."""
        return 2 if self.elements < 4 else 1

    @property
    def guards(self) -> int:
        """Guarded places per element that are spread evenly: 16 along the finger, six on an element at most."""
        # Few are enough beside the probes: with 12 sensitivities, which leave out that places move, are 4e-4 off.
        return min(math.ceil(16 / self.elements), 6)

    @staticmethod
    def of(setup: FingerSetup, on: frozenset[str], weighs: bool) -> FingerSpec:
        """The structure of a finger with some of its contacts on."""
        finger = setup.finger
        inner = inner_masses(finger)
        return FingerSpec(
            name=setup.name,
            family=setup.family,
            elements=setup.elements,
            before=setup.before,
            touching=tuple(name in on for name in setup.middle_names),
            stations=bool(setup.stations),
            tip=setup.tip_name in on,
            friction_cells=setup.tendons.friction_cells if setup.tendons.friction > 0.0 else 0,
            bending_cells=setup.bending_cells,
            branches=len(finger.damping.dry_friction),
            friction_states=setup.friction_states,
            weighs=weighs,
            preshaped=not setup.graded and finger.profile.rest_curvature.constant != 0.0,
            tip_heavy=weighs and len(inner) < len(finger.masses),
            masses=len(inner) if weighs else 0,
            strained=finger.strain_limit is not None,
            free=finger.base_free is not None,
            bending_range=next((r for r in _RANGES if setup.bending_range <= r), setup.bending_range),
            accuracy=setup.accuracy,
            curves=curves_of(setup, weighs),
            drive=DriveSpec.of(setup),
            wound=setup.drive is not None,
            pulley=setup.drive is not None and setup.drive.pulley,
        )


def _alike(fingers: list[FingerSpec]) -> tuple[FingerSpec, ...]:
    """Fingers of a scene that share one structure where curves at rest or masses on tips of zero make them alike."""
    tip_heavy = any(finger.tip_heavy for finger in fingers)
    preshaped = any(finger.preshaped for finger in fingers)
    # The nodes of graded fingers have their curvature at rest.
    return tuple(
        replace(finger, tip_heavy=tip_heavy, preshaped=preshaped and not finger.curves.graded) for finger in fingers
    )


def inner_masses(finger: Finger) -> list[PointMass]:
    length = finger.rod.length
    return [mass for mass in finger.masses if abs(mass.at - length) > 1e-9 * length]


@dataclass(frozen=True)
class ContactSpec:
    """A contact that is on."""

    name: str
    finger: int  # index of the finger; -1 for a support's
    joint: int  # index of the middle contact along the finger; -1 for the tip, -2 for a support's
    peg: bool  # whether the support is round
    surface: Surface[Any]  # of the part that is touched
    bounded: bool  # whether the support is a finite line


@dataclass(frozen=True)
class ProblemSpec:
    """A grasp problem but for its numbers."""

    fingers: tuple[FingerSpec, ...]
    contacts: tuple[ContactSpec, ...]
    surfaces: tuple[Surface[Any], ...]  # of the object's parts
    obstacles: int  # convex pieces of them that a place must keep clear of, the nearest ones
    planes: int  # supports that are half planes
    edges: int  # finite ones
    pegs: int  # round ones
    pairs: tuple[tuple[int, int], ...]  # indices of fingers that must keep clear of each other; of one twice, of itself
    free: bool  # whether the object's pose is sought
    balances: tuple[int, ...]  # of the object that must be met: force along x, y, z, moment about x, y, z
    aims: tuple[str, ...]  # objectives with a weight
    wrenches: int  # disturbances, where they are an aim
    locked: bool  # whether tendons are locked under disturbances and pushes
    pushed: bool = False  # whether the grasp bears a push in any direction
    steadied: bool = False  # whether there is a bound on what the least eigenvalue is to first order
    yielding: bool = False  # whether the object yields to tips that stay where they met it

    @property
    def dimensions(self) -> int:
        """Components of a force: three where forces act out of the plane of the fingers."""
        return 3 if 2 in self.balances else 2

    @property
    def shared(self) -> ProblemSpec:
        """The structure that all parts of the problem share."""
        return replace(self, fingers=(), contacts=(), surfaces=(), pairs=())

    def fits(self, scene: GraspScene, contacts: dict[str, ContactStart]) -> bool:
        """Whether the problem of a scene with these contacts on has this structure, whatever keeps apart."""
        return replace(ProblemSpec.of(scene, contacts), pairs=self.pairs) == self

    @staticmethod
    def of(
        scene: GraspScene, contacts: dict[str, ContactStart], apart: frozenset[tuple[str, str]] | None = None
    ) -> ProblemSpec:
        """The structure of the problem of a scene with some contacts on, which sit where a start has them; fingers that
        keep ``apart`` are given by their names, one that must not pass through itself twice. By default all do that
        could meet.
        """
        aims = scene.aims
        setups = scene.setups
        weighs = any(scene.gravity[:2])
        on = frozenset(contacts)
        places: dict[str, tuple[int, int]] = {}
        for i, setup in enumerate(setups):
            places |= {name: (i, k) for k, name in enumerate(setup.middle_names)}
            places[setup.tip_name] = (i, -1)
        bounded = {wall.name for wall in scene.walls if math.isfinite(wall.half_length)}
        surfaces = tuple(surface_of(part) for part in scene.object.parts)
        specs = []
        for name, start in contacts.items():
            support = scene.support_of(name)
            place = places.get(name, (-1, -2))
            finite = support is not None and support.name in bounded
            specs.append(ContactSpec(name, *place, isinstance(support, Peg), surfaces[start.part], finite))
        disturbed = "greatest_disturbance" in aims
        pushed = "greatest_push" in aims or bool(scene.contacts.push)
        pairs = scene.pairs
        if apart is not None:
            count = range(len(setups))
            pairs = tuple((k, m) for k in count for m in count if (setups[k].name, setups[m].name) in apart)
        return ProblemSpec(
            fingers=_alike([FingerSpec.of(setup, on, weighs) for setup in setups]),
            contacts=tuple(specs),
            surfaces=surfaces,
            obstacles=min(len(scene.object.pieces), _NEAREST),
            planes=len(scene.walls) - len(bounded),
            edges=len(bounded),
            pegs=len(scene.pegs),
            pairs=pairs,
            free=scene.object.free is not None,
            balances=scene.balances,
            aims=aims,
            wrenches=len(scene.wrenches) if disturbed else 0,
            locked=(disturbed or pushed) and scene.disturbances.tendons == "locked",
            pushed=pushed,
        )

    def in_error(self, *, yielding: bool) -> ProblemSpec:
        """Structure for the same contacts of an object that is not as it should be: the greatest reserve of their cones
        is sought.

        A ``yielding`` object yields to the fingers, tips stay where they met it.
        """
        free = self.free or yielding
        aims = ("greatest_reserve",)
        fingers = tuple(finger if finger.drive is None else replace(finger, in_error=True) for finger in self.fingers)
        return replace(
            self, fingers=fingers, free=free, yielding=yielding, aims=aims, wrenches=0, locked=False, pushed=False
        )

    def lands(self, contact: ContactSpec) -> bool:
        """Whether a contact stays where it met the object."""
        return self.yielding and contact.finger >= 0 and self.fingers[contact.finger].lands
