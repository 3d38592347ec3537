"""Compute the greatest push on an object that its contacts bear in every direction, to first order, with numpy alone.

Under a push p d, |d| <= 1, a contact bears f + p G d. With the normal n, S = (1 + mu^2) n n' - 1, it is within the
cone of friction mu for every d if and only if n . f >= p |G' n| and some e >= 0 makes

    [ G' S G + e 1    G' S f        ]
    [ f' S G          f' S f - e p^2 ]

positive semidefinite (the S-lemma, which is exact for one quadratic: I. Polik, T. Terlaky, SIAM Review 49 (2007),
doi:10.1137/S003614450444614X). With w the eigenvalues of G' S G and v = Q' G' S f along its eigenvectors Q,

    p^2 <= (f' S f - sum v^2 / (w + e)) / e,  e > max(0, -min w),

a ratio of a concave and a linear function of e, which has a single maximum.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from continuum_grasp.base import Array

_STEPS = 75
"""Steps of the golden section: to 1e-16 of the interval, the rounding of its ends."""
_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)


def bears(force: Array, slope: Array, normal: Array, friction: float, most: float = math.inf) -> float:
    """Compute the greatest push that a contact bears in every direction [N].

    Parameters
    ----------
    force : ndarray, shape (m,)
        Load on the contact [N].
    slope : ndarray, shape (m, k)
        Change of the load per push along each of k axes [1].
    normal : ndarray, shape (m,)
        Unit normal of the pressing contact.
    friction : float
        Coefficient of friction [1].
    most : float, optional
        Greatest normal force [N].
    """
    press = float(force @ normal)
    opening = float(np.linalg.norm(slope.T @ normal))
    form = (1.0 + friction**2) * np.outer(normal, normal) - np.eye(normal.size)
    spare = float(force @ form @ force)
    if not (press > 0.0 and spare > 0.0 and press < most):
        return 0.0
    limit = min(press, most - press) / opening if opening > 0.0 else math.inf
    w, axes = np.linalg.eigh(slope.T @ form @ slope)
    v = axes.T @ (slope.T @ form @ force)
    least = max(0.0, -float(w[0]))
    scale = float(np.abs(w).max(initial=0.0))
    if scale == 0.0:
        return limit

    def square(logarithm: float) -> float:
        beyond = scale * math.exp(logarithm)
        return float((spare - (v**2 / (w + least + beyond)).sum()) / (least + beyond))

    _, greatest = maximum(square, math.log(1e-12), math.log(1e12))
    return min(limit, math.sqrt(max(greatest, 0.0)))


def maximum(function: Callable[[float], float], low: float, high: float) -> tuple[float, float]:
    """Find the only maximum of a function in an interval by golden section; returns its place and its value.

    Unlike the methods of SciPy, it also locates a kink to rounding.
    """
    a, b = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
    at_a, at_b = function(a), function(b)
    for _ in range(_STEPS):
        if at_a >= at_b:
            high, b, at_b = b, a, at_a
            a = high - _GOLDEN * (high - low)
            at_a = function(a)
        else:
            low, a, at_a = a, b, at_b
            b = low + _GOLDEN * (high - low)
            at_b = function(b)
    return 0.5 * (low + high), max(at_a, at_b)
