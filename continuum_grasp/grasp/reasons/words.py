"""Words for limits that give a grasp once they are relaxed, in order, and of objects out of reach."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace

from continuum_grasp.grasp.problem.relaxations import RELAXATIONS, Relaxation
from continuum_grasp.grasp.reasons.elastic import Elastic, Repair
from continuum_grasp.grasp.shape import ROUNDING
from continuum_grasp.grasp.values import NEAR, Reason
from continuum_grasp.scene.grasp import FingerSetup, GraspScene
from continuum_grasp.scene.objects.shapes import greatest_shift

CLEAR = 0.03
"""Relative change of a limit, or part of a usual amount, from which on no other start would do without: the estimates
of a scan are off by less."""


def rank(reason: Reason) -> tuple[int, bool, bool, float]:
    """Single limits come before several, a friction that few surfaces have after the others, and before it limits that
    the scene has no number for; the least product of the factors that limits are off comes first.
    """
    parts = (reason, *reason.also)
    factors = [part.needed / part.limit for part in parts if part.limit > 0.0 and part.needed > 0.0]
    size = sum(abs(math.log(factor)) for factor in factors)
    return len(parts), any(map(is_rare, parts)), len(factors) < len(parts), size


def ordered(reasons: Iterable[Reason]) -> list[Reason]:
    """Reasons by rank; those that are off by equal factors in the order of the limits, as images of a scene differ by
    less.
    """
    names = [relaxation.name for relaxation in RELAXATIONS]
    result: list[Reason] = []
    tied: list[Reason] = []
    for reason in sorted(reasons, key=rank):
        if tied and (rank(reason)[:3] != rank(tied[0])[:3] or rank(reason)[3] - rank(tied[0])[3] > NEAR):
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


def part_of(elastic: Elastic, limit: Relaxation, repair: Repair) -> Reason:
    """A limit of a repair, in the scene where the others are relaxed."""
    others = {other: part for other, part in repair.parts.items() if other is not limit}
    scene, amount = elastic.relaxed(others, spare=1.0), repair.parts[limit] * limit.start(elastic.scene)
    bound = 0.0 if limit.limit is None else limit.limit(scene)
    needed, unit = limit.value(scene, amount), "" if limit.unit == "1" else limit.unit
    text = limit.needed.format(limit=bound, needed=needed)
    advice = limit.repair.format(key=limit.key, needed=needed, unit=unit).strip()
    advice += limit.beside(scene, limit.relaxed(scene, amount))
    return Reason(limit.name, limit.key, limit.unit, bound, needed, text, advice)


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
    return away - greatest_shift(body.free, body.position) - greatest_shift(setup.finger.base_free, (x, y))
