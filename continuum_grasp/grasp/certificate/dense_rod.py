"""The bent rod integrated densely from its curvature profile, apart from the optimizer and its model."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.scene.finger import Finger

__all__ = ["DenseRod"]

Array = NDArray[Any]

_X, _W = np.polynomial.legendre.leggauss(5)


class DenseRod:
    """Position and angle of a planar rod whose curvature is linear in each element.

    The elements are cut into short panels with five Gauss points each; joints, ends, point masses and steps
    of the rest curvature are panel edges. All shapes may have leading axes, one for each of several rods.

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
    """

    def __init__(
        self, finger: Finger, lengths: Array, panel: float = 1 / 400, base: Sequence[float] | Array | None = None
    ) -> None:
        lengths = np.asarray(lengths, dtype=float)
        pose = (*finger.base.position, finger.base.angle) if base is None else base
        self.start, self.start_angle = np.asarray(pose[:2], dtype=float), float(pose[2])
        self.lengths = lengths
        self.joints = np.concatenate([[0.0], np.cumsum(lengths)])
        total = self.joints[-1]
        pieces = finger.curvature_pieces
        marks = [m.at for m in finger.masses] + [b for _, b, _ in pieces]
        inside = [s for s in marks if np.abs(self.joints - s).min() > 1e-9 * total]
        knots = np.unique(np.concatenate([self.joints, inside]))
        cuts = [np.linspace(a, b, max(1, int(np.ceil((b - a) / (panel * total)))) + 1)[:-1] for a, b in pairwise(knots)]
        self.edges = np.concatenate([*cuts, [total]])
        half = 0.5 * np.diff(self.edges)
        middle = 0.5 * (self.edges[1:] + self.edges[:-1])
        self.s = (middle[:, None] + half[:, None] * _X).ravel()
        self.weights = (half[:, None] * _W).ravel()
        self._inside = self._place(self.s)
        self._at_edges = self._place(self.edges)
        steps = np.array([end for _, end, _ in pieces[:-1]])
        self.rest = np.array([value for *_, value in pieces])[np.searchsorted(steps, self.s)]

    def curvature(self, ends: Array) -> Array:
        """Curvature at the Gauss points (..., G) [1/m]; ``ends`` (..., N, 2): that at both ends of each element."""
        element, share = self._inside
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
        steps = np.stack([-np.sin(angle), np.cos(angle)], axis=-1) * self.weights[:, None]
        steps = steps.reshape(*angle.shape[:-1], -1, _X.size, 2).sum(axis=-2)
        points = np.zeros((*steps.shape[:-2], steps.shape[-2] + 1, 2), dtype=steps.dtype)
        np.cumsum(steps, axis=-2, out=points[..., 1:, :])
        return np.asarray(points + self.start)

    def edge_index(self, s: float) -> int:
        """Index of the panel edge at a position, for joints, ends and masses."""
        return int(np.argmin(np.abs(self.edges - s)))

    def mean_point(self, ends: Array, angle: Array | None = None) -> Array:
        """Integral of the position over the length (..., 2) [m2]."""
        angle = self.angle(ends) if angle is None else angle
        lever = self.weights * (self.joints[-1] - self.s)
        walked = np.stack([-np.sin(angle) @ lever, np.cos(angle) @ lever], axis=-1)
        return np.asarray(self.start * self.joints[-1] + walked)

    def at(self, ends: Array, s: Array) -> tuple[Array, Array]:
        """World positions (K, 2) [m] and angles (K,) [rad] of one rod at any places (K,) [m] along it."""
        s = np.asarray(s, dtype=float)
        before = np.clip(np.searchsorted(self.edges, s, side="right") - 1, 0, self.edges.size - 2)
        half = 0.5 * (s - self.edges[before])
        within = self.edges[before][:, None] + half[:, None] * (1.0 + _X)
        angle = self._angle(ends, *self._place(within.ravel())).reshape(within.shape)
        walked = half[:, None] * np.stack([-np.sin(angle) @ _W, np.cos(angle) @ _W], axis=-1)
        return self.edge_points(ends)[before] + walked, self._angle(ends, *self._place(s))

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
