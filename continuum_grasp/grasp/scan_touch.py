"""Curves that touch: Newton's method on curvatures and on the place along the outline, many curves at once."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.scan_curves import stretch
from continuum_grasp.grasp.shapes import Shape

__all__ = ["arc_tangent", "tangent", "touch"]

Array = NDArray[Any]

_EXACT = 1e-12
_STEPS = 14


def tangent(
    shape: Shape, start: tuple[Array, Array], lengths: Array, curvatures: Array, free: tuple[int, int], walk: Array
) -> tuple[Array, Array, Array]:
    """Curves whose end lies on the grown outline with the section's X axis along its outward normal.

    Parameters
    ----------
    shape : Shape
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
    curvatures, walk = curvatures.copy(), walk.copy()
    system = np.empty((len(walk), 3, 3))
    for step in range(_STEPS):
        end, turn, dend, dturn = stretch(lengths, curvatures)
        at = shape.walk(walk)
        phase = np.exp(1j * start[1])
        off = start[0] + phase * end - at.point
        tilt = np.remainder(start[1] + turn - at.angle + math.pi, math.tau) - math.pi
        good = (np.abs(off) < _EXACT) & (np.abs(tilt) < _EXACT)
        if good.all() or step == _STEPS - 1:
            break
        for column, k in enumerate(free):
            move = phase * dend[:, k]
            system[:, 0, column], system[:, 1, column], system[:, 2, column] = move.real, move.imag, dturn[:, k]
        system[:, 0, 2], system[:, 1, 2], system[:, 2, 2] = -at.dpoint.real, -at.dpoint.imag, -at.dangle
        change = _solve(system, np.stack([off.real, off.imag, tilt], axis=1))
        change *= np.minimum(1.0, 3.0 / np.maximum(np.abs(change[:, :2]).max(axis=1), 1e-9))[:, None]
        change *= np.minimum(1.0, 0.15 * shape.period / np.maximum(np.abs(change[:, 2]), 1e-300))[:, None]
        curvatures[:, free[0]] -= change[:, 0]
        curvatures[:, free[1]] -= change[:, 1]
        walk -= change[:, 2]
    return curvatures, walk, good


def touch(
    shape: Shape, start: tuple[Array, Array], lengths: Array, curvatures: Array, free: int, walk: Array
) -> tuple[Array, Array, Array]:
    """Curves whose end lies on the grown outline, as :func:`tangent` does, with one free curvature each."""
    curvatures, walk = curvatures.copy(), walk.copy()
    for step in range(_STEPS):
        end, _, dend, _ = stretch(lengths, curvatures)
        at = shape.walk(walk)
        phase = np.exp(1j * start[1])
        off = start[0] + phase * end - at.point
        good = np.abs(off) < _EXACT
        if good.all() or step == _STEPS - 1:
            break
        move = phase * dend[:, free]
        det = -(move * np.conj(at.dpoint)).imag
        det = np.where(np.abs(det) < 1e-14, 1e-14, det)
        bend = -(off * np.conj(at.dpoint)).imag / det
        slide = (np.conj(move) * off).imag / -det
        cut = np.minimum(
            1.0, np.minimum(3.0 / np.maximum(np.abs(bend), 1e-9), 0.15 * shape.period / np.abs(slide + 1e-300))
        )
        curvatures[:, free] -= cut * bend
        walk -= cut * slide
    return curvatures, walk, good


def arc_tangent(shape: Shape, length: Array, curvature: Array, walk: Array) -> tuple[Array, Array, Array, Array]:
    """Circular arcs from the base, tangent to the grown outline at their ends: lengths, curvatures, walks, good."""
    length, curvature, walk = length.copy(), curvature.copy(), walk.copy()
    system = np.empty((len(walk), 3, 3))
    for step in range(_STEPS):
        end, turn, dend, dturn = stretch(length[:, None], np.stack([curvature, curvature], axis=1))
        at = shape.walk(walk)
        off = end - at.point
        tilt = np.remainder(turn - at.angle + math.pi, math.tau) - math.pi
        good = (np.abs(off) < _EXACT) & (np.abs(tilt) < _EXACT)
        if good.all() or step == _STEPS - 1:
            break
        move, on = dend.sum(axis=1), 1j * np.exp(1j * turn)
        for column, (d, angle) in enumerate(
            ((move, dturn.sum(axis=1)), (on, curvature), (-at.dpoint, -np.asarray(at.dangle)))
        ):
            system[:, 0, column], system[:, 1, column], system[:, 2, column] = d.real, d.imag, angle
        change = _solve(system, np.stack([off.real, off.imag, tilt], axis=1))
        change *= np.minimum(1.0, 3.0 / np.maximum(np.abs(change[:, 0]), 1e-9))[:, None]
        change *= np.minimum(1.0, 0.2 / np.maximum(np.abs(change[:, 1]), 1e-9))[:, None]
        change *= np.minimum(1.0, 0.15 * shape.period / np.maximum(np.abs(change[:, 2]), 1e-300))[:, None]
        curvature -= change[:, 0]
        length = np.clip(length - change[:, 1], 1e-3, 1.5)
        walk -= change[:, 2]
    return length, curvature, walk, good


def _solve(system: Array, right: Array) -> Array:
    """Cramer's rule for B systems of three equations."""
    a, b, c = system[:, :, 0], system[:, :, 1], system[:, :, 2]
    bc = np.cross(b, c)
    det = (a * bc).sum(axis=1)
    det = np.where(np.abs(det) < 1e-14, 1e-14, det)
    return np.stack(
        [
            (right * bc).sum(axis=1) / det,
            (a * np.cross(right, c)).sum(axis=1) / det,
            (a * np.cross(b, right)).sum(axis=1) / det,
        ],
        axis=1,
    )
