"""The result of a grasp that holds for all errors within bounds, or of none that does."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from continuum_grasp.base import amount_text
from continuum_grasp.grasp.judge.certificate import RodCertificate, certify_rods
from continuum_grasp.grasp.result import GraspResult
from continuum_grasp.grasp.robust.result import GraspTrials, Robustness
from continuum_grasp.grasp.rods.histories import frictions_of
from continuum_grasp.grasp.rods.record import held_rods
from continuum_grasp.grasp.rods.robust import RobustSearch, robustness_of, share_held
from continuum_grasp.grasp.rods.solving import StartedSearch
from continuum_grasp.grasp.rods.verdict import RodVerdict
from continuum_grasp.grasp.values import GraspStatus, Reason
from continuum_grasp.scene import Robust

_KEYS = ("position", "angle", "radius", "friction", "mass")
"""Keys of the bounds of a scene."""


DRAWS = 20
"""Friction states that are drawn, where the scene names no errors: 100 of `mug_motor` take 5 s, and none is as bad as
those that are sought."""


def bounds_of(robust: Robust | None) -> dict[str, float]:
    """Bounds of the errors that a scene names."""
    return {} if robust is None else {key: bound for key in _KEYS if (bound := getattr(robust, key))}


class SoughtRobust:
    """A grasp that is sought for the errors and friction states of a scene, next to grasps of a search."""

    def __init__(self, search: StartedSearch) -> None:
        scene = search.scene
        self._search, self._bounds = search, bounds_of(scene.robust)
        self._found = RobustSearch(search, self._bounds)
        self._found.run()
        draws = DRAWS if scene.robust is None else scene.robust.draws
        self._robustness = robustness_of(search, self._found, draws, scene.solver.random_seed)

    def verdict(self, nominal: RodVerdict) -> RodVerdict:
        """The verdict on the robust grasp, by that on the nominal one; the same where there is none."""
        best = self._found.best
        if best is None:
            return nominal
        held = held_rods(best.grasp)
        return replace(nominal, best=best.grasp, held=held, certificate=certify_rods(self._search.scene, held))

    def result(self, result: GraspResult) -> GraspResult:
        """The result of that verdict, with trials; or why no grasp is robust."""
        trials = self._robustness.robust
        if trials is None:
            return self._none(result)
        nominal, own = (amount_text(each.tension, "N", ".4g") for each in (self._robustness.nominal, trials))
        notes = result.message.split("; ")[1:]
        words = [
            f"held with {own} of total tension whatever {self._whatever}",
            f"{nominal} {'without errors' if self._bounds else 'as they are pulled'}",
            *notes,
        ]
        changed = replace(
            result,
            message="; ".join(words),
            sensitivity=(),  # the nominal grasp has it
            robustness=self._robustness,
            statistics={**result.statistics, "robust": self._effort},
        )
        if isinstance(result.certificate, RodCertificate) and not result.certificate.passed:
            worst = result.certificate.worst
            message = f"found for {self._whatever}, but the independent certificate refuses the grasp: {worst}"
            return replace(changed, status=GraspStatus.NOT_SOLVED, message=message)
        if trials.holds:
            return changed
        corners = "corners of robust" if self._bounds else "friction states that were sought"
        message = f"held at all {corners}, but NOT robust: {_failures(trials)}"
        return replace(changed, status=GraspStatus.FEASIBLE, message=message)

    @property
    def _whatever(self) -> str:
        """Errors and friction states that must not matter, in words."""
        scene = self._search.scene
        parts = {word for setup in scene.setups for word in frictions_of(setup)} if scene.state_columns else set()
        words = ["the errors within robust"] * bool(self._bounds)
        words += [f"the friction states {' and '.join(sorted(parts, reverse=True))}"] * bool(parts)
        return " and ".join(words)

    @property
    def _effort(self) -> dict[str, Any]:
        best = self._found.best
        corners = (0, 0) if best is None else (len(best.responses), len(best.active))
        return {"corners": corners[0], "corners_in_problem": corners[1], "branches": len(self._found.tried)}

    def _none(self, result: GraspResult) -> GraspResult:
        """No robust grasp: with which share of the bounds there is one."""
        robustness: Robustness = self._robustness
        share = share_held(self._search, self._bounds) if self._bounds else 0.0
        text = (
            f"the object can be held as it is ({amount_text(robustness.nominal.tension, 'N', '.4g')}), but no grasp "
            f"was found that holds whatever {self._whatever}"
        )
        changed = replace(result, robustness=robustness, sensitivity=())
        if not share:
            advice = "Lower the bounds in robust, raise contacts.friction or tendons.max_tension, or add a contact."
            if not self._bounds:
                advice = (
                    "Lower the friction of the fingers, raise contacts.friction or contacts.normal_force_max, which "
                    "fingers that were let out press with more, or add a contact. friction_states: pulled, where "
                    "nothing moves the fingers after they are pulled."
                )
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
