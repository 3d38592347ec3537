"""Verdicts of a search for a grasp with one model, and their words: what was found, why something better may have been
missed, what stands in the way, and what to do.
"""

from __future__ import annotations

import math
import re
import time
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from continuum_grasp.base import amount_text
from continuum_grasp.grasp.certificate.certificate import certify
from continuum_grasp.grasp.changes import sensitivities
from continuum_grasp.grasp.effort import OPEN
from continuum_grasp.grasp.problem.solver_run import OVERDETERMINED, GraspAttempt
from continuum_grasp.grasp.result import GraspResult
from continuum_grasp.grasp.search import GraspSearch
from continuum_grasp.grasp.starts.supports import object_outlines, settle, touching_supports
from continuum_grasp.grasp.tried import Tried
from continuum_grasp.grasp.values import (
    DRIVEN_AWAY,
    OPENED,
    STEADIER,
    STEADIER_IN_SPACE,
    GraspStatus,
    Reason,
    force_text,
    force_units,
    tension_of,
)
from continuum_grasp.nlp import Budget, Violation
from continuum_grasp.scene import GraspScene

_CASE = r"^((?:disturbed|pushed) .*|(?:sticking contact|constant tensions|locked tendons), .*), (?:[+-]?\d+|push [xy])$"
"""Name of a constraint under one of several disturbances; the group is its kind."""


def most_elements(scene: GraspScene) -> int:
    """Most elements of a finger."""
    return max(setup.elements for setup in scene.setups)


@dataclass(frozen=True)
class SearchVerdict:
    """A search with one model that is over, before its result is made."""

    scene: GraspScene
    search: GraspSearch
    budget: Budget
    began: float
    """``time.monotonic()`` at its begin [s]."""
    by_stations: bool
    """Whether stations of the fingers were chosen, too."""
    interrupted: bool

    def solved(self, best: Tried) -> GraspResult:
        """Result with the best grasp."""
        steadied = best.solver.problem.spec.steadied
        unit = force_units(best.arrays)[0]
        tension = tension_of(self.scene, best.arrays)
        held = f"a sum of tensions of {force_text(best.arrays, tension, unit)} {unit}"
        if self.search.pushed:
            held += f" against any push up to {amount_text(best.certificate.push, 'N', '.3g')}"
        notes = list(self._notes(best))
        why = best.certificate.stability.why
        advice = STEADIER_IN_SPACE if why else STEADIER
        status = GraspStatus.FEASIBLE if notes else GraspStatus.OPTIMAL
        allowed = ""
        if best.certificate.stability.stable:
            verdict = f"held with {held}"
        elif best.acceptable:
            verdict, allowed = f"held with {held}{why}", OPENED
        else:
            status = GraspStatus.UNSTABLE
            verdict = f"in balance with {held}, {DRIVEN_AWAY}{why}"
        return GraspResult(
            self.scene,
            status,
            "; ".join([verdict, *notes]) + allowed,
            best.arrays,
            best.certificate,
            # The eigenvalue's own dependence on the scene's numbers is not in the problem.
            sensitivity=sensitivities(self.scene, best) if best.attempt.optimal and not steadied else (),
            advice=" ".join(part for part in (self._support_note(), "" if best.acceptable else advice) if part),
            statistics=self._statistics(best.attempt),
            exploration=self.search.exploration,
            lower_bound=self.search.bound,
        )

    def _notes(self, best: Tried) -> Iterator[str]:
        """Why something better may have been missed."""
        if best is self.search.fallback and self.search.best is None:
            yield "this grasp has the least tension; no grasp was found for the objective"
        elif not best.attempt.optimal and not self.search.proven:
            yield f"the solver stopped early ({best.attempt.why_it_ended})"
        if self.by_stations:
            yield f"a local search over {self.search.exploration.modes} sets chose the stations that press"
        search = self.search
        explored = self.search.exploration
        if search.excess > OPEN and search.left_out:
            yield (
                f"the greatest normal force is {search.excess:.0%} above its lower bound, and {search.left_out} starts "
                "were skipped or led to no grasp"
            )
        if explored.sampled and not search.proven:
            yield f"the search only sampled postures for {explored.sampled} of {explored.modes} sets of contacts"
        if explored.untried and search.best is not None and not search.proven:
            none = f"the search skipped {explored.untried} of {explored.settled} postures that hold the object"
            yield f"{none} ({self._more} tries them)" if self._more else none
        if not math.isnan(explored.exact_less):
            yield self._too_coarse(explored.exact_less)
        if best.certificate.model_error.is_large:
            yield f"{best.certificate.model_error}: {most_elements(self.scene)} elements per finger are too few"
        if self.budget.cut:
            yield f"{self._cut()}, so it did not try all starts"
        if self.interrupted:
            yield "you interrupted the search, so it did not try all starts"

    def infeasible(self, reasons: list[Reason], closest: Tried | None) -> GraspResult:
        """Result without a grasp, with what stands in the way."""
        advice = "Any one of these repairs it: " + "; ".join(reason.repair for reason in reasons) + "."
        message = reasons[0].text
        if len(self.scene.setups) > 2 and not self.search.impossible:
            # One of ten random scenes of three fingers is held from one start of a hundred.
            message += f"; the search tried {len(self.search.tried)} samples of all postures"
            message += f" ({self._more} tries more)" if self._more else ""
        return self._failed(GraspStatus.INFEASIBLE, message, advice, closest, reasons)

    def gives_way(self, closest: Tried | None) -> GraspResult:
        """Return the result if contacts hold the object, but bear no push."""
        outcomes = {t.attempt.outcome for t in self.search.tried}
        message = f"no grasp was found that bears a push in every direction. {self._fruitless(outcomes)}"
        advice = "Let the object be touched from other sides: add a contact, a support or a finger."
        return self._failed(GraspStatus.NOT_SOLVED, message, advice, closest)

    def unsolved(self, closest: Tried | None) -> GraspResult:
        """Result without a grasp and without a reason: the search ended, or no single limit explains it."""
        if self.budget.stopped:
            message = f"{self._cut()} before it reached a verdict"
            return self._failed(GraspStatus.STOPPED, message, "Raise solver.time_limit, or free the machine.", closest)
        if self.budget.cut:
            message, advice = f"{self._cut()} without a verified grasp", "Raise solver.max_total_iterations."
        elif self.search.exact:
            message = self._too_coarse(min(candidate.start.estimate for candidate in self.search.held_exactly))
            advice = "Raise fidelity.elements, or omit it: the program then uses as many as it needs."
        elif crossed := sorted(self.search.maps.apart):
            message, advice = _overlapping(crossed)
        elif closest is not None and closest.attempt.optimal:
            names = ", ".join(check.name for check in closest.certificate.failed)
            message = f"the solver converged, but the independent check rejects: {names}"
            advice = "Raise fidelity.elements or fidelity.accuracy."
        else:
            outcomes = {t.attempt.outcome for t in self.search.tried}
            message = (
                f"No grasp found. {self._fruitless(outcomes)}. No single limit explains it, and no two limits together."
            )
            first = f"Try {self._more}, which tries more starts. Otherwise" if self._more else "Probably"
            advice = (
                f"{first} the geometry is the cause: move the base or the object (base_free lets the search move the "
                "base), or let the middle contact be elsewhere (contacts.middle_range)."
            )
            if outcomes == {OVERDETERMINED}:
                advice = "Add a contact: a support that the object lies against, or another finger."
        return self._failed(GraspStatus.NOT_SOLVED, message, advice, closest)

    def _failed(
        self, status: GraspStatus, message: str, advice: str, closest: Tried | None, reasons: Sequence[Reason] = ()
    ) -> GraspResult:
        # What the object needs says more than where the search gave up.
        repaired = reasons[0].arrays if reasons else {}
        near = None if repaired else closest
        certificate = certify(self.scene, repaired) if repaired else None
        return GraspResult(
            self.scene,
            status,
            message,
            arrays=repaired if near is None else near.arrays,
            certificate=certificate if near is None else near.certificate,
            violated=() if near is None else _broken(near.attempt.violations),
            reasons=tuple(reasons),
            advice=" ".join(part for part in (self._support_note(), advice) if part),
            statistics=self._statistics(None if closest is None else closest.attempt),
            exploration=self.search.exploration,
        )

    def _too_coarse(self, tension: float) -> str:
        """Say that exact rods hold the object with a sum of tensions [N], and the model cannot."""
        held = amount_text(tension, "N", ".4g")
        count = most_elements(self.scene)
        return f"exact rods hold with {held} in all, but {count} elements per finger cannot follow them"

    def _fruitless(self, outcomes: Collection[str]) -> str:
        """Starts that led to no grasp, in words."""
        count = len(self.search.tried)
        if not count:
            return "No posture touches the object as the scene asks"
        tried = f"{count} starting postures were tried" if count > 1 else "One starting posture was tried"
        if set(outcomes) == {OVERDETERMINED}:
            return f"{tried}; their contacts leave fewer unknowns than there are forces to balance"
        return f"{tried}; none reached contact and force balance"

    @property
    def _more(self) -> str:
        """Key and value with which the search tries more; empty where nothing does."""
        return "" if self.scene.solver.effort == "thorough" else "solver.effort: thorough"

    def _cut(self) -> str:
        """Limit that cut the search short, in words."""
        options = self.scene.solver
        if self.budget.stopped:
            return f"the clock stopped the search after {options.time_limit:g} s (solver.time_limit)"
        return f"all {options.max_total_iterations} iterations were used up (solver.max_total_iterations)"

    def _support_note(self) -> str:
        gaps = ((body.name, self.scene.gap_range(body)[0]) for body in self.scene.places)
        return " ".join(
            f"The object is {gap:.4g} m away from {name}, so {name} carries nothing{_place_at(self.scene, name)}."
            for name, gap in gaps
            if gap > self.scene.touching_gap
        )

    def _statistics(self, chosen: GraspAttempt | None) -> dict[str, Any]:
        attempts = [t.attempt for t in self.search.tried]
        return {
            "build_seconds": self.search.build_seconds,
            "start_seconds": self.search.start_seconds,
            "solver_seconds": sum(a.seconds for a in attempts),
            "total_seconds": time.monotonic() - self.began,
            "interrupted": self.interrupted,
            "cut_short": self.budget.cut,
            "total_iterations": self.scene.solver.max_total_iterations - self.budget.left,
            "iterations": None if chosen is None else chosen.iterations,
            "start": None if chosen is None else chosen.start.label,
            "attempts": [
                {
                    "start": a.start.label,
                    "contacts": sorted(a.start.contacts),
                    "outcome": a.outcome,
                    "iterations": a.iterations,
                    "seconds": a.seconds,
                    "objective": a.objective,
                    "greatest_violation": a.badness,
                }
                for a in attempts
            ],
        }


def _overlapping(crossed: Sequence[tuple[str, str]]) -> tuple[str, str]:
    """Say that fingers of all grasps found pass through each other, or of the same name through themselves, and what to
    do.
    """
    curled = [f"{finger} passes through itself" for finger, other in crossed if finger == other]
    met = [f"{finger} and {other} pass through each other" for finger, other in crossed if finger != other]
    advice = []
    if curled:
        advice.append("Use a shorter finger, or a base where it need not curl up: base_free lets the search find one.")
    if met:
        advice.append("Move the bases apart, or state overlap: allow where the fingers lie at different heights.")
    return f"every grasp that was found overlaps: {', '.join([*curled, *met])}", " ".join(advice)


def _broken(violations: Sequence[Violation]) -> tuple[str, ...]:
    """Violated constraints in words, the worst first; of those that several disturbances break, the worst alone."""
    kinds = [re.sub(_CASE, r"\1", violation.name) for violation in violations]
    return tuple(str(violation) for k, violation in enumerate(violations) if kinds[k] not in kinds[:k])


def _place_at(scene: GraspScene, support: str) -> str:
    """Position of a fixed object at which it touches one more support, in words; empty where there is none within its
    size.
    """
    (x, y, angle), size = scene.object.pose, scene.object.size
    on = touching_supports(scene, scene.object.pose) | {support}
    within = [(x - size, x + size), (y - size, y + size), (angle, angle)]
    fixed = scene.object.free is None
    pose = settle(scene, object_outlines(scene), on, scene.object.pose, within) if fixed else None
    return "" if pose is None else f"; it touches at object.position = [{pose[0]:.9g}, {pose[1]:.9g}]"
