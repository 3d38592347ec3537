"""Grasps found again: from a result's own numbers, at a scene nearby, with the greatest mass."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.grasp.certificate.certificate import certify
from continuum_grasp.grasp.nearby.held import HeldGrasp, moved_start, with_mass
from continuum_grasp.grasp.problem.relaxations import RELAXATIONS
from continuum_grasp.grasp.problem.solver_run import GraspSolverRun
from continuum_grasp.grasp.result import GraspResult
from continuum_grasp.grasp.starts.values import ContactStart, GraspStart
from continuum_grasp.model import Feature
from continuum_grasp.nlp import Budget
from continuum_grasp.scene import GraspScene, Robust

if TYPE_CHECKING:
    from continuum_grasp.grasp.robust.joint import JointSolverRun

_MASS = next(relaxation for relaxation in RELAXATIONS if relaxation.name == "mass")


@dataclass(frozen=True)
class GraspFollower:
    """Finds grasps again without a search.

    ``spent`` is called with the iterations of each run of the solver; the greatest mass is sought below a multiple of
    the mass held, which is set ``masses`` times at most.
    """

    spent: Callable[[int], None]
    masses: int

    def again(self, result: GraspResult) -> HeldGrasp | None:
        """The grasp of a result, its guarded places moved until they stand still; None where it is not found again."""
        scene = result.scene
        start = GraspStart.of(result.scene, dict(result.arrays))
        if result.robustness is not None:
            return self._run_joint(scene, start, result.robustness.active, result.robustness.touching)
        return self._run(scene, start)

    def at(self, scene: GraspScene, before: HeldGrasp, guess: Array | None) -> HeldGrasp | None:
        """A grasp at a scene nearby; from a guess, from its own unknowns, or from its posture alone."""
        from continuum_grasp.grasp.robust.joint import JointSolverRun

        start = moved_start(before.scene, scene, before.attempt.start)
        options: dict[str, Any] = {}
        if before.relaxed:
            scene = with_mass(scene, before.scene.object.mass)
            options = {"relaxed": [(_MASS, 1.0 - before.quantities["payload"] / before.scene.object.mass)]}
        features = before.attempt.features_in(before.scene, scene, start.contacts)
        guesses = ([] if guess is None else [guess]) + [before.attempt.x]
        for x0 in guesses:
            if isinstance(before.solver, JointSolverRun):
                grasp = self._run_joint(scene, start, before.solver.errors, before.solver.touching, x0, features)
            else:
                grasp = self._run(scene, start, x0=x0, features=features, **options)
            if grasp is not None:
                full = before.relaxed and grasp.full
                return self._heaviest(scene, grasp.attempt.start, grasp.quantities["payload"]) if full else grasp
        return None

    def heaviest(self, result: GraspResult, payload: float) -> HeldGrasp | None:
        """The grasp with the greatest mass, from a result that holds a payload; None where a solver finds none."""
        return self._heaviest(result.scene, GraspStart.of(result.scene, dict(result.arrays)), payload)

    def _run(self, scene: GraspScene, start: GraspStart, **options: Any) -> HeldGrasp | None:
        """A certified grasp from a start; None where there is none."""
        grasp = self._converged(scene, start, GraspSolverRun.of(scene, start.contacts), options_at=2, **options)
        if grasp is None:
            return None
        checked = scene if not grasp.relaxed else with_mass(scene, grasp.quantities["payload"])
        return grasp if certify(checked, grasp.arrays).passed else None

    def _converged(
        self, scene: GraspScene, start: GraspStart, solver: GraspSolverRun | JointSolverRun, **options: Any
    ) -> HeldGrasp | None:
        """The grasp that a solver finds from a start, its guarded places moved until they stand still."""
        budget = Budget.of(scene.solver)
        before = None
        # 4: most runs until guarded places stand still
        for _ in range(4):
            attempt = solver.run(scene, start, budget, **options)
            self.spent(attempt.iterations)
            if not attempt.converged or not np.isfinite(attempt.x).all():
                return None
            grasp = HeldGrasp(scene, solver, attempt, solver.arrays(scene, attempt), "relaxed" in options)
            # 1e-9: relative change of quantities at which another run from the same point is not worth it
            same = before is not None and _same(before.quantities, grasp.quantities, 1e-9)
            if same or not _probed(grasp):
                break
            before = grasp
            options = {**options, "x0": attempt.x.copy(), "features": attempt.features}
        return grasp

    def _run_joint(
        self,
        scene: GraspScene,
        start: GraspStart,
        errors: Array,
        touching: Sequence[Mapping[str, ContactStart]],
        x0: Array | None = None,
        features: dict[str, Feature] | None = None,
    ) -> HeldGrasp | None:
        """A certified grasp that holds for all errors and friction states that are tried, from a start with those that
        matter there; ones that fail become part of its problem. None where there is none.
        """
        from continuum_grasp.grasp.robust.joint import JointSolverRun
        from continuum_grasp.grasp.robust.search import Exchange

        grasp = self._converged(scene, start, JointSolverRun(scene, start, errors, touching), x0=x0, features=features)
        if grasp is None:
            return None
        budget = Budget.of(scene.solver)
        bounds = scene.robust or Robust.model_construct()
        exchange = Exchange(scene, bounds, grasp.arrays, budget, list(errors))
        while active := exchange.active(grasp.arrays):
            contacts = [response.begin.contacts for response in active]
            solver = JointSolverRun(scene, start, np.array([response.error for response in active]), contacts)
            x0 = np.concatenate([grasp.nominal, *(response.attempt.x for response in active)])
            grasp = self._converged(scene, start, solver, x0=x0, features=features)
            if grasp is None:
                return None
        if not exchange.holds:
            return None
        grasp = replace(grasp, arrays=exchange.with_postures())
        return grasp if certify(scene, grasp.arrays).passed else None

    def _heaviest(self, scene: GraspScene, start: GraspStart, payload: float) -> HeldGrasp | None:
        """The greatest mass from a start that holds a payload; None where a solver finds none.

        It is sought below a multiple of that payload, again where it is all of that.
        """
        grasp: HeldGrasp | None = None
        for _ in range(self.masses):
            # 3.0: mass in the scene, per payload that is held, below which the greatest is sought
            limit = 3.0 * payload
            more = self._run(with_mass(scene, limit), start, relaxed=[(_MASS, 1.0 - payload / limit)])
            grasp = more or grasp
            if more is None or not more.full:
                break
            payload = more.quantities["payload"]
            start = more.attempt.start
        return grasp


def _probed(grasp: HeldGrasp) -> bool:
    """Whether limits of guarded places act, which move with the grasp."""
    forces = grasp.attempt.multipliers.constraints[grasp.solver.guarded]
    return bool(np.abs(forces).max(initial=0.0) > 1e-6)


def _same(first: dict[str, float], two: dict[str, float], tolerance: float) -> bool:
    return all(abs(first[name] - two[name]) <= tolerance * max(abs(first[name]), 1e-3) for name in first)
