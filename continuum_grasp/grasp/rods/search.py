"""The search in the plane: combinations of all fingers' equilibria are the starts."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from functools import cached_property

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.grasp.body.table import DistanceTable
from continuum_grasp.grasp.finger_map import Place, SceneMaps, places_of
from continuum_grasp.grasp.finger_map.balance import ObjectBalance, Settled
from continuum_grasp.grasp.finger_map.fill import FingerMap
from continuum_grasp.grasp.modes import contact_modes
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

    @property
    def starts(self) -> list[SettledStart]:
        """Settled combinations: those that hold, or the ones that come nearest to it."""
        x = self.balance.candidates(self._maps)
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
        return [
            ShotFinger(
                bend,
                np.array([fx, fy]),
                pull,
                tuple(middles[::3]),
                [np.array(pair) for pair in zip(middles[1::3], middles[2::3], strict=True)],
                self._lift,
            )
            for bend, fx, fy, pull, *middles in shots
        ]

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

    @cached_property
    def table(self) -> DistanceTable:
        """Distances of the object."""
        return planar_table(self.scene)

    @cached_property
    def starts(self) -> list[RodStart]:
        """All starts, the most promising first."""
        cases = (
            Case(self, on, place) for on in contact_modes(self.scene) for place in places_of(self.scene, on)[:PLACES]
        )
        found = [start for case in cases for start in case.starts]
        # 4e-3: imbalance up to which a combination holds
        return sorted(
            found, key=lambda start: (start.imbalance > 4e-3, start.imbalance if start.imbalance > 4e-3 else start.aim)
        )
