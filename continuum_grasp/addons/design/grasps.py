"""The grasps of one case at one design after another: each from the one before, searched in full where that is lost."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from continuum_grasp.base import Array
from continuum_grasp.grasp import SAME, GraspFollower, GraspResult, HeldGrasp, Stencil, optimize_grasp
from continuum_grasp.scene import GraspScene

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

    def count(self, iterations: int) -> None:
        """Count a run of the solver from a grasp nearby."""
        self.solves += 1
        self.iterations += iterations


@dataclass
class CaseGrasps:
    """The grasps of one case; ``held`` by their aim, the scene's ``objective`` or the ``payload``."""

    name: str
    wanted: tuple[str, ...]
    effort: Effort
    held: Mapping[str, HeldGrasp] = field(default_factory=dict)
    found: GraspResult | None = None
    """Result of the last full search."""

    def search(self, scene: GraspScene) -> None:
        """Search for the best grasps in full; a better one replaces the one at hand.

        Raises
        ------
        LostGrasp
            There is none.
        """
        if "objective" in self.wanted:
            self.found = self._searched(scene)
            grasp = self._follower.again(self.found)
            if grasp is None:
                raise LostGrasp(f"{self.name}: the solver found the grasp, but not a second time from its own numbers")
            self._take("objective", grasp)
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
            before = self.held.get(aim)
            near = before and self._follower.at(scene, before, guesses.get(aim))
            if near is None:
                self.held = {name: grasp for name, grasp in self.held.items() if name != aim}
                self.search(scene)
                return
            self.held = {**self.held, aim: near}

    @property
    def _follower(self) -> GraspFollower:
        return GraspFollower(self.effort.count, _MASSES)

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
            grasp = self._follower.heaviest(result, mass)
            if grasp is None:
                raise LostGrasp(f"{self.name}: the solver found no payload, starting from the grasp of {mass:.3g} kg")
            if best is not None and grasp.quantities["payload"] < best.quantities["payload"] * (1.0 + SAME):
                break
            best = grasp
            mass = grasp.quantities["payload"] * (1.0 + 10.0 * SAME)
        if best is None:
            raise LostGrasp(f"{self.name}: no mass down to {mass:.3g} kg can be held")
        self.held = {**self.held, "payload": best}
        if "objective" not in self.wanted:
            self.found = best.result(f"at most {best.quantities['payload']:.4g} kg are held")

    # -- how all change

    def slopes(self, near: Stencil) -> tuple[dict[str, float], dict[str, Array]]:
        """Change of the quantities and of the unknowns along a direction."""
        quantities: dict[str, float] = {}
        unknowns: dict[str, Array] = {}
        for aim, held in self.held.items():
            unknowns[aim], numbers = held.slopes(near)
            quantities |= numbers
        return quantities, unknowns

    @property
    def quantities(self) -> dict[str, float]:
        """Quantities that expressions may name."""
        return {name: value for held in self.held.values() for name, value in held.quantities.items()}


def _with_mass(scene: GraspScene, mass: float) -> GraspScene:
    return scene.model_copy(update={"object": scene.object.model_copy(update={"mass": mass})})


def fingers_mass(scene: GraspScene) -> float:
    """Mass of all fingers with everything fastened to them [kg]."""
    fingers: Sequence[Any] = tuple(scene.named_fingers.values())
    mass = 0.0
    for finger in fingers:
        fastened = sum(each.mass for each in finger.masses)
        mass += finger.rod.mass + fastened
    return float(mass)
