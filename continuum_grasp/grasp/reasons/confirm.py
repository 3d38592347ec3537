"""The numbers of reasons, found once more by linear programming at the posture that the optimizer ended at.

Where shapes and places are given, every equation of a grasp is linear in tensions and contact forces. So the least
tension, friction coefficient or normal force limit, the greatest mass, and the least moment that tilts, are optima of
linear problems (LP; SOCP out of the plane), which need no start and know no local optima. Nothing is
shared with the optimizer: the equations are the certificate's.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.certificate.check import EQUILIBRIUM
from continuum_grasp.grasp.quality.lp import Cones, LPOutcome, solve_socp
from continuum_grasp.grasp.reasons.posture_statics import PostureStatics
from continuum_grasp.scene.grasp import GraspScene

Array = NDArray[Any]

OFF = 0.2 * EQUILIBRIUM
"""By what part equations may be off: a given posture is never exact, and with many elements there are more equations
than forces. Well below what the certificate lets pass."""
PRECISION = 1e-6
"""Of a friction coefficient, relative."""


@dataclass(frozen=True)
class Confirmed:
    """The numbers of a reason, by LP."""

    amount: float  # least amount by which the limit must be relaxed at the posture
    arrays: dict[str, Array]  # the posture with the tensions and contact forces of that amount


def least_amount(name: str, scene: GraspScene, arrays: Mapping[str, Any], amount: float) -> Confirmed | None:
    """By how much the limit of a relaxation must be relaxed at least at a posture, and the forces that then hold.

    The scene has its limit as it is; the ``arrays``, as `continuum_grasp.grasp.certify` takes them, are those of the
    grasp that there is with the limit relaxed by ``amount``. None where no LP applies, for limits of the shape, and
    where it fails.
    """
    ask = _ASKED.get(name)
    if ask is None:
        return None
    statics = PostureStatics.of(scene, arrays)
    found = ask(_PostureProblem(statics), amount)
    if found is None:
        return None
    least, x = found
    tensions, forces = x[: statics.tensions].reshape(-1, 2), x[statics.tensions :].reshape(-1, 3)
    changed = {key: np.asarray(value) for key, value in arrays.items()} | {"contact_forces": forces * statics.force}
    for setup, pair in zip(scene.setups, tensions, strict=True):
        changed[f"{setup.name}.tensions"] = pair * statics.force
    return Confirmed(least, changed)


class _PostureProblem:
    """LPs or SOCPs over the tensions and forces x and the amount z, which comes last."""

    def __init__(self, statics: PostureStatics) -> None:
        self.statics = statics
        self.size = statics.own.size
        self.pulling = np.flatnonzero(statics.most[: statics.tensions] > 0.0)
        self.normals = np.arange(statics.tensions, self.size, 3)
        self._cuts: list[tuple[int, Array]] | None = None

    def least(
        self,
        *,
        along: Array | None = None,
        most: float = np.inf,
        relaxed: Array | None = None,
        tilted: bool = False,
        added: float = 0.0,
    ) -> LPOutcome:
        """Least z for which x satisfies everything, with ``added`` to all friction coefficients.

        z, which is ``most`` at most, adds ``along`` (m,) to the rows, and is added to the upper limits of the tensions
        or forces with the indices ``relaxed``; where ``tilted``, the norm of the tilting moment may be z, not zero.
        """
        s, size = self.statics, self.size
        # Equations hold to a tolerance, as ranges: a stored posture solves them to rounding only.
        rows = np.column_stack([s.rows, np.zeros(len(s.rows)) if along is None else along])
        middle, wide = s.right - s.weight, np.full(len(s.rows), OFF)
        blocks, lower, upper = [rows], [middle - wide], [middle + wide]
        if not tilted and s.balances_tilt:
            blocks.append(np.column_stack([s.tilt, np.zeros(2)]))
            lower.append(np.full(2, -OFF))
            upper.append(np.full(2, OFF))
        highest = np.append(s.most, most)
        if relaxed is not None and relaxed.size:
            spare = np.zeros((relaxed.size, size + 1))
            spare[np.arange(relaxed.size), relaxed], spare[:, -1] = 1.0, -1.0
            blocks.append(spare)
            lower.append(np.full(relaxed.size, -np.inf))
            upper.append(s.most[relaxed])
            highest[relaxed] = np.inf
        cost = np.zeros(size + 1)
        cost[-1] = 1.0
        cones = self._cones(s.share * (s.friction + added), tilted)
        bounds = np.append(s.least, 0.0), highest
        return solve_socp(cost, np.concatenate(blocks), np.concatenate(lower), np.concatenate(upper), *bounds, cones)

    def _cones(self, friction: Array, tilted: bool) -> Cones:
        count = self.normals.size
        matrix, width = np.zeros((count + tilted, 2, self.size + 1)), np.zeros((count + tilted, self.size + 1))
        for k, n in enumerate(self.normals):
            # |(friction, lift)| <= mu N; a lift that must be zero takes no part.
            matrix[k, 0, n + 1] = 1.0
            matrix[k, 1, n + 2] = float(self.statics.most[n + 2] > 0.0)
            width[k, n] = friction[k]
        if tilted:
            matrix[-1, :, :-1] = self.statics.tilt
            width[-1, -1] = 1.0
        cones = Cones.made(matrix, np.zeros((count + tilted, 2)), width, np.zeros(count + tilted))
        if self._cuts is not None:  # tangent planes that were found hold for every coefficient
            cones.cuts = self._cuts
        self._cuts = cones.cuts
        return cones


def _found(outcome: LPOutcome, unit: float) -> tuple[float, Array] | None:
    return (max(0.0, float(outcome.x[-1])) * unit, outcome.x[:-1]) if outcome.optimal else None


def _friction(problem: _PostureProblem, amount: float) -> tuple[float, Array] | None:
    """By bisection: force and coefficient multiply, so that only with a given coefficient it is an LP."""
    high, best = 0.0, None
    # The amount found may be rounding too small for its own posture.
    for more in (1e-5, 1e-3, 1e-1):
        high = amount * (1.0 + more)
        best = problem.least(added=high)
        if best.optimal:
            break
    if best is None or not best.optimal:
        return None
    low, guess = 0.0, amount * (1.0 - 1e-5)
    while high - low > PRECISION * (high + float(problem.statics.friction.max(initial=0.0))):
        found = problem.least(added=guess)
        if found.status == "infeasible":
            low = guess
        elif found.optimal:
            high, best = guess, found
        else:
            return None
        guess = 0.5 * (low + high)
    return high, best.x[:-1]


_ASKED: dict[str, Callable[[_PostureProblem, float], tuple[float, Array] | None]] = {
    "tension": lambda p, _: _found(p.least(relaxed=p.pulling), p.statics.force),
    "friction": _friction,
    "mass": lambda p, _: _found(p.least(along=-p.statics.weight, most=1.0), 1.0),
    "normal force": lambda p, _: _found(p.least(relaxed=p.normals), p.statics.force),
    "tilt balance": lambda p, _: _found(p.least(tilted=True), p.statics.moment),
}
