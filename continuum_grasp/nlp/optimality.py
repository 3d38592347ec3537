"""Error of a point in the conditions of optimality, whatever a solver says of it.

Karush, Kuhn and Tucker: with the multipliers lam of constraints and z of bounds, which are negative at lower ends,

    grad f + J' lam + z = 0,    lower <= g <= upper,    low <= x <= high,    each multiplier times the slack that is
                                                                             left to its end = 0

The error is that of IPOPT (A. Waechter, L. T. Biegler, doi:10.1007/s10107-004-0559-y, equations 5 and 6, section 3.8):
the greatest of dual, primal and complementarity errors, of functions whose gradients at the start are scaled down to
100, dual and complementarity divided by the mean multiplier per 100, where that is more than one.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from continuum_grasp.arrays import Array
from continuum_grasp.nlp.attempt import Multipliers, Start
from continuum_grasp.nlp.problem import NLP

_GREATEST = 100.0
"""Greatest gradient at the start, beyond which functions are scaled, and greatest mean multiplier (IPOPT:
nlp_scaling_max_gradient, s_max)."""
_LEAST_SCALE = 1e-8
"""Least scale of functions (IPOPT: nlp_scaling_min_value)."""


def optimality_error(problem: NLP, start: Start, x: Array, multipliers: Multipliers) -> float:
    """Compute the scaled error of the conditions of optimality.

    Parameters
    ----------
    problem : NLP
    start : Start
        Where the solver began: its bounds, parameters, and the point that scales the functions.
    x : (n,) ndarray
    multipliers : Multipliers

    Returns
    -------
    float
        Infinite where something is not finite.
    """
    by_f, by_g = _scales(problem, start)
    _, gradient = (np.array(v).ravel() for v in problem.functions["grad_f"](x, start.p))
    value, jacobian = problem.functions["jac_g"](x, start.p)
    g, forces, bounds = np.array(value).ravel(), multipliers.constraints, multipliers.bounds
    slope = gradient + np.array(jacobian.T @ forces).ravel() + bounds
    fixed = start.low == start.high  # no condition: the multiplier is whatever balances
    low, high = np.concatenate([start.low, start.lower]), np.concatenate([start.high, start.upper])
    at, scale = np.concatenate([x, g]), np.concatenate([np.ones(x.size), by_g])
    pressed = by_f * np.concatenate([bounds, forces]) / scale
    if not all(np.isfinite(v).all() for v in (at, slope, pressed)):
        return float("inf")
    primal = scale * np.maximum(np.maximum(low - at, at - high), 0.0)
    # A multiplier whose end is infinite has the wrong sign.
    push = np.stack([np.maximum(-pressed, 0.0), np.maximum(pressed, 0.0)])
    # Beyond its end a point has no slack; by how much counts as primal.
    slack = np.maximum(np.stack([at - low, high - at]), 0.0) * scale
    bounded = np.isfinite(slack) & (low != high)
    mean = np.abs(pressed).mean() if pressed.size else 0.0
    share = max(_GREATEST, float(mean)) / _GREATEST
    dual = np.concatenate([by_f * np.abs(slope[~fixed]), push[~np.isfinite(slack)]]) / share
    gap = push * np.where(bounded, slack, 0.0) / share
    return float(max(dual.max(initial=0.0), primal.max(initial=0.0), gap.max(initial=0.0)))


def _scales(problem: NLP, start: Start) -> tuple[float, Array]:
    """Factors of the objective and of the constraints (m,)."""
    x = np.clip(start.x, start.low, start.high)
    gradient = np.array(problem.functions["grad_f"](x, start.p)[1]).ravel()
    jacobian = problem.functions["jac_g"](x, start.p)[1]
    rows = np.zeros(jacobian.shape[0])
    np.maximum.at(rows, np.array(jacobian.sparsity().row(), dtype=int), np.abs(np.array(jacobian.nonzeros())))
    return float(_scale(np.abs(gradient).max(initial=0.0))), _scale(rows)


def _scale(slopes: Any) -> Any:
    with np.errstate(divide="ignore"):
        return np.maximum(np.minimum(_GREATEST / np.asarray(slopes), 1.0), _LEAST_SCALE)
