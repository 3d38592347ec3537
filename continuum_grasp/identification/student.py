"""Quantiles of Student's t distribution."""

from __future__ import annotations

import math

__all__ = ["t_cumulative", "t_quantile"]


def t_cumulative(t: float, freedom: float) -> float:
    """Probability that Student's t with so many degrees of freedom is at most t."""
    tail = 0.5 * _beta_ratio(0.5 * freedom, 0.5, freedom / (freedom + t * t))
    return 1.0 - tail if t > 0.0 else tail


def t_quantile(probability: float, freedom: float) -> float:
    """Value that Student's t with so many degrees of freedom stays below with a probability between 0 and 1."""
    if probability < 0.5:
        return -t_quantile(1.0 - probability, freedom)
    low, high = 0.0, 1.0
    while t_cumulative(high, freedom) < probability and high < 1e12:
        low, high = high, 2.0 * high
    for _ in range(200):
        middle = 0.5 * (low + high)
        if middle in (low, high):
            break
        low, high = (middle, high) if t_cumulative(middle, freedom) < probability else (low, middle)
    return 0.5 * (low + high)


def _beta_ratio(a: float, b: float, x: float) -> float:
    """The regularised incomplete beta function, by Lentz's continued fraction (DLMF 8.17.22)."""
    if x <= 0.0 or x >= 1.0:
        return 0.0 if x <= 0.0 else 1.0
    if x > (a + 1.0) / (a + b + 2.0):
        return 1.0 - _beta_ratio(b, a, 1.0 - x)
    front = math.exp(math.lgamma(a + b) - math.lgamma(a) - math.lgamma(b) + a * math.log(x) + b * math.log1p(-x))
    tiny, c, d = 1e-300, 1.0, 1.0 - (a + b) * x / (a + 1.0)
    d = 1.0 / (d if abs(d) > tiny else tiny)
    value = d
    for m in range(1, 10_000):
        for term in (
            m * (b - m) * x / ((a + 2 * m - 1) * (a + 2 * m)),
            -(a + m) * (a + b + m) * x / ((a + 2 * m) * (a + 2 * m + 1)),
        ):
            d = 1.0 + term * d
            d = 1.0 / (d if abs(d) > tiny else tiny)
            c = 1.0 + term / c
            c = c if abs(c) > tiny else tiny
            value *= c * d
        if abs(c * d - 1.0) < 1e-16 * 8:
            break
    return front * value / a
