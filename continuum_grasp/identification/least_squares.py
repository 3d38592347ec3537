"""Nonlinear least squares with bounds, for predictions that exist for some parameters only."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.errors import NumericalError, SolverError

__all__ = ["Minimum", "least_squares"]

Array = NDArray[np.float64]

_STEP = 1e-9
"""Step per typical size below which the search has converged [1]: measured rods have deviations of 4e-4 and more."""
_DECREASE = 1e-14
"""Relative decrease of the sum of squares below which it has converged [1]: some 50 roundings of a double."""
_AT_BOUND = 1e-6
"""Distance from a bound per typical size at which a value is put on it [1]; the iterates themselves stay inside."""


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
    status : str
        ``converged``, ``iteration limit`` or ``no step possible``.
    """

    values: Array
    residuals: Array
    jacobian: Array
    iterations: int
    evaluations: int
    status: str

    @property
    def converged(self) -> bool:
        """Whether the sum of squares is least here, to the tolerances."""
        return self.status == "converged"


class _NoStepPossibleError(Exception):
    """Even the shortest steps lead to values without predictions."""


def least_squares(
    function: Callable[[Array], tuple[Array, Array]],
    start: Array,
    lower: Array,
    upper: Array,
    sizes: Array,
    *,
    evaluations: int = 200,
) -> Minimum:
    """Minimize the sum of squares of residuals between bounds.

    Parameters
    ----------
    function : callable
        Residuals (m,) and their Jacobian (m, n) at values (n,). Where it raises ``SolverError`` or ``NumericalError``
        other than at the start, shorter steps are tried.
    start, lower, upper : (n,) ndarray
        First values and bounds.
    sizes : (n,) ndarray
        Typical sizes of the values, which scale the search.
    evaluations : int
        Most evaluations of the function.

    Returns
    -------
    Minimum

    Raises
    ------
    NumericalError
        If residuals or derivatives at the start are not finite.

    Notes
    -----
    The trust-region reflective method of ``scipy.optimize.least_squares`` (M. A. Branch, T. F. Coleman, Y. Li, 1999,
    doi:10.1137/S1064827595289108) stays inside the bounds; values that end beside one which the gradient pushes
    against are put on it, and the others are sought once more.
    """
    values = np.clip(start, lower, upper)
    residuals, jacobian = function(values)
    if not (np.isfinite(residuals).all() and np.isfinite(jacobian).all()):
        raise NumericalError("the predictions at the start values, or their derivatives, are not finite")
    free, used, iterations = np.ones(len(values), dtype=bool), 1, 0
    while True:
        run = _Run(function, values, residuals, jacobian, free, sizes)
        status = run.search(lower, upper, evaluations - used)
        values, residuals, jacobian = run.best
        used, iterations = used + run.evaluations, iterations + run.iterations
        gradient = (jacobian * sizes).T @ residuals
        near = np.where(gradient > 0.0, values - lower, upper - values) <= _AT_BOUND * sizes
        if status != "converged" or not np.any(near & free & (gradient != 0.0)):
            return Minimum(values, residuals, jacobian, iterations, used, status)
        free = free & ~(near & (gradient != 0.0))
        values = np.where(free, values, np.where(gradient > 0.0, lower, upper))
        residuals, jacobian = function(values)
        used += 1
        if not free.any():
            return Minimum(values, residuals, jacobian, iterations, used, status)


class _Run:
    """One search in the values that are free, in units of their typical sizes."""

    def __init__(
        self,
        function: Callable[[Array], tuple[Array, Array]],
        values: Array,
        residuals: Array,
        jacobian: Array,
        free: NDArray[np.bool_],
        sizes: Array,
    ) -> None:
        self._function, self._free, self._sizes = function, free, sizes
        self.best = self._last = values, residuals, jacobian
        self.evaluations = self.iterations = 0

    def search(self, lower: Array, upper: Array, evaluations: int) -> str:
        """Move ``best`` to the minimum; how that ended."""
        from scipy.optimize import least_squares

        free, sizes = self._free, self._sizes
        try:
            found = least_squares(
                self._residuals,
                self._scaled(self.best[0]),
                self._jacobian,
                (lower[free] / sizes[free], upper[free] / sizes[free]),
                x_scale="jac",
                ftol=_DECREASE,
                xtol=_STEP,
                gtol=None,
                max_nfev=max(evaluations, 1),
            )
        except _NoStepPossibleError:
            return "no step possible"
        return "converged" if found.status > 0 else "iteration limit"

    def _scaled(self, values: Array) -> Array:
        return np.asarray(values[self._free] / self._sizes[self._free])

    def _residuals(self, scaled: Array) -> Array:
        """NaN where there are no predictions, which makes the search try a shorter step."""
        if np.array_equal(scaled, self._scaled(self.best[0])):
            self._last = self.best
            return self.best[1]
        values = self.best[0].copy()
        values[self._free] = scaled * self._sizes[self._free]
        self.evaluations += 1
        try:
            residuals, jacobian = self._function(values)
            usable = bool(np.isfinite(residuals).all() and np.isfinite(jacobian).all())
        except (SolverError, NumericalError):
            usable = False
        if usable:
            self._last = values, residuals, jacobian
            return residuals
        if np.abs(scaled - self._scaled(self.best[0])).max() <= _STEP:
            raise _NoStepPossibleError
        return np.full_like(self.best[1], np.nan)

    def _jacobian(self, scaled: Array, _: Array | None = None) -> Array:
        """Asked for at the values that were evaluated last, once they are accepted."""
        self.iterations += self.best is not self._last
        self.best = self._last
        return np.asarray((self.best[2] * self._sizes)[:, self._free])
