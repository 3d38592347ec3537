"""The greatest reserve of friction cones over a few directions, for many loads at once: a barrier method.

    maximize r - M t - rho |w|^2 / 2   subject to   slacks + S w + t >= 0,   t >= 0,   |sideways| <= pressed - r

Slacks, pressed and sideways are affine in w. What no w satisfies is exceeded by t as little as can be. The unknowns are
few (two to eight), so that Newton's method takes many problems at once: S. Boyd, L. Vandenberghe, Convex
Optimization, 2004, section 11.3.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

_PENALTY = 100.0
"""M: what exceeding a limit costs, per reserve; limits are scaled so that it is more than they bring [1]."""
NEAR = 1e-6
"""Least rho: makes w unique where the reserve does not depend on it [1]."""
_FIRST, _LAST, _FACTOR = 1.0, 1e-9, 0.1
"""Weights of the barrier: each limit costs as much of the reserve as the last one at most."""
_STEPS, _CENTERED = 50, 0.1
"""Newton steps for one weight, and the decrement below which it is small enough."""


@dataclass(frozen=True)
class Limits:
    """What bounds the reserve: A matrix of d directions, and values for each of B problems.

    Attributes
    ----------
    slacks, slack_slopes : ndarray, shapes (B, m) and (m, d)
        What must not be negative.
    cones, cone_slopes : ndarray, shapes (B, c, 3) and (c, 3, d)
        Pressed and sideways twice, per contact.
    """

    slacks: Array
    slack_slopes: Array
    cones: Array
    cone_slopes: Array


@dataclass(frozen=True)
class Reserve:
    """The optima.

    Attributes
    ----------
    w : ndarray, shape (B, d)
    reserve, excess : ndarray, shape (B,)
        r and t.
    slack_forces : ndarray, shape (B, m)
        What r - M t gains with a slack.
    cone_forces : ndarray, shape (B, c, 3)
        The same with each number of a cone.
    """

    w: Array
    reserve: Array
    excess: Array
    slack_forces: Array
    cone_forces: Array


def greatest_reserve(limits: Limits, rho: float = NEAR) -> Reserve:
    """Solve B problems that differ in their values alone."""
    count, size = len(limits.slacks), limits.slack_slopes.shape[1]
    rows, cones = limits.slacks.shape[1], limits.cones.shape[1]
    # Unknowns: w, r, t.
    slopes = np.concatenate([limits.slack_slopes, np.zeros((rows, 1)), np.ones((rows, 1))], axis=1)
    slopes = np.concatenate([slopes, np.eye(size + 2)[-1:]])
    values = np.concatenate([limits.slacks, np.zeros((count, 1))], axis=1)
    cone_slopes = np.concatenate([limits.cone_slopes, np.zeros((cones, 3, 2))], axis=2)
    cone_slopes[:, 0, size] = -1.0
    signs = np.array([1.0, -1.0, -1.0])
    squares = np.matmul(cone_slopes.transpose(0, 2, 1) * signs, cone_slopes).reshape(cones, -1)
    flat, x = cone_slopes.reshape(3 * cones, size + 2), np.zeros((count, size + 2))
    spare = limits.cones[..., 0] - np.hypot(limits.cones[..., 1], limits.cones[..., 2])
    x[:, size] = spare.min(axis=1, initial=0.0) - 1.0
    x[:, -1] = 1.0 + np.maximum(-limits.slacks, 0.0).max(axis=1, initial=0.0)
    cost, near = np.zeros(size + 2), np.zeros(size + 2)
    cost[size:], near[:size] = (-1.0, _PENALTY), rho
    weight = _FIRST
    while True:
        for _ in range(_STEPS):
            slack = values + x @ slopes.T
            cone = limits.cones + (x @ flat.T).reshape(count, cones, 3)
            depth = (cone**2) @ signs
            own = np.matmul((2.0 * signs * cone / depth[..., None])[:, :, None, :], cone_slopes)[:, :, 0]
            gradient = cost + near * x - weight * ((1.0 / slack) @ slopes + own.sum(axis=1))
            bend = np.matmul(slopes.T * (slack**-2.0)[:, None, :], slopes) + np.matmul(own.transpose(0, 2, 1), own)
            bend = weight * (bend - ((2.0 / depth) @ squares).reshape(bend.shape))
            bend[:, range(size + 2), range(size + 2)] += near
            # Scaled to a unit diagonal: barriers differ by many orders.
            scale = 1.0 / np.sqrt(np.maximum(np.diagonal(bend, axis1=1, axis2=2), 1e-300))
            scaled = bend * scale[:, :, None] * scale[:, None, :]
            scaled[:, range(size + 2), range(size + 2)] += 1e-14
            step = -scale * np.linalg.solve(scaled, (scale * gradient)[..., None])[..., 0]
            decrement = np.sqrt(np.maximum(-(step * gradient).sum(axis=1), 0.0) / weight)
            # Damped steps of a self-concordant function stay within its domain.
            x = x + np.where(decrement > 0.25, 1.0 / (1.0 + decrement), 1.0)[:, None] * step
            if decrement.max() < _CENTERED:
                break
        if weight <= _LAST:
            break
        weight = max(_FACTOR * weight, _LAST)
    slack = values + x @ slopes.T
    cone = limits.cones + (x @ flat.T).reshape(count, cones, 3)
    forces = weight * 2.0 * signs * cone / ((cone**2) @ signs)[..., None]
    return Reserve(x[:, :size], x[:, size], x[:, -1], (weight / slack)[:, :rows], forces)
