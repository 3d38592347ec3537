"""A grasp at scenes nearby: found again without a search, and how it changes with the numbers of the scene."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from continuum_grasp.base import Array, amount_text
from continuum_grasp.grasp.body.bodies import body_of
from continuum_grasp.grasp.judge.certificate import certify_held
from continuum_grasp.grasp.result import GraspResult
from continuum_grasp.grasp.rods import kinds
from continuum_grasp.grasp.rods.answers import AskedAnswers, asked_of, steady_of
from continuum_grasp.grasp.rods.guess import Held
from continuum_grasp.grasp.rods.hand_numbers import hand_numbers
from continuum_grasp.grasp.rods.hand_search import HandRodSearch
from continuum_grasp.grasp.rods.numbers import GraspAims, SceneNumbers
from continuum_grasp.grasp.rods.optimize import stored
from continuum_grasp.grasp.rods.planar_numbers import planar_numbers
from continuum_grasp.grasp.rods.problem import GraspRods
from continuum_grasp.grasp.rods.record import held_rods
from continuum_grasp.grasp.rods.search import RodSearch
from continuum_grasp.grasp.rods.solving import RodGrasp, RodStart, StartedSearch
from continuum_grasp.grasp.rods.stencil import STEP, Stencil, StructureChanges
from continuum_grasp.grasp.values import SAME, GraspStatus
from continuum_grasp.nlp import Attempt, Budget, SolutionSlopes, Start
from continuum_grasp.scene import GraspScene, HandScene

_PLACED = {"position", "angle", "rotation", "mass", "density", "free", "against"}
"""Keys of an object that leave its surface as it is."""


@dataclass(frozen=True, eq=False)
class NearStart(RodStart):
    """A start with the numbers of another scene, next to a grasp of the first one."""

    before: RodStart
    own: SceneNumbers

    def __post_init__(self) -> None:
        for name in ("on", "places", "imbalance", "aim"):
            object.__setattr__(self, name, getattr(self.before, name))

    def changed(self, scene: Any) -> RodStart:
        """The start in a scene with other limits."""
        return self.before.changed(scene)

    @property
    def numbers(self) -> SceneNumbers:
        """The scene in plain numbers."""
        return self.own

    @property
    def guesses(self) -> Any:
        """Knowledge about each finger."""
        return self.before.guesses

    @property
    def joints(self) -> list[tuple[float, ...]]:
        """Approximate places of the middle contacts of each finger [L]."""
        return self.before.joints

    @property
    def supports(self) -> Held:
        """Forces of supports by name [F0]."""
        return self.before.supports


def numbers_near(grasp: RodGrasp, before: Any, scene: Any) -> SceneNumbers:
    """The numbers of a scene with the contacts of a grasp of another one."""
    problem, numbers, on = grasp.problem, grasp.problem.numbers, grasp.start.on
    table = numbers.table
    if _surface(before) != _surface(scene):
        table = table.of_body(body_of(scene.object), scene.object.size)
    if isinstance(scene, HandScene):
        return hand_numbers(scene, on, table)
    x, y, angle = grasp.attempt.x[problem.pose] * [numbers.size, numbers.size, 1.0]
    pose = scene.object.pose if scene.object.free is None else (float(x), float(y), float(angle))
    bases = tuple((*setup.finger.base.position, setup.finger.base.angle) for setup in scene.setups)
    return planar_numbers(scene, on, (pose, bases), numbers.force, table)


def _surface(scene: Any) -> dict[str, Any]:
    """Data of the surface of a scene's object."""
    return dict(scene.object.model_dump(exclude=_PLACED))


@dataclass(frozen=True)
class AnyMass:
    """The problem of a scene whose object may have any mass, at a gain for a greater one."""

    answers: AskedAnswers | None
    """Answers that the scene requires."""
    shares: bool
    """Whether their push is in proportion to the mass."""

    def __call__(self, problem: GraspRods) -> None:
        """Add the mass to a problem."""
        if self.answers is not None:
            self.answers(problem)
        less = problem.unknown("less mass", -np.inf, 1.0)
        problem.cost(less, 1.0)
        problem.add_load_share(less)
        if self.shares and "push" in problem.at:
            push = problem.at["push"]
            least = float(problem.limits[0][push][0])
            row = problem.rows("push of the mass", "contacts.push", "F0", 1, 1.0, least, least).ravel()
            problem.bound(push, 0.0, np.inf)
            problem.add(kinds.share_kind(), push, row, [1.0])
            problem.add(kinds.share_kind(), less, row, [least])


def _variant_at(scene: Any, grasp: RodGrasp) -> Callable[[GraspRods], None] | None:
    """The variant of the problem of a grasp, with the numbers of another scene."""
    variant = grasp.variant
    if isinstance(variant, AnyMass):
        return _any_mass(scene, with_answers=variant.answers is not None)
    if not isinstance(variant, AskedAnswers):
        return variant
    aims = variant if isinstance(scene, HandScene) or scene.unloaded else asked_of(scene)
    steady = steady_of(scene) if variant.stiffness else None
    if steady is None:
        return aims
    return steady.joined(aims if variant.aimed else None)


def _any_mass(scene: Any, *, with_answers: bool) -> AnyMass:
    return AnyMass(steady_of(scene) if with_answers else None, scene.contacts.push is None)


@dataclass(frozen=True, eq=False)
class RodsAtScene:
    """A grasp of rods at a scene.

    Of one whose mass is ``chosen``, the greatest mass is sought.
    """

    scene: GraspScene | HandScene
    grasp: RodGrasp
    follower: RodsFollower

    @property
    def chosen(self) -> bool:
        """Whether the mass of the object is sought."""
        return isinstance(self.grasp.variant, AnyMass)

    @cached_property
    def quantities(self) -> dict[str, float]:
        """Quantities of the grasp that expressions may name."""
        return self._quantities(self.scene, self.grasp.problem, self.grasp.attempt.x)

    def result(self) -> GraspResult:
        """The grasp as a result of a scene in the plane, with the mass that it holds."""
        scene, held = self._weighed, held_rods(self.grasp)
        certificate = certify_held(scene, held)
        resolved, arrays, errors = stored(scene, held, certificate)
        status = GraspStatus.FEASIBLE if certificate.passed else GraspStatus.NOT_SOLVED
        tension = amount_text(self.grasp.tension, "N", ".4g")
        message = f"held with a sum of tensions of {tension}" if certificate.passed else str(certificate.worst)
        return GraspResult(resolved, status, message, arrays, certificate, element_errors=errors)

    @property
    def _weighed(self) -> Any:
        """The scene with the mass that is held."""
        if not self.chosen:
            return self.scene
        known = self.scene.object
        return self.scene.model_copy(update={"object": known.model_copy(update={"mass": self.quantities["payload"]})})

    @property
    def attempt(self) -> Attempt:
        """The solve that found it."""
        return self.grasp.attempt

    @property
    def objective(self) -> float:
        """Aim of the grasp."""
        return self.grasp.attempt.objective

    @property
    def acting(self) -> tuple[tuple[float, ...], ...]:
        """Errors that decide the grasp: none of one that is held as the scene is."""
        return ()

    def slopes(self, near: Stencil) -> tuple[Array, dict[str, float]]:
        """Derivatives of the unknowns (n,) and of the quantities along a direction of scenes.

        Raises
        ------
        StructureChanges
            Scenes there have a problem of another structure.
        """
        problem, x = self.grasp.problem, self.grasp.attempt.x
        beside = [self._problem(scene) for scene in near.scenes]
        if not all(other.nlp is problem.nlp for other in beside):
            raise StructureChanges("the grasp problem changes its structure here")
        starts = [other.start(x) for other in beside]
        moved = self._slopes.unknowns(near.difference, [self._unclipped(start) for start in starts])
        samples = [
            self._quantities(scene, other, x + offset * STEP * moved)
            for offset, scene, other in zip(near.offsets, near.scenes, beside, strict=True)
        ]
        slopes = {name: float(near.difference([s[name] for s in samples])) for name in self.quantities}
        return moved, slopes | (self._optimal_mass(near, starts, moved) if self.chosen else {})

    def _optimal_mass(self, near: Stencil, starts: Sequence[Start], moved: Array) -> dict[str, float]:
        """Derivative of the greatest mass, as an optimal value: multipliers that are not unique do not matter to it."""
        grasp = self.grasp
        less = int(grasp.problem.at["less mass"][0])
        unclipped = [self._unclipped(start) for start in starts]
        others = []
        for offset, start in zip(near.offsets, starts, strict=True):
            x = grasp.attempt.x + offset * STEP * moved
            cost, _ = grasp.problem.nlp.functions["grad_f"](x, start.p)
            others.append(float(cost) - x[less])
        change = self._slopes.value(near.difference, unclipped) - near.difference(others)
        share = 1.0 - float(grasp.attempt.x[less])
        masses = [_mass(scene) for scene in near.scenes]
        return {"payload": share * float(near.difference(masses)) - _mass(self.scene) * float(change)}

    @cached_property
    def _slopes(self) -> SolutionSlopes:
        grasp = self.grasp
        return SolutionSlopes(grasp.problem.nlp, grasp.problem.start(grasp.attempt.x), grasp.attempt)

    def _unclipped(self, start: Start) -> Start:
        return replace(start, x=self.grasp.attempt.x)

    def _problem(self, scene: Any) -> GraspRods:
        """The problem of a scene beside this one, with the same rows."""
        grasp, known = self.grasp, self.grasp.problem
        numbers = numbers_near(grasp, self.scene, scene)
        if self.chosen:
            numbers = replace(numbers, aims=GraspAims(0.0, 0.0))
        problem = GraspRods(
            numbers,
            joints=grasp.start.joints,
            stages=known.stages,
            places=known.places,
            near=known.near,
            fine=known.fine,
        )
        if (variant := _variant_at(scene, grasp)) is not None:
            variant(problem)
        return problem

    def _quantities(self, scene: Any, problem: GraspRods, x: Array) -> dict[str, float]:
        """Quantities next to this grasp: greatest and least ones belong to the tendon or contact that has them here."""
        if self.chosen:
            return {"payload": _mass(scene) * (1.0 - float(x[problem.at["less mass"]][0]))}
        tensions, forces, margins = _parts(scene, problem, x)
        tightest, pressed, least = self._extremes
        return {
            "tension": float(tensions.sum()),
            "tension_max": float(tensions[tightest]),
            "normal_force_max": float(forces[pressed]),
            "friction_margin": float(margins[least]),
        }

    @cached_property
    def _extremes(self) -> tuple[int, int, int]:
        """Indices of the greatest tension and normal force, and of the least friction margin."""
        tensions, forces, margins = _parts(self.scene, self.grasp.problem, self.grasp.attempt.x)
        return int(tensions.argmax()), int(forces.argmax()), int(margins.argmin())


def _agree(found: Sequence[RodsAtScene]) -> bool:
    """Whether several grasps have the same aim."""
    aims = [each.objective for each in found]
    return len(aims) > 1 and max(aims) - min(aims) <= SAME * abs(min(aims))


def _mass(scene: Any) -> float:
    """Mass of a scene's object [kg]."""
    return float(scene.object.weighed if isinstance(scene, HandScene) else scene.object.mass)


def _parts(scene: Any, problem: GraspRods, x: Array) -> tuple[Array, Array, Array]:
    """Tensions and normal forces [N], and friction margins of the contacts, without the reserve."""
    numbers = problem.numbers
    pairs = zip(numbers.fingers, problem.parts, strict=True)
    tensions = np.concatenate([finger.tensions(x[part.pulls]) for finger, part in pairs])
    limits = {name: (finger.friction, finger.force) for finger in numbers.fingers for name in finger.contacts}
    limits |= {support.name: (support.friction, numbers.force) for support in numbers.supports}
    held = np.array([x[at] * limits[name][1] for name, at in problem.contacts.items()])
    friction = np.array([limits[name][0] for name in problem.contacts]) / (1.0 - scene.contacts.reserve)
    across = np.linalg.norm(held[:, 1:], axis=1)
    return tensions, held[:, 0], 1.0 - across / np.maximum(friction * held[:, 0], 1e-15)


@dataclass(frozen=True, eq=False)
class RodsFollower:
    """Finds grasps again without a search.

    Parameters
    ----------
    search : StartedSearch
        That found the first one.
    spent : callable
        Called with the iterations of each solve.
    """

    search: StartedSearch
    spent: Callable[[int], None] = lambda iterations: None

    @classmethod
    def searched(
        cls,
        scene: Any,
        spent: Callable[[int], None] = lambda iterations: None,
        beside: Sequence[RodsAtScene] = (),
    ) -> list[RodsAtScene]:
        """Grasps of a scene, as stable as it requires, the best one first and the others by their aim.

        They are followed from grasps of scenes ``beside`` it, and found by a full search unless several of these lead
        to the same one.
        """
        kind = HandRodSearch if isinstance(scene, HandScene) else RodSearch
        search = kind(scene, Budget.of(scene.solver))
        follower = cls(search, spent)
        near = [found for before in beside if (found := follower.at(scene, before)) is not None]
        if not _agree(near):
            search.run()
        steady = search.steady
        held = [g for g in search.tried if (g.holds if steady is None else g.meets(steady))]
        others = [RodsAtScene(scene, grasp, follower) for grasp in held]
        return sorted([*near, *others], key=lambda each: (not each.grasp.fine, each.objective))

    def at(self, scene: Any, before: RodsAtScene, guess: Array | None = None) -> RodsAtScene | None:
        """A grasp at a scene nearby, from a guess or from its own unknowns; None where it is lost."""
        numbers = numbers_near(before.grasp, before.scene, scene)
        if before.chosen:
            numbers = replace(numbers, aims=GraspAims(0.0, 0.0))
        start, variant = NearStart(before.grasp.start, numbers), _variant_at(scene, before.grasp)
        for x in [*([] if guess is None else [guess]), before.grasp.attempt.x]:
            beside = replace(before.grasp, attempt=replace(before.grasp.attempt, x=x))
            found = self._solved(scene, start, beside, variant)
            if found is not None:
                return found
        return None

    def heaviest(self, before: RodsAtScene, scene: Any) -> RodsAtScene | None:
        """The grasp of a scene with the greatest mass next to one, as stable as the scene requires; None where the
        solver finds none.
        """
        numbers = replace(numbers_near(before.grasp, before.scene, scene), aims=GraspAims(0.0, 0.0))
        start = NearStart(before.grasp.start, numbers)
        found = self._solved(scene, start, before.grasp, _any_mass(scene, with_answers=False))
        if found is None or steady_of(scene) is None:
            return found
        return self._solved(scene, start, found.grasp, _any_mass(scene, with_answers=True))

    def _solved(
        self,
        scene: Any,
        start: NearStart,
        beside: RodGrasp,
        variant: Callable[[GraspRods], None] | None,
    ) -> RodsAtScene | None:
        """A grasp as stable as the scene requires."""
        grasp = self.search.solved(start, widen=variant, beside=beside, fine=beside.fine)
        self.spent(grasp.attempt.iterations)
        steady = None if isinstance(variant, AnyMass) else steady_of(scene)
        if grasp.holds and steady is not None and not grasp.meets(steady):
            answers = variant if isinstance(variant, AskedAnswers) else None
            grasp = self.search.solved(start, widen=steady.joined(answers), beside=grasp, fine=beside.fine)
            self.spent(grasp.attempt.iterations)
        return RodsAtScene(scene, grasp, self) if grasp.holds else None
