"""The grasp of a hand that is turned: it holds the object while its weight takes every direction.

From a grasp with the weight along -z, the object without weight is held by normal forces whose sum rises step by step,
with the least friction; at each step the contacts' needs under a weight of any direction follow to first order. More
is not always safer: fingers curl past the object.
"""

from __future__ import annotations

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


@dataclass(frozen=True)
class TurnedGrasp:
    """A grasp without weight, and what it needs while the weight takes every direction."""

    scene: HandScene
    tried: HandTried
    certificate: HandCertificate

    @property
    def friction(self) -> float:
        """Coefficient of friction that is needed, per one that is there less the reserve."""
        return max((c.friction / c.held for c in self.certificate.turned), default=float("inf"))

    @property
    def yielding(self) -> float:
        """Motion of the object per what is allowed, the greater of displacement and turn."""
        moved = zip(self.certificate.turned_motion, self.scene.most_motion, strict=True)
        return max(motion / most for motion, most in moved)


def turned_grasps(scene: HandScene, held: HandTried, search: HandSearch) -> list[TurnedGrasp]:
    """Grasps with rising forces next to one with a weight along -z, up to the first that holds every direction."""
    spec = HandSpec.of(scene, held.on)
    problem = hand_problem(replace(spec, pairs=held.problem.spec.pairs, aims=Aims(gripped=True)))
    forces, normals = held.arrays["contact_forces"], held.arrays["contact_normals"]
    grip = float((forces * normals).sum())
    last = held
    found = list[TurnedGrasp]()
    for _ in range(STEPS):
        tried = search.next_to(last, problem, {"grip": np.array([grip / search.units.force])})
        if search.budget.over or not tried.attempt.converged:
            break
        certificate = certify_hand(scene, tried.arrays)
        if certificate.passed_at_rest:
            found.append(TurnedGrasp(scene, tried, certificate))
            words = f"{amount_text(grip, 'N', '.4g')} on the object"
            search.budget.tell(f"{words}: it needs {found[-1].friction:.3g} of the available friction")
            if certificate.acceptable:
                break
        last, grip = tried, STEP * grip
    return found
