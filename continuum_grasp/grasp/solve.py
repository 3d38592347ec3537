"""The search for a grasp: starts, solver, verification, verdict."""

from __future__ import annotations

import math
import os
import re
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypeVar, overload

from continuum_grasp.base import Interrupted, SolverError, amount_text, check_arguments, interruptible
from continuum_grasp.grasp.certificate.certificate import certify
from continuum_grasp.grasp.changes import (
    FIRST,
    NONE,
    asked_tolerance,
    resolve_elements,
    sensitivities,
    with_fine,
    with_finer_outline,
    with_outline,
)
from continuum_grasp.grasp.effort import OPEN
from continuum_grasp.grasp.modes import with_elements
from continuum_grasp.grasp.problem.relaxations import gives_bending_range, gives_elements, with_bending_range
from continuum_grasp.grasp.problem.solver_run import OVERDETERMINED, GraspAttempt
from continuum_grasp.grasp.reasons.diagnosis import Repairs, out_of_reach
from continuum_grasp.grasp.result import GraspResult, flawed
from continuum_grasp.grasp.search import GraspSearch
from continuum_grasp.grasp.starts.supports import object_outlines, settle, touching_supports
from continuum_grasp.grasp.stations import find_station_reasons, search_stations, stabilize, without_stations
from continuum_grasp.grasp.tried import Tried
from continuum_grasp.grasp.values import (
    DRIVEN_AWAY,
    OPENED,
    REFUTED,
    STEADIER,
    STEADIER_IN_SPACE,
    GraspStatus,
    Reason,
    force_text,
    force_units,
    tension_of,
)
from continuum_grasp.nlp import Budget, Violation
from continuum_grasp.scene import ONE_TURN, GraspScene, HandScene, scene_of

if TYPE_CHECKING:
    from continuum_grasp.grasp.hand.result import HandResult

_Listener = Callable[[str], None] | None


@overload
def optimize_grasp(
    scene: HandScene, *, raise_on_failure: bool = ..., fine: bool = ..., progress: _Listener = ...
) -> HandResult: ...
@overload
def optimize_grasp(
    scene: GraspScene, *, raise_on_failure: bool = ..., fine: bool = ..., progress: _Listener = ...
) -> GraspResult: ...
@overload
def optimize_grasp(
    scene: str | os.PathLike[str], *, raise_on_failure: bool = ..., fine: bool = ..., progress: _Listener = ...
) -> Any: ...
@interruptible()
@check_arguments
def optimize_grasp(
    scene: GraspScene | HandScene | str | os.PathLike[str],
    *,
    raise_on_failure: bool = True,
    fine: bool = False,
    progress: Callable[[str], None] | None = None,
) -> Any:
    """Find the best grasp of an object by the fingers of a scene, and verify it.

    Parameters
    ----------
    scene : GraspScene, HandScene or path-like
        The scene, in the plane or of a hand in space, or its YAML file. Where it has a ``fidelity.tolerance``, the
        cheapest model that satisfies it is found by comparison with a fine one, and the result's scene has it. Where it
        has ``robust``, the grasp holds for all those errors, and ``robustness`` of the result has its
        trials.
    raise_on_failure : bool, optional
        Raise where no verified grasp holds the object; False: return the result with its ``status``.
    fine : bool, optional
        Solve once more with a fine model, and report the changes in the result's ``fine``; where the object is an
        outline, also with a polygon nearer to its drawing, in ``outline``. Takes some seconds each. Not for a scene
        with ``robust`` or tendons whose friction states must not matter.
    progress : callable, optional
        Takes a line of text now and then: the best so far, and the remaining work.

    Returns
    -------
    GraspResult or HandResult
        The best verified grasp found; its ``exploration`` describes the search. ``optimal`` is the
        best local optimum next to all exact rods that hold the object, but for those that take clearly more tension,
        and none of them takes clearly less; or a bound proves it to be the least.

    Raises
    ------
    InputError
        The scene is inconsistent, or its file cannot be read.
    SolverError
        There is no verified grasp, or only an unstable one (``status`` unstable) where the scene requires a stable
        one; ``result`` of the error holds the outcome.
    Interrupted
        Ctrl-C was pressed before any grasp was verified. With one, that is the result, and its message
        reports the interruption.

    Examples
    --------
    A finger holds a mug against a palm; tensions and forces in N:

    >>> import continuum_grasp as cg
    >>> grasp = cg.optimize_grasp("configs/grasp/mug_arcs.yaml")
    >>> grasp.status.value, round(grasp.tension, 1), len(grasp.contacts)
    ('feasible', 42.3, 3)
    """
    asked = scene_of(scene, (GraspScene, HandScene))
    if isinstance(asked, HandScene):
        from continuum_grasp.grasp.hand.solve import hold

        return _raised(hold(asked, progress), raise_on_failure)
    return _raised(_held(asked, fine, progress), raise_on_failure)


def _held(scene: GraspScene, fine: bool, progress: _Listener) -> GraspResult:
    """The best grasp in the plane, for errors and of a fine model where these are asked for."""
    budget = Budget.of(scene.solver, progress)
    tolerance = asked_tolerance(scene)
    if tolerance is None:
        first = _Verdict(scene, budget)
        result = _for_errors(first.result(), first.search, budget)
    else:
        result = _for_errors(*_within_tolerance(scene, tolerance, budget), budget)
    result = with_outline(result)
    if fine and not scene.is_robust and result.solved and not result.statistics["interrupted"]:
        result = _compared(result, tolerance is None, budget)
    return result


_AnyResult = TypeVar("_AnyResult", GraspResult, "HandResult")


def _raised(result: _AnyResult, raise_on_failure: bool) -> _AnyResult:
    """The result, or the error that there is none where it is to be raised."""
    if raise_on_failure and not result.solved:
        raise SolverError(
            result.message,
            status=result.status.value,
            violated=result.violated if isinstance(result, GraspResult) else (),
            advice=result.advice,
            result=result,
        )
    return result


def _compared(result: GraspResult, elements: bool, budget: Budget) -> GraspResult:
    """The result compared with a fine model, where its ``elements`` are not compared yet, and a finer outline."""
    try:
        if result.outline is not None and result.outline.finer > result.outline.corners:
            budget.tell(f"held with {amount_text(result.tension, 'N', '.4g')}; compared with a finer outline")
            result = with_finer_outline(result, result.outline, budget, lambda scene: _Verdict(scene, budget).result())
        if elements:
            budget.tell(f"held with {amount_text(result.tension, 'N', '.4g')}; compared with a fine model")
            result = with_fine(result, budget)
    except KeyboardInterrupt:
        return replace(result, statistics={**result.statistics, "fine_model": "interrupted"})
    return result


def _for_errors(result: GraspResult, search: GraspSearch, budget: Budget) -> GraspResult:
    """The grasp that holds for the errors of a scene that names some and for all friction states of its tendons, next
    to the one found or others of its search.
    """
    if not result.scene.is_robust or not result.verified or result.statistics["interrupted"]:
        return result
    from continuum_grasp.grasp.robust.solve import with_robust

    budget.tell(f"held with {amount_text(result.tension, 'N', '.4g')} as it is; errors and friction states are tried")
    try:
        return with_robust(result, search, budget)
    except KeyboardInterrupt:
        message = f"{result.message}; the search was interrupted before a grasp for all errors and friction states"
        return replace(result, status=GraspStatus.FEASIBLE if result.solved else result.status, message=message)


def _within_tolerance(scene: GraspScene, tolerance: float, budget: Budget) -> tuple[GraspResult, GraspSearch]:
    """Find the grasp with the cheapest model that satisfies a tolerance; its search."""
    verdict = _Verdict(with_elements(scene, FIRST), budget)
    first = verdict.result()
    if not first.verified or first.statistics["interrupted"]:
        return first, verdict.search
    try:
        resolved, note, change = resolve_elements(scene, first, tolerance, budget)
    except KeyboardInterrupt:
        return replace(
            first, statistics={**first.statistics, "interrupted": True, "fidelity": "interrupted"}
        ), verdict.search
    result = first
    if resolved != first.scene and not budget.over:
        verdict = _Verdict(resolved, budget)
        result = verdict.result()
    result = replace(result, fine=change, statistics={**result.statistics, "fidelity": note})
    return flawed(result, REFUTED) if note.startswith(f"the fine model: {NONE}") else result, verdict.search


MOST_ELEMENTS = 16
"""Elements per finger up to which the program doubles them: half a turn each is eight turns."""


class _Verdict:
    """A search with one model, and its verdict."""

    def __init__(
        self, scene: GraspScene, budget: Budget, chosen_range: bool = False, chosen_elements: bool = False
    ) -> None:
        self.scene, self.budget = scene, budget
        # By the program, not by the user, so that it may take others.
        self._chosen_range = chosen_range or not gives_bending_range(scene)
        self._chosen_elements = chosen_elements or not gives_elements(scene)
        self.began = time.monotonic()
        self.search = GraspSearch(scene, budget)
        has_stations = any(setup.stations for setup in scene.setups)
        # Of the scene with one middle contact in place of stations, where there are any.
        self._before = GraspSearch(without_stations(scene), budget) if has_stations else None
        plain = self._before or self.search
        self.repairs = Repairs(plain.scene, plain)
        self.interrupted = False

    def result(self) -> GraspResult:
        """Search and judge; on Ctrl-C, judge what there is."""
        try:
            return self._judged()
        except KeyboardInterrupt:
            self.interrupted = True
            best = self._best()
            if best is None:
                tried = f"{len(self.search.tried)} starts tried to the end"
                raise Interrupted(f"interrupted before a grasp was found ({tried})") from None
            return self._solved(best)

    def _best(self) -> Tried | None:
        return self.search.best or self.search.fallback or self.search.unstable

    def _judged(self) -> GraspResult:
        far = out_of_reach(self.scene)
        if far is not None:
            return self._infeasible([far], None)
        search = self.search
        if self._before is None:
            search.run()
        else:
            search.run_before(self._before)
            search_stations(search, self._before)
        stabilize(search)
        best = self._best()
        if self._are_too_few(best):
            return self._refined(best)
        if best is not None:
            return self._solved(best)
        closest = min(search.tried, key=lambda t: t.attempt.badness, default=None)
        self.budget.tell("no grasp found; looking for a change that allows one")
        reasons = self._reasons()
        if not reasons and self._best() is None:
            reasons = self._reasons(further=True)
        best = self._best()
        if best is not None:  # feasible after all, though no start saw it
            return self._solved(best)
        # Reasons found before the clock stopped the search may not be the ones that matter.
        if reasons and not self.budget.stopped:
            # What the model cannot follow is no impossibility, where the user did not choose how far that is.
            bent = [reason for reason in reasons if self._chosen_range and "bending range" in reason.title]
            if any(reason is reasons[0] or not reason.also for reason in bent):
                return self._with_wider_model(bent)
            return self._infeasible([reason for reason in reasons if reason not in bent], closest)
        return self._unsolved(closest)

    def _with_wider_model(self, reasons: Sequence[Reason]) -> GraspResult:
        """The verdict with a model that bends further, for reasons that include its bending range."""
        bent = [part.needed for reason in reasons for part in (reason, *reason.also) if part.name == "bending range"]
        bending_range = max(setup.bending_range for setup in self.scene.setups)
        if max(bent) <= ONE_TURN:
            wide = min(max(2.0 * bending_range, max(bent)), ONE_TURN)
            note, scene = f"fidelity.bending_range of {wide:.4g} rad", with_bending_range(self.scene, wide)
        else:
            if self._elements > MOST_ELEMENTS:
                return self._unsolved(None)
            return self._with_more_elements(f"with {bending_range:.4g} rad per element there is no grasp")
        return self._again(scene, f"{note}: with {bending_range:.4g} rad per element there is no grasp")

    def _are_too_few(self, best: Tried | None) -> bool:
        """Whether more elements than the program chose may hold with less than the best grasp, or at all."""
        if not self._chosen_elements or self._elements >= MOST_ELEMENTS or self.budget.over:
            return False
        if best is None:
            return self.search.exact
        return not math.isnan(self.search.exact_less) or best.certificate.model_error.is_large

    def _refined(self, best: Tried | None) -> GraspResult:
        """The verdict with more elements, which exact rods ask for, unless the best grasp with fewer is better."""
        search, why = self.search, "exact rods take other forces"
        if best is None:
            return self._with_more_elements(why)
        try:
            result = self._with_more_elements(why)
        except Interrupted:
            self.interrupted = True
            return self._solved(best)
        doubted = not best.acceptable or best.certificate.model_error.is_large
        if result.solved and (doubted or result.tension <= tension_of(self.scene, best.arrays)):
            return result
        self.search = search
        return self._solved(best)

    def _with_more_elements(self, why: str) -> GraspResult:
        """The verdict with twice as many elements, and why that is asked."""
        per_segment = max(2 * s.elements // (len(s.middles) + 1) for s in self.scene.setups)
        scene = with_elements(self.scene, per_segment, as_curved=not self._chosen_range)
        return self._again(scene, f"{max(setup.elements for setup in scene.setups)} elements: {why}")

    def _again(self, scene: GraspScene, note: str) -> GraspResult:
        """The verdict with another model that the program chose."""
        other = _Verdict(scene, self.budget, chosen_range=self._chosen_range, chosen_elements=self._chosen_elements)
        result, self.search = other.result(), other.search
        return replace(result, statistics={**result.statistics, "fidelity": note})

    def _reasons(self, further: bool = False) -> list[Reason]:
        """Limits that are in the way, alone or two at once; ``further`` ones where those at sight do not convince."""
        repairs, before = self.repairs, self._before
        # A limit that is relaxed may be the distance of fingers.
        self.search.keep_all_apart()
        repairs.look_further() if further else repairs.look()
        if before is None:
            return repairs.reasons()
        reasons = find_station_reasons(self.search, before, repairs)
        search_stations(self.search, before)
        return reasons

    # -- verdicts --------------------------------------------------------------------------------------------

    def _solved(self, best: Tried) -> GraspResult:
        steadied = best.solver.problem.spec.steadied
        unit, tension = force_units(best.arrays)[0], tension_of(self.scene, best.arrays)
        held = f"a sum of tensions of {force_text(best.arrays, tension, unit)} {unit}"
        notes, why = list(self._notes(best)), best.certificate.stability.why
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
        if self._before is not None:
            yield f"a local search over {self.search.exploration.modes} sets chose the stations that press"
        search, explored = self.search, self.search.exploration
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
            held = amount_text(explored.exact_less, "N", ".4g")
            yield f"exact rods hold with {held} in all, but {self._elements} elements per finger cannot follow them"
        if best.certificate.model_error.is_large:
            yield f"{best.certificate.model_error}: {self._elements} elements per finger are too few"
        if self.budget.cut:
            yield f"{self._cut()}, so it did not try all starts"
        if self.interrupted:
            yield "you interrupted the search, so it did not try all starts"

    def _infeasible(self, reasons: list[Reason], closest: Tried | None) -> GraspResult:
        advice = "Any one of these repairs it: " + "; ".join(reason.repair for reason in reasons) + "."
        message = reasons[0].text
        if len(self.scene.setups) > 2 and not self.search.impossible:
            # One of ten random scenes of three fingers is held from one start of a hundred.
            message += f"; the search tried {len(self.search.tried)} samples of all postures"
            message += f" ({self._more} tries more)" if self._more else ""
        return self._failed(GraspStatus.INFEASIBLE, message, advice, closest, reasons)

    def _unsolved(self, closest: Tried | None) -> GraspResult:
        if self.budget.stopped:
            message = f"{self._cut()} before it reached a verdict"
            return self._failed(GraspStatus.STOPPED, message, "Raise solver.time_limit, or free the machine.", closest)
        if self.budget.cut:
            message, advice = f"{self._cut()} without a verified grasp", "Raise solver.max_total_iterations."
        elif self.search.exact:
            held = amount_text(min(candidate.start.estimate for candidate in self.search.held_exactly), "N", ".4g")
            message = f"exact rods hold with {held} in all, but {self._elements} elements per finger cannot follow them"
            advice = "Raise fidelity.elements, or omit it: the program then uses as many as it needs."
        elif curled := sorted(finger for finger, other in self.search.apart if finger == other):
            message = f"no grasp was found in which {', '.join(curled)} does not pass through itself"
            advice = "Use a shorter finger, or a base where it need not curl up: base_free lets the search find one."
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

    @property
    def _elements(self) -> int:
        """Most elements of a finger."""
        return max(setup.elements for setup in self.scene.setups)

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


def _broken(violations: Sequence[Violation]) -> tuple[str, ...]:
    """Violated constraints in words, the worst first; of those that several disturbances break, the worst alone."""
    kinds = [re.sub(r"^(disturbed .*|sticking contact, .*), \d+$", r"\1", violation.name) for violation in violations]
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
