"""The grasp of a scene as exact rods: search, verdict, certificate, reasons, elements, and all of it as a result."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, overload

from continuum_grasp.base import (
    Array,
    InputError,
    Interrupted,
    SolverError,
    amount_text,
    check_arguments,
    interruptible,
)
from continuum_grasp.grasp.exploration import Exploration
from continuum_grasp.grasp.hand.result import HandResult
from continuum_grasp.grasp.judge.arrays import RodArrays
from continuum_grasp.grasp.judge.certificate import Certificate, shapes_of
from continuum_grasp.grasp.judge.held import HeldRods
from continuum_grasp.grasp.result import GraspResult, with_outline
from continuum_grasp.grasp.rods.contact_sets import contact_modes
from continuum_grasp.grasp.rods.hand_search import HandRodSearch
from continuum_grasp.grasp.rods.projection import MOST_ELEMENTS, on_elements
from continuum_grasp.grasp.rods.record import held_rods
from continuum_grasp.grasp.rods.repairs import LeastRepairs, reason_of
from continuum_grasp.grasp.rods.robust_result import SoughtRobust
from continuum_grasp.grasp.rods.search import RodSearch
from continuum_grasp.grasp.rods.sensitivity import sensitivities_of
from continuum_grasp.grasp.rods.solving import BORNE, STARTS, RodGrasp, StartedSearch
from continuum_grasp.grasp.rods.verdict import RodVerdict, VerdictDoubt, verdict_of
from continuum_grasp.grasp.values import OPENED, STEADIER, ElementError, GraspStatus, Reason, unloaded_words
from continuum_grasp.nlp import Budget
from continuum_grasp.scene import GraspScene, HandScene, scene_of

_MORE = {"quick": STARTS // 2, "normal": STARTS, "thorough": 4 * STARTS}
"""Starts by effort."""


_Listener = Callable[[str], None] | None


@overload
def optimize_grasp(scene: HandScene, *, raise_on_failure: bool = ..., progress: _Listener = ...) -> HandResult: ...
@overload
def optimize_grasp(scene: GraspScene, *, raise_on_failure: bool = ..., progress: _Listener = ...) -> GraspResult: ...
@overload
def optimize_grasp(
    scene: str | os.PathLike[str], *, raise_on_failure: bool = ..., progress: _Listener = ...
) -> Any: ...
@interruptible()
@check_arguments
def optimize_grasp(
    scene: GraspScene | HandScene | str | os.PathLike[str],
    *,
    raise_on_failure: bool = True,
    progress: Callable[[str], None] | None = None,
) -> Any:
    """Find the best grasp of an object by the fingers of a scene, and verify it.

    Parameters
    ----------
    scene : GraspScene, HandScene or path-like
        The scene, in the plane or of a hand in space, or its YAML file. With
        ``robust``, the grasp holds for all those errors, and ``robustness`` of the result has the trials.
    raise_on_failure : bool, optional
        Raise an error if no verified grasp holds the object; False: return the result with its ``status``.
    progress : callable, optional
        Takes a line of text now and then: the best so far, and the remaining work.

    Returns
    -------
    GraspResult or HandResult
        The best verified grasp found; its ``exploration`` describes the search. ``optimal`` is a local optimum to which
        starts from different postures lead, and none to a better one.

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
    ('optimal', 39.7, 3)
    """
    asked = scene_of(scene, (GraspScene, HandScene))
    result = _result(asked, Budget.of(asked.solver, progress))
    if raise_on_failure and not result.solved:
        raise SolverError(
            result.message,
            status=result.status.value,
            violated=result.violated if isinstance(result, GraspResult) else (),
            advice=result.advice,
            result=result,
        )
    return result


def _result(scene: GraspScene | HandScene, budget: Budget) -> GraspResult | HandResult:
    """Search and judge; on Ctrl-C, judge what there is."""
    _check(scene)
    search = RodSearch(scene, budget) if isinstance(scene, GraspScene) else HandRodSearch(scene, budget)
    ended = _EndedSearch(scene, search, time.monotonic())
    try:
        search.run(_MORE[scene.solver.effort])
        return _outlined(ended.judged(verdict_of(search)))
    except KeyboardInterrupt:
        ended.interrupted = True
        verdict = verdict_of(search, interrupted=True)
        if verdict.status not in (GraspStatus.OPTIMAL, GraspStatus.FEASIBLE):
            tried = f"{len(search.tried)} starts tried to the end"
            raise Interrupted(f"interrupted before a grasp was found ({tried})") from None
        return _outlined(ended.solved(verdict))


def _check(scene: GraspScene | HandScene) -> None:
    """Refuse what the problem of rods does not have, so that no grasp claims it."""
    if isinstance(scene, HandScene) and scene.turned:
        raise InputError("expected one direction: rods do not hold in every direction of the weight", key="gravity")


def _outlined(result: GraspResult | HandResult) -> GraspResult | HandResult:
    """The result with the error of the object's outline, where it has one."""
    return with_outline(result) if isinstance(result, GraspResult) else result


@dataclass(eq=False)
class _EndedSearch:
    """A search that is over, before its result is made."""

    scene: GraspScene | HandScene
    search: StartedSearch
    began: float
    """``time.monotonic()`` at its begin [s]."""
    interrupted: bool = False

    def judged(self, verdict: RodVerdict) -> GraspResult | HandResult:
        """The result of a verdict."""
        if verdict.status not in (GraspStatus.OPTIMAL, GraspStatus.FEASIBLE):
            return self._without(verdict)
        if isinstance(self.scene, HandScene) or self.scene.robust is None:
            return self.solved(verdict)
        self.search.budget.tell("grasp found; looking for one that holds for all errors")
        sought = SoughtRobust(self.search)
        result = self.solved(sought.verdict(verdict))
        return sought.result(result) if isinstance(result, GraspResult) else result

    # -- with a grasp ------------------------------------------------------------------------------------------

    def solved(self, verdict: RodVerdict) -> GraspResult | HandResult:
        """The result with a grasp."""
        best, held, certificate = verdict.best, verdict.held, verdict.certificate
        if best is None or held is None or certificate is None:
            raise ValueError(f"a verdict {verdict.status} has a certified grasp")
        scene, arrays, errors = stored(self.search.scene, held, certificate)
        tension = amount_text(best.tension, "N", ".4g")
        held_with = f"held with a sum of tensions of {tension}"
        if scene.contacts.push:
            held_with += f" against any push up to {amount_text(certificate.push, 'N', '.3g')}"
        message = "; ".join([held_with, *(doubt.value for doubt in verdict.doubts), *self._unloaded])
        if self.search.steady is None and not best.is_stable:
            message += OPENED
        common: dict[str, Any] = {"statistics": self._statistics(best), "element_errors": errors}
        if isinstance(scene, HandScene):
            return HandResult(scene, verdict.status, message, arrays, certificate, **common)
        return GraspResult(
            scene,
            verdict.status,
            message,
            arrays,
            certificate,
            **common,
            sensitivity=sensitivities_of(scene, best) if best.attempt.converged else (),
            exploration=self._exploration,
            lower_bound=self.search.bound,
        )

    @property
    def _unloaded(self) -> list[str]:
        """Why a grasp bears a push that the scene does not state."""
        return [] if self.search.greatest_push is None else [unloaded_words(self.search.greatest_push)]

    # -- without one -------------------------------------------------------------------------------------------

    def _without(self, verdict: RodVerdict) -> GraspResult | HandResult:
        """The result without a grasp, with what stands in the way."""
        reasons = self._reasons(verdict)
        message = self._said(verdict, reasons)
        advice = self._advice(verdict, reasons)
        scene, arrays, errors = self.scene, dict[str, Array](), dict[str, ElementError]()
        if reasons and not self.search.yielding:
            arrays = dict(reasons[0].arrays)
        elif verdict.best is not None:
            # What is no grasp is not worth more elements.
            held = verdict.held or held_rods(verdict.best)
            scene, arrays, errors = stored(self.scene, held, verdict.certificate, most=0)
        common: dict[str, Any] = {"statistics": self._statistics(verdict.best), "element_errors": errors}
        common |= {"certificate": verdict.certificate, "reasons": tuple(reasons), "advice": advice}
        if isinstance(scene, HandScene):
            return HandResult(scene, verdict.status, message, arrays, **common)
        common |= {"violated": () if reasons else tuple(_violated(verdict)), "exploration": self._exploration}
        return GraspResult(scene, verdict.status, message, arrays, **common)

    def _reasons(self, verdict: RodVerdict) -> list[Reason]:
        """Limits that stand in the way, with the grasp of the first one."""
        if verdict.best is None or not {VerdictDoubt.UNBORNE, VerdictDoubt.NO_BALANCE}.intersection(verdict.doubts):
            return []
        if self.search.yielding:
            return [self._push_reason()]
        self.search.budget.tell("no grasp found; looking for a change that allows one")
        found = LeastRepairs(self.search).found()
        reasons = [reason_of(self.search.scene, repair) for repair in found]
        if reasons:
            changed = self.search.scene.changed(found[0].changes)
            arrays = stored(changed, held_rods(found[0].grasp))[1]
            reasons[0] = replace(reasons[0], arrays=arrays)
        return reasons

    def _push_reason(self) -> Reason:
        """Reason that grasps hold the object, but bear a smaller push than the scene states."""
        # 0.99: a grasp with it is found, too
        asked, borne = self.search.scene.contacts.push or 0.0, 0.99 * self.search.most_push()
        most = amount_text(borne, "N", ".3g")
        text = f"the push is too great: {amount_text(asked, 'N', '.3g')}; a grasp bears {most}"
        return Reason("push", "contacts.push", "N", asked, borne, text, f"contacts.push = {most}")

    def _said(self, verdict: RodVerdict, reasons: Sequence[Reason]) -> str:
        """Why there is no grasp, in one sentence."""
        if reasons:
            return reasons[0].text
        if self.search.greatest_push is not None and not self.search.scene.contacts.push:
            most = amount_text(self.search.greatest_push, "N", ".3g")
            return f"nothing loads the object, and the greatest push that any found grasp bears is negligible: {most}"
        if verdict.status is GraspStatus.UNSTABLE:
            return "; ".join([f"in balance, but {verdict.doubts[0].value}", *self._unloaded])
        if verdict.certificate is not None:
            return f"{verdict.doubts[0].value}: {verdict.certificate.worst}"
        words = [doubt.value for doubt in verdict.doubts]
        if verdict.best is not None and VerdictDoubt.UNBORNE in verdict.doubts:
            words[0] = _missed(verdict.best)
        return f"no grasp found from {len(self.search.tried)} starts: {'; '.join(words)}"

    def _advice(self, verdict: RodVerdict, reasons: Sequence[Reason]) -> str:
        """A remedy."""
        if reasons:
            return "Any one of these repairs it: " + "; ".join(reason.repair for reason in reasons) + "."
        if verdict.status is GraspStatus.UNSTABLE:
            return STEADIER
        if self.search.budget.stopped:
            return "Raise solver.time_limit, or free the machine."
        if self.search.budget.cut:
            return "Raise solver.max_total_iterations."
        move = "move the base or the object, or let the middle contact be elsewhere (contacts.middle_range)"
        if verdict.best is not None and verdict.best.crosses:
            return "Use a shorter finger, or bases further apart: base_free lets the search find them."
        if self.scene.solver.effort == "thorough":
            return f"Probably the geometry is the cause: {move}."
        return f"Try solver.effort: thorough, which tries more starts. Otherwise {move}."

    # -- the search --------------------------------------------------------------------------------------------

    @property
    def _exploration(self) -> Exploration:
        """Record of the search."""
        tried = self.search.tried
        solved = sum(grasp.holds for grasp in tried)
        modes = len(contact_modes(self.scene)) if isinstance(self.scene, GraspScene) else 0
        return Exploration(
            modes=modes,
            starts_solved=solved,
            starts_failed=len(tried) - solved,
            settled=len(self.search.starts),
            untried=max(len(self.search.starts) - len(tried), 0),
        )

    def _statistics(self, chosen: RodGrasp | None) -> dict[str, Any]:
        attempts = [grasp.attempt for grasp in self.search.tried]
        budget = self.search.budget
        return {
            "solver_seconds": sum(attempt.seconds for attempt in attempts),
            "total_seconds": time.monotonic() - self.began,
            "interrupted": self.interrupted,
            "cut_short": budget.cut,
            "total_iterations": self.scene.solver.max_total_iterations - budget.left,
            "iterations": None if chosen is None else chosen.attempt.iterations,
            "starts": len(attempts),
            "attempts": [
                {
                    "contacts": sorted(grasp.start.on),
                    "outcome": grasp.attempt.outcome,
                    "holds": grasp.holds,
                    "iterations": grasp.attempt.iterations,
                    "seconds": grasp.attempt.seconds,
                    "objective": grasp.attempt.objective,
                    "unborne": grasp.unborne,
                }
                for grasp in self.search.tried
            ],
        }


def stored(
    scene: Any, held: HeldRods, certificate: Certificate | None = None, most: int = MOST_ELEMENTS
) -> tuple[Any, dict[str, Array], dict[str, ElementError]]:
    """Scene with the elements, up to ``most``, that stand for a grasp, its arrays, and differences by finger."""
    rods = certificate.rods if certificate is not None and certificate.rods else shapes_of(scene, held)
    resolved, projection = on_elements(scene, held, rods, most)
    return resolved, {**projection.arrays, **RodArrays.of(scene).stored(held, rods)}, dict(projection.errors)


def _missed(nearest: RodGrasp) -> str:
    """Why a solution is no grasp, in words."""
    if nearest.crosses:
        return "fingers pass through each other or through themselves"
    if not nearest.attempt.converged:
        return f"the solver stopped early ({nearest.attempt.why_it_ended})"
    return f"nothing bears {amount_text(nearest.unborne, 'N', '.3g')} of the load"


def _violated(verdict: RodVerdict) -> list[str]:
    """Constraints that what came nearest to a grasp violates, in words."""
    if verdict.certificate is not None:
        return [str(check) for check in verdict.certificate.failed]
    if verdict.best is None:
        return []
    problem, x = verdict.best.problem, verdict.best.attempt.x
    left = {name.removeprefix("unborne, "): float(x[at].sum()) for name, at in problem.at.items() if "unborne" in name}
    force = problem.numbers.force
    units = {name: ("N", force) if name.startswith("force") else ("N m", force * problem.numbers.size) for name in left}
    return [
        f"{name} of the object: {amount_text(units[name][1] * amount, units[name][0], '.3g')} is not balanced"
        for name, amount in sorted(left.items(), key=lambda pair: -pair[1])
        if amount > BORNE
    ]
