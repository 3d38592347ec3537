"""Gauss-Legendre nodes, weights and integration matrix to many digits.

The numbers live in a private mpmath context (``ctx``), so nothing here changes mpmath's global precision.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import mpmath

ctx = mpmath.mp.clone()
ctx.dps = 50

NODES = 40
"""Nodes per element: for bends up to 2 pi per element more than 30 digits (tested)."""


class Rule(NamedTuple):
    """Gauss rule on [0, 1] with the integrals of its Lagrange polynomials.

    ``integrals[k][j]`` is the integral from 0 to ``nodes[k]`` of the j-th Lagrange polynomial.
    """

    nodes: list
    weights: list
    integrals: list


def _legendre(x, degree):
    """Values P_0(x) .. P_degree(x)."""
    values = [ctx.mpf(1), x]
    for m in range(1, degree):
        values.append(((2 * m + 1) * x * values[m] - m * values[m - 1]) / (m + 1))
    return values


@lru_cache(maxsize=8)
def gauss(count: int = NODES) -> Rule:
    """Gauss-Legendre rule with ``count`` nodes on [0, 1]."""
    roots = []
    for k in range(count):
        x = ctx.cos(ctx.pi * (k + ctx.mpf(3) / 4) / (count + ctx.mpf(1) / 2))
        for _ in range(12):
            p = _legendre(x, count)
            slope = count * (p[count - 1] - x * p[count]) / (1 - x * x)
            step = p[count] / slope
            x -= step
            if abs(step) < ctx.mpf(10) ** (-ctx.dps // 2 - 5):
                break
        roots.append(x)
    roots.sort()
    tables = [_legendre(x, count) for x in roots]
    weights = []
    for x, p in zip(roots, tables, strict=True):
        slope = count * (p[count - 1] - x * p[count]) / (1 - x * x)
        weights.append(2 / ((1 - x * x) * slope * slope))
    # The j-th Lagrange polynomial is sum_m (2 m + 1)/2 w_j P_m(x_j) P_m(x) for m < count, and
    # (2 m + 1) times the integral of P_m from -1 to x is P_{m+1}(x) - P_{m-1}(x); x + 1 for m = 0.
    primitives = [
        [(x + 1) / 2] + [(p[m + 1] - p[m - 1]) / 2 for m in range(1, count)] for x, p in zip(roots, tables, strict=True)
    ]
    integrals = [
        [weights[j] * ctx.fdot(primitives[k], tables[j][:count]) / 2 for j in range(count)] for k in range(count)
    ]
    return Rule([(1 + x) / 2 for x in roots], [w / 2 for w in weights], integrals)
