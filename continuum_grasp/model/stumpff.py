"""Stumpff functions by Horner's rule: circular arcs without a singularity.

For x = theta^2, c_k(x) = sum_n (-x)^n / (2n+k)!. They are entire; c_0 = cos(theta), c_1 = sin(theta)/theta, and
c_k = 1/k! - x c_{k+2}. The two highest are evaluated by Horner's rule and the others by that recursion, which has no
division and no cancellation near zero (K. Stumpff, Himmelsmechanik I, 1959; design of the project, section 2.2).
"""

from __future__ import annotations

import math
from fractions import Fraction
from functools import cache

import casadi as ca

from continuum_grasp.model.planar import Rotation, Scalar

__all__ = ["ROUNDING", "horner_degree", "rotation", "stumpff"]

ROUNDING = 1.5e-16
"""Truncation error below which a series is as good as exact in double precision."""


def horner_degree(angle_range: float, accuracy: float, top: int) -> int:
    """Degree in x at which a series from c_top on may be cut.

    Parameters
    ----------
    angle_range : float
        Greatest absolute angle [rad].
    accuracy : float
        Greatest absolute error of c_0 (for odd ``top``: of theta c_1) over the range.
    top : int
        Index of the series that is evaluated.

    Returns
    -------
    int
        Degree n; the first term left out contributes less than ``accuracy``.
    """
    degree = 0
    while True:
        power = 2 * (degree + 1) + top
        if power * math.log(max(angle_range, 1e-300)) - math.lgamma(power + 1) <= math.log(accuracy):
            return degree
        degree += 1


def _series(x: Scalar, k: int, degree: int) -> Scalar:
    """c_k(x) to the given degree, by Horner's rule."""
    value: Scalar = (-1.0) ** degree / math.factorial(2 * degree + k)
    for n in range(degree - 1, -1, -1):
        value = value * x + (-1.0) ** n / math.factorial(2 * n + k)
    return value


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


def rotation(angle: ca.SX, angle_range: float, accuracy: float = 2e-15) -> Rotation:
    """Cosine and sine of a bounded angle without a call of the mathematical library.

    The Taylor series are economised (the last terms replaced by multiples of Chebyshev polynomials, C. Lanczos,
    Applied Analysis, 1956), which saves one to two terms; the values at zero stay exact.

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
    cosine, sine = (_horner(x, _economized(k, angle_range, accuracy)) for k in (0, 1))
    return Rotation(cosine, angle * sine)


def _horner(x: ca.SX, coefficients: tuple[float, ...]) -> Scalar:
    value: Scalar = coefficients[-1]
    for c in reversed(coefficients[:-1]):
        value = value * x + c
    return value


@cache
def _economized(k: int, angle_range: float, accuracy: float) -> tuple[float, ...]:
    """Coefficients of c_k(x) on 0 <= x <= angle_range^2 with an error below ``accuracy``; exact at zero."""
    scale = Fraction(angle_range) ** 2
    full = horner_degree(angle_range, 1e-3 * accuracy, k)
    # c_k = 1/k! + x g(x); g in t = x / scale, from which shifted Chebyshev polynomials are taken away.
    g = [(-1) ** (n + 1) * scale**n / math.factorial(2 * n + 2 + k) for n in range(full)]
    while len(g) > 1:
        degree = len(g) - 1
        if float(abs(g[-1]) * scale) / 2.0 ** (2 * degree - 1) > 0.5 * accuracy:
            break
        top = _shifted_chebyshev(degree)
        g = [c - g[-1] / top[-1] * t for c, t in zip(g[:-1], top, strict=False)]
    return (1.0 / math.factorial(k), *(float(c / scale**n) for n, c in enumerate(g)))


@cache
def _shifted_chebyshev(degree: int) -> tuple[int, ...]:
    """Coefficients of T_n(2 t - 1), ascending."""
    before: tuple[int, ...] = (1,)
    here: tuple[int, ...] = (-1, 2)
    if degree == 0:
        return before
    for _ in range(degree - 1):
        after = [0] * (len(here) + 1)
        for n, c in enumerate(here):
            after[n + 1] += 4 * c
            after[n] -= 2 * c
        for n, c in enumerate(before):
            after[n] -= c
        before, here = here, tuple(after)
    return here
