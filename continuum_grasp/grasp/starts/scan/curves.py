"""Backbones for the search: curvature linear between knots, many curves at once.

Lengths are in units of the finger's length; planar vectors are complex; a curve starts at 0 with tangent i. B curves
with K knots: ``knots`` (B, K), ``curvatures`` (B, K).
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["bends", "curvature_at", "guess_table", "sample", "segment_end", "table_of", "turning"]

Array = NDArray[Any]

_X, _W = np.polynomial.legendre.leggauss(12)
_NODES, _WEIGHTS = 0.5 * (_X + 1.0), 0.5 * _W
"""Gauss-Legendre rule of 12 nodes on [0, 1]: one interval may bend by more than a turn."""
_TWO = 0.5 + np.array([-0.5, 0.5]) / np.sqrt(3.0)
"""Gauss-Legendre rule of 2 nodes on [0, 1], between samples that lie close to each other."""


def segment_end(lengths: Array, curvatures: Array) -> tuple[Array, Array, Array, Array]:
    """Ends of curves of several intervals, with derivatives.

    Parameters
    ----------
    lengths : ndarray, (B, K - 1)
        Of the intervals.
    curvatures : ndarray, (B, K)

    Returns
    -------
    end : ndarray of complex, (B,)
        End point, from the start and turned so that the start's tangent is i.
    turn : ndarray, (B,)
        Angle of the end.
    dend, dturn : ndarray, (B, K)
        Derivatives with respect to the curvatures.
    """
    count, size = curvatures.shape
    turn = np.zeros(count)
    dturn = np.zeros((count, size))
    end = np.zeros(count, complex)
    dend = np.zeros((count, size), complex)
    late = _NODES * (0.5 * _NODES)
    early = _NODES - late
    for k in range(size - 1):
        ell = lengths[:, k : k + 1]
        weights = ell * _WEIGHTS
        angle = turn[:, None] + ell * (curvatures[:, k : k + 1] * early + curvatures[:, k + 1 : k + 2] * late)
        tangent = np.empty(angle.shape, complex)
        tangent.real, tangent.imag = -np.sin(angle) * weights, np.cos(angle) * weights
        end = end + tangent.sum(axis=1)
        across = 1j * tangent
        dend[:, :k] += across.sum(axis=1)[:, None] * dturn[:, :k]
        dend[:, k] += (across * (dturn[:, k : k + 1] + ell * early)).sum(axis=1)
        dend[:, k + 1] += (across * (ell * late)).sum(axis=1)
        dturn[:, k] += 0.5 * lengths[:, k]
        dturn[:, k + 1] += 0.5 * lengths[:, k]
        turn = turn + 0.5 * lengths[:, k] * (curvatures[:, k] + curvatures[:, k + 1])
    return end, turn, dend, dturn


def turning(knots: Array, curvatures: Array, at: Array) -> Array:
    """Angle of the section (B, S) at positions ``at`` (B, S)."""
    angle = np.zeros(at.shape)
    for k in range(knots.shape[1] - 1):
        ell = np.maximum(knots[:, k + 1 : k + 2] - knots[:, k : k + 1], 1e-300)
        u = np.clip(at - knots[:, k : k + 1], 0.0, ell)
        slope = (curvatures[:, k + 1 : k + 2] - curvatures[:, k : k + 1]) / ell
        angle += u * (curvatures[:, k : k + 1] + 0.5 * slope * u)
    return angle


def curvature_at(knots: Array, curvatures: Array, at: Array) -> Array:
    """Curvature (B, S) at positions ``at`` (B, S)."""
    out = np.broadcast_to(curvatures[:, :1], at.shape).copy()
    for k in range(knots.shape[1] - 1):
        ell = np.maximum(knots[:, k + 1 : k + 2] - knots[:, k : k + 1], 1e-300)
        share = np.clip((at - knots[:, k : k + 1]) / ell, 0.0, 1.0)
        out += share * (curvatures[:, k + 1 : k + 2] - curvatures[:, k : k + 1])
    return out


def sample(knots: Array, curvatures: Array, at: Array) -> tuple[Array, Array]:
    """Points (B, S) and angles (B, S) at increasing positions ``at`` (B, S), the first of which is 0."""
    step = np.diff(at, axis=1)
    inner = at[:, :-1, None] + step[..., None] * _TWO
    shape = inner.shape
    angle = turning(knots, curvatures, inner.reshape(shape[0], -1)).reshape(shape)
    move = 0.5 * step * (1j * np.exp(1j * angle)).sum(axis=2)
    points = np.concatenate([np.zeros((shape[0], 1), complex), np.cumsum(move, axis=1)], axis=1)
    return points, turning(knots, curvatures, at)


def bends(knots: Array, curvatures: Array, joints: Array, counts: tuple[int, ...]) -> Array:
    """Greatest length times curvature of an element (B,), which is its bend where it is an arc; the segments between
    base, ``joints`` (B, J) and tip have ``counts`` equal elements each.
    """
    size = len(joints)
    marks = np.concatenate([np.zeros((size, 1)), joints, np.ones((size, 1))], axis=1)
    ends = [
        marks[:, k : k + 1] + (marks[:, k + 1 : k + 2] - marks[:, k : k + 1]) * (np.arange(n) / n)
        for k, n in enumerate(counts)
    ]
    at = np.concatenate([*ends, np.ones((size, 1))], axis=1)
    lengths = np.diff(at, axis=1)
    inside = 1e-9 * lengths
    near = np.maximum(
        np.abs(curvature_at(knots, curvatures, at[:, :-1] + inside)),
        np.abs(curvature_at(knots, curvatures, at[:, 1:] - inside)),
    )
    return np.asarray((lengths * near).max(axis=1))


@lru_cache(64)
def guess_table(reach: float, count: int, joint: float | None = None) -> tuple[Array, Array, Array, Array]:
    """Curves of length one whose end curvatures are on a grid: end curvatures (count,), end points (count, count) and
    angles (count, count) by first and last curvature, and which of them are not too crooked.

    Where ``joint`` is given they are two arcs that meet there.
    """
    grid = np.linspace(-reach, reach, count)
    ends, turns, _ = table_of(grid, grid, joint)
    return grid, ends, turns, np.abs(grid[:, None] - grid) <= 1.5 * reach


def table_of(firsts: Array, lasts: Array, joint: float | None = None) -> tuple[Array, Array, Array]:
    """End points, angles, and whether to use them, of curves of length one by first and last curvature."""
    first, last = np.meshgrid(firsts, lasts, indexing="ij")
    pairs = np.stack([first.ravel(), last.ravel()], axis=1)
    lengths = np.array([1.0])
    if joint is not None:
        pairs, lengths = pairs[:, [0, 0, 1, 1]], np.array([joint, 0.0, 1.0 - joint])
    end, turn, _, _ = segment_end(np.broadcast_to(lengths, (len(pairs), len(lengths))), pairs)
    return end.reshape(first.shape), turn.reshape(first.shape), np.ones(first.shape, bool)
