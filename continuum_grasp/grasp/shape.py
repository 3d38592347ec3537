"""The curvature of a finger from a grasp's stored numbers, and its skin, by numpy alone, from the scene's profile."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.polynomial import Polynomial

from continuum_grasp.base import Array
from continuum_grasp.scene import FAMILIES, Curve, FingerSetup

ROUNDED = 0.01
"""Part of the length, to either side of a corner, over which it is rounded [1], so that the skin turns steadily where
contacts pass it. A kink of slope d is off by d * ROUNDED / 4 of the length at most: 0.1 mm of 0.2 m for d = 0.2."""
ROUNDING = 1e-9
"""Relative difference of lengths, slopes and numbers that is rounding."""


class FingerShape:
    """The curvature along a finger of a grasp, linear in its coordinates.

    The bending moment is m(s) = p(s) + K(s) - k(s), with p a polynomial on each element. Of families whose tip is
    matched, K is the moment of the tendons, and k is linear on each element and equal to K at its ends: what inputs do
    is then known, wherever tendons end. Of others both are zero. The curvature is k*(s) + m(s) / EI(s).

    ``lengths`` (N,) belong to the elements [m]; ``q`` (n,) the coordinates: elastic curvatures, above the rest
    curvature, at nodes (of arcs: bends); ``shapes`` (N, D, M) the elastic curvature at D places spread evenly along
    each element per coordinate, the first on the tip side of its node. Where M = n + 1, the last coordinate is
    ``tip``, the elastic curvature at the tip [1/m]. ``tensions`` (T,) belong to the tendons [N].
    """

    def __init__(self, setup: FingerSetup, arrays: Mapping[str, Any]) -> None:
        def stored(key: str) -> Array:
            return np.asarray(arrays[f"{setup.name}.{key}"], dtype=float)

        self.profile = setup.finger.profile
        self.channels = setup.finger.channels
        self.lengths, self.q, self.tip, self._shapes = (
            stored(key) for key in ("lengths", "q", "tip_curvature", "curvature_shapes")
        )
        self.joints = np.concatenate([[0.0], np.cumsum(self.lengths)])
        self._family = FAMILIES[setup.family]
        self.matches_tip = self._family.matches_tip
        # Of the channels at the stored tensions [N m].
        self.amplitudes = [np.dot(channel.arms, stored("tensions")) for channel in self.channels]
        # Only the part that is not linear on an element matters: none for tendons of constant offset to the tip.
        self._inside = [
            (channel.shape, amplitude)
            for channel, amplitude in zip(self.channels, self.amplitudes, strict=True)
            if self.matches_tip and channel.shape.constant is None
        ]
        self._stiffness = self._at_places(self.profile.bending_stiffness)

    @property
    def complete(self) -> bool:
        """Whether the coordinates span all moments that are polynomials of their degree on each element, or all of
        these that are continuous from element to element. Balanced along fewer coordinates, a finger is not in balance.
        """
        elements, places, size = self._shapes.shape
        moments = self._stiffness[..., None] * self._shapes
        jumps = np.abs(moments[1:, 0] - moments[:-1, -1]).max(initial=0.0)
        continuous = places > 1 and jumps < 1e-6 * np.abs(moments).max()  # rounding: otherwise one is as large as all
        needed = elements * (places - 1) + 1 if continuous else elements * places
        spanned = np.linalg.matrix_rank(self._shapes.reshape(-1, size))
        return bool(size == spanned == needed and (places == 1) is self._family.even)

    @property
    def spread(self) -> Array:
        """Fractions (D,) of an element's length of the places; the middle where there is one."""
        count = self._shapes.shape[1]
        return np.linspace(0.0, 1.0, count) if count > 1 else np.array([0.5])

    def _at_places(self, curve: Curve) -> Array:
        """A curve (N, D) at the places of the elements, at their ends from inside."""
        places = self.joints[:-1, None] + self.lengths[:, None] * self.spread
        first = (np.arange(self.spread.size) == 0) & (self.spread.size > 1)
        return np.where(first, curve(places, tip_side=True), curve(places))

    @property
    def curvatures(self) -> Array:
        """Curvature (N, D) [1/m] at the places of the elements, at their ends from inside."""
        places = self.joints[:-1, None] + self.lengths[:, None] * self.spread
        elastic = self.moment(places.ravel()).reshape(places.shape) / self._stiffness
        return np.asarray(elastic + self._at_places(self.profile.rest_curvature))

    def actuation(self, s: Array) -> Array:
        """Bending moment [N m] of the tendons at positions [m]; at the end of a tendon, the moment inside."""
        moments = [a * channel.shape(s) for a, channel in zip(self.amplitudes, self.channels, strict=True)]
        return np.asarray(np.sum(moments, axis=0)) if moments else np.zeros(np.shape(s))

    def moment(self, s: Array, q: Array | None = None) -> Array:
        """Bending moment (..., G) [N m] at positions (G,) [m], of coordinates (..., n); the stored ones by default."""
        full = self.q if q is None else q
        if full.shape[-1] < self._shapes.shape[-1]:
            full = np.concatenate([full, np.full((*full.shape[:-1], 1), self.tip, dtype=full.dtype)], axis=-1)
        count = self.spread.size
        # On each element the polynomial through the moments at its places; degrees are 0 to 2, so powers do.
        powers = np.linalg.inv(np.vander(self.spread, increasing=True)) if count > 1 else np.eye(1)
        values = self._stiffness * np.einsum("kda,...a->...kd", self._shapes, full)
        coefficients = values @ powers.T
        element = np.clip(np.searchsorted(self.joints, s) - 1, 0, self.lengths.size - 1)
        share = (s - self.joints[element]) / self.lengths[element]
        total = coefficients[..., element, -1]
        for k in range(count - 2, -1, -1):
            total = coefficients[..., element, k] + total * share
        for shape, amplitude in self._inside:
            total = total + amplitude * (shape(s) - np.interp(s, self.joints, shape(self.joints)))
        return np.asarray(total)

    def elastic(self, s: Array, q: Array | None = None, *, tip_side: bool = False) -> Array:
        """Curvature above the rest curvature (..., G) [1/m] at positions (G,) [m]."""
        return np.asarray(self.moment(s, q) / self.profile.bending_stiffness(s, tip_side=tip_side))

    def curvature(self, s: Array, q: Array | None = None, *, tip_side: bool = False) -> Array:
        """Curvature (..., G) [1/m] at positions (G,) [m]."""
        return np.asarray(self.profile.rest_curvature(s, tip_side=tip_side) + self.elastic(s, q, tip_side=tip_side))


@lru_cache(maxsize=64)
def skin(thickness: Curve) -> Curve:
    """Half thickness [m] whose kinks and jumps are rounded by cubics, with a continuous slope."""
    length = thickness.edges[-1]
    corners = []
    for k, at in enumerate(thickness.edges[1:-1], 1):
        before = thickness.local(k - 1, at)
        after = thickness.local(k, at)
        jump = after(0.0) - before(0.0)
        bend = after.deriv()(0.0) - before.deriv()(0.0)
        if abs(jump) > ROUNDING * length or abs(bend) > ROUNDING:
            # Not beyond half-way to the next edge.
            half_width = 0.5 * min(at - thickness.edges[k - 1], thickness.edges[k + 1] - at)
            corners.append((k, at, min(ROUNDED * length, half_width)))
    if not corners:
        return thickness
    widths = {k: width for k, _, width in corners}
    edges = [0.0]
    pieces = []
    for k, (a, b) in enumerate(zip(thickness.edges[:-1], thickness.edges[1:], strict=True)):
        start = a + widths.get(k, 0.0)
        end = b - widths.get(k + 1, 0.0)
        edges.append(end)
        pieces.append(tuple(thickness.local(k, start).coef.tolist()))
        if k + 1 in widths:
            edges.append(b + widths[k + 1])
            pieces.append(_cubic(thickness.local(k, end), thickness.local(k + 1, edges[-1]), edges[-1] - end))
    return Curve(tuple(edges), tuple(pieces))


def _cubic(start: Polynomial, end: Polynomial, width: float) -> tuple[float, ...]:
    """The cubic with values and slopes of two polynomials at zero, at both ends of an interval."""
    (a, s), (b, t) = ((float(p(0.0)), float(p.deriv()(0.0))) for p in (start, end))
    rise = (b - a) / width
    return a, s, (3.0 * rise - 2.0 * s - t) / width, (s + t - 2.0 * rise) / width**2


@lru_cache(maxsize=64)
def steepest(curve: Curve) -> float:
    """Greatest slope of a skin without sign [1]."""
    at = np.concatenate([np.linspace(a, b, 33) for a, b in zip(curve.edges[:-1], curve.edges[1:], strict=True)])
    return float(np.abs(np.diff(curve(at)) / np.maximum(np.diff(at), 1e-12 * curve.edges[-1]))[np.diff(at) > 0.0].max())
