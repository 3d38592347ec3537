"""Starts of the elastic problem: fingers that hold the object once limits are relaxed, or nearly do."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cached_property

import numpy as np

from continuum_grasp.grasp.finger_map import SceneMaps, is_mapped
from continuum_grasp.grasp.problem.relaxations import RELAXATIONS, RelaxedLimit
from continuum_grasp.grasp.search import GraspSearch
from continuum_grasp.grasp.starts.values import GraspStart, interleaved
from continuum_grasp.scene import GraspScene

USUAL, WIDE = 1.0, 3.0
"""Usual amounts by which limits are relaxed; what needs more is no repair."""

NEARLY = 0.02
"""Residual of fingers that may hold the object: few elements miss it by as much where a repair is found."""


OF_CURVATURE = ("bending range", "strain")
"""Limits that bound curvature: of these, postures tell how much they need; forces may be spread otherwise."""


def greatest_curvature(start: GraspStart) -> float:
    """Greatest curvature of the fingers of a start [1/m]."""
    return max(float(np.abs(finger.curvatures).max()) for finger in start.fingers.values())


class Starts:
    """Starts with limits relaxed of the scene of a search that found no grasp: fingers that hold the object then, from
    maps with all limits relaxed. Without maps, postures that nearly touch.
    """

    def __init__(self, scene: GraspScene, search: GraspSearch) -> None:
        self._scene = scene
        self._search = search
        self._maps: SceneMaps | None = None

    @cached_property
    def near(self) -> list[GraspStart]:
        """Starts of the search, those that came nearest to a grasp first."""
        closest = sorted(self._search.tried, key=lambda tried: tried.attempt.badness)
        starts = [*(tried.attempt.start for tried in closest), *(each.start for each in self._search.settled)]
        return list({id(start): start for start in starts}.values())

    def of(self, limits: Sequence[RelaxedLimit]) -> list[GraspStart]:
        """Starts with limits relaxed by the usual amounts and more; none where nothing holds the object then."""
        usual, wide = (eased(self._scene, limits, amount) for amount in (USUAL, WIDE))
        if wide == self._scene or not self._widest:
            # Where no key of the scene holds a limit of the shape, or maps are empty, postures of the scene as it is
            # may be repaired.
            return self.near
        if not self.holds(self._widest) or not self.holds(found := self._settled(wide)):
            return []
        lists = [found] if usual in (self._scene, wide) else [self._settled(usual), found]
        return interleaved([self._by_need(limits, starts) for starts in lists])

    def closer(self, limits: Sequence[RelaxedLimit], enough: float) -> list[GraspStart]:
        """Starts with limits relaxed by no more than is enough [usual amounts]."""
        relaxed = eased(self._scene, limits, enough)
        if relaxed == self._scene or not self.holds(self._widest):
            return []
        found = self._settled(relaxed)
        return self._by_need(limits, found) if self.holds(found) else []

    @staticmethod
    def _by_need(limits: Sequence[RelaxedLimit], starts: list[GraspStart]) -> list[GraspStart]:
        """Starts that hold the object by how much of a limit they need, least first; then the others."""
        if not all(limit.name in OF_CURVATURE for limit in limits):
            return starts
        return sorted(starts, key=lambda start: (start.imbalance > NEARLY, greatest_curvature(start)))

    @cached_property
    def needed(self) -> frozenset[RelaxedLimit]:
        """Limits without which nothing holds the object though all others are relaxed."""
        if not self._widest:
            return frozenset()
        others = {limit: [other for other in self._limits if other is not limit] for limit in self._limits}
        scenes = {limit: eased(self._scene, rest, WIDE) for limit, rest in others.items()}
        seen = [limit for limit, scene in scenes.items() if scene != self._wide.scene]
        return frozenset(limit for limit in seen if not self.holds(self._settled(scenes[limit])))

    @cached_property
    def _widest(self) -> list[GraspStart]:
        """Starts with all limits relaxed; none where maps are empty."""
        return self._settled(self._wide.scene)

    @staticmethod
    def holds(starts: Sequence[GraspStart]) -> bool:
        """Whether some hold the object; without maps any may."""
        return not is_mapped() or any(start.imbalance <= NEARLY for start in starts)

    @cached_property
    def _limits(self) -> list[RelaxedLimit]:
        return [limit for limit in RELAXATIONS if limit.applies(self._scene)]

    @property
    def _wide(self) -> SceneMaps:
        """Maps of the scene with all limits relaxed, in which fingers keep apart that crossed so far."""
        apart = self._search.maps.apart
        if self._maps is None:
            self._maps = SceneMaps(eased(self._scene, self._limits, WIDE), apart=apart)
        elif not apart <= self._maps.apart:
            self._maps = SceneMaps(self._maps.scene, self._maps, apart)
        return self._maps

    def _settled(self, relaxed: GraspScene) -> list[GraspStart]:
        """Fingers that hold the object of a scene with limits relaxed, of least tension first, then those that nearly
        do.
        """
        search = GraspSearch(relaxed, self._search.budget)
        starts = [candidate.start for candidate in search.settle(SceneMaps(relaxed, self._wide))]
        self._search.start_seconds += search.start_seconds
        return starts


def eased(scene: GraspScene, limits: Iterable[RelaxedLimit], factor: float) -> GraspScene:
    """A scene with limits relaxed by a multiple of their usual amounts."""
    relaxed = scene
    for limit in limits:
        relaxed = limit.eased(relaxed, min(factor * limit.start(scene), limit.sensible(scene)))
    return relaxed
