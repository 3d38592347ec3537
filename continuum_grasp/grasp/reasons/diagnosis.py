"""Why a scene has no grasp: each limit is relaxed alone as little as possible, from many starts, and the amount that
then suffices, verified and confirmed, is the reason.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.bound import cannot_balance
from continuum_grasp.grasp.certificate.certificate import certify_reached
from continuum_grasp.grasp.modes import contact_modes
from continuum_grasp.grasp.problem.relaxations import RELAXATIONS, Relaxation
from continuum_grasp.grasp.problem.solver_run import Attempt
from continuum_grasp.grasp.reasons.confirm import least_amount
from continuum_grasp.grasp.search import BENT, Search, branch_of
from continuum_grasp.grasp.starts.values import Start
from continuum_grasp.grasp.values import Reason
from continuum_grasp.scene.grasp import GraspScene

FIRST, MORE = 4, 8
"""Starts per limit, and per limit that gives a grasp, or per limit again if none does."""
BALANCED = 0.02
"""Imbalance up to which a posture may hold with the limit relaxed: those that do had 0.003 at most, others 0.02 and
more with few exceptions (28 scenes)."""
NEARER, EXACT = 0.95, 1e-3
"""Imbalance per that without the limit relaxed from which on relaxing it does not help, and imbalance that is none."""
LARGER = (1.0, 4.0, 16.0)
"""Usual amounts by which a limit is relaxed in search of postures that are then nearly in balance."""
CLEAR = 0.03
"""Relative change of a limit, or part of a usual amount, from which on no other start would do without: the estimates
of a scan are off by less."""
RARE = 1.0
"""Friction coefficient that few surfaces have: reasons that ask for more are listed last."""

Array = NDArray[Any]

SHORT = 1e-3
"""By what part of it an amount must stay short of the most that makes sense."""
HASTY = 80
"""Iterations from one start, all renewals of the guarded places included: most limits are no reason, and of 50 scenes
98 % of the starts that gave a grasp took fewer."""
SAME, AGREEING = 1e-4, 3
"""Relative difference up to which two amounts are taken for the same point, and how many starts end there before no
more are tried."""
BETTER = 1e-3
"""By what part of a number linear programming must improve it for its own to be taken."""


def find_reasons(repairs: Repairs, further: bool = False) -> list[Reason]:
    """Find the limits each of which, relaxed alone, gives a grasp that the certificate confirms.

    The starts of a search without success are used, and grasps that turn up after all are added to it. Reasons that
    the scene has a number for come first, by how small a factor is missing. At first those limits alone are relaxed
    without which there would be a scene; ``further``, all are, from more starts.
    """
    repairs.look_further() if further else repairs.look()
    return sorted((repairs.reason(relaxation) for relaxation in repairs.relaxations), key=rank)


def rank(reason: Reason) -> tuple[bool, float, int]:
    """Limits that the scene has a number for come first, by the factor that they are off, and then in order of trial;
    a friction that few surfaces have comes after them.
    """
    order = [relaxation.name for relaxation in RELAXATIONS].index(reason.name)
    if is_rare(reason) or reason.limit <= 0.0 or reason.needed <= 0.0:
        return True, 0.0, order
    return False, round(abs(math.log(reason.needed / reason.limit)), 2), order


def is_rare(reason: Reason) -> bool:
    """Whether it asks for a friction that few surfaces have."""
    return reason.name == "friction" and reason.needed > RARE


def is_clear(reason: Reason, scene: GraspScene) -> bool:
    """Whether so much is missing that no other start would do without."""
    (relaxation,) = (one for one in RELAXATIONS if one.name == reason.name)
    if relaxation.limit is None or reason.limit <= 0.0:
        return reason.needed >= CLEAR * relaxation.start(scene)
    return abs(reason.needed / reason.limit - 1.0) >= CLEAR


@dataclass(frozen=True)
class Repair:
    """A relaxed limit, and the resulting grasp."""

    amount: float  # by how much
    arrays: Mapping[str, Array]  # of the grasp
    attempt: Attempt  # that found it


class Repairs:
    """Relaxed limits that give a grasp where a search found none; ``found`` has the best so far by the limit's name."""

    def __init__(self, scene: GraspScene, search: Search) -> None:
        self.scene, self._search = scene, search
        self.found: dict[str, Repair] = {}
        self._amounts: dict[str, list[float]] = {}
        self._starts: dict[str, list[Start]] = {}

    def look(self) -> None:
        """Relax each limit alone that scenes without it show starts for."""
        limits = [limit for limit in RELAXATIONS if limit.applies(self.scene)]
        self._try([limit for limit in limits if limit.eased(self.scene, limit.start(self.scene)) is not self.scene])

    def look_further(self) -> None:
        """Relax the other limits: whether fingers may pass through what the scene cannot be without; if none gives a
        grasp, all once more.
        """
        limits = [limit for limit in RELAXATIONS if limit.applies(self.scene)]
        self._try([limit for limit in limits if limit.name not in self._starts])
        for relaxation in [] if self.found else limits:
            starts = self._starts.get(relaxation.name, [])
            self.try_starts(relaxation, starts[FIRST:MORE] or self.starts(relaxation, rough=True)[:FIRST])

    def _try(self, limits: Sequence[Relaxation]) -> None:
        """Relax limits, those that give a grasp from more starts."""
        for relaxation in limits:
            if self._search.budget.over:
                return
            self._starts[relaxation.name] = self.starts(relaxation)
            self.try_starts(relaxation, self._starts[relaxation.name][:FIRST])
        for relaxation in [limit for limit in limits if limit.name in self.found]:
            self.try_starts(relaxation, self._starts[relaxation.name][FIRST:MORE])
            if not self.agree(relaxation):
                # Where the amount is known, the scan finds postures for just this much: closer than the first ones.
                self.try_starts(relaxation, self.starts(relaxation)[:MORE])

    @property
    def relaxations(self) -> list[Relaxation]:
        """Those that give a grasp."""
        return [relaxation for relaxation in RELAXATIONS if relaxation.name in self.found]

    def agree(self, relaxation: Relaxation) -> bool:
        """Whether several starts gave the same least amount."""
        amounts = self._amounts.get(relaxation.name, [])
        same = [amount for amount in amounts if math.isclose(amount, min(amounts), rel_tol=SAME)]
        return relaxation.name in self.found and len(same) >= AGREEING

    def starts(self, relaxation: Relaxation, rough: bool = False) -> list[Start]:
        """Starts of the scene with a relaxed limit, those of different branches first: by as much as was found, or
        well beyond what is likely. Where no key of the scene holds the limit, those of the search, too; ``rough`` ones
        also of scenes that are scanned.
        """
        best = self.found.get(relaxation.name)
        amount = relaxation.start(self.scene) if best is None else best.amount
        eased = relaxation.eased(self.scene, amount)
        if self._search.impossible and cannot_balance(_eased(self.scene, relaxation, LARGER[-1])):
            return []
        known: list[Start] = []
        if relaxation.limit is None:
            closest = sorted(self._search.tried, key=lambda t: t.attempt.badness)
            tried = {id(t.attempt.start): t.attempt.start for t in closest}
            known = spread(list(tried.values()) or self._search.rough_starts_of(contact_modes(self.scene)[0]))
        if eased is self.scene:
            return known
        if not relaxation.bounds_shape and not rough:
            factors = LARGER if best is None else (amount / relaxation.start(self.scene),)
            balanced = balanced_starts(self._search, [relaxation], factors)
            if balanced is not None:
                return balanced
        search = Search(eased, self._search.budget)
        eased_starts = []
        for mode in contact_modes(eased):
            scanned = None if rough else search.basins_of(mode)
            eased_starts.append(
                spread(search.rough_starts_of(mode) if scanned is None else _hopeful(self._search, scanned))
            )
        self._search.start_seconds += search.start_seconds
        return interleaved([*eased_starts, known])

    def try_starts(self, relaxation: Relaxation, starts: Iterable[Start]) -> None:
        """Relax one limit as little as possible, from every start until several agree."""
        for start in starts:
            if self._search.budget.over or self.agree(relaxation):
                return
            self.attempt(relaxation, start, relaxation.start(self.scene), iterations=HASTY)

    def attempt(self, relaxation: Relaxation, start: Start, amount: float, **options: Any) -> None:
        name, search = relaxation.name, self._search
        solver = search.solver(start)
        attempt = solver.run(self.scene, start, search.budget, rung=2, relaxed=[(relaxation, amount)], **options)
        if not np.isfinite(attempt.x).all() or attempt.violations:
            return
        amount, best = solver.given(self.scene, attempt.x, relaxation), self.found.get(name)
        self._amounts.setdefault(name, []).append(amount)
        if amount < min(math.inf if best is None else best.amount, relaxation.most * (1.0 - SHORT)):
            arrays = solver.arrays(self.scene, attempt)
            amount = max(amount, self._depth(relaxation, arrays))
            if (best is None or amount < best.amount) and self._holds(relaxation, amount, arrays):
                self.found[name] = Repair(amount, arrays, attempt)

    def reason(self, relaxation: Relaxation) -> Reason:
        """The best repair in words, confirmed by linear programming where it applies; where little is missing, whether
        its posture needs no repair after all is tried too.
        """
        scene, best = self.scene, self.found[relaxation.name]
        attempt, amount = best.attempt, best.amount
        least = least_amount(relaxation.name, scene, best.arrays, amount)
        confirmed = None if least is None else relaxation.value(scene, least.amount)
        if least is not None and confirmed is not None and least.amount < amount:
            found = relaxation.value(scene, amount)
            gains = abs(confirmed - found) > BETTER * abs(found)
            if gains and self._holds(relaxation, least.amount, least.arrays):
                amount = least.amount
        limit = 0.0 if relaxation.limit is None else relaxation.limit(scene)
        needed, unit = relaxation.value(scene, amount), "" if relaxation.unit == "1" else relaxation.unit
        text = relaxation.needed.format(limit=limit, needed=needed)
        if confirmed is not None:
            text += f" ({confirmed:.4g} by linear programming at that posture)"
        advice = relaxation.repair.format(key=relaxation.key, needed=needed, unit=unit).strip()
        advice += relaxation.beside(scene, relaxation.relaxed(scene, amount))
        reason = Reason(relaxation.name, relaxation.key, relaxation.unit, limit, needed, text, advice, confirmed)
        if not (attempt.optimal and is_clear(reason, scene)):
            self._search.attempt(attempt.start, features=attempt.features, x0=attempt.x, iterations=HASTY)
        return reason

    def _holds(self, relaxation: Relaxation, amount: float, arrays: Mapping[str, Array]) -> bool:
        """Whether the certificate confirms the grasp, but for what the relaxation excuses."""
        failed = certify_reached(relaxation.relaxed(self.scene, amount), arrays).failed
        return all(relaxation.excuses is not None and relaxation.excuses(check.name) for check in failed)

    def _depth(self, relaxation: Relaxation, arrays: Mapping[str, Array]) -> float:
        """How much of what the relaxation excuses there is, by the certificate [m]: guarded places may swap
        to the last, and the amount be too small.
        """
        if relaxation.excuses is None:
            return 0.0
        lengths = {setup.name: setup.finger.rod.length for setup in self.scene.setups}
        failed = [check for check in certify_reached(self.scene, arrays).failed if relaxation.excuses(check.name)]
        return max((check.value * lengths[check.name.split(", ")[-1]] for check in failed), default=0.0)


def spread(starts: list[Start]) -> list[Start]:
    """One start of each branch first, then the second of each, and so on."""
    branches: dict[tuple[Any, ...], list[Start]] = {}
    for start in starts:
        branches.setdefault((frozenset(start.contacts), *branch_of(start)), []).append(start)
    return interleaved(list(branches.values()))


def balanced_starts(
    search: Search, limits: Sequence[Relaxation], factors: Iterable[float] = LARGER
) -> list[Start] | None:
    """Starts of scanned postures that are nearly in balance with limits of forces relaxed by the first multiple of the
    usual amounts for which there are any; none: however much they are relaxed, they are no reason. None where postures
    are not scanned.
    """
    last: GraspScene | None = None
    for factor in factors:
        eased = search.scene
        for limit in limits:
            eased = _eased(eased, limit, factor)
        scans = None if eased == last else search.rebalanced(eased)
        if scans is None:
            break
        last, starts = eased, _hopeful(search, interleaved(scans))
        if starts:
            return starts
    return None if last is None else []


def _eased(scene: GraspScene, limit: Relaxation, factor: float) -> GraspScene:
    """A scene with a limit relaxed by a multiple of the usual amount."""
    return limit.eased(scene, min(factor * limit.start(scene), limit.most * (1.0 - SHORT)))


def _hopeful(search: Search, starts: list[Start]) -> list[Start]:
    """Those nearly in balance, and nearer than without the limit relaxed, where that tells."""
    if not search.knows_postures:
        return starts
    most = BALANCED if all(setup.elements <= 2 for setup in search.scene.setups) else BENT
    known = min((basin.start.imbalance for basin in search.basins), default=math.inf)
    return [start for start in starts if start.imbalance < min(most, max(NEARER * known, EXACT))]


def interleaved(lists: list[list[Start]]) -> list[Start]:
    """The first of each list, then the second of each, and so on."""
    return [start for rank in zip_longest(*lists) for start in rank if start is not None]
