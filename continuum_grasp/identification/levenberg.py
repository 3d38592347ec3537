"""Nonlinear least squares with bounds, by the method of Levenberg and Marquardt."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.errors import NumericalError, SolverError

__all__ = ["Minimum", "least_squares"]

Array = NDArray[np.float64]

_STEP = 1e-9
"""Relative step below which the search has converged."""
_LIMIT = 0.5
"""Longest step, relative to a value, or to its typical size where that is greater than five times the value."""
_FLOOR = 0.2


@dataclass(frozen=True)
class Minimum:
    """Where the sum of squares is least.

    Attributes
    ----------
    values : (n,) ndarray
    residuals : (m,) ndarray
    jacobian : (m, n) ndarray
    iterations : int
    evaluations : int
    converged : bool
    """

    values: Array
    residuals: Array
    jacobian: Array
    iterations: int
    evaluations: int
    converged: bool


def least_squares(
    function: Callable[[Array], tuple[Array, Array]],
    start: Array,
    lower: Array,
    upper: Array,
    sizes: Array,
    *,
    iterations: int = 100,
) -> Minimum:
    """Minimise the sum of squares of residuals between bounds.

    Parameters
    ----------
    function : callable
        Residuals (m,) and their Jacobian (m, n) at values (n,). Where it raises ``SolverError`` or ``NumericalError``
        other than at the start, shorter steps are tried.
    start, lower, upper : (n,) ndarray
        First values and bounds.
    sizes : (n,) ndarray
        Typical sizes of the values, which scale the search and bound its steps.
    iterations : int
        Most steps.

    Returns
    -------
    Minimum

    Raises
    ------
    NumericalError
        If residuals or derivatives at the start are not finite.

    Notes
    -----
    Steps are damped in the metric of the scaled Jacobian (J. J. More, 1978, doi:10.1007/BFb0067700; damping after
    H. B. Nielsen, 1999) and cut off at the bounds; values at a bound that the gradient pushes outwards are held.
    """
    values = np.clip(start, lower, upper)
    residuals, jacobian = function(values)
    if not (np.isfinite(residuals).all() and np.isfinite(jacobian).all()):
        raise NumericalError("the predictions at the start values, or their derivatives, are not finite")
    cost, damping, growth, evaluations = float(residuals @ residuals), 1e-4, 2.0, 1
    weights = np.zeros(len(values))
    for count in range(iterations):
        scaled = jacobian * sizes
        gradient = scaled.T @ residuals
        held = ((values <= lower) & (gradient > 0.0)) | ((values >= upper) & (gradient < 0.0))
        free = np.flatnonzero(~held)
        normal = scaled.T @ scaled
        weights = np.maximum(weights, np.diag(normal))
        floor = np.maximum(weights[free], 1e-16 * max(float(weights.max(initial=0.0)), 1e-300))
        if not free.size or float(np.abs(gradient[free]).max()) <= 1e-14 * max(cost, 1e-300):
            return Minimum(values, residuals, jacobian, count, evaluations, True)
        reach = np.maximum(np.abs(values), _FLOOR * sizes)
        while True:
            step = np.zeros(len(values))
            matrix = normal[np.ix_(free, free)] + damping * np.diag(floor)
            step[free] = np.linalg.lstsq(matrix, -gradient[free], rcond=None)[0]
            step *= min(1.0, _LIMIT / max(float(np.abs(step * sizes / reach).max()), 1e-300))
            trial = np.clip(values + step * sizes, lower, upper)
            step = (trial - values) / sizes
            short = float(np.abs(step).max()) <= _STEP
            try:
                after, slope = function(trial)
                new = float(after @ after) if np.isfinite(slope).all() else np.inf
            except (SolverError, NumericalError):
                new = np.inf
            evaluations += 1
            expected = -float(step @ (2.0 * gradient + normal @ step))
            if new < cost or (short and new <= cost * (1.0 + 1e-12)):
                # A step that a bound cuts off need not lead down in the quadratic model: that has predicted nothing.
                gain = min(max((cost - new) / expected, 0.0), 1.0) if expected > 0.0 else 0.0
                damping = max(damping * max(1.0 / 3.0, 1.0 - (2.0 * gain - 1.0) ** 3), 1e-14)
                growth = 2.0
                small = cost - new <= 1e-14 * cost and expected <= 1e-14 * cost
                values, residuals, jacobian, cost = trial, after, slope, min(new, cost)
                if short or small or cost == 0.0:
                    return Minimum(values, residuals, jacobian, count + 1, evaluations, True)
                break
            if short:
                return Minimum(values, residuals, jacobian, count, evaluations, bool(np.isfinite(new)))
            damping, growth = damping * growth, 2.0 * growth
    return Minimum(values, residuals, jacobian, iterations, evaluations, False)
