"""The grasps of one case at one design after another: each from the one before, searched in full where that is lost."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from continuum_grasp.addons.design.held import HeldGrasp, Stencil, moved_start
from continuum_grasp.base import Array
from continuum_grasp.grasp import (
    RELAXATIONS,
    SAME,
    ContactStart,
    Exchange,
    GraspResult,
    GraspSolverRun,
    GraspStart,
    GraspStatus,
    JointSolverRun,
    certify,
    optimize_grasp,
)
from continuum_grasp.model import Feature
from continuum_grasp.nlp import Budget
from continuum_grasp.scene import GraspScene, Robust

MASS = next(relaxation for relaxation in RELAXATIONS if relaxation.name == "mass")
_MASSES = 12
"""Number of times that the mass in the scene is set until the payload lies below, or any is held."""


class LostGrasp(Exception):
    """There is no grasp at a design, or none was found; the message says why."""


@dataclass
class Effort:
    """Effort spent."""

    searches: int = 0
    """Full searches for grasps."""
    solves: int = 0
    """Runs of the solver from a grasp nearby."""
    iterations: int = 0
    """Iterations of these runs."""
    lost: int = 0
    """Designs for which there was no grasp."""
    most: int = 0
    """Most iterations of a full search that found a grasp."""


@dataclass
class CaseGrasps:
    """The grasps of one case; ``held`` by what is sought, the scene's ``objective`` or the ``payload``."""

    name: str
    wanted: tuple[str, ...]
    effort: Effort
    held: Mapping[str, HeldGrasp] = field(default_factory=dict)
    found: GraspResult | None = None
    """Result of the last full search."""

    def search(self, scene: GraspScene) -> None:
        """Search for the best grasps in full; what is better than the one at hand replaces it.

        Raises
        ------
        LostGrasp
            There is none.
        """
        if "objective" in self.wanted:
            self.found = self._searched(scene)
            self._take("objective", self._settled(self.found))
        if "payload" in self.wanted:
            self._search_payload(scene)

    def follow(self, scene: GraspScene, guesses: dict[str, Array]) -> None:
        """Follow the grasps at hand to a scene nearby; where one is lost, search in full.

        Raises
        ------
        LostGrasp
            There is none.
        """
        for aim in self.wanted:
            near = self._near(aim, scene, guesses.get(aim))
            if near is None:
                self.held = {name: grasp for name, grasp in self.held.items() if name != aim}
                self.search(scene)
                return
            self.held = {**self.held, aim: near}

    # -- the scene's objective

    def _searched(self, scene: GraspScene) -> GraspResult:
        """The result of a full search; `LostGrasp` where there is no grasp."""
        effort = self.effort
        effort.searches += 1
        # Why there is no grasp is not asked, which takes longer than finding one.
        # 5, 1000: iterations per those of the longest search that has found a grasp, and at least
        iterations = min(scene.solver.max_total_iterations, max(1000, 5 * effort.most))
        solver = scene.solver.model_copy(update={"max_total_iterations": iterations})
        limited = scene.model_copy(update={"solver": solver}) if effort.most else scene
        result = optimize_grasp(limited, raise_on_failure=False)
        if not result.solved:
            raise LostGrasp(f"{self.name}: {result.message}")
        effort.most = max(effort.most, int(result.statistics["total_iterations"]))
        return replace(result, scene=scene)

    def _settled(self, result: GraspResult) -> HeldGrasp:
        """The grasp of a full search, its guarded places moved until they stand still."""
        scene, start = result.scene, GraspStart.of(result.scene, dict(result.arrays))
        if result.robustness is not None:
            grasp = self._run_joint(scene, start, result.robustness.active, result.robustness.touching)
        else:
            grasp = self._run(scene, start)
        if grasp is None:
            raise LostGrasp(f"{self.name}: the grasp was found but not again from its own numbers")
        return grasp

    def _near(self, aim: str, scene: GraspScene, guess: Array | None) -> HeldGrasp | None:
        """The grasp at hand at a scene nearby; from a guess, from its own unknowns, or from its posture alone."""
        before = self.held.get(aim)
        if before is None:
            return None
        start = moved_start(before.scene, scene, before.attempt.start)
        options: dict[str, Any] = {}
        if before.relaxed:
            scene = _with_mass(scene, before.scene.object.mass)
            options = {"relaxed": [(MASS, 1.0 - before.quantities["payload"] / before.scene.object.mass)]}
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

    def _run(self, scene: GraspScene, start: GraspStart, **options: Any) -> HeldGrasp | None:
        """A certified grasp from a start; None where there is none."""
        grasp = self._converged(scene, start, GraspSolverRun.of(scene, start.contacts), options_at=2, **options)
        if grasp is None:
            return None
        checked = scene if not grasp.relaxed else _with_mass(scene, grasp.quantities["payload"])
        return grasp if certify(checked, grasp.arrays).passed else None

    def _converged(
        self, scene: GraspScene, start: GraspStart, solver: GraspSolverRun | JointSolverRun, **options: Any
    ) -> HeldGrasp | None:
        """The grasp that a solver finds from a start, its guarded places moved until they stand still."""
        budget, before = Budget.of(scene.solver), None
        # 4: most runs until guarded places stand still
        for _ in range(4):
            attempt = solver.run(scene, start, budget, **options)
            self.effort.solves += 1
            self.effort.iterations += attempt.iterations
            if not attempt.converged or not np.isfinite(attempt.x).all():
                return None
            grasp = HeldGrasp(scene, solver, attempt, solver.arrays(scene, attempt), "relaxed" in options)
            # 1e-9: relative change of quantities at which another run from the same point is not worth it
            same = before is not None and _same(before.quantities, grasp.quantities, 1e-9)
            if same or not _probed(grasp):
                break
            before, options = grasp, {**options, "x0": attempt.x.copy(), "features": attempt.features}
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
        grasp = self._converged(scene, start, JointSolverRun(scene, start, errors, touching), x0=x0, features=features)
        if grasp is None:
            return None
        budget, bounds = Budget.of(scene.solver), scene.robust or Robust.model_construct()
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

    def _take(self, aim: str, grasp: HeldGrasp) -> None:
        """Keep a grasp unless the one at hand is better."""
        before = self.held.get(aim)
        if before is None or before.scene != grasp.scene or grasp.attempt.objective < before.attempt.objective:
            self.held = {**self.held, aim: grasp}

    # -- payload

    def _search_payload(self, scene: GraspScene) -> None:
        """From the best grasp of the scene's own mass; and from one with more than what was found, where there is."""
        near = self.held.get("payload")
        best: HeldGrasp | None = (
            near if near is not None and near.scene == _with_mass(scene, near.scene.object.mass) else None
        )
        mass = scene.object.mass if best is None else best.quantities["payload"] * (1.0 + SAME)
        for _ in range(_MASSES):
            try:
                result = self._searched(_with_mass(scene, mass))
            except LostGrasp:
                if best is not None:
                    break
                mass *= 0.5
                continue
            start = GraspStart.of(result.scene, dict(result.arrays))
            grasp = self._heaviest(result.scene, start, mass)
            if grasp is None:
                raise LostGrasp(f"{self.name}: no payload was found from the grasp of {mass:.3g} kg")
            if best is not None and grasp.quantities["payload"] < best.quantities["payload"] * (1.0 + SAME):
                break
            best, mass = grasp, grasp.quantities["payload"] * (1.0 + 10.0 * SAME)
        if best is None:
            raise LostGrasp(f"{self.name}: no mass down to {mass:.3g} kg can be held")
        self.held = {**self.held, "payload": best}
        if "objective" not in self.wanted:
            payload = best.quantities["payload"]
            heaviest, message = _with_mass(scene, payload), f"at most {payload:.4g} kg are held"
            self.found = GraspResult(
                heaviest, GraspStatus.OPTIMAL, message, best.arrays, certify(heaviest, best.arrays)
            )

    def _heaviest(self, scene: GraspScene, start: GraspStart, payload: float) -> HeldGrasp | None:
        """The greatest mass from a start that holds a payload; None where a solver finds none.

        It is sought below a multiple of that payload, again where it is all of that.
        """
        grasp: HeldGrasp | None = None
        for _ in range(_MASSES):
            # 3.0: mass in the scene, per payload that is held, below which the greatest is sought
            limit = 3.0 * payload
            more = self._run(_with_mass(scene, limit), start, relaxed=[(MASS, 1.0 - payload / limit)])
            grasp = more or grasp
            if more is None or not more.full:
                break
            payload, start = more.quantities["payload"], more.attempt.start
        return grasp

    # -- how all change

    def slopes(self, near: Stencil) -> tuple[dict[str, float], dict[str, Array]]:
        """Change of the quantities and of the unknowns along a direction."""
        quantities: dict[str, float] = {}
        unknowns: dict[str, Array] = {}
        for aim, held in self.held.items():
            along = near.change(partial(_with_mass, mass=held.scene.object.mass)) if held.relaxed else near
            unknowns[aim], numbers = held.slopes(along)
            quantities |= numbers
        return quantities, unknowns

    @property
    def quantities(self) -> dict[str, float]:
        """Quantities that expressions may name."""
        return {name: value for held in self.held.values() for name, value in held.quantities.items()}


def _with_mass(scene: GraspScene, mass: float) -> GraspScene:
    return scene.model_copy(update={"object": scene.object.model_copy(update={"mass": mass})})


def _probed(grasp: HeldGrasp) -> bool:
    """Whether limits of guarded places act, which move with the grasp."""
    forces = grasp.attempt.multipliers.constraints[grasp.solver.guarded]
    return bool(np.abs(forces).max(initial=0.0) > 1e-6)


def _same(first: dict[str, float], two: dict[str, float], tolerance: float) -> bool:
    return all(abs(first[name] - two[name]) <= tolerance * max(abs(first[name]), 1e-3) for name in first)


def fingers_mass(scene: GraspScene) -> float:
    """Mass of all fingers with what is fastened to them [kg]."""
    fingers: Sequence[Any] = tuple(scene.named_fingers.values())
    return float(sum(finger.rod.mass + sum(fastened.mass for fastened in finger.masses) for finger in fingers))
