"""Starts of the elastic problem: fingers that hold the object once limits are relaxed."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cached_property

from continuum_grasp.grasp.effort import HELD
from continuum_grasp.grasp.finger_map import SETTLED, SceneMaps
from continuum_grasp.grasp.problem.relaxations import RELAXATIONS, RelaxedLimit
from continuum_grasp.grasp.search import GraspSearch
from continuum_grasp.grasp.starts.values import GraspStart, interleaved
from continuum_grasp.scene import GraspScene

USUAL, WIDE = 1.0, 3.0
"""Usual amounts by which limits are relaxed."""
CLOSER = (0.5, 1.0)
"""Parts of an amount that is enough with which less is sought."""


class Starts:
    """Starts with limits relaxed of the scene of a search that found no grasp: fingers that hold the object then, from
    maps with all limits relaxed.
    """

    def __init__(self, scene: GraspScene, search: GraspSearch) -> None:
        self._scene, self._search = scene, search

    @cached_property
    def near(self) -> list[GraspStart]:
        """Starts of the search, those that came nearest to a grasp first."""
        closest = sorted(self._search.tried, key=lambda tried: tried.attempt.badness)
        starts = [*(tried.attempt.start for tried in closest), *(each.start for each in self._search.settled)]
        return list({id(start): start for start in starts}.values())

    def alone(self, limit: RelaxedLimit, enough: float | None = None) -> list[GraspStart]:
        """Starts with a limit relaxed; with no more than is ``enough`` [usual amounts] where that is known."""
        # Where no key of the scene holds a limit of the shape, postures of the scene as it is may be repaired.
        known = self.near if limit.limit is None and limit.bounds_shape else []
        parts = (USUAL, WIDE) if enough is None else (CLOSER[0] * enough, CLOSER[1] * enough)
        return interleaved([*self._relaxed([limit], *parts), known])

    def together(self, limits: Iterable[RelaxedLimit]) -> list[GraspStart]:
        """Starts for many limits at once: some of the scene as it is, and twice as many with limits relaxed."""
        return [*self.near[:HELD], *interleaved(self._relaxed([*limits], USUAL, WIDE))[: 2 * HELD]]

    def _relaxed(self, limits: Sequence[RelaxedLimit], less: float, more: float) -> list[list[GraspStart]]:
        """Starts with limits relaxed by so many usual amounts; by ``less`` where ``more`` is enough."""
        wide = eased(self._scene, limits, more)
        if self._hopeless or wide == self._scene:
            return []
        found, narrow = self._held(wide), eased(self._scene, limits, less)
        enough = any(start.imbalance <= SETTLED for start in found)
        return [self._held(narrow), found] if enough and narrow not in (self._scene, wide) else [found]

    @cached_property
    def _wide(self) -> SceneMaps:
        """Maps of the scene with all limits relaxed."""
        limits = [limit for limit in RELAXATIONS if limit.applies(self._scene)]
        return SceneMaps(eased(self._scene, limits, WIDE))

    @cached_property
    def _hopeless(self) -> bool:
        """Whether nothing holds the object even with all limits relaxed."""
        return all(start.imbalance > SETTLED for start in self._held(self._wide.scene))

    def _held(self, relaxed: GraspScene) -> list[GraspStart]:
        """Fingers that hold the object of a scene with limits relaxed, of least tension first, or nearly do."""
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
