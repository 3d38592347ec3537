"""Stumpff functions by Horner's rule: circular arcs without a singularity.

For x = theta^2, c_k(x) = sum_n (-x)^n / (2n+k)!. They are entire; c_0 = cos(theta), c_1 = sin(theta)/theta, and
c_k = 1/k! - x c_{k+2}. The two highest are evaluated by Horner's rule and the others by that recursion, which has no
division and no cancellation near zero (K. Stumpff, Himmelsmechanik I, 1959; design of the project, section 2.2).
"""

from __future__ import annotations

import math

import casadi as ca

from continuum_grasp.model.planar import Rotation, Scalar

ROUNDING = 1.5e-16
"""Truncation error below which a series is as good as exact in double precision."""


def horner_degree(angle_range: float, accuracy: float, top: int) -> int:
    """Degree in x at which a series from c_top on may be cut.

    Parameters
    ----------
    angle_range : float
        Greatest absolute angle [rad].
    accuracy : float
        Greatest error over the range, of c_top relative to its value at zero, and of what the downward recursion makes
        of it, theta^top c_top.
    top : int
        Index of the series that is evaluated.

    Returns
    -------
    int
        Degree n; the first term left out stays below ``accuracy`` on both counts.
    """
    span, limit = math.log(max(angle_range, 1e-300)), math.log(accuracy)
    degree = 0
    while True:
        power = 2 * (degree + 1)
        left_out = power * span - math.lgamma(power + top + 1)
        if left_out + max(top * span, math.lgamma(top + 1)) <= limit:
            return degree
        degree += 1


def _series(x: Scalar, k: int, degree: int) -> Scalar:
    """c_k(x) to the given degree, by Horner's rule."""
    return ca.polyval(ca.DM([(-1.0) ** n / math.factorial(2 * n + k) for n in range(degree, -1, -1)]), x)


def stumpff(theta: Scalar, angle_range: float, accuracy: float = ROUNDING, top: int = 7) -> list[Scalar]:
    """The Stumpff functions c_0 ... c_top of theta^2.

    Parameters
    ----------
    theta : float or casadi.SX
        Bending angle [rad].
    angle_range : float
        Greatest absolute value that ``theta`` takes; beyond it the error grows, smoothly.
    accuracy : float
        Truncation error allowed over the range.
    top : int
        Highest index, at least 1.

    Returns
    -------
    list
        c_0 ... c_top.
    """
    x = theta * theta
    c: list[Scalar] = [0.0] * (top + 1)
    for k in (top, top - 1):
        c[k] = _series(x, k, horner_degree(angle_range, accuracy, k))
    for k in range(top - 2, -1, -1):
        c[k] = 1.0 / math.factorial(k) - x * c[k + 2]
    return c


def rotation(angle: ca.SX, angle_range: float, accuracy: float = ROUNDING) -> Rotation:
    """Cosine and sine of a bounded angle without a call of the mathematical library.

    Parameters
    ----------
    angle : casadi.SX
        Angle [rad].
    angle_range : float
        Greatest absolute value that it takes.
    accuracy : float
        Truncation error allowed over the range.
    """
    x = angle * angle
    cosine, sine = (_series(x, k, horner_degree(angle_range, accuracy, k)) for k in (0, 1))
    return Rotation(cosine, angle * sine)
