"""The grasps of exact rods of one case at one design after another; `CaseGrasps` has the same of few elements."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from continuum_grasp.addons.design.grasps import Effort, LostGrasp
from continuum_grasp.base import Array
from continuum_grasp.grasp import GraspResult, RodsAtScene, RodsFollower, Stencil
from continuum_grasp.scene import GraspScene

_HALVINGS = 12
"""Number of times that the mass in the scene is halved until any is held."""


@dataclass
class CaseRods:
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
            self._take("objective", self._searched(scene)[0])
        if "payload" in self.wanted:
            self._take("payload", self._heaviest(scene))

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
        found = RodsFollower.searched(scene, self.effort.count)
        if not found:
            raise LostGrasp(f"{self.name}: no grasp was found")
        return found

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
