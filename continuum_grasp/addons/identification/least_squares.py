"""Nonlinear least squares with bounds, for predictions that exist for some parameters only.

1. SciPy's trust region within bounds (TRF: M. A. Branch, T. F. Coleman, Y. Li, SIAM J. Sci. Comput. 21 (1999),
   doi:10.1137/S1064827595289108), with residuals and Jacobian from one prediction.
2. Where there is no prediction, residuals are no numbers, and the step becomes shorter.
3. What ends at a bound is put on it, and the others are searched again.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.base import Array, NumericalError, SolverError

Function = Callable[[Array], tuple[Array, Array]]

_STEP = 1e-9
"""Step per typical size below which the search has converged [1]: measured rods have deviations of 4e-4 and more."""
_DECREASE = 1e-14
"""Relative decrease of the sum of squares below which it has converged [1]: some 50 roundings of a double."""


class Minimum(NamedTuple):
    """Minimum of the sum of squares: values (n,), residuals (m,) and their Jacobian (m, n)."""

    values: Array
    residuals: Array
    jacobian: Array
    iterations: int
    evaluations: int
    status: str
    """``converged``, ``iteration limit`` or ``no step possible``."""

    @property
    def converged(self) -> bool:
        """Whether the sum of squares is least here, to the tolerances."""
        return self.status == "converged"


def least_squares(
    function: Function,
    start: Array,
    lower: Array,
    upper: Array,
    sizes: Array,
    *,
    evaluations: int = 200,
    decrease: float = _DECREASE,
) -> Minimum:
    """Minimize the sum of squares of residuals between bounds, all (n,), by at most so many evaluations.

    It has converged where a step lowers the sum by less than ``decrease``, relatively.

    The function gives residuals (m,) and their Jacobian (m, n) at values (n,). Where it raises `SolverError` or
    `NumericalError` other than at the start, shorter steps are tried. Typical sizes of the values scale the search.

    The trust-region reflective method of ``scipy.optimize.least_squares`` (M. A. Branch, T. F. Coleman, Y. Li, 1999,
    doi:10.1137/S1064827595289108) stays inside the bounds; values that end beside one which the gradient pushes
    against are put on it, and the others are sought once more.

    Raises
    ------
    NumericalError
        If residuals or derivatives at the start are not finite.
    """
    minimum = _at(function, np.clip(start, lower, upper))
    free = np.ones(len(start), dtype=bool)
    while True:
        minimum = _search(function, minimum, lower, upper, sizes, free, evaluations, decrease)
        values = minimum.values
        gradient = (minimum.jacobian * sizes).T @ minimum.residuals
        # 1e-6: distance from a bound per typical size at which a value is put on it; the iterates themselves stay
        # inside
        beside = np.where(gradient > 0.0, values - lower, upper - values) <= 1e-6 * sizes
        pushed = free & beside & (gradient != 0.0)
        if not (minimum.converged and pushed.any()):
            return minimum
        free = free & ~pushed
        bounds = np.where(gradient > 0.0, lower, upper)
        minimum = _at(function, np.where(pushed, bounds, values), minimum.iterations, minimum.evaluations)
        if not free.any():
            return minimum


def _at(function: Function, values: Array, iterations: int = 0, evaluations: int = 0) -> Minimum:
    """Minimum found without a search."""
    residuals, jacobian = function(values)
    if not (np.isfinite(residuals).all() and np.isfinite(jacobian).all()):
        raise NumericalError("the predictions at the start values, or their derivatives, are not finite")
    return Minimum(values, residuals, jacobian, iterations, evaluations + 1, "converged")


class _NoStepPossibleError(Exception):
    """Even the shortest steps lead to values without predictions."""


def _search(
    function: Function,
    start: Minimum,
    lower: Array,
    upper: Array,
    sizes: Array,
    free: NDArray[np.bool_],
    evaluations: int,
    decrease: float,
) -> Minimum:
    """Search in the values that are free, in units of their typical sizes."""
    from scipy.optimize import least_squares

    scale = sizes[free]
    count = start.evaluations
    accepted = start.values[free] / scale
    # scipy asks for residuals and Jacobian one after the other; predictions give both at once
    known = {accepted.tobytes(): (start.values, start.residuals, start.jacobian)}

    def residuals(scaled: Array) -> Array:
        nonlocal count
        key = scaled.tobytes()
        if key not in known:
            values = start.values.copy()
            values[free] = scaled * scale
            count += 1
            with suppress(SolverError, NumericalError):
                y, jacobian = function(values)
                if np.isfinite(y).all() and np.isfinite(jacobian).all():
                    known[key] = values, y, jacobian
        if key in known:
            return known[key][1]
        if np.abs(scaled - accepted).max() <= _STEP:  # scipy would shorten steps until they are lost in rounding
            raise _NoStepPossibleError
        return np.full_like(start.residuals, np.nan)  # which makes the search try a shorter step

    def slopes(scaled: Array) -> Array:
        nonlocal accepted
        accepted = scaled.copy()  # scipy asks for the Jacobian only where it takes the step
        jacobian = (known[scaled.tobytes()][2] * sizes)[:, free]
        # a column of rounding alone, scaled by its own length, would take the whole step
        lengths = np.linalg.norm(jacobian, axis=0)
        # 1e-10: length of a column of the Jacobian per that of the longest up to which it is rounding of the
        # predictions
        return np.asarray(jacobian * (lengths > 1e-10 * lengths.max(initial=0.0)))

    iterations = start.iterations
    status = "no step possible"
    with suppress(_NoStepPossibleError):
        solution = least_squares(
            residuals,
            accepted,
            slopes,
            (lower[free] / scale, upper[free] / scale),
            x_scale="jac",
            ftol=decrease,
            xtol=_STEP,
            gtol=None,  # the gradient has the unit of the data, for which there is no one tolerance
            max_nfev=max(evaluations - count, 1),
        )
        iterations += solution.njev - 1
        status = "converged" if solution.status > 0 else "iteration limit"
    return Minimum(*known[accepted.tobytes()], iterations, count, status)
