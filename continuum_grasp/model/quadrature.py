"""Gauss-Legendre collocation on [0, 1]: nodes, weights, and the kernel of kinetic energy."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Collocation:
    """Gauss-Legendre nodes u on the pieces of [0, 1], and what follows from interpolation at them on each piece.

    ``running`` integrates from 0 to each node. ``kernel``: the integral of the density times F G is f' kernel g, with
    F, G the running integrals of the interpolated f, g. The density is one unless stated.
    """

    pieces: tuple[tuple[float, float], ...]  # where the interpolated is smooth
    nodes: NDArray[np.float64]  # (m,) increasing
    piece: tuple[int, ...]  # (m,) of each node
    weights: NDArray[np.float64]  # (m,) integral over [0, 1]
    steps: NDArray[np.float64]  # (m + 1,) from 0 to the first node, between nodes, from the last to 1
    running: NDArray[np.float64]  # (m, m)
    mass: float  # integral of the density
    mean_weights: NDArray[np.float64]  # (m,) integral of the density times F
    kernel: NDArray[np.float64]  # (m, m) symmetric
    rotary_weights: NDArray[np.float64]  # (m,) weights times the rotary density

    @property
    def offsets(self) -> NDArray[np.float64]:
        """(m + 1,) steps times the distance of their middles from 1/2."""
        stops = np.concatenate(([0.0], self.nodes, [1.0]))
        offsets = self.steps * (0.5 * (stops[1:] + stops[:-1]) - 0.5)
        return 0.5 * (offsets - offsets[::-1])


@cache
def _integrals(count: int) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Gauss nodes (m,) and weights on [-1, 1]; Legendre coefficients (m + 1, m) of the running integrals over [0, 1] of
    the polynomials that are one at a node and zero at the others.
    """
    x, w = np.polynomial.legendre.leggauss(count)
    # Running integrals of Legendre polynomials: int_{-1}^x P_n = (P_{n+1} - P_{n-1}) / (2 n + 1).
    polynomials = np.polynomial.legendre.legvander(x, count)
    coefficients = (2 * np.arange(count) + 1)[:, None] * polynomials[:, :count].T * (0.5 * w)
    running = np.zeros((count + 1, count))
    running[:2] += coefficients[0] * 0.5
    for n in range(1, count):
        running[n + 1] += 0.5 * coefficients[n] / (2 * n + 1)
        running[n - 1] -= 0.5 * coefficients[n] / (2 * n + 1)
    return x, w, running


def running_weights(count: int, fraction: Any) -> Any:
    """Weights (m, K) of the integrals from 0 to fractions (1, K) of the polynomial through values at ``count`` Gauss
    nodes.

    An ndarray or a number gives an ndarray, a casadi.SX a casadi.SX.
    """
    # Legendre polynomials by their recurrence, which serves numbers and expressions alike.
    x = 2.0 * fraction - 1.0
    polynomials = [1.0 + 0.0 * x, x]
    for n in range(1, count):
        polynomials.append(((2 * n + 1) * x * polynomials[n] - n * polynomials[n - 1]) / (n + 1))
    weights = _integrals(count)[2].T
    if isinstance(fraction, ca.SX):
        return ca.DM(weights) @ ca.vertcat(*polynomials)
    return weights @ np.vstack(polynomials)


Density = Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""A function of the fraction u, smooth on each piece."""
_FINE = 24
"""Least nodes per piece of the integrals with a density [1]: exact to rounding for polynomials of degree 47."""


def graded_collocation(
    pieces: Sequence[tuple[float, float]], count: int, density: Density, rotary: Density
) -> Collocation:
    """The rule with ``count`` nodes on each piece, for a density and a rotary density."""
    # A jump inside one rule costs 5e-3 to 2e-5 in the frequencies, however many nodes there are; a rule on each side of
    # it is exact again.
    x, w, coefficients = _integrals(count)
    fine, fine_weights = np.polynomial.legendre.leggauss(max(_FINE, count + 8))
    size, m = len(pieces), len(pieces) * count

    def at(points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Fractions of points of [-1, 1] on each piece."""
        return np.concatenate([a + 0.5 * (b - a) * (points + 1.0) for a, b in pieces])

    def running(points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Running integrals (size * points, m) at points on each piece."""
        integrals = np.zeros((size, len(points), size, count))
        inside = np.polynomial.legendre.legvander(points, count) @ coefficients
        for k, (a, b) in enumerate(pieces):
            integrals[k, :, k] = (b - a) * inside
            integrals[k + 1 :, :, k] = (b - a) * 0.5 * w
        return integrals.reshape(size * len(points), m)

    nodes, widths = at(x), np.array([b - a for a, b in pieces])
    weights = np.kron(widths, 0.5 * w)
    rotary_weights = weights * rotary(nodes)
    measure = np.kron(widths, 0.5 * fine_weights) * density(at(fine))
    moved = running(fine)
    kernel = moved.T @ (measure[:, None] * moved)
    return Collocation(
        pieces=tuple(pieces),
        nodes=nodes,
        piece=tuple(k for k in range(size) for _ in range(count)),
        weights=weights,
        steps=np.diff(np.concatenate(([0.0], nodes, [1.0]))),
        running=running(x),
        mass=float(measure.sum()),
        mean_weights=measure @ moved,
        kernel=0.5 * (kernel + kernel.T),
        rotary_weights=rotary_weights,
    )


@cache
def collocation(count: int) -> Collocation:
    """The rule with ``count`` nodes on one piece of uniform density."""
    rule = graded_collocation([(0.0, 1.0)], count, np.ones_like, np.ones_like)
    # Symmetric to the last bit, so that CasADi recognizes equal factors of both halves as one.
    return replace(rule, mass=1.0, steps=0.5 * (rule.steps + rule.steps[::-1]))


STRICT = 1e-8
"""Least accuracy [1] that requires a tenth of it from the table. The table's errors are relative to the largest entry
over all shapes, so that shapes with a small bias then reach the accuracy too."""
