"""The search in the plane: combinations of all fingers' equilibria are the starts."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping
from functools import cached_property

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.grasp.body.table import DistanceTable
from continuum_grasp.grasp.bound import least_normal_force_bound
from continuum_grasp.grasp.finger_map import (
    FOR_STARTS,
    FULL,
    WEIGHTS,
    FingerMap,
    MapFinger,
    ObjectBalance,
    Place,
    SceneMaps,
    Settled,
    is_mapped,
    places_of,
)
from continuum_grasp.grasp.rods.answers import AskedAnswers, asked_of
from continuum_grasp.grasp.rods.contact_sets import contact_sets, nearest_stations, neighboring_stations
from continuum_grasp.grasp.rods.guess import ContinuedFinger, PosedFinger, ShotFinger, filled
from continuum_grasp.grasp.rods.numbers import FingerNumbers, SceneNumbers
from continuum_grasp.grasp.rods.planar_numbers import planar_numbers, planar_supports, planar_table
from continuum_grasp.grasp.rods.problem import STAGES, GraspRods
from continuum_grasp.grasp.rods.rough import RoughPostures, rough_postures
from continuum_grasp.grasp.rods.solving import RodGrasp, RodStart, StartedSearch
from continuum_grasp.grasp.rods.supports import SupportNumbers
from continuum_grasp.nlp import Budget
from continuum_grasp.scene import GraspScene

PLACES = 5
"""Places of object and bases that are sampled with a set of contacts."""


class Case:
    """A set of contacts at one place of the object and of the bases.

    Stations stand for each other: as many stations of a finger are ``on`` as touch, and `named` has the ones that
    are nearest to the places that touch.
    """

    def __init__(self, search: RodSearch, on: frozenset[str], place: Place) -> None:
        self.search, self.on, self.place = search, on, place
        self._scene = search.scene
        self._named = {on: self}

    def named(self, on: frozenset[str]) -> Case:
        """The case with other stations, with the balance of this one."""
        if on not in self._named:
            made = Case(self.search, on, self.place)
            made._scene, made._named, made.balance = self._scene, self._named, self.balance
            self._named[on] = made
        return self._named[on]

    def changed(self, scene: GraspScene) -> Case:
        """The case in a scene with other limits, or other places of its bases; with the balance of this one."""
        pose, bases = self.place
        if any(
            one.finger.base != other.finger.base for one, other in zip(scene.setups, self._scene.setups, strict=True)
        ):
            bases = tuple((*setup.finger.base.position, setup.finger.base.angle) for setup in scene.setups)
        if scene.object.pose != self._scene.object.pose:
            pose = scene.object.pose
        made = Case(self.search, self.on, (pose, bases))
        made._scene, made.balance = scene, self.balance
        return made

    @cached_property
    def _maps(self) -> list[FingerMap]:
        """Maps of the fingers."""
        pose, bases = self.place
        pairs = zip(self.search.scene.setups, bases, strict=True)
        return [self.search.maps.map_of(setup.name, base, pose, self.on) for setup, base in pairs]

    @cached_property
    def _fingers(self) -> list[MapFinger]:
        """The fingers of the maps."""
        pose, bases = self.place
        pairs = zip(self.search.scene.setups, bases, strict=True)
        return [self.search.maps.finger_of(setup.name, base, pose, self.on) for setup, base in pairs]

    @cached_property
    def balance(self) -> ObjectBalance:
        """The balance of the object, as samples of the maps are combined."""
        # Samples may be rough; what they settle to is not.
        fingers = [finger.stepped(FULL.steps) for finger in self._fingers]
        return ObjectBalance(self.search.scene, self.on, fingers, self.place[0])

    @cached_property
    def numbers(self) -> SceneNumbers:
        """The scene in plain numbers."""
        return planar_numbers(self._scene, self.on, self.place, self.balance.force, self.search.table)

    def supports_at(self, pose: Array) -> list[SupportNumbers]:
        """The supports of the scene as they touch the object at a pose; of a fixed one as they are."""
        if self._scene.object.free is None:
            return self.numbers.supports
        size = self._scene.object.size
        x, y, angle = (pose * [size, size, 1.0]).tolist()
        return planar_supports(self._scene, self.on, (x, y, angle), self.balance.force)

    @cached_property
    def _combinations(self) -> Array:
        """Samples that balance the object best for their tension (n, numbers)."""
        return self.balance.candidates(self._maps) if is_mapped() else np.zeros((0, self.balance.numbers))

    @property
    def unsettled(self) -> list[SettledStart] | list[RoughStart]:
        """Combinations as they are sampled: nearly balanced ones, and ones of little tension in turn; rough ones
        if there are none.
        """
        balance, x = self.balance, self._combinations
        if not len(x):
            return [RoughStart(self, postures) for postures in rough_postures(self._scene, self.on, *self.place)]
        traced = balance.traced(x, slopes=False)
        total = np.zeros((len(x), 3)) + balance.loads
        for k, at in enumerate(traced):
            total += balance.wrench(k, at)
        pairs = balance.force * np.reshape(x[:, balance.at[-1] : balance.first_lift], (len(x), -1, 2))
        for k, (point, normal) in enumerate(balance.places.values()):
            arm = (point - balance.center) / balance.size
            force = normal * (pairs[:, k, 0] + 1j * pairs[:, k, 1])
            total -= np.stack([force.real, force.imag, (np.conj(arm) * force).imag], axis=1)
        left = np.linalg.norm(total, axis=1) / balance.force
        settled = Settled.of(balance, x, left)
        orders = [np.argsort(settled.tension / balance.greatest + weight * left, kind="stable") for weight in WEIGHTS]
        mixed = np.stack(orders, axis=1).ravel()
        first = np.sort(np.unique(mixed, return_index=True)[1])
        return self._apart(self._start(settled, row) for row in mixed[first].tolist())

    @property
    def starts(self) -> list[SettledStart]:
        """Settled combinations: those that hold, or the ones that come nearest to it."""
        x = self._combinations
        if not len(x):
            return []
        settled = self.balance.settle(x)
        size = self.search.scene.object.size
        rows = settled.holding(size)
        nearest = [] if rows else settled.nearest(size)[: self.search.NEAREST]
        return self._apart(self._start(settled, row) for row in (*rows, *nearest))

    def _apart(self, starts: Iterable[SettledStart]) -> list[SettledStart]:
        """Starts without those in which two contacts are at one station."""
        return [start for start in starts if len(start.on) == len(self.on)]

    def _start(self, settled: Settled, row: int) -> SettledStart:
        aims, x = self.search.scene.weights, settled.x[row]
        least = sum(2.0 * finger.least_tension for finger in self.balance.fingers)
        aim = max(aims.least_tension, 1e-5) * (float(settled.tension[row]) - least) / self.balance.greatest
        if aims.greatest_friction_margin:
            traced = self.balance.traced(x[None], slopes=False)
            normal, along = (part[0] for part in self.balance.forces(x[None], traced))
            friction = np.array([self.search.scene.held_friction(name) for name in self.names])
            free = 1.0 - np.abs(along) / np.maximum(friction * normal, 1e-9 * self.balance.force)
            aim -= aims.greatest_friction_margin * float(np.clip(free, 0.0, 1.0).min())
        return SettledStart(self._at_stations(x), x, float(settled.off[row]), aim, settled.places[row])

    def _at_stations(self, x: Array) -> Case:
        """The case with the stations that are nearest to the places of the middle contacts of a combination."""
        on = set(self.on)
        for begin, finger in zip(self.balance.at[:-1], self._fingers, strict=True):
            setup = finger.setup
            if setup.stations:
                on -= set(finger.names)
                on |= nearest_stations(setup, x[begin + 4 : begin + 4 + 3 * finger.middles : 3] * finger.length)
        return self.named(frozenset(on))

    @property
    def names(self) -> list[str]:
        """Contacts in the order of `ObjectBalance.forces`."""
        return [*(name for names in self.balance.names for name in names), *self.balance.supports]


class SettledStart(RodStart):
    """A settled combination of samples, with what it promises."""

    def __init__(self, case: Case, x: Array, imbalance: float, aim: float, places: Array) -> None:
        self.case, self._x, self.on = case, x, case.on
        self.imbalance, self.aim, self.places = imbalance, aim, places

    def changed(self, scene: GraspScene) -> SettledStart:
        """The start in a scene with other limits, or other places of its bases."""
        return SettledStart(self.case.changed(scene), self._x, self.imbalance, self.aim, self.places)

    @property
    def numbers(self) -> SceneNumbers:
        """The scene in plain numbers."""
        return self.case.numbers

    def supports_at(self, pose: Array) -> list[SupportNumbers]:
        """The supports of the scene as they touch the object at a pose."""
        return self.case.supports_at(pose)

    @property
    def _lift(self) -> float:
        """Force of the object on each contact out of the plane [F0]."""
        numbers = self.numbers
        count = sum(len(finger.contacts) for finger in numbers.fingers) + sum(each.touches for each in numbers.supports)
        return float(numbers.weight[2]) / count if numbers.spatial else 0.0

    @property
    def guesses(self) -> list[ShotFinger]:
        """Equilibria of the fingers."""
        shots = [self._x[i:j].tolist() for i, j in itertools.pairwise(self.case.balance.at)]
        guesses = []
        for (bend, fx, fy, pull, *middles), finger in zip(shots, self.numbers.fingers, strict=True):
            # Units of the map are of the mean stiffness.
            unit = finger.setup.stiffness / finger.section.stiffness
            held = [unit * np.array(pair) for pair in zip(middles[1::3], middles[2::3], strict=True)]
            force = unit * np.array([fx, fy])
            guesses.append(ShotFinger(bend, force, unit * pull, tuple(middles[::3]), held, self._lift))
        return guesses

    @property
    def supports(self) -> Mapping[str, Array]:
        """Forces of supports by name [F0]."""
        balance = self.case.balance
        pairs = np.reshape(self._x[balance.at[-1] : balance.first_lift], (-1, 2))
        names = (support.name for support in self.numbers.supports if support.touches)
        return {name: np.array([*pair, self._lift]) for name, pair in zip(names, pairs, strict=True)}


class RoughStart(RodStart):
    """Postures that nearly touch, where fingers have no maps, or empty ones.

    Contacts press as their friction carries the weight.
    """

    def __init__(self, case: Case, postures: RoughPostures) -> None:
        self.case, self._postures, self.on = case, postures, case.on
        # 1: nothing is known of forces
        self.imbalance, self.aim = 1.0 + postures.off, 1.0
        self.places = np.array([point for one in postures.contacts.values() for point in one.point])

    def changed(self, scene: GraspScene) -> RoughStart:
        """The start in a scene with other limits, or other places of its bases."""
        return RoughStart(self.case.changed(scene), self._postures)

    @property
    def numbers(self) -> SceneNumbers:
        """The scene in plain numbers."""
        return self.case.numbers

    def supports_at(self, pose: Array) -> list[SupportNumbers]:
        """The supports of the scene as they touch the object at a pose."""
        return self.case.supports_at(pose)

    @property
    def guesses(self) -> list[PosedFinger]:
        """Postures of the fingers."""
        return [self._posed(finger) for finger in self.numbers.fingers]

    def _posed(self, finger: FingerNumbers) -> PosedFinger:
        one, length = self._postures.fingers[finger.name], finger.length
        held = {name: np.array([self._pressed / finger.force, 0.0, 0.0, 0.0]) for name in finger.contacts}
        joints = tuple(one.joints[name] / length for name in finger.middles)
        curvatures = np.array(one.curvatures) * length
        return PosedFinger(np.array([0.0, 1.0]), curvatures, joints, np.zeros(len(finger.pulls)), held)

    @property
    def _pressed(self) -> float:
        """Normal force [N] with which friction of all contacts carries the weight."""
        scene = self.case.search.scene
        frictions = sum(scene.held_friction(name) for name in self._postures.contacts)
        return float(scene.weight / max(frictions, 0.1))

    @property
    def supports(self) -> Mapping[str, Array]:
        """Forces of supports by name [F0]."""
        pressed = np.array([self._pressed / self.numbers.force, 0.0, 0.0])
        return {support.name: pressed for support in self.numbers.supports if support.touches}


class ContinuedStart(RodStart):
    """A grasp with other contacts, which press nothing at first."""

    def __init__(self, case: Case, grasp: RodGrasp) -> None:
        self.case, self._grasp, self.on = case, grasp, case.on
        self.imbalance, self.aim, self.places = 0.0, grasp.attempt.objective, grasp.start.places

    def changed(self, scene: GraspScene) -> ContinuedStart:
        """The start in a scene with other limits, or other places of its bases."""
        return ContinuedStart(self.case.changed(scene), self._grasp)

    @property
    def numbers(self) -> SceneNumbers:
        """The scene in plain numbers."""
        return self.case.numbers

    def supports_at(self, pose: Array) -> list[SupportNumbers]:
        """The supports of the scene as they touch the object at a pose."""
        return self.case.supports_at(pose)

    @property
    def guesses(self) -> list[ContinuedFinger]:
        """Fingers of the grasp."""
        fingers = self.numbers.fingers
        return [ContinuedFinger(self._grasp.problem, self._grasp.attempt.x, k, one) for k, one in enumerate(fingers)]

    @property
    def supports(self) -> Mapping[str, Array]:
        """Forces of supports by name [F0]."""
        contacts, x = self._grasp.problem.contacts, self._grasp.attempt.x
        return {support.name: x[contacts[support.name]] for support in self.numbers.supports if support.touches}

    def x_of(self, problem: GraspRods) -> Array:
        """Unknowns of the start, with the pose of the grasp."""
        return filled(problem, self.guesses, self.supports, self._grasp.attempt.x[self._grasp.problem.pose])


class RodSearch(StartedSearch):
    """Finds grasps of a planar scene as exact rods."""

    NEAREST = 6
    """Combinations of a case of which none holds that are starts nevertheless."""

    def __init__(self, scene: GraspScene, budget: Budget, stages: int = STAGES) -> None:
        super().__init__(budget, stages)
        self.scene = scene
        self.maps = SceneMaps(scene, sampling=FOR_STARTS)
        self.apart = 0.25 * scene.object.size
        self._known = list[frozenset[str]]()
        if not scene.weights.greatest_friction_margin:
            # Combinations are settled to the least tension: of 70 random scenes none that promised 5 % more was best.
            self.promised = 0.1

    def again(self, scene: GraspScene) -> RodSearch:
        """A search of a changed scene."""
        return RodSearch(scene, self.budget, self.stages)

    def with_contacts(self, scene: GraspScene) -> RodSearch:
        """A search of the scene with other contacts. It skips the sets that were searched already."""
        search = self.again(scene)
        search.maps, search._known = self.maps, contact_sets(self.scene)
        return search

    @cached_property
    def bound(self) -> float | None:
        """Lower bound on the greatest normal force of all grasps [N]; None where that is not the objective."""
        return least_normal_force_bound(self.scene) if self.scene.objective == "least_normal_force" else None

    @property
    def asked(self) -> AskedAnswers | None:
        """Answers to loads that the scene asks for; None where it asks for none."""
        return asked_of(self.scene)

    @cached_property
    def table(self) -> DistanceTable:
        """Distances of the object."""
        return planar_table(self.scene)

    @cached_property
    def _cases(self) -> list[Case]:
        """Sets of contacts, and places of object and bases that are tried with them."""
        modes = [on for on in contact_sets(self.scene) if on not in self._known]
        return [Case(self, on, place) for on in modes for place in places_of(self.scene, on)[:PLACES]]

    def beside(self, grasp: RodGrasp) -> Iterator[RodStart]:
        """Starts with other stations than a grasp: one more, one less, one moved to its neighbor."""
        if isinstance(grasp.start, (SettledStart, ContinuedStart)):
            for on in neighboring_stations(self.scene, grasp.start.on):
                yield ContinuedStart(grasp.start.case.named(on), grasp)

    @property
    def further(self) -> list[RodStart]:
        """Combinations that are not settled, of all cases in turn."""
        each = itertools.zip_longest(*(case.unsettled for case in self._cases))
        return [start for starts in each for start in starts if start is not None]

    @cached_property
    def starts(self) -> list[RodStart]:
        """All starts, the most promising first."""
        found = [start for case in self._cases for start in case.starts]
        # 4e-3: imbalance up to which a combination holds
        return sorted(
            found, key=lambda start: (start.imbalance > 4e-3, start.imbalance if start.imbalance > 4e-3 else start.aim)
        )
