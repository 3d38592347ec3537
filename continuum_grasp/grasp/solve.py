"""The search for a grasp: starts, solver, verification, and an honest word at the end."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.errors import InputError, Interrupted, SolverError
from continuum_grasp.grasp.certificate import Certificate, certify
from continuum_grasp.grasp.diagnosis import find_reasons, out_of_reach
from continuum_grasp.grasp.ipopt import Attempt, GraspSolverRun
from continuum_grasp.grasp.points import starting_point
from continuum_grasp.grasp.problem import GraspProblem
from continuum_grasp.grasp.result import GraspResult, Reason, Status
from continuum_grasp.grasp.seeds import make_seeds
from continuum_grasp.scene.grasp import GraspScene

__all__ = ["optimize_grasp"]

REFINEMENTS = 2
"""How often the points at which penetration is excluded may be doubled."""


def optimize_grasp(scene: GraspScene | str | os.PathLike[str], *, raise_on_failure: bool = True) -> GraspResult:
    """Find how the finger holds the object with the least tension, and verify it.

    Parameters
    ----------
    scene : GraspScene or path-like
        The scene, or its YAML file.
    raise_on_failure : bool, optional
        Raise where there is no verified grasp; False: return the result, whose ``status`` says so.

    Returns
    -------
    GraspResult
        The best verified grasp of all starts. ``optimal`` is a local optimum.

    Raises
    ------
    InputError
        The scene does not make sense, or its file cannot be read.
    SolverError
        There is no verified grasp; ``result`` of the error holds what was found.
    Interrupted
        Ctrl-C was pressed before any grasp was verified. With one, that is the result; its message says so.
    """
    if not isinstance(scene, GraspScene):
        scene = _load(scene)
    result = _Search(scene).result()
    if raise_on_failure and not result.solved:
        raise SolverError(
            result.message,
            status=result.status.value,
            violated=result.violated,
            advice=result.advice,
            result=result,
        )
    return result


def _load(path: str | os.PathLike[str]) -> GraspScene:
    from continuum_grasp.scene.load import load

    if not isinstance(path, (str, os.PathLike)):
        raise InputError(f"expected a GraspScene or the path of its YAML file, got {path!r:.80}")
    scene = load(os.fspath(path))
    if not isinstance(scene, GraspScene):
        raise InputError("expected a grasp scene (it has an object)", file=os.fspath(path))
    return scene


@dataclass(frozen=True)
class _Verified:
    attempt: Attempt
    arrays: dict[str, NDArray[Any]]
    certificate: Certificate


class _Search:
    def __init__(self, scene: GraspScene) -> None:
        self.scene = scene
        self.began = time.monotonic()
        self.until = self.began + scene.solver.time_limit
        self.attempts: list[Attempt] = []
        self.good: list[_Verified] = []
        self.build_seconds = 0.0
        self.interrupted = False

    def result(self) -> GraspResult:
        """Search and judge; on Ctrl-C, judge what there is."""
        try:
            return self._search()
        except KeyboardInterrupt:
            self.interrupted = True
            if not self.good:
                tried = f"{len(self.attempts)} starts tried to the end"
                raise Interrupted(f"interrupted before a grasp was found ({tried})") from None
            return self._solved()

    def _search(self) -> GraspResult:
        far = out_of_reach(self.scene)
        if far is not None:
            return self._infeasible([far])
        solver = self._solver(self.scene.solver.samples)
        seeds = make_seeds(self.scene)
        starts = [(seed.label, starting_point(solver.problem, seed)) for seed in seeds]
        tried = self._run(solver, starts)
        for round_ in range(1, REFINEMENTS + 1):
            if self.good:
                break
            again = [v for v in tried if v.attempt.converged and _only_penetrates(v.certificate)]
            if not again or time.monotonic() > self.until:
                break
            solver = self._solver(self.scene.solver.samples * 2**round_)
            tried = self._run(solver, [(v.attempt.start, v.attempt.x) for v in again])
        if self.good:
            return self._solved()
        closest = min(tried, key=lambda v: v.attempt.badness, default=None)
        if closest is not None and any(v.attempt.infeasible for v in tried):
            found = find_reasons(self.scene, solver, seeds, self.until)
            self._run(solver, [(f"relaxed {f.reason.name}", f.x) for f in found])
            if self.good:  # feasible after all, though no start saw it
                return self._solved()
            if found:
                return self._infeasible([f.reason for f in found], closest)
        return self._unsolved(closest)

    def _solver(self, samples: int) -> GraspSolverRun:
        began = time.perf_counter()
        solver = GraspSolverRun(GraspProblem(self.scene, samples))
        self.build_seconds += time.perf_counter() - began
        return solver

    def _run(self, solver: GraspSolverRun, starts: list[tuple[str, NDArray[Any]]]) -> list[_Verified]:
        tried: list[_Verified] = []
        for label, x0 in starts:
            if tried and time.monotonic() > self.until:
                break
            attempt = solver.run(label, x0, self.until)
            self.attempts.append(attempt)
            if np.isfinite(attempt.x).all():
                arrays = solver.reader.arrays(attempt.x)
                verified = _Verified(attempt, arrays, certify(self.scene, arrays))
                tried.append(verified)
                if verified.certificate.passed:
                    self.good.append(verified)
        return tried

    # -- verdicts --------------------------------------------------------------------------------------------

    def _solved(self) -> GraspResult:
        best = min(self.good, key=lambda v: (round(v.attempt.objective, 9), not v.attempt.converged))
        tension = float(best.arrays["tensions"].max())
        if best.attempt.converged:
            status, message = Status.OPTIMAL, f"held with a tension of {tension:.4g} N"
        else:
            status = Status.FEASIBLE
            message = f"held with a tension of {tension:.4g} N; the solver stopped early ({best.attempt.outcome})"
        if self.interrupted:
            message += "; the search was interrupted, not all starts were tried"
        return GraspResult(
            self.scene,
            status,
            message,
            best.arrays,
            best.certificate,
            advice=self._palm_note(),
            statistics=self._statistics(best.attempt),
        )

    def _infeasible(self, reasons: list[Reason], closest: _Verified | None = None) -> GraspResult:
        advice = "Any one of these repairs it: " + "; ".join(reason.repair for reason in reasons) + "."
        return self._failed(Status.INFEASIBLE, reasons[0].text, closest, tuple(reasons), advice)

    def _unsolved(self, closest: _Verified | None) -> GraspResult:
        late = time.monotonic() > self.until
        if late:
            message, advice = "the time limit passed without a verified grasp", "Raise solver.time_limit."
        elif closest is not None and closest.attempt.converged:
            names = ", ".join(check.name for check in closest.certificate.failed)
            message = f"the solver converged, but the independent check rejects: {names}"
            advice = "Raise solver.samples or fidelity.accuracy."
        else:
            outcomes = ", ".join(sorted({a.outcome for a in self.attempts}))
            message = f"no start led to a grasp ({outcomes}), and no single limit explains it"
            advice = (
                "Likely the geometry: move the base or the object, let the middle contact be elsewhere "
                "(contacts.middle_range), or raise solver.seeds. A scene that breaks two limits at once ends "
                "here too."
            )
        return self._failed(Status.NOT_SOLVED, message, closest, (), advice)

    def _failed(
        self,
        status: Status,
        message: str,
        closest: _Verified | None,
        reasons: tuple[Reason, ...],
        advice: str,
    ) -> GraspResult:
        violated: tuple[str, ...] = ()
        if closest is not None:
            violated = tuple(str(v) for v in closest.attempt.violations)
        return GraspResult(
            self.scene,
            status,
            message,
            arrays={} if closest is None else closest.arrays,
            certificate=None if closest is None else closest.certificate,
            violated=violated,
            reasons=reasons,
            advice=" ".join(part for part in (advice, self._palm_note()) if part),
            statistics=self._statistics(None if closest is None else closest.attempt),
        )

    def _palm_note(self) -> str:
        if self.scene.palm is not None and not self.scene.palm_touches:
            gap = self.scene.palm.height(self.scene.object.position) - self.scene.object.radius
            return f"The object is {gap:.4g} m away from the palm, which therefore carries nothing."
        return ""

    def _statistics(self, chosen: Attempt | None) -> dict[str, Any]:
        return {
            "build_seconds": self.build_seconds,
            "solver_seconds": sum(a.seconds for a in self.attempts),
            "total_seconds": time.monotonic() - self.began,
            "interrupted": self.interrupted,
            "iterations": None if chosen is None else chosen.iterations,
            "start": None if chosen is None else chosen.start,
            "attempts": [
                {
                    "start": a.start,
                    "outcome": a.outcome,
                    "iterations": a.iterations,
                    "seconds": a.seconds,
                    "objective": a.objective,
                    "greatest_violation": a.badness,
                }
                for a in self.attempts
            ],
        }


def _only_penetrates(certificate: Certificate) -> bool:
    return all(check.name.startswith("penetration") for check in certificate.failed)
