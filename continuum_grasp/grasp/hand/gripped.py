"""Grasps of a hand whose contacts press more than one weight asks: for a weight of any direction, or for pushes.

From a grasp with a weight along one direction, the object is held by normal forces whose sum rises step by step, with
the least friction; at each step the contacts' needs follow to first order. More is not always safer: fingers curl past
the object.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from continuum_grasp.base import amount_text
from continuum_grasp.grasp.hand.certificate import HandCertificate, certify_hand
from continuum_grasp.grasp.hand.parts import Aims
from continuum_grasp.grasp.hand.problem import HandSpec, hand_problem
from continuum_grasp.grasp.hand.search import HandSearch, HandTried
from continuum_grasp.scene import HandScene

STEP = 1.15
"""Ratio of the sums of normal forces of a step and the one before."""
STEPS = 18
"""Steps at most: twelve times the normal forces of the first."""
PUSH_STEP, PUSH_STEPS = 1.5, 14
"""The same where a push is sought: up to two hundred times the normal forces of the first, which bears next to none."""
REFINED, NEAR_PUSH = 4, 0.05
"""Steps toward the least normal forces that bear a push, and the share by which it may be more, which ends them."""


@dataclass(frozen=True)
class GrippedGrasp:
    """A grasp whose normal forces have a sum that was asked for."""

    scene: HandScene
    tried: HandTried
    certificate: HandCertificate
    grip: float  # sum of the normal forces [N]

    @property
    def friction(self) -> float:
        """Coefficient of friction that a weight of any direction needs, per one that is there less the reserve."""
        return max((c.friction / c.held for c in self.certificate.turned), default=float("inf"))

    @property
    def yielding(self) -> float:
        """Motion of the object per what is allowed, the greater of displacement and turn."""
        moved = zip(self.certificate.turned_motion, self.scene.most_motion, strict=True)
        return max(motion / most for motion, most in moved)

    @property
    def push(self) -> float:
        """Push that it bears in every direction [N]; none where it is not a grasp as the scene asks."""
        return self.certificate.push if self.certificate.acceptable else 0.0


def turned_grasps(scene: HandScene, held: HandTried, search: HandSearch) -> list[GrippedGrasp]:
    """Grasps with rising forces next to one with a weight along -z, up to the first that holds every direction."""
    found = list[GrippedGrasp]()
    for grasp in _rising(scene, held, search, STEP, STEPS):
        if grasp.certificate.passed_at_rest:
            found.append(grasp)
            words = f"{amount_text(grasp.grip, 'N', '.4g')} on the object"
            search.budget.tell(f"{words}: it needs {grasp.friction:.3g} of the available friction")
            if grasp.certificate.acceptable:
                break
    return found


def pushed_grasps(scene: HandScene, held: HandTried, search: HandSearch, enough: float) -> list[GrippedGrasp]:
    """Grasps with rising forces next to one that bear a push in every direction, up to the first that bears enough
    [N]; with an infinite push all that there are.
    """
    found = list[GrippedGrasp]()
    for grasp in _rising(scene, held, search, PUSH_STEP, PUSH_STEPS):
        words = f"{amount_text(grasp.grip, 'N', '.4g')} on the object"
        search.budget.tell(f"{words}: it bears a push of {amount_text(grasp.push, 'N', '.3g')}")
        found.append(grasp)
        if grasp.push >= enough:
            break
    return found


def least_pushed(grasps: list[GrippedGrasp], search: HandSearch, enough: float) -> GrippedGrasp | None:
    """The grasp with the least normal forces that bears a push [N], between those of rising forces; None where none
    does.
    """
    bearing = next((k for k, grasp in enumerate(grasps) if grasp.push >= enough), None)
    if bearing is None:
        return None
    best = grasps[bearing]
    low = grasps[bearing - 1].grip if bearing else 0.0
    for _ in range(REFINED):
        if best.push <= (1.0 + NEAR_PUSH) * enough or search.budget.over:
            break
        # A push rises about as the forces do; half way at most, where that is below what does not bear it.
        grip = max(best.grip * enough / best.push, 0.5 * (low + best.grip))
        grasp = _gripped(best.scene, best.tried, search, grip)
        if grasp is not None and grasp.push >= enough:
            best = grasp
        else:
            low = grip
    return best


def _rising(scene: HandScene, held: HandTried, search: HandSearch, step: float, steps: int) -> Iterator[GrippedGrasp]:
    """Grasps next to one, with normal forces whose sum rises by a ratio, as long as there are some."""
    grip = float((held.arrays["contact_forces"] * held.arrays["contact_normals"]).sum())
    last = held
    for _ in range(steps):
        grasp = None if search.budget.over else _gripped(scene, last, search, grip)
        if grasp is None:
            return
        yield grasp
        last = grasp.tried
        grip *= step


def _gripped(scene: HandScene, near: HandTried, search: HandSearch, grip: float) -> GrippedGrasp | None:
    """The grasp next to one whose normal forces have a sum [N]."""
    spec = HandSpec.of(scene, near.on)
    problem = hand_problem(replace(spec, pairs=near.problem.spec.pairs, aims=Aims(gripped=True)))
    tried = search.next_to(near, problem, {"grip": np.array([grip / search.units.force])})
    if not tried.attempt.converged:
        return None
    return GrippedGrasp(scene, tried, certify_hand(scene, tried.arrays), grip)
