"""The bent rod integrated densely from its curvature profile."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.rod.mesh import Mesh, panel_edges, with_places
from continuum_grasp.scene.finger import Finger

__all__ = ["DenseRod", "curvature_profile"]

Array = NDArray[Any]


def curvature_profile(shapes: Array, q: Array, tip_curvature: float) -> Array:
    """Compute the curvature (..., N, D) [1/m] at D places spread evenly along each element.

    Between them it is the polynomial through these values; a single value holds for the whole element.

    Parameters
    ----------
    shapes : ndarray, shape (N, D, M)
        Curvature there per coordinate.
    q : ndarray, shape (..., n)
        Coordinates; all M, or all but the last, which is then the curvature at the tip.
    tip_curvature : float
        [1/m]
    """
    if q.shape[-1] < shapes.shape[-1]:
        q = np.concatenate([q, np.full((*q.shape[:-1], 1), tip_curvature, dtype=q.dtype)], axis=-1)
    return np.asarray(np.einsum("kda,...a->...kd", shapes, q))


class DenseRod:
    """Position and angle of a planar rod whose curvature is a polynomial in each element.

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

    def curvature(self, profile: Array, s: Array | None = None) -> Array:
        """Curvature (..., G) [1/m] at the Gauss points, or at places (G,) [m].

        ``profile`` (..., N, D) is the curvature at places along each element, as `curvature_profile` gives.
        """
        element, share = self._inside if s is None else self._place(s)
        return _horner(_coefficients(profile)[..., element, :], share)

    def bends(self, profile: Array) -> Array:
        """Bending angle of each element (..., N) [rad]."""
        degrees = np.arange(profile.shape[-1])
        weights = (1.0 / (degrees + 1.0)) @ _polynomials(profile.shape[-1])
        return np.asarray(self.lengths * (profile @ weights))

    def angle(self, profile: Array) -> Array:
        """World angle of the section's X axis at the Gauss points (..., G) [rad]."""
        return self._angle(profile, *self._inside)

    def edge_angle(self, profile: Array) -> Array:
        """World angle of the section's X axis at the panel edges (..., P + 1) [rad]."""
        return self._angle(profile, *self._at_edges)

    def edge_points(self, profile: Array, angle: Array | None = None) -> Array:
        """World positions of the panel edges (..., P + 1, 2) [m]; ``angle`` as `angle` gives, where it is known."""
        angle = self.angle(profile) if angle is None else angle
        walked = [self.mesh.to_edges(-np.sin(angle)), self.mesh.to_edges(np.cos(angle))]
        return np.asarray(self.start + np.stack(walked, axis=-1))

    def edge_index(self, s: float) -> int:
        """Index of the panel edge at a position, for joints, ends and marks."""
        return int(np.argmin(np.abs(self.edges - s)))

    def mean_point(self, profile: Array, angle: Array | None = None) -> Array:
        """Integral of the position over the length (..., 2) [m2]."""
        angle = self.angle(profile) if angle is None else angle
        lever = self.weights * (self.joints[-1] - self.mesh.nodes)
        walked = np.stack([-np.sin(angle) @ lever, np.cos(angle) @ lever], axis=-1)
        return np.asarray(self.start * self.joints[-1] + walked)

    def at(self, profile: Array, s: Array) -> tuple[Array, Array]:
        """World positions (K, 2) [m] and angles (K,) [rad] of one rod at any places (K,) [m] along it."""
        s = np.asarray(s, dtype=float)
        walked = self.mesh.integrate(1j * np.exp(1j * self.angle(profile)), s)
        return self.start + np.stack([walked.real, walked.imag], axis=-1), self._angle(profile, *self._place(s))

    def _place(self, s: Array) -> tuple[Array, Array]:
        """Elements in which positions lie, and how far along them [1]."""
        element = np.clip(np.searchsorted(self.joints, s) - 1, 0, self.lengths.size - 1)
        return element, (s - self.joints[element]) / self.lengths[element]

    def _angle(self, profile: Array, element: Array, share: Array) -> Array:
        coefficients = _coefficients(profile)
        integrals = self.lengths[:, None] * (coefficients / np.arange(1.0, coefficients.shape[-1] + 1.0))
        bends = self.bends(profile)
        before = np.cumsum(bends, axis=-1) - bends
        return np.asarray(self.start_angle + before[..., element] + share * _horner(integrals[..., element, :], share))


def _coefficients(profile: Array) -> Array:
    """Coefficients (..., D) of 1, u, u^2 ... of the polynomials of each element."""
    return np.asarray(profile @ _polynomials(profile.shape[-1]).T)


def _polynomials(count: int) -> Array:
    """Coefficients (D, D) of 1, u, u^2 ... on [0, 1], by value at the places spread evenly."""
    return np.asarray(np.linalg.inv(np.vander(np.linspace(0.0, 1.0, count), increasing=True)))


def _horner(coefficients: Array, u: Array) -> Array:
    total = coefficients[..., -1]
    for k in range(coefficients.shape[-1] - 2, -1, -1):
        total = coefficients[..., k] + total * u
    return np.asarray(total)
