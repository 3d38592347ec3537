"""Reasons why a scene has no grasp: its limits, one at a time, widened at a cost in the same problem.

A limit says how the problem is widened, how much of that a solution uses, and how the scene's keys change by as much.
The least amount is found by going down: from the amount that the cost leaves, until 0.97 of it holds from no start.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from continuum_grasp.base import Array, Indices, InputError
from continuum_grasp.grasp.rods import kinds
from continuum_grasp.grasp.rods.problem import GraspRods
from continuum_grasp.grasp.rods.search import RodSearch
from continuum_grasp.grasp.rods.solving import RodGrasp
from continuum_grasp.grasp.values import Reason
from continuum_grasp.scene import GraspScene

FAR = 16.0
"""Factor on a limit from which on it is no reason."""
COST = 3.0
"""Cost of a limit's relative amount, of which an unborne force costs 100 and all tensions together 1."""
SURE = 0.97
"""Share of a change that must not hold."""
STARTS = 6
"""Starts from which a limit is widened."""
MOVED = 0.1
"""Greatest shift of a base that is tried, per length."""
UNUSUAL = 1.0
"""Friction coefficient that few surfaces have."""


class WidenedLimit(ABC):
    """A limit of a scene that may be in the way of a grasp."""

    name: ClassVar[str]
    unit: ClassVar[str]

    def applies(self, scene: GraspScene) -> bool:
        """Whether a scene has this limit."""
        return True

    @abstractmethod
    def widen(self, problem: GraspRods) -> None:
        """Let the problem go beyond the limit, at a cost."""

    @abstractmethod
    def used(self, problem: GraspRods, x: Array) -> float:
        """Relative amount, zero or more, by which a solution goes beyond the limit."""

    @abstractmethod
    def changes(self, scene: GraspScene, amount: float, grasp: RodGrasp) -> dict[str, Any]:
        """Changes of keys of a scene that widen its limit by a relative amount, towards a grasp that uses it."""


def _multiplied(scene: GraspScene, paths: Mapping[str, float | None], factor: float) -> dict[str, Any]:
    """Changes by a factor of the numbers that a scene states, by their paths."""
    return {path: _rounded(factor * value, factor) for path, value in paths.items() if value}


def _rounded(value: float, factor: float) -> float:
    """A number of four digits beyond another, up for factors above one, else down."""
    digit = 10.0 ** (math.floor(math.log10(abs(value))) - 3)
    away = math.ceil if factor > 1.0 else math.floor
    return float(f"{away(value / digit) * digit:.4g}")


def _fingers(scene: GraspScene) -> dict[str, str]:
    """Path of each finger by name."""
    return {setup.name: setup.where for setup in scene.setups}


class WidenedFriction(WidenedLimit):
    """Friction coefficients of all contacts."""

    name, unit = "friction", "1"

    def widen(self, problem: GraspRods) -> None:
        problem.bound(problem.margin, low=1.0 - FAR)
        problem.cost(problem.margin, -COST)

    def used(self, problem: GraspRods, x: Array) -> float:
        return max(0.0, -float(x[problem.margin][0]))

    def changes(self, scene: GraspScene, amount: float, grasp: RodGrasp) -> dict[str, Any]:
        paths: dict[str, float | None] = {"contacts.friction": scene.contacts.friction}
        for name, body in (scene.supports or {}).items():
            paths[f"supports.{name}.friction"] = body.friction
        for setup in scene.setups:
            own = setup.finger.contacts.stated().get("friction")
            paths[f"{setup.where}.contacts.friction"] = own
        return _multiplied(scene, paths, 1.0 + amount)


class WidenedTension(WidenedLimit):
    """Greatest tensions of all tendons."""

    name, unit = "tension", "N"

    def widen(self, problem: GraspRods) -> None:
        more = problem.unknown("more tension", 0.0, FAR - 1.0)
        problem.cost(more, COST)
        for part, finger in zip(problem.parts, problem.numbers.fingers, strict=True):
            for at, most, pull in zip(part.pulls, finger.pulls, finger.section.pulls, strict=True):
                if most > 0.0:
                    _share(problem, at, most, most + pull.least, more)

    def used(self, problem: GraspRods, x: Array) -> float:
        return float(x[problem.at["more tension"]][0])

    def changes(self, scene: GraspScene, amount: float, grasp: RodGrasp) -> dict[str, Any]:
        paths = {f"{setup.where}.tendons.max_tension": setup.tendons.max_tension for setup in scene.setups}
        return _multiplied(scene, paths, 1.0 + amount)


class WidenedNormalForce(WidenedLimit):
    """Greatest normal forces of all contacts."""

    name, unit = "normal force", "N"

    def applies(self, scene: GraspScene) -> bool:
        return math.isfinite(scene.contacts.normal_force_max)

    def widen(self, problem: GraspRods) -> None:
        more = problem.unknown("more force", 0.0, FAR - 1.0)
        problem.cost(more, COST)
        _, high = problem.limits
        for held in problem.contacts.values():
            if math.isfinite(high[held[0]]):
                _share(problem, held[0], high[held[0]], high[held[0]], more)

    def used(self, problem: GraspRods, x: Array) -> float:
        return float(x[problem.at["more force"]][0])

    def changes(self, scene: GraspScene, amount: float, grasp: RodGrasp) -> dict[str, Any]:
        paths: dict[str, float | None] = {"contacts.normal_force_max": scene.contacts.normal_force_max}
        for setup in scene.setups:
            own = setup.finger.contacts.stated().get("normal_force_max")
            paths[f"{setup.where}.contacts.normal_force_max"] = own
        return _multiplied(scene, paths, 1.0 + amount)


class WidenedMass(WidenedLimit):
    """Mass of the object."""

    name, unit = "mass", "kg"

    def applies(self, scene: GraspScene) -> bool:
        return scene.object.mass > 0.0 and any(scene.gravity)

    def widen(self, problem: GraspRods) -> None:
        less = problem.unknown("less mass", 0.0, 1.0)
        problem.cost(less, COST)
        problem.add_load_share(less)

    def used(self, problem: GraspRods, x: Array) -> float:
        return float(x[problem.at["less mass"]][0])

    def changes(self, scene: GraspScene, amount: float, grasp: RodGrasp) -> dict[str, Any]:
        return _multiplied(scene, {"object.mass": scene.object.mass}, 1.0 - amount)


def _share(problem: GraspRods, at: int, most: float, greatest: float, more: Indices) -> None:
    """Let an unknown exceed its bound by a share of its greatest value."""
    problem.bound(at, high=np.inf)
    row = problem.rows("widened", "limit", "1", 1, 1.0, -most, np.inf)
    problem.add(kinds.share_kind(), more, row, [greatest])
    problem.add(kinds.share_kind(), at, row, [-1.0])


class WidenedBase(WidenedLimit):
    """Places of the bases that may not move by themselves."""

    name, unit = "base place", "m"

    def applies(self, scene: GraspScene) -> bool:
        return all(setup.finger.base_free is None for setup in scene.setups)

    def widen(self, problem: GraspRods) -> None:
        for part, finger in zip(problem.parts, problem.numbers.fingers, strict=True):
            for at, place in zip(part.nodes[0][:2], finger.base[:2], strict=True):
                problem.bound(at, low=place - MOVED, high=place + MOVED)
                problem.cost(at, -2.0 * COST / MOVED * place, 2.0 * COST / MOVED)

    def used(self, problem: GraspRods, x: Array) -> float:
        return max(float(np.linalg.norm(shift)) for shift in self._shifts(problem, x))

    def changes(self, scene: GraspScene, amount: float, grasp: RodGrasp) -> dict[str, Any]:
        problem, x = grasp.problem, grasp.attempt.x
        share = amount / max(self.used(problem, x), 1e-12)
        changes = dict[str, Any]()
        for setup, finger, shift in zip(scene.setups, problem.numbers.fingers, self._shifts(problem, x), strict=True):
            place = np.array(setup.finger.base.position) + share * finger.length * shift
            changes[f"{setup.where}.base.position"] = tuple(float(f"{value:.4g}") for value in place)
        return changes

    @staticmethod
    def _shifts(problem: GraspRods, x: Array) -> list[Array]:
        """Shifts (2,) of the bases [L]."""
        pairs = zip(problem.parts, problem.numbers.fingers, strict=True)
        return [x[part.nodes[0][:2]] - np.array(finger.base[:2]) for part, finger in pairs]


LIMITS: tuple[WidenedLimit, ...] = (
    WidenedBase(),
    WidenedTension(),
    WidenedNormalForce(),
    WidenedMass(),
    WidenedFriction(),
)
"""Limits in the order in which they are named where they are off by equal factors."""


@dataclass(frozen=True, eq=False)
class LeastRepair:
    """Changes of a scene with which it has a grasp."""

    limit: WidenedLimit
    amount: float
    changes: dict[str, Any]
    grasp: RodGrasp


class LeastRepairs:
    """Least amounts of the limits of a scene without a grasp."""

    def __init__(self, search: RodSearch) -> None:
        self._search, self._scene = search, search.scene
        self._starts = search.starts[:STARTS]

    def found(self) -> Iterator[LeastRepair]:
        """A repair per limit that alone is enough."""
        for limit in LIMITS:
            if limit.applies(self._scene) and (repair := self._least(limit)) is not None:
                yield repair

    def _least(self, limit: WidenedLimit) -> LeastRepair | None:
        """The least amount of a limit with which a start holds."""
        widened = [self._search.solved(start, widen=limit.widen) for start in self._starts]
        used = [(limit.used(grasp.problem, grasp.attempt.x), grasp) for grasp in widened if grasp.holds]
        for amount, grasp in sorted(used, key=lambda pair: pair[0]):
            best = self._held(limit, amount, grasp)
            if best is None:
                continue
            while (less := self._held(limit, SURE * best.amount, grasp)) is not None:
                best = less
            return best
        return None

    def _held(self, limit: WidenedLimit, amount: float, widened: RodGrasp) -> LeastRepair | None:
        """A grasp of the scene with a limit changed by an amount, towards a grasp with the limit widened."""
        changes = limit.changes(self._scene, amount, widened)
        try:
            scene = self._scene.changed(changes)
        except InputError:
            return None
        for start, beside in [(widened.start, widened), *((start, None) for start in self._starts)]:
            grasp = self._search.solved(start.changed(scene), beside=beside)
            if grasp.holds:
                return LeastRepair(limit, amount, changes, grasp)
        return None


def reason_of(scene: GraspScene, repair: LeastRepair) -> Reason:
    """A repair in words."""
    key, needed = next(iter(repair.changes.items()))
    before = _at(scene, key)
    unit = "" if repair.limit.unit == "1" else f" {repair.limit.unit}"
    advice = " and ".join(f"{path} = {_shown(value)}{unit}" for path, value in repair.changes.items())
    if isinstance(needed, tuple):
        shift = math.dist(before, needed)
        text = f"{repair.limit.name}: a grasp needs the base {shift:.3g} m from here"
        return Reason(repair.limit.name, key, repair.limit.unit, 0.0, shift, text, advice)
    limit = float(before)
    unusual = ", which few surfaces have" if repair.limit.name == "friction" and needed > UNUSUAL else ""
    text = f"{repair.limit.name} limit: {limit:.4g}{unit}; a grasp needs {needed:.4g}{unit}{unusual}"
    return Reason(repair.limit.name, key, repair.limit.unit, limit, needed, text, advice)


def _shown(value: Any) -> str:
    """A number, or a list of numbers, as it is typed."""
    return f"[{', '.join(f'{part:.4g}' for part in value)}]" if isinstance(value, tuple) else f"{value:.4g}"


def _at(scene: Any, key: str) -> Any:
    """Value of a scene at a path."""
    for name in key.split("."):
        scene = scene[name] if isinstance(scene, dict) else getattr(scene, name)
    return scene
