"""Stable grasps next to unstable ones: the least eigenvalue of the second-order test becomes a constraint.

The eigenvalue is the certificate's own, of rods cut into many cells. It enters the NLP to first order, and the
point that solves it is where it is taken anew, until the grasp found is stable and hardly changes (successive
linearization: J. Nocedal, S. J. Wright, Numerical Optimization, 2006, chapter 18).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from continuum_grasp.arrays import Array
from continuum_grasp.grasp.certificate.recomputed import RecomputedGrasp
from continuum_grasp.grasp.certificate.stability import contact_stability
from continuum_grasp.grasp.problem.solver_run import OPTION_SETS, solver_for
from continuum_grasp.grasp.search import Search
from continuum_grasp.grasp.tried import Tried
from continuum_grasp.grasp.values import NEAR, SAME
from continuum_grasp.scene.grasp import GraspScene

LEAST = 1e-2
"""Least eigenvalue [E I / L] that is asked for: well above what changes of the last digits can undo."""
ROUNDS = 12
"""Linearizations from one unstable grasp."""
_STEP = 1e-6
"""Step of a difference quotient (problem's units): rounding of the eigenvalue is 1e-12 of the stiffest spring."""


def stabilize(search: Search) -> None:
    """Seek stable grasps next to the unstable ones that are better than the best stable one."""
    unstable = sorted((t for t in search.good if not t.acceptable), key=lambda t: t.attempt.objective)
    tried: list[float] = []
    for at in unstable:
        best, objective = search.best, at.attempt.objective
        # 2: unstable grasps from which a stable one is sought
        if search.budget.over or len(tried) == 2 or (best and best.attempt.objective <= objective):
            return
        if not any(abs(objective - other) <= NEAR * abs(other) for other in tried):
            tried.append(objective)
            _stabilize(search, at)


def _stabilize(search: Search, at: Tried) -> None:
    """Raise the least eigenvalue of an unstable grasp, by smaller steps where the solver does not follow."""
    solver = solver_for(replace(at.solver.problem.spec, steadied=True))
    share, before = 1.0, np.inf
    slope = _slope(search.scene, at)
    for _ in range(ROUNDS):
        value = at.certificate.stability.eigenvalue
        if search.budget.over or not np.isfinite(slope).all():
            return
        wanted = value + share * (LEAST - value)
        numbers = {"stability slope": slope, "stability level": wanted - value + float(slope @ at.attempt.x)}
        start, features = replace(at.attempt.start, label="stable"), at.attempt.features
        tried = search.attempt(
            start, solver, features=features, x0=at.attempt.x, numbers=numbers, iterations=OPTION_SETS[0][1]
        )
        if tried is None or not tried.attempt.converged or tried.certificate.stability.eigenvalue < value:
            share *= 0.4
            # 0.3: part of the way to stability of a step that the solver must at least follow
            if share < 0.3:
                return
            continue
        at, share, objective = tried, min(1.0, 2.0 * share), tried.attempt.objective
        if at.acceptable and abs(objective - before) <= SAME * max(1.0, abs(objective)):
            return
        before, slope = objective, _slope(search.scene, at)


def _slope(scene: GraspScene, at: Tried) -> Array:
    """Derivative of the eigenvalue by the unknowns, by differences."""
    solver, attempt = at.solver, at.attempt

    def value(x: Array) -> float:
        arrays = solver.arrays(scene, replace(attempt, x=x))
        return contact_stability(RecomputedGrasp(scene, arrays)).eigenvalue

    slope, here = np.zeros(attempt.x.size), value(attempt.x)
    shape = {f"{setup.name}.{key}" for setup in scene.setups for key in ("q", "pulls", "base")}
    for name, place in solver.problem.x.at.items():
        moves = name in shape or name == "object pose" or name.startswith(("force, ", "place, ")) or ".joint_" in name
        for k in range(place.start, place.stop) if moves else ():
            off = np.zeros(attempt.x.size)
            off[k] = _STEP
            slope[k] = (value(attempt.x + off) - here) / _STEP
    return slope
