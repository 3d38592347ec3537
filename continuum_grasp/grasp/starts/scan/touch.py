"""Curves that touch: Newton's method on curvatures and on the place along the outline, many curves at once."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.starts.scan.curves import segment_end
from continuum_grasp.model.surfaces.outline import Outline

__all__ = ["arc_tangent", "tangent", "touch"]

Array = NDArray[Any]
Equations = Callable[[Array, Array], tuple[list[Array], list[list[Array]]]]

_EXACT = 1e-12
"""Residual, in lengths of the finger and rad, at which a curve touches: rounding after a few operations."""
_STEPS, _EARLY, _HOPEFUL = 14, 5, 0.05
"""Newton steps; after the first five, systems with a larger residual are given up: a start in the basin of a root has
converged quadratically below it by then."""
_BEND_STEP = 3.0
"""Greatest change of a curvature in one step [1/L]: half of the range of the scans, so that no step leaves it."""


def tangent(
    shape: Outline, start: tuple[Array, Array], lengths: Array, curvatures: Array, free: tuple[int, int], walk: Array
) -> tuple[Array, Array, Array]:
    """Curves whose end lies on the grown outline with the section's X axis along its outward normal.

    Parameters
    ----------
    shape : Outline
    start : (ndarray of complex (B,), ndarray (B,))
        Point and angle where the curves start.
    lengths : ndarray, (B, K - 1)
    curvatures : ndarray, (B, K)
        First guesses.
    free : (int, int)
        Columns of the curvatures that may change.
    walk : ndarray, (B,)
        First guesses of the place on the outline.

    Returns
    -------
    curvatures : ndarray, (B, K)
    walk : ndarray, (B,)
    good : ndarray of bool, (B,)
    """
    point, angle = start
    phase = np.exp(1j * angle)
    out = curvatures.copy()

    def equations(u: Array, rows: Array) -> tuple[list[Array], list[list[Array]]]:
        bent = out[rows]
        bent[:, free[0]], bent[:, free[1]] = u[:, 0], u[:, 1]
        end, turn, dend, dturn = segment_end(lengths[rows], bent)
        at = shape.walk(u[:, 2])
        off = point[rows] + phase[rows] * end - at.point
        tilt = _turned(angle[rows] + turn - at.angle)
        one, two = phase[rows] * dend[:, free[0]], phase[rows] * dend[:, free[1]]
        return [off.real, off.imag, tilt], [
            [one.real, two.real, -at.dpoint.real],
            [one.imag, two.imag, -at.dpoint.imag],
            [dturn[:, free[0]], dturn[:, free[1]], -at.dangle],
        ]

    first = np.stack([out[:, free[0]], out[:, free[1]], walk], axis=1)
    found, good = _newton(equations, first, (_BEND_STEP, _BEND_STEP, 0.15 * shape.period))
    out[:, free[0]], out[:, free[1]] = found[:, 0], found[:, 1]
    return out, found[:, 2], good


def touch(
    shape: Outline, start: tuple[Array, Array], lengths: Array, curvatures: Array, free: tuple[int, ...], walk: Array
) -> tuple[Array, Array, Array]:
    """Curves whose end lies on the grown outline, as :func:`tangent` does; the curvatures of the columns ``free`` all
    change by the same amount.
    """
    columns = list(free)
    point, angle = start
    phase = np.exp(1j * angle)
    out = curvatures.copy()

    def equations(u: Array, rows: Array) -> tuple[list[Array], list[list[Array]]]:
        bent = out[rows]
        bent[:, columns] += u[:, :1]
        end, _, dend, _ = segment_end(lengths[rows], bent)
        at = shape.walk(u[:, 1])
        off = point[rows] + phase[rows] * end - at.point
        move = phase[rows] * dend[:, columns].sum(axis=1)
        return [off.real, off.imag], [[move.real, -at.dpoint.real], [move.imag, -at.dpoint.imag]]

    first = np.stack([np.zeros(len(walk)), walk], axis=1)
    found, good = _newton(equations, first, (_BEND_STEP, 0.15 * shape.period))
    out[:, columns] += found[:, :1]
    return out, found[:, 1], good


def arc_tangent(shape: Outline, length: Array, curvature: Array, walk: Array) -> tuple[Array, Array, Array, Array]:
    """Circular arcs from the base, tangent to the grown outline at their ends: lengths, curvatures, walks, good."""

    def equations(u: Array, rows: Array) -> tuple[list[Array], list[list[Array]]]:
        bent = u[:, 1]
        end, turn, dend, _ = segment_end(u[:, :1], np.stack([bent, bent], axis=1))
        at = shape.walk(u[:, 2])
        off = end - at.point
        move, on = dend.sum(axis=1), 1j * np.exp(1j * turn)
        return [off.real, off.imag, _turned(turn - at.angle)], [
            [on.real, move.real, -at.dpoint.real],
            [on.imag, move.imag, -at.dpoint.imag],
            [bent, u[:, 0], -at.dangle],
        ]

    first = np.stack([length, curvature, walk], axis=1)
    found, good = _newton(equations, first, (0.2, _BEND_STEP, 0.15 * shape.period))
    return found[:, 0], found[:, 1], found[:, 2], good & (found[:, 0] > 0.0)


def _turned(angle: Array) -> Array:
    return np.asarray(np.remainder(angle + math.pi, math.tau) - math.pi)


def _newton(equations: Equations, first: Array, most: tuple[float, ...]) -> tuple[Array, Array]:
    """Roots of B systems of two or three equations from ``first`` (B, n), and which were found; those that get
    nowhere are given up early.
    """
    unknown = first.copy()
    good = np.zeros(len(first), bool)
    rows = np.arange(len(first))
    for step in range(_STEPS):
        if not len(rows):
            break
        left, slopes = equations(unknown[rows], rows)
        wrong = np.abs(left[0])
        for more in left[1:]:
            wrong = np.maximum(wrong, np.abs(more))
        good[rows[wrong < _EXACT]] = True
        going = (wrong >= _EXACT) & np.isfinite(wrong)
        if step >= _EARLY:
            going &= wrong < _HOPEFUL
        if not going.all():
            rows = rows[going]
            left = [part[going] for part in left]
            slopes = [[part[going] for part in row] for row in slopes]
        change = _solve(slopes, left)
        cut = np.ones(len(rows))
        for part, limit in zip(change, most, strict=True):
            cut = np.minimum(cut, limit / np.maximum(np.abs(part), 1e-300))
        for k, part in enumerate(change):
            unknown[rows, k] -= cut * part
    return unknown, good


def _solve(a: list[list[Array]], b: list[Array]) -> list[Array]:
    """Cramer's rule for many systems of two or three equations; `numpy.linalg.solve` loops over them."""
    if len(b) == 2:
        det = _safe(a[0][0] * a[1][1] - a[0][1] * a[1][0])
        return [(b[0] * a[1][1] - a[0][1] * b[1]) / det, (a[0][0] * b[1] - b[0] * a[1][0]) / det]
    (p, q, r), (u, v, w), (x, y, z) = a
    one, two, three = v * z - w * y, w * x - u * z, u * y - v * x
    det = _safe(p * one + q * two + r * three)
    return [
        (b[0] * one + b[1] * (r * y - q * z) + b[2] * (q * w - r * v)) / det,
        (b[0] * two + b[1] * (p * z - r * x) + b[2] * (r * u - p * w)) / det,
        (b[0] * three + b[1] * (q * x - p * y) + b[2] * (p * v - q * u)) / det,
    ]


def _safe(det: Array) -> Array:
    return np.where(np.abs(det) < 1e-14, 1e-14, det)
