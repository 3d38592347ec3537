"""The search in the plane: combinations of all fingers' equilibria are the starts."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from functools import cached_property

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.grasp.body.table import DistanceTable
from continuum_grasp.grasp.finger_map import Place, SceneMaps, places_of
from continuum_grasp.grasp.finger_map.balance import WEIGHTS, ObjectBalance, Settled
from continuum_grasp.grasp.finger_map.fill import FingerMap
from continuum_grasp.grasp.modes import contact_modes
from continuum_grasp.grasp.rods.answers import AskedAnswers, asked_of
from continuum_grasp.grasp.rods.guess import ShotFinger
from continuum_grasp.grasp.rods.numbers import SceneNumbers
from continuum_grasp.grasp.rods.planar_numbers import planar_numbers, planar_table
from continuum_grasp.grasp.rods.problem import STAGES
from continuum_grasp.grasp.rods.solving import RodStart, StartedSearch
from continuum_grasp.nlp import Budget
from continuum_grasp.scene import GraspScene

PLACES = 5
"""Places of object and bases that are sampled with a set of contacts."""


class Case:
    """A set of contacts at one place of the object and of the bases."""

    def __init__(self, search: RodSearch, on: frozenset[str], place: Place) -> None:
        self.search, self.on, self.place = search, on, place
        self._scene = search.scene

    def changed(self, scene: GraspScene) -> Case:
        """The case in a scene with other limits, or other places of its bases; with the balance of this one."""
        pose, bases = self.place
        if any(
            one.finger.base != other.finger.base for one, other in zip(scene.setups, self._scene.setups, strict=True)
        ):
            bases = tuple((*setup.finger.base.position, setup.finger.base.angle) for setup in scene.setups)
        made = Case(self.search, self.on, (pose, bases))
        made._scene, made.balance = scene, self.balance
        return made

    @cached_property
    def _maps(self) -> list[FingerMap]:
        """Maps of the fingers."""
        pose, bases = self.place
        pairs = zip(self.search.scene.setups, bases, strict=True)
        return [self.search.maps.map_of(setup.name, base, pose, self.on, exact=True) for setup, base in pairs]

    @cached_property
    def balance(self) -> ObjectBalance:
        """The balance of the object, as samples of the maps are combined."""
        return ObjectBalance(self.search.scene, self.on, [one.finger for one in self._maps], self.place[0])

    @cached_property
    def numbers(self) -> SceneNumbers:
        """The scene in plain numbers."""
        return planar_numbers(self._scene, self.on, self.place, self.balance.force, self.search.table)

    @cached_property
    def _combinations(self) -> Array:
        """Samples that balance the object best for their tension (n, numbers)."""
        return self.balance.candidates(self._maps)

    @property
    def unsettled(self) -> list[SettledStart]:
        """Combinations as they are sampled: nearly balanced ones, and ones of little tension in turn."""
        balance, x = self.balance, self._combinations
        if not len(x):
            return []
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
        return [self._start(settled, row) for row in mixed[first].tolist()]

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
        return [self._start(settled, row) for row in (*rows, *nearest)]

    def _start(self, settled: Settled, row: int) -> SettledStart:
        aims, x = self.search.scene.weights, settled.x[row]
        aim = max(aims.least_tension, 1e-5) * float(settled.tension[row]) / self.balance.greatest
        if aims.greatest_friction_margin:
            traced = self.balance.traced(x[None], slopes=False)
            normal, along = (part[0] for part in self.balance.forces(x[None], traced))
            friction = np.array([self.search.scene.held_friction(name) for name in self.names])
            free = 1.0 - np.abs(along) / np.maximum(friction * normal, 1e-9 * self.balance.force)
            aim -= aims.greatest_friction_margin * float(np.clip(free, 0.0, 1.0).min())
        return SettledStart(self, x, float(settled.off[row]), aim, settled.places[row])

    @property
    def names(self) -> list[str]:
        """Contacts in the order of `ObjectBalance.forces`."""
        return [*(name for names in self.balance.names for name in names), *self.balance.supports]


class SettledStart(RodStart):
    """A settled combination of samples, with what it promises."""

    def __init__(self, case: Case, x: Array, imbalance: float, aim: float, places: Array) -> None:
        self._case, self._x, self.on = case, x, case.on
        self.imbalance, self.aim, self.places = imbalance, aim, places

    def changed(self, scene: GraspScene) -> SettledStart:
        """The start in a scene with other limits, or other places of its bases."""
        return SettledStart(self._case.changed(scene), self._x, self.imbalance, self.aim, self.places)

    @property
    def numbers(self) -> SceneNumbers:
        """The scene in plain numbers."""
        return self._case.numbers

    @property
    def _lift(self) -> float:
        """Force of the object on each contact out of the plane [F0]."""
        numbers = self.numbers
        count = sum(len(finger.contacts) for finger in numbers.fingers) + len(numbers.supports)
        return float(numbers.weight[2]) / count if numbers.spatial else 0.0

    @property
    def guesses(self) -> list[ShotFinger]:
        """Equilibria of the fingers."""
        shots = [self._x[i:j].tolist() for i, j in itertools.pairwise(self._case.balance.at)]
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
        balance = self._case.balance
        pairs = np.reshape(self._x[balance.at[-1] : balance.first_lift], (-1, 2))
        names = (support.name for support in self.numbers.supports)
        return {name: np.array([*pair, self._lift]) for name, pair in zip(names, pairs, strict=True)}


class RodSearch(StartedSearch):
    """Finds grasps of a planar scene as exact rods."""

    NEAREST = 6
    """Combinations of a case of which none holds that are starts nevertheless."""

    def __init__(self, scene: GraspScene, budget: Budget, stages: int = STAGES) -> None:
        super().__init__(budget, stages)
        self.scene = scene
        self.maps = SceneMaps(scene)
        self.apart = 0.25 * scene.object.size

    @property
    def asked(self) -> AskedAnswers | None:
        """Answers to loads that the scene asks for; None where it asks for none."""
        if self.scene.unloaded:
            return self.share_of_greatest_push(self.scene.contacts.normal_force_max)
        return asked_of(self.scene)

    @cached_property
    def table(self) -> DistanceTable:
        """Distances of the object."""
        return planar_table(self.scene)

    @cached_property
    def _cases(self) -> list[Case]:
        """Sets of contacts, and places of object and bases that are tried with them."""
        modes = contact_modes(self.scene)
        return [Case(self, on, place) for on in modes for place in places_of(self.scene, on)[:PLACES]]

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
