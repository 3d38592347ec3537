"""Limits of a scene that may be in the way of a grasp, in the plane and of hands.

A limit says how a problem is widened, how much of that a solution uses, and how the scene's keys change by as much.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from continuum_grasp.base import Array, Indices, amount_text
from continuum_grasp.grasp.rods import kinds
from continuum_grasp.grasp.rods.numbers import FingerNumbers, SceneNumbers
from continuum_grasp.grasp.rods.problem import UNBORNE, GraspRods
from continuum_grasp.scene import FingerSetup, GraspScene, HandScene, MotorDrive

AnyGraspScene = GraspScene | HandScene
FAR = 16.0
"""Factor on a limit from which on it is no reason [1]."""
MOVED = 0.1
"""Greatest shift of a base that is tried, per length of the finger [1]: farther is another hand."""
SHIFTED = 0.5
"""Greatest shift of the object that is tried, per size [1]: farther, other parts of it are touched."""
DIGITS = 6
"""Digits of places per size or length [1]: an object touches a support to within 1e-6 of its size."""


@dataclass(frozen=True)
class KeyNumber:
    """A number of a scene that a limit multiplies, or a part of it."""

    key: str
    value: float
    unit: str
    apart: float = 0.0  # part of it that is not multiplied

    def times(self, factor: float) -> float:
        """Return it with the limit times a factor, rounded beyond that to four digits."""
        return _beyond(self.apart + factor * (self.value - self.apart), up=factor > 1.0)


def _beyond(value: float, *, up: bool) -> float:
    """A number of four digits beyond another."""
    digit = 10.0 ** (math.floor(math.log10(abs(value))) - 3) if value else 1.0
    # 1e-9: a number of four digits stays as it is
    away = math.ceil(value / digit - 1e-9) if up else math.floor(value / digit + 1e-9)
    return float(f"{away * digit:.4g}")


class WidenedLimit(ABC):
    """A limit of a scene that may be in the way of a grasp."""

    name: ClassVar[str]
    loads: ClassVar[bool] = False
    """Whether the limit concerns the weight and the forces that carry it, wherever fingers touch."""

    def applies(self, scene: AnyGraspScene) -> bool:
        """Whether a scene has this limit."""
        return True

    def loosened(self, numbers: SceneNumbers) -> SceneNumbers:
        """Give the numbers of a scene that has the limit no more."""
        return numbers

    @abstractmethod
    def widen(self, problem: GraspRods, cost: float) -> None:
        """Let the problem go beyond the limit, at a cost of its relative amount."""

    @abstractmethod
    def used(self, problem: GraspRods, x: Array) -> float:
        """Relative amount, zero or more, by which a solution goes beyond the limit."""

    def beyond(self, amount: float, share: float) -> float:
        """A greater amount, by a share of what the limit is about."""
        return (1.0 + share) * amount

    @abstractmethod
    def changes(self, scene: AnyGraspScene, amount: float, problem: GraspRods, x: Array) -> dict[str, Any]:
        """Changes of keys of a scene that widen its limit by a relative amount, towards a solution that uses it."""

    @abstractmethod
    def words(self, scene: AnyGraspScene, changes: dict[str, Any], amount: float) -> tuple[str, str, float, float]:
        """Return a sentence about changes by an amount, the unit, the limit, and the number that is needed."""


class NumberLimit(WidenedLimit):
    """A limit of numbers in the scene; one factor multiplies all of them."""

    sentence: ClassVar[str]
    grows: ClassVar[bool] = True

    @abstractmethod
    def numbers(self, scene: AnyGraspScene) -> Iterator[KeyNumber]:
        """Return the numbers, the one that the sentence is about first."""

    def applies(self, scene: AnyGraspScene) -> bool:
        """Whether a scene has this limit."""
        return any(math.isfinite(number.value) and number.value > 0.0 for number in self.numbers(scene))

    def beyond(self, amount: float, share: float) -> float:
        """A greater amount, with numbers that are farther by a share of them."""
        return (1.0 + amount) * (1.0 + share) - 1.0 if self.grows else 1.0 - (1.0 - amount) / (1.0 + share)

    def changes(self, scene: AnyGraspScene, amount: float, problem: GraspRods, x: Array) -> dict[str, Any]:
        """Changes of the numbers."""
        factor = 1.0 + amount if self.grows else 1.0 - amount
        return {number.key: number.times(factor) for number in self.numbers(scene) if number.value}

    def words(self, scene: AnyGraspScene, changes: dict[str, Any], amount: float) -> tuple[str, str, float, float]:
        """Return a sentence about the first number."""
        number = next(number for number in self.numbers(scene) if number.key in changes)
        needed = float(changes[number.key])
        text = self.sentence.format(limit=shown(number.value, number.unit), needed=shown(needed, number.unit))
        return text, number.unit, number.value, needed


class WidenedFriction(NumberLimit):
    """Friction coefficients of all contacts."""

    name = "friction"
    loads = True
    sentence = "friction is too low: its coefficient is {limit}, and a grasp needs {needed}"

    def numbers(self, scene: AnyGraspScene) -> Iterator[KeyNumber]:
        """Return the numbers of all contacts, of supports and of fingers."""
        yield KeyNumber("contacts.friction", scene.contacts.friction, "1")
        yield from (KeyNumber(f"{key}.friction", value, "1") for key, value in _own_frictions(scene))
        yield from _stated(scene, "friction", "1")

    def widen(self, problem: GraspRods, cost: float) -> None:
        """Let the friction margin be negative."""
        problem.bound(problem.margin, low=1.0 - FAR)
        problem.cost(problem.margin, -cost)

    def used(self, problem: GraspRods, x: Array) -> float:
        """Share by which friction exceeds its limit."""
        return max(0.0, -float(x[problem.margin][0]))


def _own_frictions(scene: AnyGraspScene) -> Iterator[tuple[str, float]]:
    """Keys of supports with a friction coefficient of their own."""
    if isinstance(scene, GraspScene):
        for name, body in (scene.supports or {}).items():
            if body.friction is not None:
                yield f"supports.{name}", body.friction
    else:
        yield from ((body.key, body.friction) for body in scene.supports if body.has_own_friction)


def _stated(scene: AnyGraspScene, key: str, unit: str) -> Iterator[KeyNumber]:
    """A key of ``contacts`` where fingers have one of their own."""
    for setup in _different(scene):
        value = setup.finger.contacts.stated().get(key)
        if value is not None:
            yield KeyNumber(f"{setup.where}.contacts.{key}", value, unit)


def _different(scene: AnyGraspScene) -> Iterator[FingerSetup]:
    """Fingers of a scene that have keys of their own."""
    yield from {setup.where: setup for setup in scene.setups}.values()


class WidenedBounds(NumberLimit):
    """A limit that is an upper bound of unknowns."""

    @abstractmethod
    def bounds(self, problem: GraspRods) -> Iterator[tuple[int, float, float]]:
        """Places of unknowns, their bounds, and by how much those grow per relative amount."""

    def widen(self, problem: GraspRods, cost: float) -> None:
        """Let the unknowns exceed their bounds by a share of them."""
        more = problem.unknown(f"more {self.name}", 0.0, FAR - 1.0)
        problem.cost(more, cost)
        for at, most, grows in list(self.bounds(problem)):
            problem.bound(at, high=np.inf)
            row = problem.rows("widened", "limit", "1", 1, 1.0, -most, np.inf)
            problem.add(kinds.share_kind(), more, row, [grows])
            problem.add(kinds.share_kind(), np.array([at]), row, [-1.0])

    def used(self, problem: GraspRods, x: Array) -> float:
        """Share by which bounds are exceeded."""
        return max(0.0, float(x[problem.at[f"more {self.name}"]][0]))


class WidenedTension(WidenedBounds):
    """Greatest tensions of all tendons, and torques of motors that limit them."""

    name = "tension"
    sentence = "the tendons are too weak: {limit} at most, and a grasp needs {needed}"

    def numbers(self, scene: AnyGraspScene) -> Iterator[KeyNumber]:
        """Return tensions, and torques less what friction of the motor takes."""
        for setup in _different(scene):
            law = setup.drive
            if law is not None and isinstance(law.drive, MotorDrive) and not law.pulley:
                motor = law.drive
                yield KeyNumber(
                    f"{setup.where}.tendons.drive.torque_max", motor.torque_max, "N m", motor.coulomb_friction
                )
            if law is None or setup.max_tension >= setup.tendons.max_tension:
                yield KeyNumber(f"{setup.where}.tendons.max_tension", setup.tendons.max_tension, "N")

    def bounds(self, problem: GraspRods) -> Iterator[tuple[int, float, float]]:
        """Pulls of tendons that are used: they are above the least ones."""
        for part, finger in zip(problem.parts, problem.numbers.fingers, strict=True):
            for at, most, pull in zip(part.pulls, finger.pulls, finger.section.pulls, strict=True):
                if most > 0.0:
                    yield int(at), most, most + pull.least


class WidenedNormalForce(WidenedBounds):
    """Greatest normal forces of all contacts."""

    name = "normal force"
    loads = True
    sentence = "contacts must bear more: {limit} is allowed, and a grasp needs {needed}"

    def numbers(self, scene: AnyGraspScene) -> Iterator[KeyNumber]:
        """Return the numbers of all contacts and of fingers."""
        if math.isfinite(scene.contacts.normal_force_max):
            yield KeyNumber("contacts.normal_force_max", scene.contacts.normal_force_max, "N")
        yield from _stated(scene, "normal_force_max", "N")

    def bounds(self, problem: GraspRods) -> Iterator[tuple[int, float, float]]:
        """Normal forces."""
        high = problem.limits[1]
        for held in problem.contacts.values():
            if math.isfinite(high[held[0]]):
                yield int(held[0]), high[held[0]], high[held[0]]


class WidenedMass(NumberLimit):
    """Mass of the object."""

    name = "mass"
    loads = True
    sentence = "the object is too heavy: {limit}, of which a grasp holds {needed}"
    grows = False

    def applies(self, scene: AnyGraspScene) -> bool:
        """Whether the object has a weight."""
        return scene.weight > 0.0

    def numbers(self, scene: AnyGraspScene) -> Iterator[KeyNumber]:
        """Return mass or density."""
        if scene.object.mass is not None:
            yield KeyNumber("object.mass", scene.object.mass, "kg")
        elif (density := getattr(scene.object, "density", None)) is not None:
            yield KeyNumber("object.density", density, "kg/m3")

    def widen(self, problem: GraspRods, cost: float) -> None:
        """Let a share of the weight be gone."""
        less = problem.unknown("less mass", 0.0, 1.0 - 1.0 / FAR)
        problem.cost(less, cost)
        problem.add_load_share(less)

    def used(self, problem: GraspRods, x: Array) -> float:
        """Share of the mass that is too much."""
        return max(0.0, float(x[problem.at["less mass"]][0]))


class WidenedStrain(NumberLimit):
    """Greatest strains of rods."""

    name = "strain"
    sentence = "the rod must bend more: a strain of {limit} is allowed, and a grasp needs {needed}"

    def numbers(self, scene: AnyGraspScene) -> Iterator[KeyNumber]:
        """Return the limits of all fingers that have one."""
        for setup in _different(scene):
            if setup.finger.strain_limit is not None:
                yield KeyNumber(f"{setup.where}.strain_limit", setup.finger.strain_limit, "1")

    def widen(self, problem: GraspRods, cost: float) -> None:
        """Take what curvatures exceed their limits by off their rows, as far as a share of these."""
        more = problem.unknown("more strain", 0.0, FAR - 1.0)
        problem.cost(more, cost)
        give = kinds.share_kind()
        for block in [block for block in problem.blocks if block.name.startswith("strain, ")]:
            beyond = problem.unknown("strain beyond", -np.inf, np.inf)
            problem.add(give, beyond, block.rows.ravel(), [-1.0])
            for sign in (1.0, -1.0):
                row = problem.rows("widened", "limit", "1", 1, 1.0, 0.0, np.inf)
                problem.add(give, more, row, [float(block.upper.item())])
                problem.add(give, beyond, row, [sign])

    def used(self, problem: GraspRods, x: Array) -> float:
        """Share by which curvatures exceed their limits."""
        return max(0.0, float(x[problem.at["more strain"]][0]))


class WidenedTilt(WidenedLimit):
    """Balance of the object against tilting out of the plane."""

    name = "tilt balance"

    def applies(self, scene: AnyGraspScene) -> bool:
        """Whether contacts bear these moments of a weight."""
        return isinstance(scene, GraspScene) and scene.spatial and 3 in scene.balances and scene.weight > 0.0

    def widen(self, problem: GraspRods, cost: float) -> None:
        """Let something else bear the moments."""
        for axis in ("x", "y"):
            moment = problem.at.pop(f"unborne, moment {axis}")
            problem.at[f"tilt, moment {axis}"] = moment
            problem.bound(moment, high=np.inf)
            problem.scale_costs(moment, cost / UNBORNE)

    def used(self, problem: GraspRods, x: Array) -> float:
        """Moment that something else bears, per weight and size of the object."""
        moment = np.hypot(*(x[problem.at[f"tilt, moment {axis}"]] @ [1.0, -1.0] for axis in ("x", "y")))
        return float(moment / np.linalg.norm(problem.numbers.weight[:3]))

    def changes(self, scene: AnyGraspScene, amount: float, problem: GraspRods, x: Array) -> dict[str, Any]:
        """The key by which something else bears the moments."""
        return {"upright": True}

    def words(self, scene: AnyGraspScene, changes: dict[str, Any], amount: float) -> tuple[str, str, float, float]:
        """Return a sentence with the moment, for which there is no key."""
        moment = amount * scene.weight * scene.object.size
        missing = amount_text(moment, "N m", ".3g")
        text = f"the object would tip over: contacts leave a moment of {missing}, which something else may bear"
        return text, "N m", 0.0, moment


class WidenedPlace(WidenedLimit):
    """Places that are fixed: of the bases or of the object."""

    what: ClassVar[str]
    farthest: ClassVar[float]
    """Greatest way that is tried, in the unit of the place [1]."""

    @abstractmethod
    def placed(self, problem: GraspRods) -> Iterator[tuple[Indices, Array, float]]:
        """Unknown places, where the scene has them, and their unit [m]."""

    @abstractmethod
    def keys(self, scene: AnyGraspScene) -> Iterator[tuple[str, Any]]:
        """Keys of the places, and the positions there [m]."""

    def widen(self, problem: GraspRods, cost: float) -> None:
        """Let the places move, at a cost of the square of the way."""
        for at, place, _ in self.placed(problem):
            for one, value in zip(at, place, strict=True):
                problem.bound(one, low=value - self.farthest, high=value + self.farthest)
                problem.cost(one, -2.0 * cost / self.farthest**2 * value, 2.0 * cost / self.farthest**2)

    def used(self, problem: GraspRods, x: Array) -> float:
        """Greatest way, per the greatest one that is tried."""
        return max(float(np.linalg.norm(x[at] - place)) / self.farthest for at, place, _ in self.placed(problem))

    def changes(self, scene: AnyGraspScene, amount: float, problem: GraspRods, x: Array) -> dict[str, Any]:
        """Positions toward the ones of a solution."""
        share = amount / max(self.used(problem, x), 1e-12)
        changes = dict[str, Any]()
        for (key, position), (at, place, unit) in zip(self.keys(scene), self.placed(problem), strict=True):
            shift = share * unit * (x[at] - place)
            # As fine as a touch of a support asks for, and no finer.
            decimals = DIGITS - math.floor(math.log10(unit))
            values = (round(value + by, decimals) + 0.0 for value, by in zip(position, shift.tolist(), strict=True))
            changes[key] = tuple(values)
        return changes

    def words(self, scene: AnyGraspScene, changes: dict[str, Any], amount: float) -> tuple[str, str, float, float]:
        """Return a sentence about how far the places move."""
        positions = dict(self.keys(scene))
        far = max(math.dist(positions[key], needed) for key, needed in changes.items())
        return f"{self.what}: a grasp needs it {shown(far, 'm')} from there", "m", 0.0, far


class WidenedBase(WidenedPlace):
    """Places of the bases that may not move by themselves."""

    name, what, farthest = "base place", "the base is in the wrong place", MOVED

    def applies(self, scene: AnyGraspScene) -> bool:
        """Whether each finger has a base of its own, which is fixed."""
        if isinstance(scene, HandScene):
            return scene.hand.ring is None
        return all(setup.finger.base_free is None for setup in scene.setups)

    def loosened(self, numbers: SceneNumbers) -> SceneNumbers:
        """Give the numbers with bases that may move."""
        d = numbers.geometry.dimensions

        def moving(finger: FingerNumbers) -> FingerNumbers:
            reach = self.farthest * (np.arange(len(finger.base)) < d)
            return replace(finger, base_bounds=(finger.base - reach, finger.base + reach))

        return replace(numbers, fingers=[moving(finger) for finger in numbers.fingers])

    def placed(self, problem: GraspRods) -> Iterator[tuple[Indices, Array, float]]:
        """Bases."""
        d = problem.geometry.dimensions
        for part, finger in zip(problem.parts, problem.numbers.fingers, strict=True):
            yield part.nodes[0][:d], finger.base[:d], finger.length

    def keys(self, scene: AnyGraspScene) -> Iterator[tuple[str, Any]]:
        """Keys of the bases."""
        if isinstance(scene, HandScene):
            for name, base in scene.hand.named_bases.items():
                yield f"hand.bases.{name}.position", base.position
        else:
            yield from ((f"{setup.where}.base.position", setup.finger.base.position) for setup in scene.setups)


class WidenedObjectPlace(WidenedPlace):
    """Place of the object."""

    name, what, farthest = "object place", "the object is in the wrong place", SHIFTED

    def applies(self, scene: AnyGraspScene) -> bool:
        """Whether the object is fixed, and not by a support that it is put against."""
        return scene.object.against is None and getattr(scene.object, "free", None) is None

    def loosened(self, numbers: SceneNumbers) -> SceneNumbers:
        """Give the numbers with an object that may move."""
        reach = self.farthest * (np.arange(len(numbers.pose)) < numbers.geometry.dimensions)
        return replace(numbers, pose_bounds=(numbers.pose - reach, numbers.pose + reach))

    def placed(self, problem: GraspRods) -> Iterator[tuple[Indices, Array, float]]:
        """Place of the object."""
        d = problem.geometry.dimensions
        yield problem.pose[:d], problem.numbers.pose[:d], problem.numbers.size

    def keys(self, scene: AnyGraspScene) -> Iterator[tuple[str, Any]]:
        """Key of the place."""
        yield "object.position", scene.object.position


LIMITS: tuple[WidenedLimit, ...] = (
    WidenedObjectPlace(),
    WidenedBase(),
    WidenedTension(),
    WidenedNormalForce(),
    WidenedStrain(),
    WidenedMass(),
    WidenedTilt(),
    WidenedFriction(),
)
"""Limits in the order in which they are named."""


def shown(value: Any, unit: str = "1") -> str:
    """A number with its unit, or a list of numbers, as it is typed."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple):
        return f"[{', '.join(f'{part:.{DIGITS + 1}g}' for part in value)}]"
    return value if isinstance(value, str) else f"{value:.4g}" + (f" {unit}" if unit != "1" else "")
