"""Functions along a rod on panels of Gauss nodes, and the bent rod integrated densely from its curvature profile."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cached_property, lru_cache
from itertools import pairwise

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import ArrayLike, NDArray

from continuum_grasp.base import Array
from continuum_grasp.scene import Finger


def with_places(fixed: ArrayLike, others: Iterable[float]) -> Array:
    """Fixed places from start to end, and others that are none of those and not at one another, increasing."""
    places = [float(at) for at in np.asarray(fixed)]
    # 1e-9: distance per length below which two places are one: far above rounding, far below any distance that matters
    close = 1e-9 * (places[-1] - places[0])
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
    basis, degree = legendre.legvander(local, count), np.arange(1, count)
    higher = (basis[..., 2:] - basis[..., :-2]) / (2 * degree + 1)
    return np.concatenate([(local + 1.0)[..., None], higher], axis=-1)


class PanelMesh:
    """Panels of an interval with Gauss-Legendre nodes.

    On each panel a function is the polynomial through its values at the nodes, and integrals are those of the
    polynomial: collocation with the Gauss-Legendre Runge-Kutta method (E. Hairer, S. P. Norsett, G. Wanner, 1993,
    doi:10.1007/978-3-540-78862-1). Its integration matrix S obeys W S + S^T W = w w^T, so that integrating backwards is
    the adjoint of integrating forwards and what is variational stays so. There are P panels between P + 1 increasing
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


class DenseRod:
    """Position and angle of a planar rod whose curvature is given at the Gauss nodes of panels along it.

    Joints of elements, places where something of the finger jumps, and marks are panel edges. Curvatures may have
    leading axes, one for each of several rods, and may be complex, for derivatives by complex steps.

    ``joints`` are the ends of the elements from base to tip [m], ``panel`` the greatest length of a panel as a part of
    the finger's. ``base`` is world x, y [m] and angle [rad], the finger's where not given;
    ``marks`` are further panel edges [m], point masses where not given.
    """

    def __init__(
        self,
        finger: Finger,
        joints: Array,
        panel: float = 1 / 400,
        base: Sequence[float] | Array | None = None,
        *,
        marks: Sequence[float] | None = None,
    ) -> None:
        pose = (*finger.base.position, finger.base.angle) if base is None else base
        self.start, self.start_angle = np.asarray(pose[:2], dtype=float), float(pose[2])
        self.joints = np.asarray(joints, dtype=float)
        marks = [mass.at for mass in finger.masses] if marks is None else marks
        inner = [at for at in (*marks, *finger_breaks(finger)) if at < self.joints[-1]]
        # 5: Gauss points per panel
        self.mesh = PanelMesh(panel_edges(with_places(self.joints, inner), panel * self.joints[-1]), 5)
        self.nodes, self.edges, self.weights = self.mesh.nodes, self.mesh.edges, self.mesh.weights

    def angle(self, curvature: Array) -> Array:
        """World angle of the section's X axis at the Gauss points (..., G) [rad]."""
        return np.asarray(self.start_angle + self.mesh.to_nodes(curvature))

    def edge_angle(self, curvature: Array) -> Array:
        """World angle of the section's X axis at the panel edges (..., P + 1) [rad]."""
        return np.asarray(self.start_angle + self.mesh.to_edges(curvature))

    def edge_points(self, curvature: Array, angle: Array | None = None) -> Array:
        """World positions of the panel edges (..., P + 1, 2) [m]; ``angle`` as `angle` gives, where it is known."""
        angle = self.angle(curvature) if angle is None else angle
        walked = [self.mesh.to_edges(-np.sin(angle)), self.mesh.to_edges(np.cos(angle))]
        return np.asarray(self.start + np.stack(walked, axis=-1))

    def edge_index(self, s: float) -> int:
        """Index of the panel edge at a position, for joints, ends and marks."""
        return int(np.argmin(np.abs(self.edges - s)))

    def bends(self, curvature: Array) -> Array:
        """Bending angle of each element (..., N) [rad]."""
        return np.diff(self.mesh.to_edges(curvature)[..., [self.edge_index(s) for s in self.joints]], axis=-1)

    def first_moment(self, density: Array, angle: Array) -> Array:
        """Integral of a density, given at the Gauss points (G,), times the position (..., 2); angles as `angle`."""
        # The mass beyond a section moves with its tangent.
        lever = self.weights * (self.mesh.to_edges(density)[-1] - self.mesh.to_nodes(density))
        walked = np.stack([-np.sin(angle) @ lever, np.cos(angle) @ lever], axis=-1)
        return np.asarray(self.start * float(self.weights @ density) + walked)

    def at(self, curvature: Array, s: Array) -> tuple[Array, Array]:
        """World positions (K, 2) [m] and angles (K,) [rad] of one rod at any places (K,) [m] along it."""
        s = np.asarray(s, dtype=float)
        walked = self.mesh.integrate(1j * np.exp(1j * self.angle(curvature)), s)
        turned = np.real(self.mesh.integrate(curvature, s))
        return self.start + np.stack([walked.real, walked.imag], axis=-1), self.start_angle + turned


def finger_breaks(finger: Finger) -> list[float]:
    """Places along a finger [m] where its rod, its thickness or the moments of its tendons may jump or have kinks."""
    profile = finger.profile
    depths = () if profile.half_depth is None else profile.half_depth.breaks
    shapes = (at for channel in finger.channels for at in channel.shape.breaks)
    return sorted({*profile.breaks, *profile.half_thickness.breaks, *depths, *shapes})
