"""Stumpff functions by Horner's rule: circular arcs without a singularity.

For x = theta^2, c_k(x) = sum_n (-x)^n / (2n+k)!. They are entire; c_0 = cos(theta), c_1 = sin(theta)/theta, and
c_k = 1/k! - x c_{k+2}. The two highest are evaluated by Horner's rule, in two chains, and the others by that recursion,
which has no division and no cancellation near zero (K. Stumpff, Himmelsmechanik I, 1959; design of the project, section
2.2).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import casadi as ca

from continuum_grasp.base import CheckedArgument, check_arguments
from continuum_grasp.model.planar import Rotation, Scalar
from continuum_grasp.scene import ONE_TURN

ROUNDING = 1.5e-16
"""Truncation error below which a series is as good as exact in double precision."""


def horner_degree(angle_range: float, accuracy: float, top: int) -> int:
    """Return the degree n in x = theta^2 that suffices for the series of c_top.

    The error stays below ``accuracy`` up to ``angle_range`` [rad], relative to c_top at zero, 1 / top!, and also in the
    result of the downward recursion, theta^top c_top.
    """
    # The series alternates and its terms soon fall, so the first one left out bounds the error. Logarithms, because
    # factorials and powers overflow for wide ranges.
    span, limit = math.log(max(angle_range, 1e-300)), math.log(accuracy)
    degree = 0
    while True:
        power = 2 * (degree + 1)
        left_out = power * span - math.lgamma(power + top + 1)
        if left_out + max(top * span, math.lgamma(top + 1)) <= limit:
            return degree
        degree += 1


def coefficients(k: int, degree: int) -> list[float]:
    """Coefficients of c_k in powers of theta^2, the constant first."""
    return [(-1.0) ** n / math.factorial(2 * n + k) for n in range(degree + 1)]


@check_arguments
def stumpff(theta: Scalar, angle_range: float, accuracy: float = ROUNDING, top: int = 7) -> list[Scalar]:
    """Write the Stumpff functions c_0 ... c_top of an angle as polynomials, exact to rounding and smooth at zero.

    Parameters
    ----------
    theta : casadi.SX, casadi.MX or float
        The angle [rad].
    angle_range : float
        Greatest angle [rad]; beyond, the error grows smoothly.
    accuracy : float
        Bound of the truncation error within the range, relative.
    top : int
        Highest order, at least 1.

    Returns
    -------
    list
        c_k = sum_n (-theta^2)^n / (2n+k)!: c_0 is the cosine, c_1 sin(theta)/theta, c_2 (1-cos(theta))/theta^2.

    Examples
    --------
    >>> from continuum_grasp.model import stumpff
    >>> c = stumpff(0.0, angle_range=2.0)  # at zero, where sin(theta)/theta has no value
    >>> [float(each) for each in c[:3]]
    [1.0, 1.0, 0.5]
    """
    CheckedArgument("angle_range", angle_range).number()
    CheckedArgument("accuracy", accuracy).number(1e-300, 1.0)
    CheckedArgument("top", top).whole()
    if angle_range > ONE_TURN:
        # The terms of a series grow with the exponential of the angle and cancel: 4e-15 at one turn, 5e-9 at 20 rad.
        return _doubled(stumpff(0.5 * theta, 0.5 * angle_range, accuracy, top + 1), 0.25 * (theta * theta))
    x = theta * theta
    c: list[Scalar] = [0.0] * (top + 1)
    for k in (top, top - 1):
        # All else waits for these two: even and odd powers apart, in two chains that a processor computes side by side,
        # take 1 to 9 % off the dynamics of arcs.
        series, square = coefficients(k, horner_degree(angle_range, accuracy, k)), x * x
        even, odd = (ca.polyval(ca.DM(part[::-1]), square) for part in (series[::2], series[1::2] or [0.0]))
        c[k] = even + x * odd
    # Downward: upward would divide by x, which cancels all digits near the straight finger.
    for k in range(top - 2, -1, -1):
        c[k] = 1.0 / math.factorial(k) - x * c[k + 2]
    return c


def _doubled(c: Sequence[Scalar], x: Scalar) -> list[Scalar]:
    """Return the Stumpff functions c_0 ... c_n of twice an angle, from c_0 ... c_n+1 and the square of the angle.

    G_k(s) = s^k c_k(s^2) is the k-th integral of the cosine, so G_k(2 s) = sum_j<k G_(k-j)(s) s^j / j! + G_0 G_k -
    G_1 G_(k+1): no term is much larger than the sum.
    """
    doubled = []
    for k in range(len(c) - 1):
        taylor = [(1.0 / math.factorial(j)) * c[k - j] for j in range(k)]
        value = sum(taylor, c[0] * c[k] - x * (c[1] * c[k + 1]))
        doubled.append(0.5**k * value)
    return doubled


def rotation(angle: ca.SX, angle_range: float, accuracy: float = ROUNDING) -> Rotation:
    """Cosine and sine of an angle of at most ``angle_range`` [rad], without a call of the mathematical library."""
    # Polynomials give the same bits on every platform, and a compiler can interleave them.
    x = angle * angle
    # One chain each: a link has a dozen of them side by side, and shorter chains take up to 22 % longer.
    series = (coefficients(k, horner_degree(angle_range, accuracy, k)) for k in (0, 1))
    cosine, sine = (ca.polyval(ca.DM(part[::-1]), x) for part in series)
    return Rotation(cosine, angle * sine)
