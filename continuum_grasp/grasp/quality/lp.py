"""Linear problems (LP), solved by HiGHS through casadi; what comes back is checked before it is called optimal."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from continuum_grasp.errors import InputError

__all__ = ["LPOutcome", "solve_lp"]

Array = NDArray[Any]
Outcome = Literal["optimal", "infeasible", "unbounded", "failed"]

RESIDUAL = 1e-7
"""By what part of one and the numbers in a row an optimum may violate it: a hundred times HiGHS's own tolerance."""
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


@dataclass(frozen=True)
class LPOutcome:
    """What became of an LP.

    Attributes
    ----------
    status : {"optimal", "infeasible", "unbounded", "failed"}
        failed: the solver gave up, or its point violates a row or a bound; never to be read as infeasible.
    x : ndarray, shape (n,)
        The optimum; NaN unless optimal.
    objective : float
        cost @ x; NaN unless optimal.
    residual : float
        Greatest violation of a row or bound, as a part of one and the numbers in it; NaN where there is no point.
    """

    status: Outcome
    x: Array
    objective: float
    residual: float

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
    """Minimize cost @ x where row_lower <= rows @ x <= row_upper and lower <= x <= upper.

    Scale unknowns and rows so that what matters is near one: the solver's tolerances are absolute, and it takes
    entries of ``rows`` below 1e-9 for zero.

    Parameters
    ----------
    cost : array_like, shape (n,)
    rows : array_like, shape (m, n)
        Zeros are left out of what the solver sees.
    row_lower, row_upper : array_like, shape (m,) or ()
        Infinite where a row is one-sided.
    lower, upper : array_like, shape (n,) or ()

    Returns
    -------
    LPOutcome

    Raises
    ------
    InputError
        A number is NaN, a cost or row is infinite, or shapes do not fit.
    """
    cost = np.atleast_1d(np.asarray(cost, dtype=float))
    n = cost.size
    rows = np.asarray(rows, dtype=float).reshape(-1, n)
    m = rows.shape[0]
    low, high = _limits(row_lower, row_upper, m)
    least, most = _limits(lower, upper, n)
    if not (np.isfinite(cost).all() and np.isfinite(rows).all()):  # the solver would call this optimal at zero
        raise InputError("an LP with a number that is not finite in its cost or rows")
    nothing = np.full(n, np.nan)
    if (low > high).any() or (least > most).any() or _open_end(low, high) or _open_end(least, most):
        return LPOutcome("infeasible", nothing, float("nan"), float("nan"))
    matrix = ca.sparsify(ca.DM(rows))
    solver = ca.conic("lp", "highs", {"a": matrix.sparsity(), "h": ca.Sparsity(n, n)}, _OPTIONS)
    found = solver(g=ca.DM(cost), a=matrix, lba=low, uba=high, lbx=least, ubx=most)
    status = _NAMES.get(str(solver.stats()["return_status"]), "failed")
    if status != "optimal":
        return LPOutcome(status, nothing, float("nan"), float("nan"))
    x = np.asarray(found["x"], dtype=float).ravel()
    residual = _residual(x, rows, low, high, least, most)
    if not residual <= RESIDUAL:
        return LPOutcome("failed", nothing, float("nan"), residual)
    return LPOutcome("optimal", x, float(cost @ x), residual)


def _limits(lower: ArrayLike, upper: ArrayLike, count: int) -> tuple[Array, Array]:
    low, high = (np.broadcast_to(np.asarray(v, dtype=float), (count,)).copy() for v in (lower, upper))
    if np.isnan(low).any() or np.isnan(high).any():
        raise InputError("an LP with a limit that is not a number")
    return low, high


def _open_end(low: Array, high: Array) -> bool:
    """Whether a limit lies at the wrong infinity."""
    return bool((low == np.inf).any() or (high == -np.inf).any())


def _residual(x: Array, rows: Array, low: Array, high: Array, least: Array, most: Array) -> float:
    values = rows @ x
    size = 1.0 + np.abs(rows) @ np.abs(x)
    off = np.maximum(np.maximum(low - values, values - high), 0.0) / size
    out = np.maximum(np.maximum(least - x, x - most), 0.0) / (1.0 + np.abs(x))
    return float(max(off.max(initial=0.0), out.max(initial=0.0)))
