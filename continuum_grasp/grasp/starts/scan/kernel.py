"""The compiled inner loops of the scan, `kernel.c`, and least squares within bounds for many systems at once; without a
C compiler numpy does the same.
"""

from __future__ import annotations

import ctypes
import os
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np

from continuum_grasp.arrays import Numbers as Array
from continuum_grasp.core.cache import library_for
from continuum_grasp.core.compiler import CompileError, find_compiler


def library() -> ctypes.CDLL | None:
    """The library, compiled unless it is in the cache; None where that cannot be."""
    # A process that had no compiler for a while, or another one, is not bound to what it had then.
    return _library(os.environ.get("CC"), os.environ.get("PATH"))


@cache
def _library(_named: str | None, _path: str | None) -> ctypes.CDLL | None:
    compiler = find_compiler()
    if compiler is None:
        return None
    source = files(__package__).joinpath("kernel.c").read_text(encoding="utf-8")
    try:
        return ctypes.CDLL(str(library_for(source, compiler, "the scan of postures")))
    except (CompileError, OSError):
        return None


def called(name: str, out: Array, *arguments: Array | float) -> Array:
    """Call a function of the library: whole and other numbers, arrays of doubles or complex numbers, and its result."""
    held = [np.ascontiguousarray(each) if isinstance(each, np.ndarray) else each for each in (*arguments, out)]
    passed: list[Any] = []
    for each in held:
        if isinstance(each, np.ndarray):
            passed.append(ctypes.c_void_p(each.ctypes.data))
        else:
            passed.append(ctypes.c_double(each) if isinstance(each, float) else each)
    if getattr(library(), name)(*passed):
        raise MemoryError(f"{name}: {len(out)} systems")
    return out


_STEPS = 30
"""Most steps: 8 to 11 as a rule, more than 20 in two of a thousand."""
_RIGID, _ENOUGH = 1e-9, 1e-6
"""Stiffness that makes every system regular, and mean product of distances and multipliers, per weight, at which a
system is done: of 26 forces the tensions are exact to 5e-5 of their limits then."""
_SIGNS = np.array([1.0, -1.0])[:, None, None]
"""Changes of the distances from both bounds per change of an unknown."""


def boxed(
    system: Array, right: Array, low: Array, high: Array, cost: Array, cost_weight: float
) -> tuple[Array, Array, Array]:
    """Residuals (B,) of systems (B, m, n) with right sides (B, m) at their least squares with ``low`` <= x <= ``high``
    (n,), the costs (B,) of the unknowns, which count a little beside the squares, and the unknowns (B, n).
    """
    # In shares of their ranges all unknowns lie in (0, 1); 1e-8 beside the cost makes the optimum unique.
    span = np.maximum(high - low, 1e-12)
    across = np.ascontiguousarray(np.swapaxes(system * span, 1, 2))
    weight, enough = cost_weight * cost * span + 1e-8, _ENOUGH * cost_weight
    x = within_bounds(across, right - system @ low, weight, enough) * span + low
    left = (system @ x[..., None])[..., 0] - right
    return np.sqrt((left**2).sum(axis=1)), x @ cost, x


def within_bounds(across: Array, goal: Array, weight: Array, enough: float) -> Array:
    """Unknowns (B, n) in (0, 1) with the least squares of (K x - goal) and ``weight`` x, of transposed systems K' =
    ``across`` (B, n, m), by an interior point method until distances times multipliers are ``enough`` in the mean.

    S. Mehrotra's predictor and corrector, SIAM J. Optim. 2 (1992), doi:10.1137/0802028. The Newton steps are solved in
    the rows of the system, of which there are fewer than columns.
    """
    count, size, height = across.shape
    if library():
        sizes = count, height, size, _STEPS, _RIGID, enough
        return called("within_bounds", np.empty((count, size)), *sizes, across, goal, weight)
    scaled, unit = np.swapaxes(across, 1, 2), np.eye(height)
    # Distances from both bounds (2, B, n) and their multipliers.
    away = np.empty((2, count, size))
    away[0], away[1] = 0.1, 0.9
    press = np.full(away.shape, 0.05)
    # Where multipliers are nearly zero the steps are inaccurate: what was best counts.
    best, least = away[0], np.full(count, np.inf)
    for _ in range(_STEPS + 1):
        x = away[0]
        left = (scaled @ x[..., None])[..., 0] - goal
        value = 0.5 * np.einsum("bn,bn->b", left, left) + x @ weight
        worse = value > least
        best, least = (np.where(worse[:, None], best, x) if worse.any() else x), np.minimum(value, least)
        gap = np.einsum("kbn,kbn->b", away, press) / (2 * size)
        going = gap > enough
        if not going.any():
            break
        slope = (across @ left[..., None])[..., 0] + weight
        # (K' K + D) step = -down, by the Woodbury identity: D is diagonal, and its inverse is `soft`.
        stiff = press / away
        soft = 1.0 / (stiff[0] + stiff[1] + _RIGID)
        slim = scaled * soft[:, None, :]
        newton = soft, slim, across, unit + slim @ across
        step = _step(*newton, slope) * _SIGNS
        change = -press - stiff * step
        length = _longest(step, change, away, press)[:, 0]
        # To first order the products of both fall by the step's part.
        after = (1.0 - length) * gap + length**2 * np.einsum("kbn,kbn->b", step, change) / (2 * size)
        barrier = np.maximum(gap * np.minimum((after / gap) ** 3, 1.0), 0.1 * enough)[:, None]
        pull = (barrier - step * change) / away
        step = _step(*newton, slope - pull[0] + pull[1]) * _SIGNS
        change = pull - press - stiff * step
        # Those that have converged stay: with multipliers of zero the system is singular.
        length = 0.99 * _longest(step, change, away, press) * going[:, None]
        away, press = away + length * step, press + length * change
    return np.asarray(best)


def _step(soft: Array, slim: Array, across: Array, matrix: Array, slope: Array) -> Array:
    """A Newton step (B, n) down a slope."""
    inner = np.linalg.solve(matrix, slim @ slope[..., None])
    return np.asarray(soft * ((across @ inner)[..., 0] - slope))


def _longest(step: Array, change: Array, away: Array, press: Array) -> Array:
    """The longest step (B, 1), at most one, that no bound and no multiplier of one cuts."""
    least = np.minimum(step / away, change / press).min(axis=(0, 2))
    return np.asarray(1.0 / np.maximum(-least, 1.0))[:, None]
