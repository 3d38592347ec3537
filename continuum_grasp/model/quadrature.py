"""Gauss-Legendre collocation on [0, 1]: nodes, weights, and the kernel of kinetic energy."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

__all__ = ["Collocation", "collocation"]


@dataclass(frozen=True)
class Collocation:
    """Gauss-Legendre nodes on [0, 1] and what follows from interpolation at them."""

    nodes: NDArray[np.float64]
    """(m,) increasing."""
    weights: NDArray[np.float64]
    """(m,) integral over [0, 1]."""
    mean_weights: NDArray[np.float64]
    """(m,) integral of (1 - u) f(u), the mean of the running integral."""
    kernel: NDArray[np.float64]
    """(m, m) symmetric: int_0^1 F G du = f' kernel g, with F, G the running integrals of the interpolated f, g."""


@cache
def collocation(count: int) -> Collocation:
    """The rule with ``count`` nodes."""
    x, w = np.polynomial.legendre.leggauss(count)
    nodes, weights = 0.5 * (x + 1.0), 0.5 * w
    # Running integrals of Legendre polynomials: int_{-1}^x P_n = (P_{n+1} - P_{n-1}) / (2 n + 1).
    polynomials = np.polynomial.legendre.legvander(x, count)
    coefficients = (2 * np.arange(count) + 1)[:, None] * polynomials[:, :count].T * weights
    running = np.zeros((count + 1, count))
    running[:2] += coefficients[0] * 0.5
    for n in range(1, count):
        running[n + 1] += 0.5 * coefficients[n] / (2 * n + 1)
        running[n - 1] -= 0.5 * coefficients[n] / (2 * n + 1)
    kernel = (running.T / (2 * np.arange(count + 1) + 1)) @ running
    return Collocation(nodes, weights, weights * (1.0 - nodes), 0.5 * (kernel + kernel.T))
