"""The search for a grasp: with one model, with as many elements as it needs, for errors, and of a fine model."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypeVar, overload

from continuum_grasp.base import Interrupted, SolverError, amount_text, check_arguments, interruptible
from continuum_grasp.grasp.certificate.certificate import certify
from continuum_grasp.grasp.changes import (
    FIRST,
    NONE,
    asked_tolerance,
    resolve_elements,
    with_fine,
    with_finer_outline,
)
from continuum_grasp.grasp.modes import with_elements
from continuum_grasp.grasp.problem.relaxations import gives_bending_range, gives_elements, with_bending_range
from continuum_grasp.grasp.reasons.diagnosis import Repairs, out_of_reach, push_reason
from continuum_grasp.grasp.result import GraspResult, flawed, with_outline
from continuum_grasp.grasp.search import GraspSearch
from continuum_grasp.grasp.stations import find_station_reasons, search_stations, stabilize, without_stations
from continuum_grasp.grasp.tried import Tried
from continuum_grasp.grasp.values import (
    NEAR,
    PUSH_SHARE,
    REFUTED,
    GraspStatus,
    Reason,
    tension_of,
    unloaded_words,
)
from continuum_grasp.grasp.verdict import SearchVerdict, most_elements
from continuum_grasp.nlp import Budget
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
        The scene, in the plane or of a hand in space, or its YAML file. With ``fidelity.tolerance``, the search takes
        the cheapest model that satisfies it, by comparison with a fine one, and the result's scene has this model. With
        ``robust``, the grasp holds for all those errors, and ``robustness`` of the result has the trials.
    raise_on_failure : bool, optional
        Raise an error if no verified grasp holds the object; False: return the result with its ``status``.
    fine : bool, optional
        Solve once more with a fine model, and report the changes in the result's ``fine``; for an outline also with
        a polygon nearer to its drawing, or larger by the noise of its points, in ``outline``. Each takes some seconds.
        Not for a scene with ``robust`` or ``friction_states: any``.
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
    if scene.unloaded:
        return _held_unloaded(scene, fine, budget)
    return _held_within(scene, fine, budget)


def _held_unloaded(scene: GraspScene, fine: bool, budget: Budget) -> GraspResult:
    """Find the best grasp of an unloaded object: it bears a share of the greatest push."""
    tolerance = asked_tolerance(scene)
    sought = (scene if tolerance is None else with_elements(scene, FIRST)).replaced(objective="greatest_push")
    budget.tell("nothing loads the object: searching for the greatest push that a grasp bears")
    strongest = _ModelSearch(sought, budget).result()
    if not strongest.verified or strongest.statistics["interrupted"]:
        return replace(strongest, scene=scene, message=f"nothing loads the object, but a push may: {strongest.message}")
    # An unstable one may be stable with less force.
    borne = sought if strongest.solved else sought.replaced(stability="ignore")
    greatest = certify(borne, strongest.arrays).push
    if greatest <= NEAR * max(setup.tip_force for setup in scene.setups):  # as small as a negligible weight
        most = amount_text(greatest, "N", ".3g")
        message = f"nothing loads the object, and the greatest push that any found grasp bears is negligible: {most}"
        return replace(strongest, scene=scene, status=GraspStatus.NOT_SOLVED, message=message)
    pushed = scene.replaced(contacts=scene.contacts.replaced(push=PUSH_SHARE * greatest))
    result = _held_within(pushed, fine, budget)
    return replace(result, message=f"{result.message}; {unloaded_words(greatest)}")


def _held_within(scene: GraspScene, fine: bool, budget: Budget) -> GraspResult:
    """Find the best grasp of a scene with loads on the object."""
    tolerance = asked_tolerance(scene)
    if tolerance is None:
        first = _ModelSearch(scene, budget)
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
        outline = result.outline
        if outline is not None and (outline.noise or outline.finer > outline.corners):
            other = "a larger outline" if outline.noise else "a finer outline"
            budget.tell(f"held with {amount_text(result.tension, 'N', '.4g')}; compared with {other}")
            result = with_finer_outline(result, outline, budget, lambda scene: _ModelSearch(scene, budget).result())
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
        robust = with_robust(result, search, budget)
        spent = result.scene.solver.max_total_iterations - budget.left
        return replace(robust, statistics={**robust.statistics, "total_iterations": spent})
    except KeyboardInterrupt:
        message = f"{result.message}; the search was interrupted before a grasp for all errors and friction states"
        return replace(result, status=GraspStatus.FEASIBLE if result.solved else result.status, message=message)


def _within_tolerance(scene: GraspScene, tolerance: float, budget: Budget) -> tuple[GraspResult, GraspSearch]:
    """Find the grasp with the cheapest model that satisfies a tolerance; its search."""
    of_model = _ModelSearch(with_elements(scene, FIRST), budget)
    first = of_model.result()
    if not first.verified or first.statistics["interrupted"]:
        return first, of_model.search
    try:
        resolved, note, change = resolve_elements(scene, first, tolerance, budget)
    except KeyboardInterrupt:
        return replace(
            first, statistics={**first.statistics, "interrupted": True, "fidelity": "interrupted"}
        ), of_model.search
    result = first
    if resolved != first.scene and not budget.over:
        of_model = _ModelSearch(resolved, budget)
        result = of_model.result()
    result = replace(result, fine=change, statistics={**result.statistics, "fidelity": note})
    return flawed(result, REFUTED) if note.startswith(f"the fine model: {NONE}") else result, of_model.search


MOST_ELEMENTS = 16
"""Elements per finger up to which the program doubles them: half a turn each is eight turns."""


class _ModelSearch:
    """A search with one model."""

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
            return self._verdict.solved(best)

    @property
    def _verdict(self) -> SearchVerdict:
        """The verdict on what was searched so far."""
        by_stations = self._before is not None
        return SearchVerdict(self.scene, self.search, self.budget, self.began, by_stations, self.interrupted)

    def _best(self) -> Tried | None:
        return self.search.best or self.search.fallback or self.search.unstable

    def _judged(self) -> GraspResult:
        far = out_of_reach(self.scene)
        if far is not None:
            return self._verdict.infeasible([far], None)
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
            return self._verdict.solved(best)
        closest = min(search.tried, key=lambda t: t.attempt.badness, default=None)
        if search.pushed and not self.budget.stopped:
            return self._gives_way(closest)
        self.budget.tell("no grasp found; looking for a change that allows one")
        reasons = self._reasons()
        if not reasons and self._best() is None:
            reasons = self._reasons(further=True)
        best = self._best()
        if best is not None:  # feasible after all, though no start saw it
            return self._verdict.solved(best)
        # Reasons found before the clock stopped the search may not be the ones that matter.
        if reasons and not self.budget.stopped:
            # What the model cannot follow is no impossibility, where the user did not choose how far that is.
            bent = [reason for reason in reasons if self._chosen_range and "bending range" in reason.title]
            if any(reason is reasons[0] or not reason.also for reason in bent):
                return self._with_wider_model(bent)
            return self._verdict.infeasible([reason for reason in reasons if reason not in bent], closest)
        return self._verdict.unsolved(closest)

    def _gives_way(self, closest: Tried | None) -> GraspResult:
        """Give the verdict if no grasp bears the push: the greatest push that one bears, or why no grasp holds even
        without it.
        """
        if self.search.strongest is not None:
            return self._verdict.infeasible([push_reason(self.scene, self.search.strongest)], closest)
        contacts = self.scene.contacts.replaced(push=None)
        plain = self.scene.replaced(contacts=contacts, objective="least_tension")
        if not plain.unloaded:
            result = _ModelSearch(plain, self.budget, self._chosen_range, self._chosen_elements).result()
            if not result.solved:
                return replace(result, scene=self.scene)
        return self._verdict.gives_way(closest)

    def _with_wider_model(self, reasons: Sequence[Reason]) -> GraspResult:
        """The verdict with a model that bends further, for reasons that include its bending range."""
        bent = [part.needed for reason in reasons for part in (reason, *reason.also) if part.name == "bending range"]
        bending_range = max(setup.bending_range for setup in self.scene.setups)
        if max(bent) <= ONE_TURN:
            wide = min(max(2.0 * bending_range, max(bent)), ONE_TURN)
            note = f"fidelity.bending_range of {wide:.4g} rad"
            scene = with_bending_range(self.scene, wide)
        else:
            if most_elements(self.scene) > MOST_ELEMENTS:
                return self._verdict.unsolved(None)
            return self._with_more_elements(f"with {bending_range:.4g} rad per element there is no grasp")
        return self._again(scene, f"{note}: with {bending_range:.4g} rad per element there is no grasp")

    def _are_too_few(self, best: Tried | None) -> bool:
        """Whether more elements than the program chose may hold with less than the best grasp, or at all."""
        if not self._chosen_elements or most_elements(self.scene) >= MOST_ELEMENTS or self.budget.over:
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
            return self._verdict.solved(best)
        doubted = not best.acceptable or best.certificate.model_error.is_large
        if result.solved and (doubted or result.tension <= tension_of(self.scene, best.arrays)):
            return result
        self.search = search
        return self._verdict.solved(best)

    def _with_more_elements(self, why: str) -> GraspResult:
        """The verdict with twice as many elements, and why that is asked."""
        per_segment = max(2 * s.elements // (len(s.middles) + 1) for s in self.scene.setups)
        scene = with_elements(self.scene, per_segment, as_curved=not self._chosen_range)
        return self._again(scene, f"{max(setup.elements for setup in scene.setups)} elements: {why}")

    def _again(self, scene: GraspScene, note: str) -> GraspResult:
        """The verdict with another model that the program chose."""
        other = _ModelSearch(scene, self.budget, chosen_range=self._chosen_range, chosen_elements=self._chosen_elements)
        # Maps of the other model may miss them.
        other.search.held_before = self.search.held_exactly
        result = other.result()
        self.search = other.search
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
