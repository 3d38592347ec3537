"""Why a scene has no grasp: limits are relaxed as little as possible, in one elastic problem, from many starts, and
the amounts that then suffice, verified and confirmed, are the reason.

The problem has a slack for each limit, and minimizes the sum of their parts of a usual amount. Each limit is relaxed
alone first: that sum has local minima which mix cheap limits. Where no usual amount of one limit is enough, all are
relaxed at once, and weights that grow as parts vanish drive these to zero: reweighted L1 minimization, E. J. Candes,
M. B. Wakin, S. P. Boyd, J. Fourier Anal. Appl. 14 (2008), doi:10.1007/s00041-008-9045-x.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
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
from continuum_grasp.scene.grasp_options import Robust

FIRST, MORE = 2, 8
"""Starts per limit, and per limit that gives a grasp."""
BALANCED = 0.02
"""Imbalance up to which a posture may hold with the limit relaxed: those that do had 0.003 at most, others 0.02 and
more with few exceptions (28 scenes)."""
NEARER, EXACT = 0.95, 1e-3
"""Imbalance per that without the limit relaxed from which on relaxing it does not help, and imbalance that is none."""
LARGER = (1.0, 4.0, 16.0)
"""Usual amounts by which a limit is relaxed in search of postures that are then nearly in balance."""
WIDER = (1.0, 2.9)
"""Usual amounts by which limits of the shape are relaxed in search of postures for all limits at once."""
CLEAR = 0.03
"""Relative change of a limit, or part of a usual amount, from which on no other start would do without: the estimates
of a scan are off by less."""
RARE = 1.0
"""Friction coefficient that few surfaces have: reasons that ask for more come after the other limits."""

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
TIED = 1e-3
"""Difference of the logarithms of two factors up to which they are equal: images of a scene differ by less."""
SCANNED, EASED, SEEDS = 3, 6, 3
"""Starts for all limits at once: of the scene's own postures, and of those with limits of the shape relaxed; least sums
that are made sparse."""
REWEIGHTED, FLOOR = 2, 0.1
"""How often parts are weighted anew, and the part of a usual amount that halves a weight."""
NONE = 1e-3
"""Part of a usual amount that is none: its limit is not named."""
STEPS, HALVINGS = (0.01, 0.04, 0.16, 0.64), 2
"""Usual amounts by which a limit is relaxed further until a grasp holds for all errors and friction states, and how
often the last interval is halved.
"""
TOGETHER = 2
"""Most limits of a reason: scenes that break more are not explained."""


def rank(reason: Reason) -> tuple[int, bool, bool, float]:
    """Single limits come before several, a friction that few surfaces have after the others, and before it limits that
    the scene has no number for; the least product of the factors that limits are off comes first.
    """
    parts = (reason, *reason.also)
    factors = [part.needed / part.limit for part in parts if part.limit > 0.0 and part.needed > 0.0]
    size = sum(abs(math.log(factor)) for factor in factors)
    return len(parts), any(map(is_rare, parts)), len(factors) < len(parts), size


def ordered(reasons: Iterable[Reason]) -> list[Reason]:
    """Reasons by rank; those that are off by equal factors in the order of the limits."""
    names = [relaxation.name for relaxation in RELAXATIONS]
    result: list[Reason] = []
    tied: list[Reason] = []
    for reason in sorted(reasons, key=rank):
        if tied and (rank(reason)[:3] != rank(tied[0])[:3] or rank(reason)[3] - rank(tied[0])[3] > TIED):
            result, tied = result + tied, []
        tied = sorted([*tied, reason], key=lambda one: [names.index(part.name) for part in (one, *one.also)])
    return result + tied


def is_rare(reason: Reason) -> bool:
    """Whether it asks for a friction that few surfaces have."""
    return reason.name == "friction" and reason.needed > RARE


def is_clear(reason: Reason, scene: GraspScene) -> bool:
    """Whether so much is missing that no other start would do without."""
    (relaxation,) = (one for one in RELAXATIONS if one.name == reason.name)
    if relaxation.limit is None or reason.limit <= 0.0:
        return reason.needed >= CLEAR * relaxation.start(scene)
    return abs(reason.needed / reason.limit - 1.0) >= CLEAR


Limits = tuple[Relaxation, ...]


@dataclass(frozen=True)
class Repair:
    """Relaxed limits, and the resulting grasp."""

    parts: Mapping[Relaxation, float]  # by how many usual amounts
    arrays: Mapping[str, Array]  # of the grasp
    attempt: Attempt  # that found it

    @property
    def total(self) -> float:
        """Sum of the parts, which is minimized."""
        return sum(self.parts.values())


class Repairs:
    """Relaxed limits that give a grasp where a search found none; ``found`` has the best of each set so far."""

    def __init__(self, scene: GraspScene, search: Search) -> None:
        self.scene, self._search = scene, search
        self.limits = [limit for limit in RELAXATIONS if limit.applies(scene)]
        self.found: dict[Limits, Repair] = {}
        self._totals: dict[Limits, list[float]] = {}  # of all starts that gave a grasp

    def look(self) -> None:
        """Relax each limit alone that scenes without it show starts for; where no usual amount of one is enough, all at
        once.
        """
        usual = {limit: limit.eased(self.scene, limit.start(self.scene)) for limit in self.limits}
        self._alone([limit for limit, eased in usual.items() if eased is not self.scene])
        if not self.explained:
            self._together()

    def look_further(self) -> None:
        """Relax the other limits: whether fingers may pass through what the scene cannot be without."""
        self._alone([limit for limit in self.limits if (limit,) not in self._totals])

    @property
    def explained(self) -> bool:
        """Whether usual amounts of some limits are enough."""
        return any(
            not any(is_rare(self._part(limit, repair)) for limit in limits) for limits, repair in self.found.items()
        )

    def reasons(self) -> list[Reason]:
        """The reasons so far; of several limits at once each is needed: none is enough without the others."""
        alone = {limits[0]: repair.total for limits, repair in self.found.items() if len(limits) == 1}

        def suffices(limit: Relaxation, repair: Repair) -> bool:
            return alone.get(limit, math.inf) <= (1.0 + NONE) * repair.parts[limit]

        needed = [
            repair
            for limits, repair in self.found.items()
            if len(limits) == 1 or not any(suffices(limit, repair) for limit in limits)
        ]
        return ordered(self._reason(one) for repair in needed if (one := self._as_demanded(repair)) is not None)

    # -- runs of the solver ------------------------------------------------------------------------------------

    def _alone(self, limits: Sequence[Relaxation]) -> None:
        """Relax each limit, those that give a grasp from more starts."""
        starts = {}
        for limit in limits:
            if self._search.budget.over:
                return
            self._totals.setdefault((limit,), [])
            starts[limit] = self.starts(limit)
            self._from((limit,), starts[limit][:FIRST])
        for known in list(self.found):
            for limit in starts:
                if (limit,) not in self.found and (limit.limit is not None or not limit.bounds_shape):
                    self._in_place_of(known, limit)
        for limit in starts:
            if (limit,) in self.found:
                self._from((limit,), starts[limit][FIRST:MORE])
                if not self.agree((limit,)):
                    # Where the amount is known, the scan finds postures for just this much: closer than the first ones.
                    self._from((limit,), self.starts(limit)[:MORE])

    def _in_place_of(self, known: Limits, limit: Relaxation) -> None:
        """Relax a limit from where others are, which count the more: a point that satisfies all leads there more surely
        than starts do.
        """
        point, limits = self.found[known], tuple(one for one in self.limits if one in (*known, limit))
        weights = {one.name: 1.0 / FLOOR for one in known}
        both = self.relax(limits, point.attempt.start, point, weights=weights)
        if both is not None and all(both.parts[one] < NONE for one in known):
            self.attempt((limit,), both.attempt.start, both)

    def _from(self, limits: Limits, starts: Iterable[Start]) -> None:
        """Relax limits as little as possible, from every start until several agree."""
        for start in starts:
            if not self.agree(limits):
                self.attempt(limits, start)

    def _together(self) -> None:
        """Relax all limits at once that have a number, and then the few alone that matter; where these are no usual
        amounts, also with the tilt, whose norm has a kink that the solver often fails at.
        """
        numbered = tuple(limit for limit in self.limits if limit.limit is not None)
        bounding = tuple(limit for limit in self.limits if limit.limit is not None or not limit.bounds_shape)
        seeds: list[Repair] = []
        for every in dict.fromkeys((numbered, bounding)):
            if self.explained:
                return
            points = [self.relax(every, seed.attempt.start, seed) for seed in seeds]
            points = points or [self.relax(every, start) for start in self._starts_together(every)]
            seeds = []
            for seed in sorted((one for one in points if one is not None), key=lambda one: one.total):
                if len(seeds) < SEEDS and not (seeds and math.isclose(seed.total, seeds[-1].total, rel_tol=SAME)):
                    seeds.append(seed)
            for limits, point in filter(None, map(self._sparse, seeds)):
                # Each alone from there, too: of several limits none may be enough without the others.
                last = self.attempt(limits, point.attempt.start, point) or point
                for limit in limits if len(limits) > 1 else ():
                    self.attempt((limit,), last.attempt.start, last)

    def _sparse(self, point: Repair) -> tuple[Limits, Repair] | None:
        """Few limits that are relaxed at a point next to one with many, and that point."""
        for _ in range(REWEIGHTED):
            weights = {limit.name: FLOOR / (FLOOR + part) for limit, part in point.parts.items()}
            lighter = self.relax(tuple(point.parts), point.attempt.start, point, weights=weights)
            if lighter is None:
                break
            point = lighter
        while True:
            parts = point.parts
            needed = [limit for limit in parts if parts[limit] >= NONE] or [max(parts, key=parts.__getitem__)]
            if len(needed) <= TOGETHER:
                return tuple(needed), point
            fewer = (
                self.relax(tuple(limit for limit in needed if limit is not left), point.attempt.start, point)
                for left in sorted(needed, key=parts.__getitem__)
            )
            best = next((one for one in fewer if one is not None), None)
            if best is None:
                return None
            point = best

    def attempt(self, limits: Limits, start: Start, begin: Repair | None = None) -> Repair | None:
        """Relax limits as little as possible from a start, and retain the least amounts that are confirmed."""
        repair = self.relax(limits, start, begin)
        if repair is None:
            return None
        self._totals.setdefault(limits, []).append(repair.total)
        # Of several limits one that is not relaxed has no part in the reason.
        if len(limits) == 1 or min(repair.parts.values()) >= NONE:
            repair = self._deep(repair)
            best = self.found.get(limits)
            if (best is None or repair.total < best.total) and self._holds(repair.parts, repair.arrays):
                self.found[limits] = repair
        return repair

    def relax(self, limits: Limits, start: Start, begin: Repair | None = None, **options: Any) -> Repair | None:
        """Relax limits by the least sum of their parts of a usual amount, from a start or from a point with the same
        start to ``begin`` with; None where that gives no grasp.
        """
        scene, search = self.scene, self._search
        if search.budget.over:
            return None
        solver = search.solver(start)
        known = {} if begin is None else begin.parts
        usual = {limit: limit.start(scene) for limit in limits}
        relaxed = [(limit, most * known.get(limit, 1.0 if begin is None else 0.0)) for limit, most in usual.items()]
        x0 = None if begin is None else begin.attempt.x
        options = {"rung": 2, "iterations": HASTY, "relaxed": relaxed, "x0": x0, **options}
        attempt = solver.run(scene, start, search.budget, **options)
        if not np.isfinite(attempt.x).all() or attempt.violations:
            return None
        amounts = {limit: solver.given(scene, attempt.x, limit) for limit in limits}
        if any(amount >= limit.most(scene) * (1.0 - SHORT) for limit, amount in amounts.items()):
            return None
        parts = {limit: amount / usual[limit] for limit, amount in amounts.items()}
        return Repair(parts, solver.arrays(scene, attempt), attempt)

    def agree(self, limits: Limits) -> bool:
        """Whether several starts gave the same least amount."""
        totals = self._totals.get(limits, [])
        same = [total for total in totals if math.isclose(total, min(totals), rel_tol=SAME)]
        return limits in self.found and len(same) >= AGREEING

    def _deep(self, repair: Repair) -> Repair:
        """With all of what relaxations excuse by the certificate: guarded places may swap to the last, and an amount be
        too small.
        """
        lengths = {setup.name: setup.finger.rod.length for setup in self.scene.setups}
        excuses = {limit: limit.excuses for limit in repair.parts if limit.excuses is not None}
        parts = dict(repair.parts)
        for check in certify_reached(self.scene, repair.arrays).failed if excuses else ():
            for limit in (limit for limit, excuse in excuses.items() if excuse(check.name)):
                depth = check.value * lengths[check.name.split(", ")[-1]]
                parts[limit] = max(parts[limit], depth / limit.start(self.scene))
        return replace(repair, parts=parts)

    def _relaxed(self, parts: Mapping[Relaxation, float], spare: float = 0.0) -> GraspScene:
        """The scene with limits relaxed by parts of their usual amounts."""
        scene = self.scene
        for limit, part in parts.items():
            scene = limit.relaxed(scene, part * limit.start(self.scene) * (1.0 + spare * limit.spare))
        return scene

    def _holds(self, parts: Mapping[Relaxation, float], arrays: Mapping[str, Array]) -> bool:
        """Whether the certificate confirms the grasp, but for what the relaxations excuse."""
        failed = certify_reached(self._relaxed(parts, spare=float(len(parts) > 1)), arrays).failed
        excuses = [limit.excuses for limit in parts if limit.excuses is not None]
        return all(any(excuse(check.name) for excuse in excuses) for check in failed)

    # -- starts ------------------------------------------------------------------------------------------------

    def starts(self, limit: Relaxation) -> list[Start]:
        """Starts of the scene with a relaxed limit, those of different branches first: by as much as was found, or
        well beyond what is likely. Where no key of the scene holds the limit, those of the search, too.
        """
        search = self._search
        part = self.found[limit,].total if (limit,) in self.found else None
        if search.impossible and cannot_balance(_eased(self.scene, [limit], LARGER[-1])):
            return []
        known: list[Start] = []
        if limit.limit is None:
            known = self._known() or spread(search.rough_starts_of(contact_modes(self.scene)[0]))
        eased = _eased(self.scene, [limit], 1.0 if part is None else part)
        if eased is self.scene:
            return known
        if not limit.bounds_shape:
            balanced = balanced_starts(search, [limit], LARGER if part is None else (part,))
            if balanced is not None:
                return balanced
        return interleaved([*self._starts_of(eased, hopeful=True), known])

    def _starts_together(self, limits: Limits) -> list[Start]:
        """Starts for many limits at once, those of limits of the shape relaxed in several amounts."""
        forces = [limit for limit in limits if not limit.bounds_shape]
        scans = self._search.rebalanced(_eased(self.scene, forces, 1.0))
        near = self._known() if scans is None else interleaved(scans)
        eased = [start for wider in WIDER for start in self._starts_of(_eased(self.scene, limits, wider))]
        return [*near[:SCANNED], *interleaved(eased)[:EASED]]

    def _known(self) -> list[Start]:
        """Starts of the search, those that came nearest to a grasp first."""
        closest = sorted(self._search.tried, key=lambda tried: tried.attempt.badness)
        return spread(list({id(tried.attempt.start): tried.attempt.start for tried in closest}.values()))

    def _starts_of(self, eased: GraspScene, hopeful: bool = False) -> list[list[Start]]:
        """Starts of a scene with limits relaxed, of each set of contacts; ``hopeful`` ones of scans alone."""
        search, starts = Search(eased, self._search.budget), []
        for mode in contact_modes(eased):
            scanned = search.basins_of(mode)
            if scanned is None:
                scanned = search.rough_starts_of(mode)
            elif hopeful:
                scanned = _hopeful(self._search, scanned)
            starts.append(spread(scanned))
        self._search.start_seconds += search.start_seconds
        return starts

    # -- words -------------------------------------------------------------------------------------------------

    def _reason(self, repair: Repair) -> Reason:
        """A repair in words; where little is missing, whether its posture needs none after all is tried."""
        attempt, (first, *others) = repair.attempt, ordered(self._part(limit, repair, True) for limit in repair.parts)
        if not (attempt.optimal and all(is_clear(each, self.scene) for each in (first, *others))):
            self._search.attempt(attempt.start, features=attempt.features, x0=attempt.x, iterations=HASTY)
        if not others:
            return first
        text = "; and ".join(each.text for each in (first, *others))
        advice = " together with ".join(each.repair for each in (first, *others))
        return replace(first, text=f"two limits at once: {text}", repair=advice, also=tuple(others))

    def _part(self, limit: Relaxation, repair: Repair, confirm: bool = False) -> Reason:
        """One limit of a repair; on demand confirmed by linear programming where that applies."""
        others = {other: part for other, part in repair.parts.items() if other is not limit}
        scene, usual = self._relaxed(others, spare=1.0), limit.start(self.scene)
        amount, confirmed = repair.parts[limit] * usual, None
        # At one posture linear programming knows neither errors nor other friction states.
        if confirm and not scene.is_robust:
            least = least_amount(limit.name, scene, repair.arrays, amount)
            if least is not None:
                confirmed = limit.value(scene, least.amount)
                gains = abs(confirmed - limit.value(scene, amount)) > BETTER * abs(limit.value(scene, amount))
                less = {**repair.parts, limit: least.amount / usual}
                if least.amount < amount and gains and self._holds(less, least.arrays):
                    amount = least.amount
        given = 0.0 if limit.limit is None else limit.limit(scene)
        needed, unit = limit.value(scene, amount), "" if limit.unit == "1" else limit.unit
        text = limit.needed.format(limit=given, needed=needed)
        if confirmed is not None:
            text += f" ({confirmed:.4g} by linear programming at that posture)"
        advice = limit.repair.format(key=limit.key, needed=needed, unit=unit).strip()
        advice += limit.beside(scene, limit.relaxed(scene, amount))
        return Reason(limit.name, limit.key, limit.unit, given, needed, text, advice, confirmed)

    def _as_demanded(self, repair: Repair) -> Repair | None:
        """A repair that is enough for all errors and friction states that the scene names, too: relaxed further by
        nearly the least step that is; None where none is.
        """
        if not self.scene.is_robust or any(limit.excuses is not None for limit in repair.parts):
            return repair
        short, enough = 0.0, None
        for step in STEPS:
            enough = self._further(repair, step)
            if enough is not None:
                break
            short = step
        for _ in range(0 if enough is None else HALVINGS):
            middle = 0.5 * (short + step)
            less = self._further(repair, middle)
            short, step, enough = (middle, step, enough) if less is None else (short, middle, less)
        return enough

    def _further(self, repair: Repair, step: float) -> Repair | None:
        """A repair relaxed by more usual amounts of each limit; None where no grasp next to it holds for all errors and
        friction states of the scene.
        """
        from continuum_grasp.grasp.robust.search import find_robust

        scene, search = self.scene, self._search
        if search.budget.over:
            return None
        most = {limit: limit.most(scene) * (1.0 - SHORT) / limit.start(scene) for limit in repair.parts}
        parts = {limit: min(part + step, most[limit]) for limit, part in repair.parts.items()}
        eased, start, bounds = self._relaxed(parts), repair.attempt.start, scene.robust or Robust.model_construct()
        solver = search.solver(start)
        attempt = solver.run(eased, start, search.budget, rung=2, x0=repair.attempt.x, iterations=HASTY)
        if not attempt.converged or not np.isfinite(attempt.x).all():
            return None
        found = find_robust(eased, bounds, solver.arrays(eased, attempt), search.budget)
        return replace(repair, parts=parts, arrays=found.arrays) if found.holds else None


def spread(starts: list[Start]) -> list[Start]:
    """One start of each branch first, then the second of each, and so on."""
    branches: dict[tuple[Any, ...], list[Start]] = {}
    for start in starts:
        branches.setdefault((frozenset(start.contacts), *branch_of(start)), []).append(start)
    return interleaved(list(branches.values()))


def balanced_starts(search: Search, limits: Sequence[Relaxation], factors: Iterable[float]) -> list[Start] | None:
    """Starts of scanned postures that are nearly in balance with limits of forces relaxed by the first multiple of the
    usual amounts for which there are any; none: however much they are relaxed, they are no reason. None where postures
    are not scanned.
    """
    last: GraspScene | None = None
    for factor in factors:
        eased = _eased(search.scene, limits, factor)
        scans = None if eased == last else search.rebalanced(eased)
        if scans is None:
            break
        last, starts = eased, _hopeful(search, interleaved(scans))
        if starts:
            return starts
    return None if last is None else []


def _eased(scene: GraspScene, limits: Iterable[Relaxation], factor: float) -> GraspScene:
    """A scene with limits relaxed by a multiple of their usual amounts."""
    eased = scene
    for limit in limits:
        eased = limit.eased(eased, min(factor * limit.start(scene), limit.most(scene) * (1.0 - SHORT)))
    return eased


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
