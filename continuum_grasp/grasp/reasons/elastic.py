"""The elastic problem of a scene without a grasp: limits have slacks, and the sum of their parts of a usual amount is
least; what it gives is verified.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.grasp.certificate.certificate import Certificate, certify_reached
from continuum_grasp.grasp.effort import FIRST_CAP, PATIENCE, STANDSTILL
from continuum_grasp.grasp.problem.relaxations import RelaxedLimit
from continuum_grasp.grasp.problem.solver_run import GraspAttempt
from continuum_grasp.grasp.search import GraspSearch
from continuum_grasp.grasp.starts.values import GraspStart
from continuum_grasp.grasp.values import NEAR, SAME
from continuum_grasp.scene import GraspScene, Robust

AGREEING = 3
"""Number of starts that end at the same point, or elsewhere after the least, before no more are tried."""
STEPS, HALVINGS = (0.01, 0.04, 0.16, 0.64), 2
"""Usual amounts by which a limit is relaxed further until a grasp holds for all errors and friction states, and how
often the last interval is halved.
"""

Limits = tuple[RelaxedLimit, ...]


@dataclass(frozen=True)
class Repair:
    """Relaxed limits, and the resulting grasp."""

    parts: Mapping[RelaxedLimit, float]  # by how many usual amounts
    arrays: Mapping[str, Array]  # of the grasp
    attempt: GraspAttempt  # that found it

    @property
    def total(self) -> float:
        """Sum of the parts, which is minimized."""
        return sum(self.parts.values())


class Elastic:
    """Relaxed limits that give a grasp where a search found none; ``found`` has the best of each set so far."""

    def __init__(self, scene: GraspScene, search: GraspSearch) -> None:
        self.scene = scene
        self.search = search
        self.found: dict[Limits, Repair] = {}
        self.totals: dict[Limits, list[float]] = {}  # of all starts, infinite where one gave no grasp

    def attempt(self, limits: Limits, begin: GraspStart | Repair) -> Repair | None:
        """Relax limits as little as possible, and retain the least amounts that are confirmed."""
        repair = self.relax(limits, begin)
        self.totals.setdefault(limits, []).append(math.inf if repair is None else repair.total)
        if repair is None:
            return None
        # Of several limits one that is not relaxed has no part in the reason.
        if len(limits) == 1 or min(repair.parts.values()) >= NEAR:
            repair = self._deep(repair)
            best = self.found.get(limits)
            if best is not None and repair.total >= best.total:
                return repair
            certificate = self.certificate(repair)
            if self.search.keep_clear(certificate):
                return self.attempt(limits, repair.attempt.start)
            if self._excused(certificate, repair.parts):
                self.found[limits] = repair
        return repair

    def relax(self, limits: Sequence[RelaxedLimit], begin: GraspStart | Repair) -> Repair | None:
        """Relax limits by the least sum of their parts of a usual amount, from a start or where some are relaxed; None
        where that gives no grasp.
        """
        scene, search = self.scene, self.search
        if search.budget.over:
            return None
        if isinstance(begin, Repair):
            start = begin.attempt.start
            parts = begin.parts
            x0 = begin.attempt.x
            options_at = 1
            patience = None
        else:
            # Where something repairs the scene already, further repairs are not worth what the first one is.
            patience = PATIENCE if self.found else None
            start = begin
            parts = dict.fromkeys(limits, 1.0)
            x0 = None
            options_at = 2
        solver = search.solver(start)
        usual = {limit: limit.start(scene) for limit in limits}
        relaxed = [(limit, amount * parts.get(limit, 0.0)) for limit, amount in usual.items()]
        ends = {"iterations": FIRST_CAP, "standstill": STANDSTILL, "patience": patience}
        options: dict[str, Any] = {"options_at": options_at, "relaxed": relaxed, "x0": x0, **ends}
        attempt = solver.run(scene, start, search.budget, **options)
        if not np.isfinite(attempt.x).all() or attempt.violations:
            return None
        amounts = {limit: solver.given(scene, attempt.x, limit) for limit in limits}
        if any(amount >= limit.sensible(scene) for limit, amount in amounts.items()):
            return None
        parts = {limit: amount / usual[limit] for limit, amount in amounts.items()}
        return Repair(parts, solver.arrays(scene, attempt), attempt)

    def relaxed(self, parts: Mapping[RelaxedLimit, float], spare: float = 0.0) -> GraspScene:
        """The scene with limits relaxed by parts of their usual amounts."""
        scene = self.scene
        for limit, part in parts.items():
            scene = limit.relaxed(scene, part * limit.start(self.scene) * (1.0 + spare * limit.spare))
        return scene

    def certificate(self, repair: Repair) -> Certificate:
        """The verification of a repair, in the scene with just its amounts."""
        return certify_reached(self.relaxed(repair.parts, spare=float(len(repair.parts) > 1)), repair.arrays)

    @staticmethod
    def _excused(certificate: Certificate, limits: Iterable[RelaxedLimit]) -> bool:
        """Whether a grasp is confirmed, but for what relaxed limits excuse."""
        excuses = [limit.excuses for limit in limits if limit.excuses is not None]
        return all(any(excuse(check.name) for excuse in excuses) for check in certificate.failed)

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

    # -- for all errors and friction states --------------------------------------------------------------------------

    def as_demanded(self, repair: Repair) -> Repair | None:
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

        scene, search = self.scene, self.search
        if search.budget.over:
            return None
        greatest = {limit: limit.sensible(scene) / limit.start(scene) for limit in repair.parts}
        parts = {limit: min(part + step, greatest[limit]) for limit, part in repair.parts.items()}
        eased = self.relaxed(parts)
        start = repair.attempt.start
        bounds = scene.robust or Robust.model_construct()
        solver = search.solver(start)
        attempt = solver.run(eased, start, search.budget, options_at=2, x0=repair.attempt.x, iterations=FIRST_CAP)
        if not attempt.converged or not np.isfinite(attempt.x).all():
            return None
        exchange = find_robust(eased, bounds, solver.arrays(eased, attempt), search.budget)
        return replace(repair, parts=parts, arrays=exchange.arrays) if exchange.holds else None


def settled(totals: list[float]) -> bool:
    """Whether several sums are the least, or so many came after it that are not less."""
    least = min(totals, default=math.inf)
    alike = [same(total, least) for total in totals]
    return least < math.inf and (sum(alike) >= AGREEING or len(alike) - alike.index(True) > AGREEING)


def same(first: float, other: float) -> bool:
    """Whether two sums of parts are the same."""
    return math.isclose(first, other, rel_tol=SAME)
