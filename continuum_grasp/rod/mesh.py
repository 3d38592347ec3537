"""Functions along a rod on panels of Gauss nodes."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property, lru_cache
from itertools import pairwise

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import ArrayLike, NDArray

from continuum_grasp.base import Array
from continuum_grasp.scene import SAME


def with_places(fixed: ArrayLike, others: Iterable[float]) -> Array:
    """Fixed places from start to end, and others that are none of those and not at one another, increasing."""
    places = [float(at) for at in np.asarray(fixed)]
    close = SAME * (places[-1] - places[0])
    for at in others:
        if min(abs(at - known) for known in places) > close:
            places.append(at)
    return np.sort(places)


def panel_edges(marks: ArrayLike, longest: float) -> Array:
    """Marks, and equally spaced edges between them so that no panel is longer than ``longest``."""
    marks = np.asarray(marks, dtype=float)
    # Rounding in the quotient must not cost a panel.
    counts = np.maximum(1, np.ceil(np.diff(marks) / longest - 1e-9)).astype(int)
    pieces = [np.linspace(a, b, n + 1)[:-1] for (a, b), n in zip(pairwise(marks), counts, strict=True)]
    return np.concatenate([*pieces, marks[-1:]])


@lru_cache(maxsize=32)
def _reference(count: int) -> tuple[Array, Array, Array, Array]:
    """Nodes and weights on (-1, 1), matrix from values to Legendre coefficients, matrix of the integrals from -1."""
    nodes, weights = legendre.leggauss(count)
    series = legendre.legvander(nodes, count)
    to_series = (np.arange(count)[:, None] + 0.5) * (series[:, :count] * weights[:, None]).T
    return nodes, weights, to_series, _integrals(nodes, count) @ to_series


def _integrals(local: Array, count: int) -> Array:
    """Integrals (..., count) of the Legendre polynomials from -1: (P_(k+1) - P_(k-1)) / (2 k + 1), and u + 1 of P_0."""
    basis = legendre.legvander(local, count)
    degree = np.arange(1, count)
    higher = (basis[..., 2:] - basis[..., :-2]) / (2 * degree + 1)
    return np.concatenate([(local + 1.0)[..., None], higher], axis=-1)


class PanelMesh:
    """Panels of an interval with Gauss-Legendre nodes.

    On each panel a function is the polynomial through its values at the nodes, and integrals are exact for this
    polynomial: collocation with the Gauss-Legendre Runge-Kutta method (E. Hairer, S. P. Norsett, G. Wanner, 1993,
    doi:10.1007/978-3-540-78862-1). Its integration matrix S obeys W S + S^T W = w w^T, so that integrating backwards is
    the adjoint of integrating forwards and variational equations stay so. There are P panels between P + 1 increasing
    edges, with ``count`` nodes each.
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
        # Whole panels before the node's by their weights, its own up to the node by the integrated polynomial.
        panel = np.repeat(np.arange(self.panels), self.count)
        matrix = (panel[None, :] < panel[:, None]) * self.weights
        for k, width in enumerate(self.widths):
            block = slice(k * self.count, (k + 1) * self.count)
            matrix[block, block] = 0.5 * width * self._within
        return matrix

    @cached_property
    def backward(self) -> Array:
        """Matrix (N, N) of the integrals from each node to the end."""
        return np.asarray(self.weights[None, :] - self.forward)

    def to_edges(self, values: NDArray[np.inexact]) -> NDArray[np.inexact]:
        """Integrals (..., P + 1) of functions, given at the nodes (..., N), from the start to each edge."""
        whole = (self.weights * values).reshape(*values.shape[:-1], self.panels, self.count).sum(axis=-1)
        return np.concatenate([np.zeros_like(whole[..., :1]), np.cumsum(whole, axis=-1)], axis=-1)

    def to_nodes(self, values: NDArray[np.inexact]) -> NDArray[np.inexact]:
        """Integrals (..., N) of functions, given at the nodes (..., N), from the start to each node."""
        blocks = values.reshape(*values.shape[:-1], self.panels, self.count)
        within = 0.5 * self.widths[:, None] * (blocks @ self._within.T)
        return np.asarray((self.to_edges(values)[..., :-1, None] + within).reshape(values.shape))

    def series(self, values: NDArray[np.inexact]) -> NDArray[np.inexact]:
        """Legendre coefficients (P, count) on each panel."""
        return np.asarray(values.reshape(self.panels, self.count) @ self._to_series.T)

    def evaluate(self, values: NDArray[np.inexact], at: Array) -> NDArray[np.inexact]:
        """A function given at the nodes, at other places; at an edge the value of the panel that begins there."""
        panel, local = self._locate(at)
        basis = legendre.legvander(local, self.count - 1)
        return np.asarray(np.sum(basis * self.series(values)[panel], axis=-1))

    def integrate(self, values: NDArray[np.inexact], at: Array) -> NDArray[np.inexact]:
        """Integral from the start of a function given at the nodes."""
        panel, local = self._locate(at)
        part = 0.5 * self.widths[panel] * np.sum(_integrals(local, self.count) * self.series(values)[panel], axis=-1)
        return np.asarray(self.to_edges(values)[panel] + part)

    def _locate(self, at: Array) -> tuple[NDArray[np.intp], Array]:
        panel = np.clip(np.searchsorted(self.edges, at, side="right") - 1, 0, self.panels - 1)
        return panel, 2.0 * (at - self.edges[panel]) / self.widths[panel] - 1.0

    def refined(self, marked: NDArray[np.bool_], count: int) -> PanelMesh:
        """The mesh with the marked panels halved and another number of nodes per panel."""
        middles = 0.5 * (self.edges[:-1] + self.edges[1:])[marked]
        return PanelMesh(np.sort(np.concatenate([self.edges, middles])), count)
