"""Linear problems (LP), and second-order cone problems (SOCP) by tangent planes, solved by HiGHS through casadi; what
comes back is checked before it is called optimal.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from continuum_grasp.arrays import Array
from continuum_grasp.errors import InputError
from continuum_grasp.grasp.values import SATISFIED

Outcome = Literal["optimal", "infeasible", "unbounded", "failed"]

_OPTIONS: dict[str, Any] = {
    "error_on_fail": False,
    # Why HiGHS: of 200 random problems HiGHS, qpOASES, DAQP and IPQP judged all right (residuals below 1e-10 N), while
    # OSQP judged 1.5 % wrong, and QRQP called points with residuals up to 0.7 N optimal. qpOASES prints a banner.
    # Small problems are solved twice as fast without presolve, which also reports unbounded and infeasible as one.
    "highs": {
        "output_flag": False,
        "presolve": "off",
        "threads": 1,
        "primal_feasibility_tolerance": 1e-9,
        "dual_feasibility_tolerance": 1e-9,
    },
}
_NAMES: dict[str, Outcome] = {"Optimal": "optimal", "Infeasible": "infeasible", "Unbounded": "unbounded"}

FAR = 1e3
"""Bound of unknowns that need none, per what is usual: with far greater ones an LP loses digits."""
VIOLATION = 1e-8
"""Cones may be violated by this part of one and the greatest width of a cone: ten times what the LP's
tolerance lets through."""
ROUNDS = 200
"""Most LPs for one answer."""
INWARD = 1e-7
"""Worth of a point well inside a cone, or of a small change, beside the cost: where many points are best, corners of
the planes, which lie outside the cones, are not taken."""


@dataclass(frozen=True)
class LPOutcome:
    """Outcome of an LP; ``failed`` (the solver gave up, or its point breaks a limit) is not infeasible."""

    status: Outcome
    x: Array  # (n,) the optimum; NaN unless optimal
    objective: float  # cost @ x; NaN unless optimal
    residual: float  # greatest violation of a row or bound, per one and the numbers in it; NaN where there is no point

    @property
    def optimal(self) -> bool:
        """Whether there is an optimum."""
        return self.status == "optimal"


def solve_lp(
    cost: ArrayLike,
    rows: ArrayLike,
    row_lower: ArrayLike,
    row_upper: ArrayLike,
    lower: ArrayLike = -np.inf,
    upper: ArrayLike = np.inf,
) -> LPOutcome:
    """Minimize cost @ x where row_lower <= rows @ x <= row_upper and lower <= x <= upper; rows (m, n), x (n,).

    Scale unknowns and rows so that what matters is near one: the solver's tolerances are absolute, and it takes
    entries of ``rows`` below 1e-9 for zero. Limits are infinite where one-sided, and may be a single number for all.

    Raises
    ------
    InputError
        A number is NaN, or a cost or row is infinite.
    """
    cost = np.atleast_1d(np.asarray(cost, dtype=float))
    n = cost.size
    rows = np.asarray(rows, dtype=float).reshape(-1, n)
    m = rows.shape[0]
    # The bounds are limits of the unknowns as those of the rows are: all of them are checked together.
    low, high = (
        np.concatenate([np.broadcast_to(np.asarray(v, dtype=float), count) for v, count in ((of_rows, m), (of_x, n))])
        for of_rows, of_x in ((row_lower, lower), (row_upper, upper))
    )
    if np.isnan([low, high]).any():
        raise InputError("an LP with a limit that is not a number")
    if not (np.isfinite(cost).all() and np.isfinite(rows).all()):  # the solver would call this optimal at zero
        raise InputError("an LP with a number that is not finite in its cost or rows")
    none = LPOutcome("infeasible", np.full(n, np.nan), float("nan"), float("nan"))
    if (low > high).any() or (low == np.inf).any() or (high == -np.inf).any():
        return none
    matrix = ca.sparsify(ca.DM(rows))
    solver = ca.conic("lp", "highs", {"a": matrix.sparsity(), "h": ca.Sparsity(n, n)}, _OPTIONS)
    solution = solver(g=ca.DM(cost), a=matrix, lba=low[:m], uba=high[:m], lbx=low[m:], ubx=high[m:])
    status = _NAMES.get(str(solver.stats()["return_status"]), "failed")
    if status != "optimal":
        return replace(none, status=status)
    x = np.asarray(solution["x"], dtype=float).ravel()
    values = np.concatenate([rows @ x, x])
    size = 1.0 + np.concatenate([np.abs(rows) @ np.abs(x), np.abs(x)])
    residual = float((np.maximum(np.maximum(low - values, values - high), 0.0) / size).max(initial=0.0))
    if not residual <= SATISFIED:
        return replace(none, status="failed", residual=residual)
    return LPOutcome("optimal", x, float(cost @ x), residual)


class Cones:
    """Second-order cones |A_k x + a_k| <= b_k @ x + c_k for k = 1..K, vectors with two components: ``matrix`` A
    (K, 2, n), ``offset`` a (K, 2), ``width`` b (K, n), ``spare`` c (K,).

    Tangent planes stand for them, at first in evenly spread directions; where a component is always zero, both sides of
    the other, which is the cone itself.
    """

    def __init__(self, matrix: Array, offset: Array, width: Array, spare: Array) -> None:
        self.matrix, self.offset, self.width, self.spare = matrix, offset, width, spare
        # Cone and unit direction u (2,) of the planes u @ (A_k x + a_k) <= b_k @ x + c_k so far. They hold for any
        # width, so they stay valid while widths change.
        self.cuts: list[tuple[int, Array]] = []
        # The first polygon exceeds the cone by 1 / cos(15 deg) - 1 = 3.5 % at most; cuts at solutions refine it.
        turns = 2 * np.pi * np.arange(12) / 12
        around = list(np.stack([np.cos(turns), np.sin(turns)], axis=1))
        for k in range(matrix.shape[0]):
            live = [bool(np.any(matrix[k, i]) or offset[k, i]) for i in (0, 1)]
            flat = [np.array([s, 0.0]) for s in (1, -1)] if live[0] else [np.array([0.0, s]) for s in (1, -1)]
            self.cuts += [(k, u) for u in (around if all(live) else flat)]

    def planes(self) -> tuple[Array, Array]:
        """Rows (P, n) and their upper limits (P,) of all tangent planes."""
        which = np.array([k for k, _ in self.cuts], dtype=int)
        directions = np.array([u for _, u in self.cuts]).reshape(-1, 2)
        rows = np.einsum("pi,pin->pn", directions, self.matrix[which]) - self.width[which]
        return rows, self.spare[which] - np.einsum("pi,pi->p", directions, self.offset[which])

    def cut(self, x: Array) -> bool:
        """Add tangent planes where a point lies outside; whether there were any."""
        vectors = self.matrix @ x + self.offset
        lengths = np.hypot(vectors[:, 0], vectors[:, 1])
        widths = self.width @ x + self.spare
        outside = np.flatnonzero(lengths - widths > VIOLATION * max(1.0, np.abs(widths).max(initial=0.0)))
        self.cuts += [(int(k), vectors[k] / lengths[k]) for k in outside if lengths[k] > 0.0]
        return outside.size > 0


def solve_socp(
    cost: ArrayLike,
    rows: ArrayLike,
    row_lower: ArrayLike,
    row_upper: ArrayLike,
    lower: ArrayLike,
    upper: ArrayLike,
    cones: Cones,
) -> LPOutcome:
    """Minimize cost @ x as `solve_lp` does, x in addition within cones, which get tangent planes added.

    The tangent planes contain the cones: ``infeasible`` is certain, and the optimum is not short of the true one by
    more than 1e-7 per cone. Give finite bounds: the planes are unbounded in more directions than the cones.
    """
    cost, rows = np.asarray(cost, dtype=float), np.asarray(rows, dtype=float)
    low, high = (np.broadcast_to(np.asarray(v, dtype=float), (rows.shape[0],)) for v in (row_lower, row_upper))
    least, greatest = (np.broadcast_to(np.asarray(v, dtype=float), cost.shape) for v in (lower, upper))
    count = cones.spare.size
    for _ in range(ROUNDS):
        planes, limit = cones.planes()
        # One more unknown per cone, how deep the point lies within all of its planes, is worth INWARD of the cost.
        depth = np.zeros((limit.size, count))
        depth[np.arange(limit.size), [k for k, _ in cones.cuts]] = 1.0
        solution = solve_lp(
            np.concatenate([cost, np.full(count, -INWARD)]),
            np.block([[rows, np.zeros((rows.shape[0], count))], [planes, depth]]),
            np.concatenate([low, np.full(limit.size, -np.inf)]),
            np.concatenate([high, limit]),
            np.concatenate([least, np.zeros(count)]),
            np.concatenate([greatest, np.ones(count)]),
        )
        x = solution.x[: cost.size]
        if not solution.optimal or not cones.cut(x):
            return replace(solution, x=x, objective=float(cost @ x))
    return LPOutcome("failed", np.full(cost.size, np.nan), float("nan"), float("nan"))
