"""Linear problems, also with second-order cones, solved by Clarabel; what comes back is checked before it is called
optimal.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import clarabel
import numpy as np
from numpy.typing import ArrayLike

from continuum_grasp.base import Array, InputError

Outcome = Literal["optimal", "infeasible", "unbounded", "failed"]

FAR = 1e3
"""Bound of unknowns that need none, per usual value: with far greater ones a problem loses digits."""
_REACHED = 1e-6
"""Greatest violation of a point, and what it may be short of the best by the dual problem, per one and the numbers in
them: a thousand times the usual one, since where hardly any point is allowed the solver gets no farther than 4e-7."""
_NAMES: dict[str, Outcome] = {"PrimalInfeasible": "infeasible", "DualInfeasible": "unbounded"}
"""Statuses that are proofs; points, whatever the solver calls them, are judged here."""


@dataclass(frozen=True)
class Cones:
    """Second-order cones |A_k x + a_k| <= b_k @ x + c_k for k = 1..K, vectors with M components."""

    matrix: Array  # A (K, M, n)
    offset: Array  # a (K, M)
    width: Array  # b (K, n)
    spare: Array  # c (K,)

    def rows(self) -> tuple[Array, Array]:
        """Widths and vectors of all cones, one cone after the other: -(rows @ x) + limits (K (M + 1), n)."""
        rows = -np.concatenate([self.width[:, None], self.matrix], axis=1)
        return rows.reshape(-1, self.width.shape[1]), np.column_stack([self.spare, self.offset]).ravel()


@dataclass(frozen=True)
class ConicOutcome:
    """Outcome of a problem; ``failed`` (the solver gave up, or its point breaks a limit) is not infeasible."""

    status: Outcome
    x: Array  # (n,) the optimum; NaN unless optimal
    objective: float  # NaN unless optimal
    residual: float  # greatest violation of a row, bound or cone, per one and the numbers in it; NaN without a point

    @property
    def optimal(self) -> bool:
        """Whether there is an optimum."""
        return self.status == "optimal"


class _Columns:
    """A matrix in compressed columns, with what Clarabel reads of one of SciPy, whose import takes 0.16 s."""

    has_canonical_format = True

    def __init__(self, matrix: Array) -> None:
        column, row = np.nonzero(matrix.T)
        self.shape = matrix.shape
        self.nnz = row.size
        self.data = matrix[row, column]
        self.indices = row
        self.indptr = np.searchsorted(column, np.arange(matrix.shape[1] + 1))


def solve_conic(
    cost: ArrayLike,
    rows: ArrayLike,
    row_lower: ArrayLike,
    row_upper: ArrayLike,
    lower: ArrayLike = -np.inf,
    upper: ArrayLike = np.inf,
    cones: Cones | None = None,
    squares: ArrayLike = 0.0,
) -> ConicOutcome:
    """Minimize cost @ x + squares @ x**2 where row_lower <= rows @ x <= row_upper, lower <= x <= upper, and x within
    cones; rows (m, n), x (n,).

    Scale unknowns and rows so that what matters is near one: the solver's tolerances are absolute. Limits are infinite
    where one-sided, and may be a single number for all. Where many points are best, the one amid them is returned.

    Raises
    ------
    InputError
        A number is NaN, or a cost or row is infinite.
    """
    cost = np.atleast_1d(np.asarray(cost, dtype=float))
    n = cost.size
    rows = np.asarray(rows, dtype=float).reshape(-1, n)
    # Bounds limit the unknowns as rows do: both are treated together.
    every = np.concatenate([rows, np.eye(n)])

    def joined(of_rows: ArrayLike, of_unknowns: ArrayLike) -> Array:
        spread = [np.broadcast_to(np.asarray(of_rows, dtype=float), len(rows))]
        spread.append(np.broadcast_to(np.asarray(of_unknowns, dtype=float), n))
        return np.concatenate(spread)

    low = joined(row_lower, lower)
    high = joined(row_upper, upper)
    if np.isnan([low, high]).any():
        raise InputError("a linear problem with a limit that is not a number")
    if not (np.isfinite(cost).all() and np.isfinite(rows).all()):
        raise InputError("a linear problem with a number that is not finite in its cost or rows")
    weights = np.broadcast_to(np.asarray(squares, dtype=float), n)
    nowhere = np.full(n, np.nan)
    if (low > high).any() or (low == np.inf).any() or (high == -np.inf).any():
        return ConicOutcome("infeasible", nowhere, float("nan"), float("nan"))
    equal = low == high
    most = (low < high) & np.isfinite(high)
    least = (low < high) & np.isfinite(low)
    curved, offsets = cones.rows() if cones is not None else (np.zeros((0, n)), np.zeros(0))
    matrix = np.concatenate([every[equal], every[most], -every[least], curved])
    limits = np.concatenate([high[equal], high[most], -low[least], offsets])
    kinds = [clarabel.ZeroConeT(int(equal.sum())), clarabel.NonnegativeConeT(int(most.sum() + least.sum()))]
    wide = 3 if cones is None else cones.offset.shape[1] + 1
    kinds += [clarabel.SecondOrderConeT(wide)] * (offsets.size // wide)
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    # Numbers are near one already, and rounding must not be scaled up to it: 50 of 1,100 problems of grasps failed.
    settings.equilibrate_enable = False
    # 1e-10: tolerance that is asked of the solver; what comes back is checked
    settings.tol_feas = settings.tol_gap_abs = settings.tol_gap_rel = 1e-10
    found = clarabel.DefaultSolver(
        _Columns(np.diag(2.0 * weights)), cost, _Columns(matrix), limits, kinds, settings
    ).solve()
    status = _NAMES.get(str(found.status), "failed")
    if status in ("infeasible", "unbounded"):
        return ConicOutcome(status, nowhere, float("nan"), float("nan"))
    x = np.asarray(found.x)
    spare = limits - matrix @ x
    size = 1.0 + np.abs(matrix) @ np.abs(x)
    first = limits.size - offsets.size
    over = np.concatenate([np.abs(spare[: equal.sum()]), -spare[equal.sum() : first]]) / size[:first]
    vectors = spare[first:].reshape(-1, wide)
    outside = np.linalg.norm(vectors[:, 1:], axis=1) - vectors[:, 0]
    over = np.concatenate([over, outside / size[first::wide]])
    objective = float(cost @ x + weights @ x**2)
    residual = float(over.max(initial=0.0))
    short = abs(objective - found.obj_val_dual) / (1.0 + np.abs(cost) @ np.abs(x))
    if not max(residual, short) <= _REACHED:
        return ConicOutcome("failed", nowhere, float("nan"), residual)
    return ConicOutcome("optimal", x, objective, residual)
