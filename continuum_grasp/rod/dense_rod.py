"""The bent rod integrated densely from its curvature profile."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.rod.mesh import Mesh, panel_edges, with_places
from continuum_grasp.scene.finger import Finger

__all__ = ["DenseRod", "curvature_ends"]

Array = NDArray[Any]


def curvature_ends(family: str, q: Array, lengths: Array, tip_curvature: float) -> Array:
    """Curvature at start and end of each element (..., N, 2) [1/m] from coordinates (..., n).

    A matched clothoid's curvature at the tip is no coordinate; it is given.
    """
    if family == "arc":
        return np.repeat((q / lengths)[..., None], 2, axis=-1)
    nodes = q
    if family == "matched_clothoid":
        tip = np.full((*q.shape[:-1], 1), tip_curvature, dtype=q.dtype)
        nodes = np.concatenate([q, tip], axis=-1)
    return np.stack([nodes[..., :-1], nodes[..., 1:]], axis=-1)


class DenseRod:
    """Position and angle of a planar rod whose curvature is linear in each element.

    The elements are cut into short panels; joints and marks are panel edges. All shapes may have leading axes, one for
    each of several rods, and may be complex, for derivatives by complex steps.

    Parameters
    ----------
    finger : Finger
        Rod, masses, rest curvature.
    lengths : array_like, shape (N,)
        Element lengths [m].
    panel : float, optional
        Greatest panel length as a part of the finger's length.
    base : sequence of float, optional
        World x, y [m] and angle [rad] of the base; that of the finger where not given.
    marks : sequence of float, optional
        Further panel edges [m]; point masses and steps of the rest curvature where not given.
    nodes : int, optional
        Gauss points per panel.
    """

    def __init__(
        self,
        finger: Finger,
        lengths: Array,
        panel: float = 1 / 400,
        base: Sequence[float] | Array | None = None,
        *,
        marks: Sequence[float] | None = None,
        nodes: int = 5,
    ) -> None:
        pose = (*finger.base.position, finger.base.angle) if base is None else base
        self.start, self.start_angle = np.asarray(pose[:2], dtype=float), float(pose[2])
        self.lengths = np.asarray(lengths, dtype=float)
        self.joints = np.concatenate([[0.0], np.cumsum(self.lengths)])
        pieces = finger.curvature_pieces
        if marks is None:
            marks = [*(mass.at for mass in finger.masses), *(end for _, end, _ in pieces)]
        self.mesh = Mesh(panel_edges(with_places(self.joints, marks), panel * self.joints[-1]), nodes)
        self.edges, self.weights = self.mesh.edges, self.mesh.weights
        self._inside = self._place(self.mesh.nodes)
        self._at_edges = self._place(self.edges)
        steps = np.array([end for _, end, _ in pieces[:-1]])
        self.rest = np.array([value for *_, value in pieces])[np.searchsorted(steps, self.mesh.nodes)]

    def curvature(self, ends: Array, s: Array | None = None) -> Array:
        """Curvature (..., G) [1/m] at the Gauss points, or at places (G,) [m].

        ``ends`` (..., N, 2) is the curvature at both ends of each element.
        """
        element, share = self._inside if s is None else self._place(s)
        a, b = ends[..., element, 0], ends[..., element, 1]
        return np.asarray(a + (b - a) * share)

    def angle(self, ends: Array) -> Array:
        """World angle of the section's X axis at the Gauss points (..., G) [rad]."""
        return self._angle(ends, *self._inside)

    def edge_angle(self, ends: Array) -> Array:
        """World angle of the section's X axis at the panel edges (..., P + 1) [rad]."""
        return self._angle(ends, *self._at_edges)

    def edge_points(self, ends: Array, angle: Array | None = None) -> Array:
        """World positions of the panel edges (..., P + 1, 2) [m]; ``angle`` as `angle` gives, where it is known."""
        angle = self.angle(ends) if angle is None else angle
        walked = [self.mesh.to_edges(-np.sin(angle)), self.mesh.to_edges(np.cos(angle))]
        return np.asarray(self.start + np.stack(walked, axis=-1))

    def edge_index(self, s: float) -> int:
        """Index of the panel edge at a position, for joints, ends and marks."""
        return int(np.argmin(np.abs(self.edges - s)))

    def mean_point(self, ends: Array, angle: Array | None = None) -> Array:
        """Integral of the position over the length (..., 2) [m2]."""
        angle = self.angle(ends) if angle is None else angle
        lever = self.weights * (self.joints[-1] - self.mesh.nodes)
        walked = np.stack([-np.sin(angle) @ lever, np.cos(angle) @ lever], axis=-1)
        return np.asarray(self.start * self.joints[-1] + walked)

    def at(self, ends: Array, s: Array) -> tuple[Array, Array]:
        """World positions (K, 2) [m] and angles (K,) [rad] of one rod at any places (K,) [m] along it."""
        s = np.asarray(s, dtype=float)
        walked = self.mesh.integrate(1j * np.exp(1j * self.angle(ends)), s)
        return self.start + np.stack([walked.real, walked.imag], axis=-1), self._angle(ends, *self._place(s))

    def _place(self, s: Array) -> tuple[Array, Array]:
        """Elements in which positions lie, and how far along them [1]."""
        element = np.clip(np.searchsorted(self.joints, s) - 1, 0, self.lengths.size - 1)
        return element, (s - self.joints[element]) / self.lengths[element]

    def _angle(self, ends: Array, element: Array, share: Array) -> Array:
        a, b = ends[..., 0], ends[..., 1]
        bends = 0.5 * self.lengths * (a + b)
        before = np.cumsum(bends, axis=-1) - bends
        first, second = self.lengths * a, 0.5 * self.lengths * (b - a)
        return np.asarray(
            self.start_angle + before[..., element] + share * (first[..., element] + share * second[..., element])
        )
