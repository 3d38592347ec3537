"""Elliptic integrals of the first and second kind by Carlson's symmetric forms."""

from __future__ import annotations

import math

__all__ = ["carlson_rd", "carlson_rf", "complete", "incomplete"]

_CLOSE = 1e-3
"""Relative spread at which the series take over; their remainder is its sixth power over 500, or less."""


def carlson_rf(x: float, y: float, z: float) -> float:
    """R_F(x, y, z) by duplication; B. C. Carlson (1995, doi:10.1007/BF02198293).

    Parameters
    ----------
    x, y, z : float
        Not negative, at most one of them zero [1].
    """
    while True:
        mean = (x + y + z) / 3.0
        a, b = 1.0 - x / mean, 1.0 - y / mean
        c = -a - b
        if max(abs(a), abs(b), abs(c)) < _CLOSE:
            break
        root = math.sqrt(x * y) + math.sqrt(y * z) + math.sqrt(z * x)
        x, y, z = 0.25 * (x + root), 0.25 * (y + root), 0.25 * (z + root)
    second, third = a * b - c * c, a * b * c
    series = 1.0 - second / 10.0 + third / 14.0 + second**2 / 24.0 - 3.0 * second * third / 44.0
    return series / math.sqrt(mean)


def carlson_rd(x: float, y: float, z: float) -> float:
    """R_D(x, y, z) by duplication; B. C. Carlson (1995, doi:10.1007/BF02198293).

    Parameters
    ----------
    x, y, z : float
        Not negative, x and y not both zero, z positive [1].
    """
    total, share = 0.0, 1.0
    while True:
        mean = (x + y + 3.0 * z) / 5.0
        a, b = 1.0 - x / mean, 1.0 - y / mean
        c = -(a + b) / 3.0
        if max(abs(a), abs(b), abs(c)) < _CLOSE:
            break
        root = math.sqrt(x * y) + math.sqrt(y * z) + math.sqrt(z * x)
        total += share / (math.sqrt(z) * (z + root))
        share *= 0.25
        x, y, z = 0.25 * (x + root), 0.25 * (y + root), 0.25 * (z + root)
    second = a * b - 6.0 * c * c
    third = (3.0 * a * b - 8.0 * c * c) * c
    fourth = 3.0 * (a * b - c * c) * c * c
    fifth = a * b * c**3
    series = 1.0 - 3.0 * second / 14.0 + third / 6.0 + 9.0 * second**2 / 88.0 - 3.0 * fourth / 22.0
    series += -9.0 * second * third / 52.0 + 3.0 * fifth / 26.0
    return 3.0 * total + share * series / (mean * math.sqrt(mean))


def complete(complement: float) -> tuple[float, float]:
    """K and E of the parameter m.

    Parameters
    ----------
    complement : float
        1 - m, above 0 [1].

    Returns
    -------
    first, second : float
        The integrals of 1 / sqrt(1 - m sin^2) and of sqrt(1 - m sin^2) from 0 to pi / 2.
    """
    first = carlson_rf(0.0, complement, 1.0)
    return first, first - (1.0 - complement) / 3.0 * carlson_rd(0.0, complement, 1.0)


def incomplete(sine: float, cosine_squared: float, m: float) -> tuple[float, float]:
    """F and E of an amplitude up to pi / 2 and the parameter m.

    Parameters
    ----------
    sine, cosine_squared : float
        Of the amplitude [1].
    m : float
        Parameter [1].

    Returns
    -------
    first, second : float
        The integrals of 1 / sqrt(1 - m sin^2) and of sqrt(1 - m sin^2) from 0 to the amplitude.
    """
    delta = 1.0 - m * sine**2
    first = sine * carlson_rf(cosine_squared, delta, 1.0)
    return first, first - m / 3.0 * sine**3 * carlson_rd(cosine_squared, delta, 1.0)
