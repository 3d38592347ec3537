"""Why a scene has no grasp where no single limit is in the way: two limits that are broken at once.

Both are relaxed by the least sum of their parts of a usual amount, so that neither can be relaxed less while the other
stays; each is then confirmed like a single limit in the scene where the other is relaxed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np

from continuum_grasp.grasp.certificate.certificate import certify_reached
from continuum_grasp.grasp.modes import contact_modes
from continuum_grasp.grasp.problem.relaxations import RELAXATIONS, Relaxation
from continuum_grasp.grasp.problem.solver_run import Attempt
from continuum_grasp.grasp.reasons.diagnosis import (
    BALANCED,
    HASTY,
    Repair,
    Repairs,
    balanced_starts,
    interleaved,
    rank,
    spread,
)
from continuum_grasp.grasp.search import Search
from continuum_grasp.grasp.starts.values import Start
from continuum_grasp.grasp.values import Reason
from continuum_grasp.scene.grasp import GraspScene

TOGETHER, SEEDS = 6, 2
"""Starts from which all limits are relaxed together, and how many of the points found every pair is tried from."""
WIDER = (1.0, 3.0)
"""Usual amounts by which a limit of the shape is relaxed in search of postures that another limit then balances."""
PAIRS = 6
"""Pairs that are looked into."""


@dataclass(frozen=True)
class _Relaxed:
    """Limits relaxed together."""

    amounts: dict[Relaxation, float]
    total: float  # sum of their parts of a usual amount
    attempt: Attempt


def find_pairs(scene: GraspScene, search: Search, further: bool = False) -> list[Reason]:
    """Find pairs of limits that, relaxed together, give a grasp that the certificate confirms, from scanned postures or
    ``further`` from points at which all limits are relaxed together.

    Those that ask for the least change come first, by the product of the factors.
    """
    limits = [relaxation for relaxation in RELAXATIONS if relaxation.applies(scene)]
    if further:
        return _reasons(scene, search, _from_seeds(scene, search, limits), {})
    for factor in WIDER:
        scanned = _scanned(scene, search, limits, factor)
        tried = []
        for pair, starts in scanned.items():
            again = [_relax(scene, search, pair, start) for start in starts[:SEEDS]]
            tried += sorted((one for one in again if one is not None), key=lambda one: one.total)[:1]
        more = {pair: starts[SEEDS:TOGETHER] for pair, starts in scanned.items()}
        reasons = _reasons(scene, search, tried, more)
        if reasons:
            return reasons
    return []


def _reasons(
    scene: GraspScene, search: Search, tried: list[_Relaxed], more: dict[tuple[Relaxation, ...], list[Start]]
) -> list[Reason]:
    """The best pairs as reasons, from ``more`` starts too, in order of the change that they ask for."""
    pairs = sorted(tried, key=lambda one: one.total)[:PAIRS]
    reasons = [_reason(scene, search, pair, more.get(tuple(pair.amounts))) for pair in pairs if not search.budget.over]
    return sorted((reason for reason in reasons if reason is not None), key=_change)


def _scanned(
    scene: GraspScene, search: Search, limits: Sequence[Relaxation], factor: float
) -> dict[tuple[Relaxation, ...], list[Start]]:
    """Pairs of limits with which scanned postures come near to balance, those of the shape relaxed by a multiple of the
    usual amount, and these as starts; none where postures are not scanned.
    """
    forces = [limit for limit in limits if not limit.bounds_shape]
    shapes = [limit for limit in limits if limit.bounds_shape and limit.eased(scene, limit.start(scene)) is not scene]
    found = {pair: balanced_starts(search, pair) or [] for pair in combinations(forces, 2)}
    for shape in shapes:
        wide = Search(shape.eased(scene, factor * shape.start(scene)), search.budget)
        for mode in contact_modes(wide.scene):
            wide.basins_of(mode)
        found |= {(shape, force): balanced_starts(wide, [force]) or [] for force in forces}
        search.start_seconds += wide.start_seconds
    for one, two in combinations(shapes, 2):
        eased = two.eased(one.eased(scene, factor * one.start(scene)), factor * two.start(scene))
        wide = Search(eased, search.budget)
        scans = [wide.basins_of(mode) or [] for mode in contact_modes(eased)]
        found[one, two] = [start for start in interleaved(scans) if start.imbalance < BALANCED]
        search.start_seconds += wide.start_seconds
    return {pair: starts for pair, starts in found.items() if starts}


def _from_seeds(scene: GraspScene, search: Search, limits: Sequence[Relaxation]) -> list[_Relaxed]:
    """All pairs relaxed from points at which all limits are relaxed together."""
    known = [t.attempt.start for t in sorted(search.tried, key=lambda t: t.attempt.badness)]
    # With clearance or balance given up, postures would lie where no other limit helps.
    seeds = _best(scene, search, [limit for limit in limits if limit.limit is not None], known)[:SEEDS]
    seeds = seeds or _best(scene, search, limits, known)[:SEEDS]
    tried: list[_Relaxed] = []
    for pair in combinations(limits, 2):
        again = [_relax(scene, search, pair, s.attempt.start, x0=s.attempt.x.copy()) for s in seeds]
        tried += sorted((one for one in again if one is not None), key=lambda one: one.total)[:1]
    return tried


def _best(scene: GraspScene, search: Search, limits: Sequence[Relaxation], known: list[Start]) -> list[_Relaxed]:
    """Limits relaxed together from the starts of the scene with all of them eased, the least sums first."""
    eased = scene
    for relaxation in limits:
        eased = relaxation.eased(eased, relaxation.start(scene))
    wide = Search(eased, search.budget)
    starts = [start for mode in contact_modes(eased) for start in spread(wide.starts_of(mode))[:TOGETHER]]
    found = [_relax(scene, search, limits, start) for start in [*starts[:TOGETHER], *spread(known)[:SEEDS]]]
    return sorted((one for one in found if one is not None), key=lambda one: one.total)


def _relax(
    scene: GraspScene, search: Search, limits: Sequence[Relaxation], start: Start, **options: Any
) -> _Relaxed | None:
    """Relax limits together as little as possible from a start; None where that gives no grasp."""
    if search.budget.over:
        return None
    solver, usual = search.solver(start), [(limit, limit.start(scene)) for limit in limits]
    attempt = solver.run(scene, start, search.budget, rung=2, relaxed=usual, iterations=HASTY, **options)
    if not np.isfinite(attempt.x).all() or attempt.violations:
        return None
    amounts = {limit: solver.given(scene, attempt.x, limit) for limit in limits}
    return _Relaxed(amounts, sum(amounts[limit] / most for limit, most in usual), attempt)


def _reason(scene: GraspScene, search: Search, pair: _Relaxed, more: list[Start] | None) -> Reason | None:
    """A pair as one reason, from ``more`` starts too, or those of rough scans; None where the certificate does not
    confirm it.
    """
    limits, start = list(pair.amounts), pair.attempt.start
    if more is None:
        found = [pair, *_best(scene, search, limits, [start])]
    else:
        again = (_relax(scene, search, limits, other) for other in more)
        found = [pair, *(one for one in again if one is not None)]
    held = (one for one in sorted(found, key=lambda one: one.total) if _holds(scene, search, one))
    best = next(held, None)
    if best is None:
        return None
    arrays = search.solver(best.attempt.start).arrays(scene, best.attempt)
    reasons = []
    for limit, other in (limits, limits[::-1]):
        repairs = Repairs(other.relaxed(scene, best.amounts[other] * (1.0 + other.spare)), search)
        repairs.found[limit.name] = Repair(best.amounts[limit], arrays, best.attempt)
        reasons.append(repairs.reason(limit))
    one, two = sorted(reasons, key=rank)
    text = f"two limits at once: {one.text}; and {two.text}"
    return replace(one, text=text, repair=f"{one.repair} together with {two.repair}", also=(two,))


def _holds(scene: GraspScene, search: Search, relaxed: _Relaxed) -> bool:
    """Whether the certificate confirms a grasp, but for what the relaxations excuse."""
    eased, excuses = scene, [limit.excuses for limit in relaxed.amounts if limit.excuses is not None]
    for limit, amount in relaxed.amounts.items():
        eased = limit.relaxed(eased, amount * (1.0 + limit.spare))
    failed = certify_reached(eased, search.solver(relaxed.attempt.start).arrays(scene, relaxed.attempt)).failed
    return all(any(excuse(check.name) for excuse in excuses) for check in failed)


def _change(reason: Reason) -> tuple[bool, float]:
    ranks = [rank(each) for each in (reason, *reason.also)]
    return any(rare for rare, _, _ in ranks), sum(size for _, size, _ in ranks)
