"""The bent rod integrated densely from its curvature profile, apart from the optimiser and its model."""

from __future__ import annotations

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
    of the rest curvature are panel edges.

    Parameters
    ----------
    finger : Finger
        Rod, masses, base pose, rest curvature.
    lengths : array_like, shape (N,)
        Element lengths [m].
    panel : float, optional
        Greatest panel length as a part of the finger's length.
    """

    def __init__(self, finger: Finger, lengths: Array, panel: float = 1 / 400) -> None:
        lengths = np.asarray(lengths, dtype=float)
        self.finger = finger
        self.lengths = lengths
        self.joints = np.concatenate([[0.0], np.cumsum(lengths)])
        total = self.joints[-1]
        marks = [m.at for m in finger.masses] + [b for _, b, _ in finger.curvature_pieces]
        inside = [s for s in marks if np.abs(self.joints - s).min() > 1e-9 * total]
        knots = np.unique(np.concatenate([self.joints, inside]))
        pieces = [
            np.linspace(a, b, max(1, int(np.ceil((b - a) / (panel * total)))) + 1)[:-1] for a, b in pairwise(knots)
        ]
        self.edges = np.concatenate([*pieces, [total]])
        half = 0.5 * np.diff(self.edges)
        middle = 0.5 * (self.edges[1:] + self.edges[:-1])
        self.s = (middle[:, None] + half[:, None] * _X).ravel()
        self.weights = (half[:, None] * _W).ravel()
        self._element = np.clip(np.searchsorted(self.joints, self.s) - 1, 0, lengths.size - 1)
        self.rest = np.array([_rest(finger, s) for s in self.s])

    def curvature(self, ends: Array) -> Array:
        """Curvature at the Gauss points [1/m]; ``ends`` (N, 2): that at both ends of each element."""
        fraction = self._fraction(self.s, self._element)
        a, b = ends[self._element, 0], ends[self._element, 1]
        kappa: Array = a + (b - a) * fraction
        return kappa

    def angle(self, ends: Array) -> Array:
        """World angle of the section's X axis at the Gauss points [rad]."""
        return self._angle(ends, self.s, self._element)

    def edge_angle(self, ends: Array) -> Array:
        """World angle of the section's X axis at the panel edges [rad]."""
        element = np.clip(np.searchsorted(self.joints, self.edges) - 1, 0, self.lengths.size - 1)
        return self._angle(ends, self.edges, element)

    def edge_points(self, ends: Array) -> Array:
        """World positions of the panel edges (P + 1, 2) [m]."""
        angle = self.angle(ends)
        tangent = np.stack([-np.sin(angle), np.cos(angle)], axis=-1)
        steps = (self.weights[:, None] * tangent).reshape(-1, _X.size, 2).sum(axis=1)
        start = np.asarray(self.finger.base.position, dtype=steps.dtype)
        walked: Array = np.concatenate([np.zeros((1, 2), dtype=steps.dtype), np.cumsum(steps, axis=0)])
        return np.asarray(start + walked)

    def edge_index(self, s: float) -> int:
        """Index of the panel edge at a position, for joints, ends and masses."""
        return int(np.argmin(np.abs(self.edges - s)))

    def mean_point(self, ends: Array) -> Array:
        """Integral of the position over the length [m2]."""
        angle = self.angle(ends)
        lever = self.weights * (self.joints[-1] - self.s)
        base = np.asarray(self.finger.base.position)
        across, along = -(lever * np.sin(angle)).sum(), (lever * np.cos(angle)).sum()
        return np.asarray(base * self.joints[-1] + np.array([across, along]))

    def _angle(self, ends: Array, s: Array, element: Array) -> Array:
        bends = 0.5 * self.lengths * (ends[:, 0] + ends[:, 1])
        before = np.concatenate([np.zeros(1, dtype=bends.dtype), np.cumsum(bends)[:-1]])
        fraction = self._fraction(s, element)
        a, b = ends[element, 0], ends[element, 1]
        local = self.lengths[element] * (a * fraction + 0.5 * (b - a) * fraction**2)
        return np.asarray(self.finger.base.angle + before[element] + local)

    def _fraction(self, s: Array, element: Array) -> Array:
        return np.asarray((s - self.joints[element]) / self.lengths[element])


def _rest(finger: Finger, s: float) -> float:
    for start, end, value in finger.curvature_pieces:
        if start <= s <= end:
            return value
    return finger.curvature_pieces[-1][2]
