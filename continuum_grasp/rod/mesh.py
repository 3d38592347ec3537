"""Piecewise Gauss-Legendre collocation: nodes, integration matrices and series on the panels of an interval."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property, lru_cache
from itertools import pairwise

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import ArrayLike, NDArray

__all__ = ["Mesh", "panel_edges", "with_places"]

Array = NDArray[np.float64]

_SAME_PLACE = 1e-9
"""Distance per length below which two places are one [1]: far above rounding, far below any distance that matters."""


def with_places(fixed: ArrayLike, others: Iterable[float]) -> Array:
    """Fixed places from start to end, and others that are none of those and not at one another, increasing."""
    found = [float(at) for at in np.asarray(fixed)]
    close = _SAME_PLACE * (found[-1] - found[0])
    for at in others:
        if min(abs(at - known) for known in found) > close:
            found.append(at)
    return np.sort(found)


def panel_edges(marks: ArrayLike, longest: float) -> Array:
    """Marks, and equally spaced edges between them so that no panel is longer than ``longest``."""
    marks = np.asarray(marks, dtype=float)
    # Rounding in the quotient must not cost a panel.
    counts = np.maximum(1, np.ceil(np.diff(marks) / longest - 1e-9)).astype(int)
    pieces = [np.linspace(a, b, n + 1)[:-1] for (a, b), n in zip(pairwise(marks), counts, strict=True)]
    return np.concatenate([*pieces, marks[-1:]])


@lru_cache(maxsize=32)
def _reference(count: int) -> tuple[Array, Array, Array, Array]:
    """Nodes and weights on (-1, 1), the matrix from values to Legendre coefficients, and that of the integrals from -1.

    The integral of P_k from -1 is (P_(k+1) - P_(k-1)) / (2 k + 1).
    """
    nodes, weights = legendre.leggauss(count)
    series = legendre.legvander(nodes, count)
    to_series = (np.arange(count)[:, None] + 0.5) * (series[:, :count] * weights[:, None]).T
    integrals = np.empty((count, count))
    integrals[:, 0] = nodes + 1.0
    for k in range(1, count):
        integrals[:, k] = (series[:, k + 1] - series[:, k - 1]) / (2 * k + 1)
    return nodes, weights, to_series, integrals @ to_series


class Mesh:
    """Panels of an interval with Gauss-Legendre nodes.

    On each panel a function is the polynomial through its values at the nodes, and integrals are those of the
    polynomial: collocation with the Gauss-Legendre Runge-Kutta method (E. Hairer, S. P. Norsett, G. Wanner, 1993,
    doi:10.1007/978-3-540-78862-1). Its integration matrix S obeys W S + S^T W = w w^T, so that integrating backwards is
    the adjoint of integrating forwards and what is variational stays so.

    Parameters
    ----------
    edges : (P + 1,) array_like
        Ends of the panels, increasing.
    count : int
        Nodes per panel.
    """

    def __init__(self, edges: ArrayLike, count: int) -> None:
        self.edges: Array = np.asarray(edges, dtype=float)
        self.count = count
        self.panels = len(self.edges) - 1
        self.widths: Array = np.diff(self.edges)
        nodes, weights, self._to_series, self._within = _reference(count)
        half = 0.5 * self.widths[:, None]
        self.nodes: Array = (self.edges[:-1, None] + half * (nodes + 1.0)).ravel()
        self.weights: Array = (half * weights).ravel()

    @property
    def size(self) -> int:
        """Number of nodes N."""
        return len(self.nodes)

    @cached_property
    def forward(self) -> Array:
        """Matrix (N, N) of the integrals from the start to each node."""
        matrix = self._whole_panels() * self.weights
        for k, width in enumerate(self.widths):
            block = slice(k * self.count, (k + 1) * self.count)
            matrix[block, block] = 0.5 * width * self._within
        return matrix

    @cached_property
    def backward(self) -> Array:
        """Matrix (N, N) of the integrals from each node to the end."""
        return np.asarray(self.weights[None, :] - self.forward)

    def _whole_panels(self) -> Array:
        """One where the column's panel ends before the row's begins."""
        panel = np.repeat(np.arange(self.panels), self.count)
        return (panel[None, :] < panel[:, None]).astype(float)

    def to_edges(self, values: NDArray[np.inexact]) -> NDArray[np.inexact]:
        """Integrals (..., P + 1) of functions, given at the nodes (..., N), from the start to each edge."""
        whole = (self.weights * values).reshape(*values.shape[:-1], self.panels, self.count).sum(axis=-1)
        return np.concatenate([np.zeros_like(whole[..., :1]), np.cumsum(whole, axis=-1)], axis=-1)

    def series(self, values: NDArray[np.inexact]) -> NDArray[np.inexact]:
        """Legendre coefficients (P, count) on each panel."""
        return np.asarray(values.reshape(self.panels, self.count) @ self._to_series.T)

    def tails(self, values: NDArray[np.inexact]) -> Array:
        """The larger of the last two Legendre coefficients on each panel: how well it is resolved."""
        return np.asarray(np.abs(self.series(values)[:, -2:]).max(axis=1))

    def evaluate(self, values: NDArray[np.inexact], at: Array) -> NDArray[np.inexact]:
        """A function given at the nodes, at other places; at an edge the value of the panel that begins there."""
        panel, local = self._locate(at)
        basis = legendre.legvander(local, self.count - 1)
        return np.asarray(np.sum(basis * self.series(values)[panel], axis=-1))

    def integrate(self, values: NDArray[np.inexact], at: Array) -> NDArray[np.inexact]:
        """Integral from the start of a function given at the nodes."""
        panel, local = self._locate(at)
        basis = legendre.legvander(local, self.count)
        degree = np.arange(1, self.count)
        rising = np.concatenate(
            [(local + 1.0)[..., None], (basis[..., 2:] - basis[..., :-2]) / (2 * degree + 1)], axis=-1
        )
        part = 0.5 * self.widths[panel] * np.sum(rising * self.series(values)[panel], axis=-1)
        return np.asarray(self.to_edges(values)[panel] + part)

    def _locate(self, at: Array) -> tuple[NDArray[np.intp], Array]:
        panel = np.clip(np.searchsorted(self.edges, at, side="right") - 1, 0, self.panels - 1)
        return panel, 2.0 * (at - self.edges[panel]) / self.widths[panel] - 1.0

    def refined(self, marked: NDArray[np.bool_], count: int) -> Mesh:
        """The mesh with the marked panels halved and another number of nodes per panel."""
        middles = 0.5 * (self.edges[:-1] + self.edges[1:])[marked]
        return Mesh(np.sort(np.concatenate([self.edges, middles])), count)
