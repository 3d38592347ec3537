"""Why a scene has no grasp: limits are relaxed as little as possible, in one elastic problem, from fingers that hold
the object then, and the amounts that then suffice, verified and confirmed, are the reason.

1. Each limit is relaxed alone.
2. Where no usual amount of one is enough, each two of them are, unless grasps were found whose only flaw is that
   fingers overlap; all others together are no substitute for some, which are part of every reason.
3. What repairs the scene is relaxed from more starts, closer by its amount, until several agree.
4. The remaining repairs are verified by the certificate with just these amounts, for all errors and friction states.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable
from dataclasses import replace
from functools import cached_property

from continuum_grasp.base import InputError, amount_text, prefixed
from continuum_grasp.grasp.bound import cannot_balance
from continuum_grasp.grasp.certificate.certificate import certify_reached
from continuum_grasp.grasp.effort import CLOSEST, FIRST_CAP
from continuum_grasp.grasp.problem.relaxations import RELAXATIONS, RelaxedLimit, beyond_needed, changed_numbers
from continuum_grasp.grasp.reasons.elastic import Elastic, Limits, Repair, settled
from continuum_grasp.grasp.reasons.starts import Starts, eased
from continuum_grasp.grasp.search import GraspSearch
from continuum_grasp.grasp.shape import ROUNDING
from continuum_grasp.grasp.starts.values import GraspStart
from continuum_grasp.grasp.tried import Tried
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
            result = result + tied
            tied = []
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
    scene = elastic.relaxed(others, spare=1.0)
    amount = repair.parts[limit] * limit.start(elastic.scene)
    bound = limit.value(scene, 0.0)
    needed = limit.value(scene, amount)
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
    text = f"the object is out of reach: it is {distance:.4g} m from the base; the finger reaches {reach:.4g} m"
    repair = f"move object and base closer together, by at least {missing:.4g} m"
    return Reason("reach", "object.position", "m", distance, reach, text, repair)


def push_reason(scene: GraspScene, strongest: Tried) -> Reason:
    """Return the reason that the required push exceeds the greatest push found."""
    asked = scene.contacts.push or 0.0
    borne = beyond_needed(strongest.certificate.push, -1.0)
    text = f"the push is too great: {amount_text(asked, 'N', '.3g')}; a grasp bears {amount_text(borne, 'N', '.3g')}"
    repair = f"contacts.push = {amount_text(borne, 'N', '.3g')}"
    return Reason("push", "contacts.push", "N", asked, borne, text, repair, arrays=strongest.arrays)


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
"""Starts from which limits that give a grasp are relaxed; before that, `CLOSEST`."""


class Repairs(Elastic):
    """Choice of the limits of a scene that are relaxed, alone or together, in search of reasons."""

    def __init__(self, scene: GraspScene, search: GraspSearch) -> None:
        super().__init__(scene, search)
        self.limits = [limit for limit in RELAXATIONS if limit.applies(scene)]
        self._tried: dict[Limits, list[GraspStart]] = {}

    @cached_property
    def starts(self) -> Starts:
        """Starts with limits relaxed."""
        return Starts(self.scene, self.search)

    def look(self) -> None:
        """Relax each limit alone that scenes without it show starts for; where no usual amount of one is enough, and
        fingers do not hold the object as it is, each two.
        """
        seen = [limit for limit in self.limits if limit.eased(self.scene, limit.start(self.scene)) is not self.scene]
        self._relaxed((limit,) for limit in seen)
        if not (self.explained or self._overlap or any(candidate.holds for candidate in self.search.settled)):
            pairs = itertools.combinations([limit for limit in seen if (limit,) not in self.found], 2)
            self._relaxed(pair for pair in pairs if self.starts.needed <= {*pair})

    def look_further(self) -> None:
        """Relax the other limits: whether fingers may pass through what the scene cannot be without."""
        self._relaxed((limit,) for limit in self.limits if (limit,) not in self.totals)

    @property
    def _overlap(self) -> bool:
        """Whether fingers overlap in grasps of the search that have no other flaw, which its verdict then says."""
        (overlap,) = (limit for limit in RELAXATIONS if limit.name == "overlap")
        converged = [tried for tried in self.search.tried if tried.attempt.converged]
        return any(one.certificate.failed and self._excused(one.certificate, [overlap]) for one in converged)

    @property
    def explained(self) -> bool:
        """Whether usual amounts of some limits are enough."""
        return any(
            not any(is_rare(part_of(self, limit, repair)) for limit in limits) for limits, repair in self.found.items()
        )

    def reasons(self) -> list[Reason]:
        """The reasons so far; of several limits at once each is needed: none is enough without the others."""
        alone = {limits[0]: repair.total for limits, repair in self.found.items() if len(limits) == 1}
        needed = []
        for limits, repair in self.found.items():
            enough = [alone.get(limit, math.inf) <= (1.0 + NEAR) * repair.parts[limit] for limit in limits]
            if len(limits) == 1 or not any(enough):
                needed.append(repair)
        demanded = map(self.as_demanded, needed)
        return ordered(self._reason(reason) for reason in demanded if reason is not None)

    def _reason(self, repair: Repair) -> Reason:
        """A repair in words; where little is missing, whether its posture needs none after all is tried."""
        attempt = repair.attempt
        reason = replace(in_words(self, repair), arrays=repair.arrays)
        if not (attempt.optimal and all(is_clear(each, self.scene) for each in (reason, *reason.also))):
            tried = self.search.attempt(attempt.start, features=attempt.features, x0=attempt.x, iterations=FIRST_CAP)
            if max(repair.parts.values()) < NEAR and not (tried and tried.verified):
                # The solver may leave a narrow feasible set that relaxed limits had led to.
                self.search.adopt(attempt)
        if self.scene.stability == "ignore" or any(limit.excuses is not None for limit in repair.parts):
            return reason
        if certify_reached(self.relaxed(repair.parts), repair.arrays).stability.stable:
            return reason
        return replace(
            reason, repair=f"{reason.repair}, but the grasp found then is {GraspStatus.UNSTABLE}", stable=False
        )

    # -- sets of limits ----------------------------------------------------------------------------------------

    def _relaxed(self, sets: Iterable[Limits]) -> None:
        """Relax each set of limits, those that give a grasp from more starts."""
        search = self.search
        starts = dict[Limits, list[GraspStart]]()
        for limits in sets:
            if search.budget.over:
                return
            self.totals.setdefault(limits, [])
            if search.impossible and cannot_balance(eased(self.scene, limits, FAR)):
                continue
            maps = None
            while limits not in self.found and maps is not search.maps:  # until no more fingers cross
                maps = search.maps
                starts[limits] = self.starts.of(limits)
                self._from(limits, starts[limits], CLOSEST)
            if starts[limits] and limits not in self.found:
                self._from(limits, [*starts[limits], *self.starts.near], CLOSEST)
        for limits in starts:
            if limits in self.found and not settled(self.totals[limits]):
                # Where an amount is known, postures for just this much are closer than the first ones.
                closer = self.starts.closer(limits, self.found[limits].total)
                self._from(limits, [*closer, *starts[limits]], MORE)

    def _from(self, limits: Limits, starts: Iterable[GraspStart], count: int) -> None:
        """Relax limits as little as possible, from so many new starts until several agree."""
        tried = self._tried.setdefault(limits, [])
        most = len(tried) + count
        for start in starts:
            enough = len(tried) >= most or settled(self.totals[limits])
            # Relaxed scenes have starts in common.
            if enough or start in tried:
                continue
            tried.append(start)
            repair = self.attempt(limits, start)
            if repair is not None and len(limits) > 1:
                self._alone(repair)

    def _alone(self, repair: Repair) -> None:
        """Relax each limit alone from where several are, where the others take no part."""
        for limit in repair.parts:
            if all(part < NEAR for other, part in repair.parts.items() if other is not limit):
                self.attempt((limit,), repair)
