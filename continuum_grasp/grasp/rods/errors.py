"""Errors of a grasp's scene: copies of the grasp whose object lies elsewhere, has another size, friction or mass.

An error is a row of numbers: offsets of the object's place [m] and turns [rad], and shares [1] of its size, of all
friction coefficients, of its mass, and of all tensions. Where friction states must not matter, these follow: of each
stage of a finger a direction from -1 to 1 of each of its frictions. An object that touches supports stays against them
where it lies; others yield to the fingers, and tips that come straight onto them stay where they land.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import Any, ClassVar

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.grasp.judge.check import YIELDS
from continuum_grasp.grasp.robust.errors import InError, scaled
from continuum_grasp.grasp.rods import kinds
from continuum_grasp.grasp.rods.copies import HeldValue, RodCopy, held_by_drives
from continuum_grasp.grasp.rods.histories import HistoryColumns
from continuum_grasp.grasp.rods.numbers import GraspAims, SceneNumbers
from continuum_grasp.grasp.rods.places import StagePlace
from continuum_grasp.grasp.rods.planar_numbers import planar_supports
from continuum_grasp.grasp.rods.problem import GraspRods
from continuum_grasp.grasp.rods.solving import RodGrasp
from continuum_grasp.grasp.rods.supports import SupportNumbers
from continuum_grasp.scene import GraspScene, HandScene

SHARES = ("radius", "friction", "mass", "tension")
"""Errors that are shares, in the order of their columns, which come last."""
_STAYS = 1e-6
"""Cost of the square of what an object moves as it yields [object size, rad], so that one that fingers do not hold
about an axis, such as a ball, does not turn: far below the cost of any margin."""
_UNAIMED = GraspAims(0.0, 0.0)


@dataclass(frozen=True, eq=False)
class ObjectInError:
    """An object in error where it lies before fingers push it, and its supports."""

    pose: Array  # place [m] and turn
    axes: Array
    supports: list[SupportNumbers]


class ErrorSpace(ABC):
    """Errors of a grasp within bounds.

    Parameters
    ----------
    scene : GraspScene or HandScene
    grasp : RodGrasp
    bounds : mapping of str to float
        Greatest errors: ``position`` [m], ``angle`` [rad], and shares by `SHARES` [1].
    """

    axes: ClassVar[tuple[tuple[str, str], ...]]
    """Columns of offsets and turns: name, and key of the bound."""

    def __init__(self, scene: Any, grasp: RodGrasp, bounds: Mapping[str, float]) -> None:
        self.scene, self.grasp, self.known = scene, grasp, bounds
        self.columns = (*self.axes, *zip(SHARES, SHARES, strict=True))
        self.bounds = np.array([bounds.get(key, 0.0) for _, key in self.columns])
        numbers = grasp.problem.numbers
        self.histories = HistoryColumns.of(scene, grasp.problem)
        d = numbers.geometry.dimensions
        self.unit = np.concatenate([np.full(d, numbers.size), np.ones(numbers.geometry.pose - d)])
        self.pose = self.unit * grasp.attempt.x[grasp.problem.pose]

    # -- errors ------------------------------------------------------------------------------------------------

    def share(self, error: Array, name: str) -> float:
        """Error of a share by name."""
        return float(error[len(self.axes) + SHARES.index(name)])

    @property
    def corners(self) -> Array:
        """All corners (n, columns) of the bounds that differ, with the least friction: more only widens the cones.

        Each with all friction states alike in each finger.
        """
        sides = [(-b, b) if b else (0.0,) for b in self.bounds.tolist()]
        friction = len(self.axes) + SHARES.index("friction")
        sides[friction] = sides[friction][:1]
        return self.distinct(self._with(np.array(list(product(*sides))), self.histories.extremes))

    @property
    def alone(self) -> dict[str, Array]:
        """Per bound, its ends with no other error (n, columns)."""
        keys = [key for _, key in self.columns]
        units = self._with(np.diag(self.bounds), self.histories.extremes[:1])
        return {
            key: np.concatenate([sign * units[[key == own for own in keys]] for sign in (1.0, -1.0)])
            for key, bound in self.known.items()
            if bound
        }

    def drawn(self, count: int, seed: int) -> Array:
        """Errors drawn evenly within the bounds (count, columns)."""
        random = np.random.default_rng(seed)
        errors = random.uniform(-1.0, 1.0, (count, self.bounds.size)) * self.bounds
        # Half of all states at their bounds.
        states = random.uniform(-2.0, 2.0, (count, self.histories.size))
        return np.concatenate([errors, np.clip(states, -1.0, 1.0)], axis=1)

    @staticmethod
    def _with(errors: Array, states: Array) -> Array:
        """Each error with each of the states."""
        return np.concatenate([np.repeat(errors, len(states), axis=0), np.tile(states, (len(errors), 1))], axis=1)

    def states(self, error: Array) -> Array:
        """Friction states of an error."""
        return error[len(self.columns) :]

    @property
    def scales(self) -> Array:
        """Greatest errors, one of states."""
        return np.concatenate([np.maximum(self.bounds, 1e-12), np.ones(self.histories.size)])

    def distinct(self, errors: Array) -> Array:
        """Errors without those that supports make equal to another, such as offsets across a palm."""
        rows = [self._key(error) for error in errors]
        _, first = np.unique(np.round(rows, 9), axis=0, return_index=True)
        return errors[np.sort(first)]

    def _key(self, error: Array) -> Array:
        placed = self.placed(error)
        return np.concatenate([placed.pose / self.unit, placed.axes, error[len(self.axes) :]])

    def words(self, error: Array) -> str:
        """An error in words."""
        moved = [f"{1e3 * e:+.3g}" for e, (_, key) in zip(error, self.axes, strict=False) if key == "position"]
        turned = [f"{np.degrees(e):+.3g}" for e, (_, key) in zip(error, self.axes, strict=False) if key == "angle"]
        shares = [f"{'size' if name == 'radius' else name} {self.share(error, name):+.1%}" for name in SHARES[:3]]
        return ", ".join([f"corner ({', '.join(moved)}) mm", f"{', '.join(turned)} deg", *shares])

    # -- copies ------------------------------------------------------------------------------------------------

    @abstractmethod
    def scene_with(self, error: Array) -> Any:
        """The scene with an error."""

    @abstractmethod
    def placed(self, error: Array) -> ObjectInError:
        """The object with an error."""

    @property
    def yields(self) -> bool:
        """Whether the object yields to the fingers."""
        return not self.grasp.problem.numbers.supports

    def numbers(self, error: Array, aims: GraspAims = _UNAIMED) -> SceneNumbers:
        """The numbers of the scene with an error."""
        numbers, placed = self.grasp.problem.numbers, self.placed(error)
        growth, d = 1.0 + self.share(error, "radius"), numbers.geometry.dimensions
        pose = placed.pose / self._unit_of(growth)
        low, high = self._pose_bounds(pose, d)
        friction = 1.0 + self.share(error, "friction")
        weight = numbers.weight * (1.0 + self.share(error, "mass"))
        weight[3:] /= growth
        return replace(
            numbers,
            fingers=[
                replace(finger, friction=friction * finger.friction, history=history)
                for finger, history in zip(numbers.fingers, self.histories.of_fingers(self.states(error)), strict=True)
            ],
            supports=placed.supports,
            table=replace(numbers.table, unit=growth * numbers.table.unit, patches={}),
            size=growth * numbers.size,
            pose=pose,
            axes=placed.axes,
            pose_bounds=(low, high),
            weight=weight,
            aims=aims,
        )

    def _unit_of(self, growth: float) -> Array:
        """Units of a pose of an object that is larger by a factor."""
        unit = self.unit.copy()
        unit[: self.grasp.problem.geometry.dimensions] *= growth
        return unit

    def _pose_bounds(self, pose: Array, dimensions: int) -> tuple[Array, Array]:
        if self.yields:
            return pose - YIELDS, pose + YIELDS
        return pose, pose

    def copy(
        self, error: Array, stages: int, *, places: tuple[StagePlace, ...] = (), aims: GraspAims = _UNAIMED
    ) -> RodCopy:
        """The copy of the grasp with an error, and rows at further places."""
        first = self.grasp.problem
        numbers = self.numbers(error, aims)
        problem = GraspRods(
            numbers,
            joints=self.grasp.start.joints,
            stages=stages,
            places=(*first.places, *places),
            near=first.near,
            fine=first.fine,
            reached=False,
        )
        if self.yields:
            problem.cost(problem.pose, 0.0, _STAYS)
            for at, value in zip(problem.pose, numbers.pose, strict=True):
                problem.cost(at, -_STAYS * value)
        held = [*held_by_drives(first, problem, 1.0 + self.share(error, "tension")), *self._held_pose(problem)]
        for k, finger in enumerate(numbers.fingers):
            if self.yields and finger.tip and not finger.middles:
                held += _landed(
                    first, problem, k, numbers.pose - self.pose / self._unit_of(numbers.size / first.numbers.size)
                )
        return RodCopy(problem, tuple(held))

    def _held_pose(self, problem: GraspRods) -> Iterator[HeldValue]:
        """Coordinates of a pose that the search chooses, off by the error."""
        first = self.grasp.problem
        low, high = first.limits
        if self.yields or (low == high)[first.pose].all():
            return
        ratio = self.unit / self._unit_of(problem.numbers.size / first.numbers.size)
        shift = problem.numbers.pose - ratio * self.pose / self.unit
        for own, at, times, off in zip(problem.pose, first.pose, ratio, shift, strict=True):
            yield HeldValue(int(own), int(at), float(times), float(off))


def _landed(first: GraspRods, problem: GraspRods, index: int, off: Array) -> Iterator[HeldValue]:
    """Add rows that leave a tip where it landed on an object that was off; what they hold of the first copy."""
    geometry, numbers, part = problem.geometry, problem.numbers, problem.parts[index]
    finger, d = numbers.fingers[index], geometry.dimensions
    place = problem.unknown(f"landed, {finger.tip}", np.full(d, -np.inf), np.inf)
    pose = problem.unknown(f"landed pose, {finger.tip}", np.full(geometry.pose, -np.inf), np.inf)
    row = problem.rows(f"landing, {finger.tip}", "robust", "1", d - 1)
    data = [finger.length / numbers.size, *off, *finger.across, *numbers.axes, *numbers.table.data]
    unknowns = [*part.nodes[-1][:d], *problem.pose, *place, *pose]
    problem.add(kinds.landing_kind(geometry), unknowns, row, data)
    ratio = np.ones(geometry.pose)
    ratio[:d] = first.numbers.size / numbers.size
    for own, at in zip(place, first.parts[index].nodes[-1][:d], strict=True):
        yield HeldValue(int(own), int(at))
    for own, at, times in zip(pose, first.pose, ratio, strict=True):
        yield HeldValue(int(own), int(at), float(times))


class PlanarErrors(ErrorSpace):
    """Errors of a planar scene."""

    axes = (("x", "position"), ("y", "position"), ("angle", "angle"))

    @cached_property
    def _in_error(self) -> InError:
        touching = (self.scene.support_of(support.name) for support in self.grasp.problem.numbers.supports)
        return InError(self.scene, self.pose, [support.name for support in touching if support is not None])

    def _object(self, error: Array) -> Array:
        """Errors of the object, as `InError` has them."""
        return error[: len(self.axes) + 3]

    def scene_with(self, error: Array) -> GraspScene:
        return self._in_error.scene_with(self._object(error))

    def placed(self, error: Array) -> ObjectInError:
        pose = self._in_error.pose(self._object(error))
        numbers = self.grasp.problem.numbers
        supports = numbers.supports
        if supports:
            supports = planar_supports(self.scene_with(error), self.grasp.start.on, pose, numbers.force)
        return ObjectInError(np.array(pose), numbers.axes, supports)


class SpatialErrors(ErrorSpace):
    """Errors of a hand's scene."""

    axes = (
        *((name, "position") for name in ("x", "y", "z")),
        *((f"turn {name}", "angle") for name in ("x", "y", "z")),
    )

    def scene_with(self, error: Array) -> HandScene:
        scene, placed = self.scene, self.placed(error)
        from scipy.spatial.transform import Rotation

        body = scaled(scene.object, 1.0 + self.share(error, "radius"), type(scene))
        mass = (1.0 + self.share(error, "mass")) * scene.object.weighed
        rotation = tuple(Rotation.from_matrix(placed.axes.reshape(3, 3)).as_rotvec().tolist())
        own = {"position": tuple(placed.pose[:3].tolist()), "rotation": rotation, "mass": mass, "density": None}
        friction = 1.0 + self.share(error, "friction")
        changes: dict[str, Any] = {"object": body.model_copy(update=own)}
        changes["contacts"] = scene.contacts.replaced(friction=friction * scene.contacts.friction)
        if scene.table is not None and scene.table.friction is not None:
            changes["table"] = scene.table.replaced(friction=friction * scene.table.friction)
        changed: HandScene = scene.model_copy(update=changes)
        return changed

    def placed(self, error: Array) -> ObjectInError:
        from scipy.spatial.transform import Rotation

        numbers = self.grasp.problem.numbers
        growth = self.share(error, "radius")
        shift, turn = error[:3].copy(), error[3:6].copy()
        contacts = [support.touched(numbers, numbers.pose) for support in numbers.supports]
        for _, normal in contacts:
            # An object against a support moves along it and turns about its normal; it grows away from it.
            shift -= normal * (normal @ shift)
            turn = normal * (normal @ turn)
        place = np.array(numbers.geometry.place(numbers.pose))
        raised = {tuple(np.round(normal, 9).tolist()): float(normal @ (point - place)) for point, normal in contacts}
        for along, height in raised.items():
            shift -= np.array(along) * height * growth * numbers.size
        rotation = Rotation.from_rotvec(turn).as_matrix()
        friction = 1.0 + self.share(error, "friction")
        supports = [replace(support, friction=support.friction * friction) for support in numbers.supports]
        pose = self.pose + np.concatenate([shift, np.zeros(3)])
        return ObjectInError(pose, (rotation @ numbers.axes.reshape(3, 3)).ravel(), supports)
