"""Starts of the elastic problem: fingers that hold the object once limits are relaxed."""

from __future__ import annotations

from collections.abc import Iterable
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
        return list({id(tried.attempt.start): tried.attempt.start for tried in closest}.values())

    def alone(self, limit: RelaxedLimit, enough: float | None = None) -> list[GraspStart]:
        """Starts with a limit relaxed; with no more than is ``enough`` [usual amounts] where that is known."""
        scenes = list[GraspScene]()
        for part in (USUAL, WIDE) if enough is None else [share * enough for share in CLOSER]:
            relaxed = eased(self._scene, [limit], part)
            if relaxed not in (self._scene, *scenes):
                scenes.append(relaxed)
        if self._hopeless:
            scenes.clear()
        # Where no key of the scene holds a limit of the shape, postures of the scene as it is may be repaired.
        known = self.near if limit.limit is None and limit.bounds_shape else []
        return interleaved([*map(self._held, scenes), known])

    def together(self, limits: Iterable[RelaxedLimit]) -> list[GraspStart]:
        """Starts for many limits at once: some of the scene as it is, and twice as many with limits relaxed."""
        limits = list(limits)
        parts = () if self._hopeless else (USUAL, WIDE)
        wider = [self._held(eased(self._scene, limits, part)) for part in parts]
        return [*self.near[:HELD], *interleaved(wider)[: 2 * HELD]]

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
