"""Why a scene has no grasp: limits are relaxed as little as possible, in one elastic problem, from many starts, and
the amounts that then suffice, verified and confirmed, are the reason.

1. Each limit is relaxed alone: the sum that the elastic problem minimizes has local minima which mix cheap limits.
2. All limits are relaxed at once from the nearest starts; from where that holds, each alone again.
3. A limit that repairs the scene is relaxed from more starts, closer by its amount, until several agree.
4. Where no usual amount of one is enough, all are relaxed at once, and weights that grow as parts vanish drive these to
   zero: reweighted L1 minimization, E. J. Candes, M. B. Wakin, S. P. Boyd, J. Fourier Anal. Appl. 14 (2008),
   doi:10.1007/s00041-008-9045-x. While more than two are left, the one with the least part is taken out.
5. What is left is verified by the certificate with just these amounts, for all errors and friction states of the scene.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import cached_property

from continuum_grasp.base import InputError, prefixed
from continuum_grasp.grasp.bound import cannot_balance
from continuum_grasp.grasp.certificate.certificate import certify_reached
from continuum_grasp.grasp.effort import CLOSEST, FIRST_CAP, HELD
from continuum_grasp.grasp.problem.relaxations import RELAXATIONS, RelaxedLimit, beyond_needed, changed_numbers
from continuum_grasp.grasp.problem.solver_run import MODEST
from continuum_grasp.grasp.reasons.elastic import Elastic, Limits, Repair, same, settled
from continuum_grasp.grasp.reasons.starts import Starts, eased
from continuum_grasp.grasp.search import GraspSearch
from continuum_grasp.grasp.shape import ROUNDING
from continuum_grasp.grasp.starts.values import GraspStart
from continuum_grasp.grasp.values import NEAR, GraspStatus, Reason
from continuum_grasp.scene import FingerSetup, GraspScene

CLEAR = 0.03
"""Relative change of a limit, or part of a usual amount, from which on no other start would do without: estimates of
settled fingers are off by less."""
FAR = 16.0
"""Usual amounts of a limit beyond which it is no reason."""


def rank(reason: Reason) -> tuple[bool, int, bool, bool, float]:
    """Stable grasps come before others, single limits before several, a friction that few surfaces have after the
    others, and before it limits that the scene has no number for; the least product of the factors that limits are off
    comes first.
    """
    parts = (reason, *reason.also)
    factors = [part.needed / part.limit for part in parts if part.limit > 0.0 and part.needed > 0.0]
    size = sum(abs(math.log(factor)) for factor in factors)
    return not reason.stable, len(parts), any(map(is_rare, parts)), len(factors) < len(parts), size


def ordered(reasons: Iterable[Reason]) -> list[Reason]:
    """Reasons by rank; those that are off by equal factors in the order of the limits, as images of a scene differ by
    less.
    """
    names = [relaxation.name for relaxation in RELAXATIONS]
    result: list[Reason] = []
    tied: list[Reason] = []
    for reason in sorted(reasons, key=rank):
        if tied and (rank(reason)[:-1] != rank(tied[0])[:-1] or rank(reason)[-1] - rank(tied[0])[-1] > NEAR):
            result, tied = result + tied, []
        tied = sorted([*tied, reason], key=lambda ranked: [names.index(part.name) for part in (ranked, *ranked.also)])
    return result + tied


def is_rare(reason: Reason) -> bool:
    """Whether a repair asks for a friction that few surfaces have."""
    # 1.0: friction coefficient that few surfaces have: reasons that ask for more come after the other limits
    return reason.name == "friction" and reason.needed > 1.0


def is_clear(reason: Reason, scene: GraspScene) -> bool:
    """Whether so much is missing that no other start would do without."""
    (relaxation,) = (candidate for candidate in RELAXATIONS if candidate.name == reason.name)
    if relaxation.limit is None or reason.limit <= 0.0:
        return reason.needed >= CLEAR * relaxation.start(scene)
    return abs(reason.needed / reason.limit - 1.0) >= CLEAR


def in_words(elastic: Elastic, repair: Repair) -> Reason:
    """The reason that a repair is, its limits in the order of their ranks."""
    first, *others = ordered(part_of(elastic, limit, repair) for limit in repair.parts)
    if not others:
        return first
    text = "; and ".join(each.text for each in (first, *others))
    advice = " together with ".join(each.repair for each in (first, *others))
    return replace(first, text=f"two limits at once: {text}", repair=advice, also=tuple(others))


def part_of(elastic: Elastic, limit: RelaxedLimit, repair: Repair) -> Reason:
    """A limit of a repair, in the scene where the others are relaxed."""
    others = {other: part for other, part in repair.parts.items() if other is not limit}
    scene, amount = elastic.relaxed(others, spare=1.0), repair.parts[limit] * limit.start(elastic.scene)
    bound, needed = limit.value(scene, 0.0), limit.value(scene, amount)
    eased = limit.relaxed(scene, amount if limit.limit is None else limit.enough(scene, amount))
    every = dict(changed_numbers(scene, eased))
    changed = _needed(scene, every, repair) if len(every) > 1 and not elastic.scene.is_robust else every
    # The key whose number is the limit; fingers and supports may have limits of their own, which go with it.
    stated = limit.value(scene, amount) if limit.limit is None else limit.limit(eased)
    key = next((key for key, number in changed.items() if number == stated), next(iter(changed), limit.key))
    if key in changed and changed[key] != stated and not key.endswith("torque_max"):
        bound = dict(changed_numbers(eased, scene))[key]
        needed = dict(changed_numbers(scene, limit.relaxed(scene, amount))).get(key, bound)
        changed[key] = beyond_needed(needed, math.copysign(1.0, needed - bound))
    # As many digits as tell the two apart.
    digits = next(digits for digits in range(4, 17) if digits == 16 or f"{bound:.{digits}g}" != f"{needed:.{digits}g}")
    factor, shown = prefixed(limit.unit, max(bound, needed))
    text = limit.needed.format(limit=factor * bound, needed=factor * needed, digits=digits, unit=shown)
    unit = "" if limit.unit == "1" else f" {limit.unit}"
    advice = " together with ".join(
        f"{each} = {changed[each]:.{3 if each == key else 4}g}{' N m' if each.endswith('torque_max') else unit}"
        for each in sorted(changed, key=lambda each: each != key)
    )
    advice = advice or limit.repair.format(key=key, needed=stated, unit=limit.unit).strip()
    return Reason(limit.name, key, limit.unit, bound, needed, text, advice)


def _needed(scene: GraspScene, changed: dict[str, float], repair: Repair) -> dict[str, float]:
    """Changed numbers, by key, without which the posture of a repair is no grasp of the scene."""
    if any(limit.excuses is not None for limit in repair.parts):
        return changed
    needed = dict(changed)
    for left_out in changed:
        fewer = {key: number for key, number in needed.items() if key != left_out}
        if fewer and _holds(scene, fewer, repair):
            needed = fewer
    return needed


def _holds(scene: GraspScene, changes: dict[str, float], repair: Repair) -> bool:
    """Whether the posture of a repair is a grasp of the scene with changes, which may not fit together."""
    try:
        changed = scene.changed(changes)
    except InputError:
        return False
    return certify_reached(changed, repair.arrays).passed


def out_of_reach(scene: GraspScene) -> Reason | None:
    """The exact test of distance: no shape at all can touch."""
    needed = [s for s in scene.setups if "on" in (*s.middles, s.tip) or len(scene.setups) == 1]
    away = [(_distance(scene, setup), _reach(setup)) for setup in needed]
    missing, distance, reach = max(((d - r, d, r) for d, r in away), key=lambda gap: gap[0], default=(0.0, 0.0, 0.0))
    if missing <= ROUNDING * reach:
        return None
    text = f"the object is out of reach: it is {distance:.4g} m from the base, {reach:.4g} m can be reached"
    repair = f"bring object and base nearer to each other, by {missing:.4g} m at least"
    return Reason("reach", "object.position", "m", distance, reach, text, repair)


def _reach(setup: FingerSetup) -> float:
    """Greatest distance from its base at which a finger can touch [m]."""
    length = setup.finger.rod.length
    middle = setup.middle_bounds[1] if "on" in setup.middles else length
    return min(middle, length) + setup.finger.thickness_radius


def _distance(scene: GraspScene, setup: FingerSetup) -> float:
    """Least distance between a base and the object's surface [m]; a lower bound where a pose is free."""
    x, y = setup.finger.base.position
    body = scene.object
    if body.free is None or body.free.angle is None:
        away = body.distance((x, y))
    else:
        # However it is turned about its position, the object lies within its size of its center of mass.
        away = math.dist((x, y), body.position) - math.hypot(*body.com) - body.size
    return away - body.greatest_shift - setup.finger.base_shift


MORE = 8
"""Starts from which a limit that gives a grasp is relaxed; before that, `CLOSEST`."""
REWEIGHTED, FLOOR = 2, 0.1
"""Number of times that parts are weighted anew, and the part of a usual amount that halves a weight."""


class Repairs(Elastic):
    """Choice of the limits of a scene that are relaxed, alone or together, in search of reasons."""

    def __init__(self, scene: GraspScene, search: GraspSearch) -> None:
        super().__init__(scene, search)
        self.limits = [limit for limit in RELAXATIONS if limit.applies(scene)]
        # Limits with a number, and all but those that keep fingers clear of something.
        self.numbered = tuple(limit for limit in self.limits if limit.limit is not None)
        self.bounding = tuple(limit for limit in self.limits if limit.limit is not None or not limit.bounds_shape)
        self._tried: dict[Limits, list[tuple[GraspStart, Repair | None]]] = {}

    @cached_property
    def starts(self) -> Starts:
        """Starts with limits relaxed."""
        return Starts(self.scene, self.search)

    def look(self) -> None:
        """Relax each limit alone that scenes without it show starts for; where no usual amount of one is enough, all at
        once.
        """
        usual = {limit: limit.eased(self.scene, limit.start(self.scene)) for limit in self.limits}
        self._alone([limit for limit, scene in usual.items() if scene is not self.scene])
        if not self.explained:
            self._together()

    def look_further(self) -> None:
        """Relax the other limits: whether fingers may pass through what the scene cannot be without."""
        self._alone([limit for limit in self.limits if (limit,) not in self.totals])

    @property
    def explained(self) -> bool:
        """Whether usual amounts of some limits are enough."""
        return any(
            not any(is_rare(part_of(self, limit, repair)) for limit in limits) for limits, repair in self.found.items()
        )

    def reasons(self) -> list[Reason]:
        """The reasons so far; of several limits at once each is needed: none is enough without the others."""
        alone = {limits[0]: repair.total for limits, repair in self.found.items() if len(limits) == 1}
        needed = [
            repair
            for limits, repair in self.found.items()
            if len(limits) == 1
            or not any(alone.get(limit, math.inf) <= (1.0 + NEAR) * repair.parts[limit] for limit in limits)
        ]
        return ordered(self._reason(reason) for repair in needed if (reason := self.as_demanded(repair)) is not None)

    def _reason(self, repair: Repair) -> Reason:
        """A repair in words; where little is missing, whether its posture needs none after all is tried."""
        attempt, reason = repair.attempt, replace(in_words(self, repair), arrays=repair.arrays)
        if not (attempt.optimal and all(is_clear(each, self.scene) for each in (reason, *reason.also))):
            tried = self.search.attempt(attempt.start, features=attempt.features, x0=attempt.x, iterations=FIRST_CAP)
            if max(repair.parts.values()) < NEAR and not (tried and tried.verified):
                # The solver may leave a narrow feasible set that relaxed limits had led to.
                self.search.adopt(attempt)
        if self.scene.stability == "ignore" or any(limit.excuses is not None for limit in repair.parts):
            return reason
        if certify_reached(self.relaxed(repair.parts), repair.arrays).stability.stable:
            return reason
        return replace(reason, repair=f"{reason.repair}, where the grasp found is {GraspStatus.UNSTABLE}", stable=False)

    # -- one limit ---------------------------------------------------------------------------------------------

    def _alone(self, limits: Sequence[RelaxedLimit]) -> None:
        """Relax each limit, those that give a grasp from more starts."""
        search, starts = self.search, dict[RelaxedLimit, list[GraspStart]]()
        for limit in limits:
            if search.budget.over:
                return
            self.totals.setdefault((limit,), [])
            if not (search.impossible and cannot_balance(eased(self.scene, [limit], FAR))):
                starts[limit] = self.starts.alone(limit)
                self._from(limit, starts[limit], CLOSEST)
        others = [limit for limit in starts if limit in self.bounding]
        # From the nearest starts all limits are relaxed at once: where that gives no grasp, one alone gives none, but
        # for a part of a limit, which is not relaxed as far beside others.
        near = self.starts.near if others else []
        points = _least(self._all_from(self.numbered, near[:CLOSEST]))
        for limit in others:
            if math.isfinite(limit.most(self.scene)) and not limit.bounds_shape and (points or not limit.additive):
                self._from(limit, near, CLOSEST)
        for point in [*points, *_least(self.found.values())[:1]]:
            self._in_place_of(point, [limit for limit in others if (limit,) not in self.found])
        for limit in starts:
            if (limit,) in self.found and not settled(self.totals[limit,]):
                # Where an amount is known, postures for just this much are closer than the first ones.
                closer = self.starts.alone(limit, self.found[limit,].total)
                self._from(limit, [*closer, *starts[limit], *(near if limit in others else [])], MORE)

    def _in_place_of(self, point: Repair, others: Sequence[RelaxedLimit]) -> None:
        """Relax other limits from where some are, which count the more: a point that satisfies all leads there more
        surely than starts do.
        """
        modest = {limit: MODEST * limit.most(self.scene) / limit.start(self.scene) for limit in point.parts}
        if any(part > modest[limit] for limit, part in point.parts.items()):
            return  # so far that is relaxed alone only
        known = tuple(limit for limit, part in point.parts.items() if part >= NEAR)
        weights = {relaxation.name: 1.0 / FLOOR for relaxation in known}
        if len(set(others) - set(known)) > 1:
            # Where none of them is relaxed though all may be, none is in the place of something.
            every = self.relax(tuple(dict.fromkeys((*known, *others))), point, weights=weights)
            if every is not None and all(
                every.parts[relaxation] < NEAR for relaxation in others if relaxation not in known
            ):
                others = [relaxation for relaxation in others if relaxation in known]
        for limit in others:
            rest = [relaxation for relaxation in known if relaxation is not limit]
            at = self.relax((*rest, limit), point, weights={**weights, limit.name: 1.0}) if rest else point
            if at is not None and all(at.parts[relaxation] < NEAR for relaxation in rest):
                self.attempt((limit,), at)

    def _from(self, limit: RelaxedLimit, starts: Iterable[GraspStart], count: int) -> None:
        """Relax a limit as little as possible, from so many new starts until several agree."""
        begun = len(self._tried.setdefault((limit,), []))
        for start in starts:
            enough = len(self._tried[limit,]) - begun >= count or settled(self.totals[limit,])
            if not enough and self._is_new((limit,), start):
                self._tried[limit,].append((start, self.attempt((limit,), start)))

    def _is_new(self, limits: Limits, start: GraspStart) -> bool:
        """Whether limits were not relaxed from an equal start yet, as relaxed scenes have in common."""
        return all(start != other for other, _ in self._tried[limits])

    # -- several limits ----------------------------------------------------------------------------------------

    def _together(self) -> None:
        """Relax all limits at once that have a number, and then the few alone that matter; where these are no usual
        amounts, also with the tilt, whose norm has a kink that the solver often fails at.
        """
        seeds: list[Repair] = []
        for every in dict.fromkeys((self.numbered, self.bounding)):
            if self.explained:
                return
            # What the further limits do not change leads to the same few again.
            known = [seed.total for seed in seeds]
            points = [self.relax(every, seed) for seed in seeds] or self._all_from(every, self.starts.together(every))
            seeds = [point for point in _least(points)[:HELD] if not any(same(point.total, total) for total in known)]
            for limits, point in filter(None, map(self._few, seeds)):
                # Each alone from there, too: of several limits none may be enough without the others.
                last = self.attempt(limits, point) or point
                for limit in limits if len(limits) > 1 else ():
                    self.attempt((limit,), last)

    def _all_from(self, limits: Limits, starts: Iterable[GraspStart]) -> list[Repair | None]:
        """Points with many limits relaxed from starts."""
        tried = self._tried.setdefault(limits, [])
        for start in starts:
            if self._is_new(limits, start):
                tried.append((start, self.relax(limits, start)))
        return [point for _, point in tried]

    def _few(self, point: Repair) -> tuple[Limits, Repair] | None:
        """Few limits that are relaxed at a point next to one with many, and that point."""
        for count in itertools.count():
            parts = point.parts
            needed = [limit for limit in parts if parts[limit] >= NEAR] or [max(parts, key=parts.__getitem__)]
            if len(needed) <= 2:  # scenes that break more are not explained
                return tuple(needed), point
            weights = {limit.name: FLOOR / (FLOOR + part) for limit, part in parts.items()}
            if count < REWEIGHTED and (lighter := self.relax(needed, point, weights=weights)):
                point = lighter
                continue
            fewer = (
                self.relax([limit for limit in needed if limit is not left], point)
                for left in sorted(needed, key=parts.__getitem__)
            )
            best = next((repair for repair in fewer if repair is not None), None)
            if best is None:
                break
            point = best
        return None


def _least(points: Iterable[Repair | None]) -> list[Repair]:
    """Points with different sums of parts, the least first."""
    least: list[Repair] = []
    for point in sorted((repair for repair in points if repair is not None), key=lambda repair: repair.total):
        if not (least and same(point.total, least[-1].total)):
            least.append(point)
    return least
