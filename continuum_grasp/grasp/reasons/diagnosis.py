"""Why a scene has no grasp: each limit is relaxed alone as little as possible, from many starts, and the amount that
then suffices, verified and confirmed, is the reason.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import zip_longest
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.certificate.certificate import certify
from continuum_grasp.grasp.problem.relaxations import RELAXATIONS, Relaxation
from continuum_grasp.grasp.problem.solver_run import Attempt
from continuum_grasp.grasp.reasons.confirm import least_amount
from continuum_grasp.grasp.result import Reason
from continuum_grasp.grasp.search import Search, branch_of, contact_modes
from continuum_grasp.grasp.starts.values import Start
from continuum_grasp.nlp import Status
from continuum_grasp.scene.grasp import FingerSetup, GraspScene
from continuum_grasp.scene.grasp_options import OutOfPlaneGravity
from continuum_grasp.scene.objects import Freedom

FIRST, MORE = 4, 8
"""Starts per limit, and per limit that gives a grasp, or per limit again if none does."""
RARE = 1.0
"""Friction coefficient that few surfaces have: reasons that ask for more are listed last."""

Array = NDArray[Any]

SHORT = 1e-3
"""By what part of it an amount must stay short of the most that makes sense."""
HASTY = 200
"""Iterations from one start, all renewals of the guarded places included: most limits are no reason."""
SAME = 1e-4
"""Relative difference up to which two amounts are taken for the same point."""
BETTER = 1e-3
"""By what part of a number linear programming must improve it for its own to be taken."""


def out_of_reach(scene: GraspScene) -> Reason | None:
    """The exact test of distance: no shape at all can touch."""
    worst: tuple[float, float, float] | None = None
    for setup in scene.setups:
        needed = "on" in (*setup.middles, setup.tip) or len(scene.setups) == 1
        distance, reach = _distance(scene, setup), _reach(setup)
        if needed and distance > reach and (worst is None or distance - reach > worst[0]):
            worst = distance - reach, distance, reach
    if worst is None:
        return None
    missing, distance, reach = worst
    text = f"the object is out of reach: it is {distance:.4g} m from the base, {reach:.4g} m can be reached"
    repair = f"bring object and base nearer to each other, by {missing:.4g} m at least"
    return Reason("reach", "object.position", "m", distance, reach, text, repair)


def _reach(setup: FingerSetup) -> float:
    """How far from its base a finger can touch at most [m]."""
    length = setup.finger.rod.length
    middle = setup.middle_bounds[1] if "on" in setup.middles else length
    return min(middle, length) + setup.finger.thickness_radius


def _distance(scene: GraspScene, setup: FingerSetup) -> float:
    """Least distance between a base and the object's surface [m]; a lower bound where a pose is free."""
    x, y = setup.finger.base.position
    body = scene.object
    if body.free is None and setup.finger.base_free is None:
        return body.distance((x, y))
    c, s = math.cos(body.angle), math.sin(body.angle)
    com = (
        body.position[0] + c * body.com[0] - s * body.com[1],
        body.position[1] + s * body.com[0] + c * body.com[1],
    )
    turns = body.free is not None and body.free.angle is not None
    away = math.dist((x, y), com) - body.size if turns else body.distance((x, y))
    slack = math.dist(com, body.position) if turns else 0.0
    return away - slack - _shift(body.free, body.position) - _shift(setup.finger.base_free, (x, y))


def _shift(free: Freedom | None, at: tuple[float, float]) -> float:
    """How far a pose may move at most [m]."""
    if free is None:
        return 0.0
    spans = [max(b[1] - v, v - b[0]) if b else 0.0 for b, v in zip((free.x, free.y), at, strict=True)]
    return math.hypot(*spans)


def find_reasons(scene: GraspScene, search: Search) -> list[Reason]:
    """Find the limits each of which, relaxed alone, gives a grasp that the certificate confirms.

    Parameters
    ----------
    scene : GraspScene
    search : Search
        A search without success; its starts are used, and grasps that turn up after all are added to it.

    Returns
    -------
    list of Reason
        Those that the scene has a number for first, by how small a factor is missing.
    """
    repairs = Repairs(scene, search)
    starts: dict[str, list[Start]] = {}
    for relaxation in _sensible(scene):
        if search.budget.over:
            break
        starts[relaxation.name] = repairs.starts(relaxation)
        repairs.try_starts(relaxation, starts[relaxation.name][:FIRST])
    for relaxation in repairs.relaxations or [r for r in RELAXATIONS if r.name in starts]:
        repairs.go_on(relaxation)
        repairs.try_starts(relaxation, starts[relaxation.name][FIRST:MORE])
        if relaxation.name in repairs.found:
            repairs.try_starts(relaxation, repairs.starts(relaxation)[:MORE])
        repairs.go_on(relaxation)
    reasons = [_reason(scene, relaxation, repairs.settled(relaxation)) for relaxation in repairs.relaxations]
    return sorted(reasons, key=_rank)


def _reason(scene: GraspScene, relaxation: Relaxation, repair: Repair) -> Reason:
    limit, needed = relaxation.limit(scene), relaxation.value(scene, repair.amount)
    text, confirmed = relaxation.sentence(scene, repair.amount), None
    if repair.confirmed is not None:
        confirmed = relaxation.value(scene, repair.confirmed)
        text += f" ({confirmed:.4g} by linear programming at that posture)"
    advice = relaxation.advice(scene, repair.amount)
    return Reason(relaxation.name, relaxation.key, relaxation.unit, limit, needed, text, advice, confirmed)


def _rank(reason: Reason) -> tuple[bool, float, int]:
    """Limits that the scene has a number for come first, by the factor that they are off, and then in order of trial;
    a friction that few surfaces have comes after them.
    """
    order = [relaxation.name for relaxation in RELAXATIONS].index(reason.name)
    rare = reason.name == "friction" and reason.needed > RARE
    if rare or reason.limit <= 0.0 or reason.needed <= 0.0:
        return True, 0.0, order
    return False, round(abs(math.log(reason.needed / reason.limit)), 2), order


def _sensible(scene: GraspScene) -> Iterator[Relaxation]:
    for relaxation in RELAXATIONS:
        if relaxation.name == "mass" and scene.weight == 0.0:
            continue
        if relaxation.name == "tilt balance" and not _balances_tilt(scene):
            continue
        if relaxation.name == "clearance at the supports" and not scene.supports:
            continue
        if relaxation.name == "strain" and all(f.strain_limit is None for f in scene.named_fingers.values()):
            continue
        yield relaxation


def _balances_tilt(scene: GraspScene) -> bool:
    gravity = scene.gravity
    return isinstance(gravity, OutOfPlaneGravity) and gravity.tilt == "balance" and scene.object.mass > 0


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
            relaxed=(relaxation, amount),
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
