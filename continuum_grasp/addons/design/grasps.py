"""The grasps of one case at one design after another: each from the one before, searched in full where that is lost."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from continuum_grasp.base import Array
from continuum_grasp.grasp import GraspResult, RodsAtScene, RodsFollower, Stencil
from continuum_grasp.scene import GraspScene

_HALVINGS = 12
"""Number of times that the mass in the scene is halved until any is held."""


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
    held: Mapping[str, RodsAtScene] = field(default_factory=dict)
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
            best = self._searched(scene)[0]
            self.found = self._certified(best)
            self._take("objective", best)
        if "payload" in self.wanted:
            heaviest = self._heaviest(scene)
            if "objective" not in self.wanted:
                self.found = self._certified(heaviest)
            self._take("payload", heaviest)

    def follow(self, scene: GraspScene, guesses: dict[str, Array]) -> None:
        """Follow the grasps at hand to a scene nearby; where one is lost, search in full.

        Raises
        ------
        LostGrasp
            There is none.
        """
        for aim in self.wanted:
            before = self.held.get(aim)
            near = before and before.follower.at(scene, before, guesses.get(aim))
            if near is None:
                self.held = {name: grasp for name, grasp in self.held.items() if name != aim}
                self.search(scene)
                return
            self.held = {**self.held, aim: near}

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

    def _searched(self, scene: GraspScene) -> list[RodsAtScene]:
        """Grasps of a full search, the best one first; `LostGrasp` where there is none."""
        self.effort.searches += 1
        # A grasp at hand counts too: at limits, no start of a search may lead to it.
        near = self.held.get("objective")
        found = RodsFollower.searched(scene, self.effort.count, [] if near is None else [near])
        if not found:
            raise LostGrasp(f"{self.name}: no grasp was found")
        return found

    def _certified(self, grasp: RodsAtScene) -> GraspResult:
        """The grasp as a result; `LostGrasp` where the independent certificate refuses it."""
        result = grasp.result()
        if not result.solved:
            raise LostGrasp(f"{self.name}: the independent certificate refuses the grasp: {result.message}")
        return result

    def _heaviest(self, scene: GraspScene) -> RodsAtScene:
        """The grasp with the greatest mass next to any that a full search found; `LostGrasp` where there is none."""
        mass = scene.object.mass
        for _ in range(_HALVINGS):
            lighter = scene.model_copy(update={"object": scene.object.model_copy(update={"mass": mass})})
            try:
                found = self._searched(lighter)
            except LostGrasp:
                mass *= 0.5
                continue
            most = [heaviest for grasp in found if (heaviest := grasp.follower.heaviest(grasp, scene)) is not None]
            if most:
                return max(most, key=lambda grasp: grasp.quantities["payload"])
        raise LostGrasp(f"{self.name}: no mass down to {mass:.3g} kg can be held")

    def _take(self, aim: str, grasp: RodsAtScene) -> None:
        """Take a grasp unless the one at hand is better."""
        before = self.held.get(aim)
        if before is None or before.scene != grasp.scene or grasp.objective < before.objective:
            self.held = {**self.held, aim: grasp}


def fingers_mass(scene: GraspScene) -> float:
    """Mass of all fingers with everything fastened to them [kg]."""
    fingers: Sequence[Any] = tuple(scene.named_fingers.values())
    mass = 0.0
    for finger in fingers:
        fastened = sum(each.mass for each in finger.masses)
        mass += finger.rod.mass + fastened
    return float(mass)
