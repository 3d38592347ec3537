"""Starts of the elastic problem of fingers with few elements: sampled postures in which forces balance, or nearly, once
limits are relaxed.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import cached_property
from typing import Any

from continuum_grasp.grasp.effort import HELD, UNLIKELY
from continuum_grasp.grasp.modes import contact_modes
from continuum_grasp.grasp.problem.relaxations import RelaxedLimit
from continuum_grasp.grasp.reasons.starts import Starts, eased
from continuum_grasp.grasp.search import GraspSearch
from continuum_grasp.grasp.starts.starts import NEARLY_BALANCED
from continuum_grasp.grasp.starts.values import GraspStart, interleaved
from continuum_grasp.grasp.tried import branch_of
from continuum_grasp.grasp.values import NEAR
from continuum_grasp.scene import GraspScene

LARGER = (1.0, 4.0, 16.0)
"""Usual amounts by which a limit is relaxed in search of postures that are then nearly in balance."""
WIDER = (1.0, 2.9)
"""Usual amounts by which limits of the shape are relaxed in search of postures for all limits at once."""

BENT = 0.06
"""Imbalance of a posture of more elements, which bend away from those of a scan, up to which a greater limit may repair
it: a scene that a greater tension repairs had 0.031."""


class SampledStarts(Starts):
    """Sampled postures, those of different branches first."""

    @cached_property
    def near(self) -> list[GraspStart]:
        """Starts of sets of contacts that are not scanned, those that came nearest to a grasp first."""
        near = {id(tried.attempt.start): tried.attempt.badness for tried in self._search.tried}
        return interleaved(
            [
                spread(sorted(self._search.rough_starts_of(mode), key=lambda start: near.get(id(start), math.inf)))
                for mode in self._search.unscanned
            ]
        )

    def alone(self, limit: RelaxedLimit, enough: float | None = None) -> list[GraspStart]:
        """Scanned starts with a limit relaxed by so many usual amounts, or well beyond what is likely; where no key of
        the scene holds a limit of the shape, those of the search, too.
        """
        if not limit.bounds_shape:
            # Postures stay as they are: however much a limit is relaxed, it is no reason where none comes near.
            return self._balanced(limit, LARGER if enough is None else (enough,))
        relaxed, known = eased(self._scene, [limit], 1.0 if enough is None else enough), list[GraspStart]()
        if limit.limit is None:
            known = spread(self.tried or self._search.rough_starts_of(contact_modes(self._scene)[0]))
        if relaxed is self._scene:
            return known
        return interleaved([*self._of(relaxed, hopeful=True, rough=limit.limit is None), known])

    def together(self, limits: Iterable[RelaxedLimit]) -> list[GraspStart]:
        """Starts for many limits at once: some of the scene's own postures, and twice as many of those with limits of
        the shape relaxed in several amounts.
        """
        limits = list(limits)
        scans = self._search.rebalanced(eased(self._scene, [limit for limit in limits if not limit.bounds_shape], 1.0))
        near = self.near if self._search.unscanned else interleaved(scans)
        wider = [start for factor in WIDER for start in self._of(eased(self._scene, limits, factor))]
        return [*near[:HELD], *interleaved(wider)[: 2 * HELD]]

    def _balanced(self, limit: RelaxedLimit, factors: Iterable[float]) -> list[GraspStart]:
        """Starts of scanned postures nearly in balance with the limit relaxed by the first factor for which there are
        any.
        """
        last = None
        for factor in factors:
            relaxed = eased(self._scene, [limit], factor)
            if relaxed != last and (starts := self._hopeful(interleaved(self._search.rebalanced(relaxed)))):
                return starts
            last = relaxed
        return []

    def _of(self, relaxed: GraspScene, hopeful: bool = False, rough: bool = True) -> list[list[GraspStart]]:
        """Starts of a scene with limits relaxed, of each set of contacts; of scans the ``hopeful`` ones alone, and
        ``rough`` ones of other sets.
        """
        search, starts = GraspSearch(relaxed, self._search.budget), []
        for mode in contact_modes(relaxed):
            scanned = search.basins_of(mode)
            if scanned is None:
                scanned = search.rough_starts_of(mode) if rough else []
            elif hopeful:
                scanned = self._hopeful(scanned)
            starts.append(spread(scanned))
        self._search.start_seconds += search.start_seconds
        return starts

    def _hopeful(self, starts: list[GraspStart]) -> list[GraspStart]:
        """Starts nearly in balance, and nearer than without the limit relaxed."""
        search, tips = self._search, {setup.tip_name for setup in self._scene.setups}
        threshold = NEARLY_BALANCED if all(setup.elements <= 2 for setup in self._scene.setups) else BENT

        def enough(start: GraspStart) -> float:
            # Behind the last contact a finger is as its tendons bend it, and a small imbalance says little.
            if not tips <= start.contacts.keys():
                return UNLIKELY
            alike = search.basins_of(frozenset(start.contacts)) or []
            known = min((other.imbalance for other in alike), default=math.inf)
            # 0.95: imbalance per that without the limit relaxed from which on relaxing it does not help
            return min(threshold, max(0.95 * known, NEAR))

        return [start for start in starts if start.imbalance < enough(start)]


def spread(starts: list[GraspStart]) -> list[GraspStart]:
    """A start of each branch first, then the second of each, and so on."""
    branches: dict[tuple[Any, ...], list[GraspStart]] = {}
    for start in starts:
        branches.setdefault(branch_of(start), []).append(start)
    return interleaved(list(branches.values()))
