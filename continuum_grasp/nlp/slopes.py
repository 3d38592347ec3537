"""Changes of a solution with the numbers of its problem, by the conditions of optimality.

With the objective f, constraints g, bounds of the unknowns x, and all numbers along a direction t, and the Lagrangian
L = f + lambda_g g + lambda_x (x - bound):

    optimal value   dV/dt = dL/dt - lambda_x dbound/dt - lambda_g dbound_g/dt
    solution        [H + S  J'] [dx      ]     [d(grad L)/dt - S dbound/dt]
                    [J     -D ] [dlambda ] = - [dg/dt - dbound_g/dt       ]

S = lambda_x / (x - bound) and D = g / lambda_g of inequalities: the conditions of an interior-point method at its
barrier parameter, so that no set of active limits has to be chosen. A. V. Fiacco, Introduction to Sensitivity and
Stability Analysis in Nonlinear Programming, 1983; H. Pirnay, R. Lopez-Negrete, L. T. Biegler, Math. Program. Comput. 4
(2012), doi:10.1007/s12532-012-0043-2.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from scipy.sparse import bmat, csc_matrix, diags
from scipy.sparse.linalg import splu

from continuum_grasp.base import Array
from continuum_grasp.nlp.attempt import Attempt, Start
from continuum_grasp.nlp.problem import NLP

_REGULAR = 1e-10
"""Added to the diagonal [units of the problem]: directions that do not matter have no curvature."""
_LEAST = 1e-15
"""Least distance from a bound, and least multiplier, that differs from zero [units of the problem]."""
Difference = Callable[[Sequence[Any]], Any]
"""Derivative of numbers or arrays along a direction, by those at places along it."""


class SolutionSlopes:
    """Derivatives of a solution along directions of starts, which have bounds and parameters of the problem.

    Parameters
    ----------
    nlp : NLP
    start : Start
        Of the solution.
    attempt : Attempt
        The solution.
    """

    def __init__(self, nlp: NLP, start: Start, attempt: Attempt) -> None:
        self._nlp, self._start, self._attempt = nlp, start, attempt

    def value(self, difference: Difference, beside: Sequence[Start]) -> float:
        """Derivative of the optimal value, by starts other than the solution's."""
        attempt, x = self._attempt, self._attempt.x
        multipliers = attempt.multipliers
        lagrangians = []
        for start in beside:
            f, _ = self._nlp.functions["grad_f"](x, start.p)
            g = np.array(self._nlp.functions["jac_g"](x, start.p)[0]).ravel()
            lagrangians.append(float(f) + float(multipliers.constraints @ g))
        change = float(difference(lagrangians))
        ends = ((multipliers.bounds, "low", "high"), (multipliers.constraints, "lower", "upper"))
        for forces, low, high in ends:
            below, above = (difference([_finite(getattr(start, key)) for start in beside]) for key in (low, high))
            change -= float(np.minimum(forces, 0.0) @ below + np.maximum(forces, 0.0) @ above)
        return change

    def unknowns(self, difference: Difference, beside: Sequence[Start]) -> Array:
        """Derivatives (n,) of the unknowns, by starts other than the solution's."""
        x, forces = self._attempt.x, self._attempt.multipliers.constraints
        gradients, rows = [], []
        for start in beside:
            value, slope = self._nlp.functions["jac_g"](x, start.p)
            gradient = self._nlp.functions["grad_f"](x, start.p)[1] + slope.T @ forces
            gradients.append(np.array(gradient).ravel())
            rows.append(np.array(value).ravel() - self._limit(start))
        low, high = (difference([_finite(getattr(start, key)) for start in beside]) for key in ("low", "high"))
        under, over = self._stiffness
        fixed = self._fixed
        right = -np.concatenate([difference(gradients) - under * low - over * high, difference(rows)])
        right[: x.size][fixed] = low[fixed]
        return np.asarray(self._factors.solve(right)[: x.size])

    def _limit(self, start: Start) -> Array:
        """Bounds of the constraints that act (m,)."""
        forces = self._attempt.multipliers.constraints
        return np.where(forces < 0.0, _finite(start.lower), _finite(start.upper))

    @property
    def _fixed(self) -> Array:
        """Unknowns without a choice, which follow their bounds."""
        return np.asarray(self._start.high <= self._start.low)

    @cached_property
    def _stiffness(self) -> tuple[Array, Array]:
        """S of the lower and upper bounds (n,)."""
        x, forces = self._attempt.x, self._attempt.multipliers.bounds
        under = np.maximum(-forces, 0.0) / np.maximum(x - self._start.low, _LEAST)
        over = np.maximum(forces, 0.0) / np.maximum(self._start.high - x, _LEAST)
        return under, over

    @cached_property
    def _slack(self) -> Array:
        """D (m,); zero of equations."""
        start, forces, g = self._start, self._attempt.multipliers.constraints, self._attempt.g
        spare = np.maximum(np.where(forces < 0.0, g - start.lower, start.upper - g), _LEAST)
        with np.errstate(invalid="ignore"):
            slack = np.minimum(spare / np.maximum(np.abs(forces), _LEAST), 1.0 / _LEAST)
        return np.where(start.lower == start.upper, 0.0, slack)

    @cached_property
    def _factors(self) -> Any:
        """Factors of the matrix of the conditions."""
        x, p, forces = self._attempt.x, self._start.p, self._attempt.multipliers.constraints
        jacobian = _sparse(self._nlp.functions["jac_g"](x, p)[1])
        upper = _sparse(self._nlp.functions["hess_lag"](x, p, 1.0, forces))
        hessian = upper + upper.T - diags(upper.diagonal())
        under, over = self._stiffness
        free = diags(1.0 - self._fixed)
        top = free @ (hessian + diags(under + over + _REGULAR)) + diags(1.0 * self._fixed)
        return splu(csc_matrix(bmat([[top, free @ jacobian.T], [jacobian, -diags(self._slack + _REGULAR**1.5)]])))


def _sparse(matrix: Any) -> csc_matrix:
    dm = ca.DM(matrix)
    return csc_matrix((np.array(dm.nonzeros()), dm.row(), dm.sparsity().colind()), shape=dm.shape)


def _finite(bounds: Array) -> Array:
    return np.where(np.isfinite(bounds), bounds, 0.0)
