"""The result of a grasp that holds for all errors within bounds, or of none that does."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from continuum_grasp.base import amount_text
from continuum_grasp.grasp.judge.certificate import certify_held
from continuum_grasp.grasp.result import GraspResult
from continuum_grasp.grasp.robust.result import GraspTrials, Robustness
from continuum_grasp.grasp.rods.record import held_rods
from continuum_grasp.grasp.rods.robust import RobustSearch, robustness_of, share_held
from continuum_grasp.grasp.rods.solving import StartedSearch
from continuum_grasp.grasp.rods.verdict import RodVerdict
from continuum_grasp.grasp.values import GraspStatus, Reason
from continuum_grasp.scene import Robust

_KEYS = ("position", "angle", "radius", "friction", "mass")
"""Keys of the bounds of a scene."""


def bounds_of(robust: Robust) -> dict[str, float]:
    """Bounds of the errors that a scene names."""
    return {key: bound for key in _KEYS if (bound := getattr(robust, key))}


class SoughtRobust:
    """A grasp that is sought for the errors of a scene, next to grasps of a search."""

    def __init__(self, search: StartedSearch) -> None:
        scene = search.scene
        self._search, self._bounds = search, bounds_of(scene.robust)
        self._found = RobustSearch(search, self._bounds)
        self._found.run()
        self._robustness = robustness_of(search, self._found, scene.robust.draws, scene.solver.random_seed)

    def verdict(self, nominal: RodVerdict) -> RodVerdict:
        """The verdict on the robust grasp, by that on the nominal one; the same where there is none."""
        best = self._found.best
        if best is None:
            return nominal
        held = held_rods(best.grasp)
        return replace(nominal, best=best.grasp, held=held, certificate=certify_held(self._search.scene, held))

    def result(self, result: GraspResult) -> GraspResult:
        """The result of that verdict, with trials; or why no grasp is robust."""
        trials = self._robustness.robust
        if trials is None:
            return self._none(result)
        nominal, own = (amount_text(each.tension, "N", ".4g") for each in (self._robustness.nominal, trials))
        notes = result.message.split("; ")[1:]
        words = [
            f"held with {own} of total tension whatever the errors within robust",
            f"{nominal} without errors",
            *notes,
        ]
        changed = replace(
            result,
            message="; ".join(words),
            sensitivity=(),  # the nominal grasp has it
            robustness=self._robustness,
            statistics={**result.statistics, "robust": self._effort},
        )
        if result.certificate is not None and not result.certificate.passed:
            message = "found for the errors within robust, but the independent check refuses the grasp"
            return replace(changed, status=GraspStatus.NOT_SOLVED, message=message)
        if trials.holds:
            return changed
        message = f"held at all corners of robust, but NOT robust: {_failures(trials)}"
        return replace(changed, status=GraspStatus.FEASIBLE, message=message)

    @property
    def _effort(self) -> dict[str, Any]:
        best = self._found.best
        corners = (0, 0) if best is None else (len(best.responses), len(best.active))
        return {"corners": corners[0], "corners_in_problem": corners[1], "branches": len(self._found.tried)}

    def _none(self, result: GraspResult) -> GraspResult:
        """No robust grasp: with which share of the bounds there is one."""
        robustness: Robustness = self._robustness
        share = share_held(self._search, self._bounds)
        text = (
            f"the object can be held as it is ({amount_text(robustness.nominal.tension, 'N', '.4g')}), but no grasp "
            "was found that holds whatever the errors within robust"
        )
        changed = replace(result, robustness=robustness, sensitivity=())
        if not share:
            advice = "Lower the bounds in robust, raise contacts.friction or tendons.max_tension, or add a contact."
            return replace(changed, status=GraspStatus.NOT_SOLVED, message=text, advice=advice)
        text += f"; with {share:.0%} of all bounds there is one"
        repair = f"multiply all bounds in robust by {share:.4g}"
        reason = Reason("errors", "robust", "1", 1.0, share, text, repair)
        advice = f"Any one of these repairs it: {repair}."
        return replace(changed, status=GraspStatus.INFEASIBLE, message=text, reasons=(reason,), advice=advice)


def _failures(trials: GraspTrials) -> str:
    """Draws that do not hold, in words."""
    count = trials.margins.size
    unknown = int((trials.margins != trials.margins).sum())
    failed = count - trials.held - unknown
    shown = [f"{failed} of {count} draws do not hold"] if failed or not unknown else []
    shown += [f"{unknown} of {count} draws are undecided, as the solver gave up"] if unknown else []
    return "; ".join(shown)
