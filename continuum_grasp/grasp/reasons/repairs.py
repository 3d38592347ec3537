"""The least relaxation of each limit for a grasp: many starts, each answer verified and confirmed."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from itertools import zip_longest
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.certificate.certificate import certify
from continuum_grasp.grasp.modes import contact_modes
from continuum_grasp.grasp.problem.relaxations import RELAXATIONS, Relaxation
from continuum_grasp.grasp.problem.solver_run import Attempt
from continuum_grasp.grasp.reasons.confirm import least_amount
from continuum_grasp.grasp.search import Search, branch_of
from continuum_grasp.grasp.starts.starts import Start
from continuum_grasp.nlp import Status
from continuum_grasp.scene.grasp import GraspScene

__all__ = ["Repair", "Repairs"]

Array = NDArray[Any]

SHORT = 1e-3
"""By what part of it an amount must stay short of the most that makes sense."""
HASTY = 200
"""Iterations from one start, all renewals of the guarded places included: most limits are no reason."""
SAME = 1e-4
"""Relative difference up to which two amounts are taken for the same point."""
BETTER = 1e-3
"""By what part of a number linear programming must improve it for its own to be taken."""


@dataclass(frozen=True)
class Repair:
    """A relaxed limit, and the resulting grasp.

    Attributes
    ----------
    amount : float
        By how much.
    arrays : dict
        Of the grasp.
    attempt : Attempt
        That found it.
    confirmed : float, optional
        Least amount at this posture by linear programming; None where that gives no answer.
    """

    amount: float
    arrays: Mapping[str, Array]
    attempt: Attempt
    confirmed: float | None = None


class Repairs:
    """Relaxed limits that give a grasp where a search found none.

    Parameters
    ----------
    scene : GraspScene
    search : Search
        Without success; grasps that turn up after all are added to it.

    Attributes
    ----------
    found : dict of str to Repair
        The best so far, by the relaxation's name.
    """

    def __init__(self, scene: GraspScene, search: Search) -> None:
        self.scene, self._search = scene, search
        self.found: dict[str, Repair] = {}
        self._open: dict[str, list[Attempt]] = {}

    @property
    def relaxations(self) -> list[Relaxation]:
        """Those that give a grasp."""
        return [relaxation for relaxation in RELAXATIONS if relaxation.name in self.found]

    def starts(self, relaxation: Relaxation) -> list[Start]:
        """Starts of the scene with a relaxed limit, those of different branches first: by as much as was found, or
        well beyond what is likely. Where no key of the scene holds the limit, those of the search, too.
        """
        best = self.found.get(relaxation.name)
        amount = relaxation.start(self.scene) if best is None else best.amount
        eased = relaxation.eased(self.scene, amount)
        known: list[Start] = []
        if relaxation.measured:
            known = _spread([t.attempt.start for t in sorted(self._search.tried, key=lambda t: t.attempt.badness)])
        if eased is self.scene:
            return known
        search = Search(eased, self._search.budget)
        eased_starts = [_spread(search.starts_of(mode)) for mode in contact_modes(eased)]
        self._search.start_seconds += search.start_seconds
        return [start for rank in zip_longest(*eased_starts, known) for start in rank if start is not None]

    def try_starts(self, relaxation: Relaxation, starts: Iterable[Start]) -> None:
        """Relax one limit as little as possible, from every start."""
        for start in starts:
            if self._search.budget.over:
                return
            self._try(relaxation, start, amount=relaxation.start(self.scene), iterations=HASTY)

    def go_on(self, relaxation: Relaxation) -> None:
        """Resume where the iterations were used up."""
        done: list[float] = []
        for attempt in self._open.pop(relaxation.name, []):
            amount = self._search.solver(attempt.start).given(self.scene, attempt.x, relaxation)
            if self._search.budget.over:
                return
            if not any(math.isclose(amount, other, rel_tol=SAME) for other in done):
                done.append(amount)
                options = {"features": attempt.features, "x0": attempt.x, "iterations": 2 * HASTY}
                self._try(relaxation, attempt.start, amount=amount, **options)

    def _try(self, relaxation: Relaxation, start: Start, *, amount: float, **options: Any) -> None:
        name, search = relaxation.name, self._search
        solver = search.solver(start)
        attempt = solver.run(
            self.scene,
            start,
            search.budget,
            relaxed={name: relaxation.most},
            given={name: amount},
            **options,
        )
        if not np.isfinite(attempt.x).all():
            return
        if attempt.status is Status.STOPPED:
            self._open.setdefault(name, []).append(attempt)
        if attempt.violations:
            return
        amount, best = solver.given(self.scene, attempt.x, relaxation), self.found.get(name)
        if amount < min(math.inf if best is None else best.amount, relaxation.most * (1.0 - SHORT)):
            arrays = solver.reader.arrays(self.scene, attempt.start, attempt.x, attempt.numbers)
            amount = max(amount, self._depth(relaxation, arrays))
            if (best is None or amount < best.amount) and self._holds(relaxation, amount, arrays):
                self.found[name] = Repair(amount, arrays, attempt)

    def settled(self, relaxation: Relaxation) -> Repair:
        """The best, confirmed by linear programming where it applies; whether its posture needs no repair after all
        is tried too.
        """
        best = self.found[relaxation.name]
        attempt = best.attempt
        self._search.attempt(attempt.start, features=attempt.features, x0=attempt.x, iterations=HASTY)
        least = least_amount(relaxation.name, self.scene, best.arrays, best.amount)
        if least is not None:
            old, new = (relaxation.value(self.scene, amount) for amount in (best.amount, least.amount))
            best = replace(best, confirmed=least.amount)
            gains = least.amount < best.amount and abs(new - old) > BETTER * abs(old)
            if gains and self._holds(relaxation, least.amount, least.arrays):
                best = replace(best, amount=least.amount, arrays=least.arrays)
        return best

    def _holds(self, relaxation: Relaxation, amount: float, arrays: Mapping[str, Array]) -> bool:
        """Whether the certificate confirms the grasp, but for what the relaxation excuses."""
        failed = certify(relaxation.relaxed(self.scene, amount), arrays).failed
        return all(relaxation.excuses is not None and relaxation.excuses(check.name) for check in failed)

    def _depth(self, relaxation: Relaxation, arrays: Mapping[str, Array]) -> float:
        """How much of what the relaxation excuses there is, by the certificate [m]: guarded places may swap
        to the last, and the amount be too small.
        """
        if relaxation.excuses is None:
            return 0.0
        lengths = {setup.name: setup.finger.rod.length for setup in self.scene.setups}
        failed = [check for check in certify(self.scene, arrays).failed if relaxation.excuses(check.name)]
        return max((check.value * lengths[check.name.split(", ")[-1]] for check in failed), default=0.0)


def _spread(starts: list[Start]) -> list[Start]:
    """One start of each branch first, then the second of each, and so on."""
    branches: dict[tuple[Any, ...], list[Start]] = {}
    for start in starts:
        branches.setdefault((frozenset(start.contacts), *branch_of(start)), []).append(start)
    return [start for rank in zip_longest(*branches.values()) for start in rank if start is not None]
