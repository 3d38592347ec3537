"""Raise the contact forces of a hand's grasp, to hold a weight in any direction or to bear pushes.

The search starts from a grasp of a weight in one direction and raises the sum of the normal forces step by step, with
the least friction; at each step the required friction follows to first order. Larger forces are not always safer:
fingers curl past the object.
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
"""Ratio of the sums of normal forces of successive steps."""
STEPS = 18
"""Greatest number of steps: up to twelve times the normal forces of the first."""
PUSH_STEP, PUSH_STEPS = 1.5, 14
"""Greatest number of steps for a push: up to 200 times the normal forces of the first, which bears almost no push."""
REFINED, NEAR_PUSH = 4, 0.05
"""Greatest number of steps to the least normal forces that bear a push, and the excess of push that ends them [1]."""


@dataclass(frozen=True)
class GrippedGrasp:
    """Grasp with a given sum of normal forces."""

    scene: HandScene
    tried: HandTried
    certificate: HandCertificate
    grip: float  # sum of the normal forces [N]

    @property
    def friction(self) -> float:
        """Friction coefficient that a weight in any direction needs, per available coefficient after the reserve
        [1].
        """
        return max((c.friction / c.held for c in self.certificate.turned), default=float("inf"))

    @property
    def yielding(self) -> float:
        """Motion of the object per allowed motion [1], the greater of displacement and turn."""
        moved = zip(self.certificate.turned_motion, self.scene.most_motion, strict=True)
        return max(motion / most for motion, most in moved)

    @property
    def push(self) -> float:
        """Push that the grasp bears in every direction [N]; zero if the grasp violates the scene's limits."""
        return self.certificate.push if self.certificate.acceptable else 0.0


def turned_grasps(scene: HandScene, held: HandTried, search: HandSearch) -> list[GrippedGrasp]:
    """Yield grasps with rising forces near one with a weight along -z, up to the first that holds in every
    direction.
    """
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
    """Yield grasps with rising forces near one, up to the first that bears a push in every direction [N]; an infinite
    push gives all.
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
    """Return the grasp with the least normal forces that bears a push [N], between grasps of rising forces; None
    without one.
    """
    bearing = next((k for k, grasp in enumerate(grasps) if grasp.push >= enough), None)
    if bearing is None:
        return None
    best = grasps[bearing]
    low = grasps[bearing - 1].grip if bearing else 0.0
    for _ in range(REFINED):
        if best.push <= (1.0 + NEAR_PUSH) * enough or search.budget.over:
            break
        # The push rises about as the forces do; the step goes at most half way to the forces that do not bear it.
        grip = max(best.grip * enough / best.push, 0.5 * (low + best.grip))
        grasp = _gripped(best.scene, best.tried, search, grip)
        if grasp is not None and grasp.push >= enough:
            best = grasp
        else:
            low = grip
    return best


def _rising(scene: HandScene, held: HandTried, search: HandSearch, step: float, steps: int) -> Iterator[GrippedGrasp]:
    """Yield grasps near one, with a sum of normal forces that rises by a ratio, as long as grasps exist."""
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
    """Return the grasp near one with a given sum of normal forces [N]."""
    spec = HandSpec.of(scene, near.on)
    problem = hand_problem(replace(spec, pairs=near.problem.spec.pairs, aims=Aims(gripped=True)))
    tried = search.next_to(near, problem, {"grip": np.array([grip / search.units.force])})
    if not tried.attempt.converged:
        return None
    return GrippedGrasp(scene, tried, certify_hand(scene, tried.arrays), grip)
