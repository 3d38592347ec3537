"""From points that were measured to the curve that they stand for."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.scene.objects.measured.chain import chain_through
from continuum_grasp.scene.objects.measured.noise import Noise, noise_of
from continuum_grasp.scene.objects.measured.pieces import pieces_of
from continuum_grasp.scene.objects.simplify import simplified
from continuum_grasp.scene.polygons import PlanePoint

_MOST_NODES = 400
"""Places at which pieces may end: the search for them takes a time that grows with the square, 0.1 s for so many."""
_GREATEST = 0.01
"""Noise, per longer side of a curve, beyond which points are corners that someone meant [1]: who measures is better."""
_CHORD = 0.02
"""Turn along the chords of an arc [rad]: they are within 5e-5 of its radius."""
_SURE = 3.0
"""Standard deviations by which an error is stated: 99.7 % of normal noise are within."""


class FittedCurve(NamedTuple):
    """Lines and arcs through measured points.

    Attributes
    ----------
    points : tuple of (float, float)
        Ends of the lines, and points of the arcs as close as those of a drawing.
    error : float
        Distance from the true curve, in the unit of the points, that three standard deviations of the fit explain.
    """

    points: tuple[PlanePoint, ...]
    error: float


def fitted(ring: Sequence[PlanePoint], quantum: float = 0.0) -> FittedCurve | None:
    """Fit lines and arcs to the points of a closed curve; None where these show no noise: they are exact.

    Parameters
    ----------
    ring : sequence of (float, float)
        Points, each once.
    quantum : float, optional
        Distance within which each point is uniformly uncertain: the pixel of a picture that is black and white.
    """
    points = np.asarray(ring, dtype=float)
    size = float(np.ptp(points, axis=0).max())
    noise = noise_of(points)
    spare = quantum**2 / 12.0
    if noise is None:
        if not spare:
            return None
        noise = Noise(spare**0.5, 1.0)
    noise = Noise(max(noise.scatter, spare**0.5), noise.share)
    if noise.scatter > _GREATEST * size:
        return None
    worth = float(np.log(max(len(points) / noise.share, 2.0)))
    pieces = pieces_of(points, _nodes(points, noise.scatter), noise.density, spare, worth)
    if 2 * sum(3 if piece.is_arc else 2 for piece in pieces) > len(points):
        return None  # as many numbers as before: the points are the shape
    chain, owner, off = chain_through(points, pieces, noise)
    corners = chain.drawn(_CHORD)
    return FittedCurve(tuple((float(x), float(y)) for x, y in corners), _SURE * off + 0.5 * quantum)


def _nodes(points: Array, scatter: float) -> Array:
    """Indices of points at which pieces may end: corners of a polygon within the noise, and points between them."""
    ring = [tuple(point) for point in points.tolist()]
    if len(ring) <= _MOST_NODES:
        return np.arange(len(ring))
    places = {point: k for k, point in enumerate(ring)}
    tolerance = scatter
    while True:
        corners = {places[corner] for corner in simplified(ring, tolerance) if corner in places}
        if len(corners) <= _MOST_NODES // 2:
            break
        tolerance *= 1.5
    even = np.linspace(0, len(ring), _MOST_NODES // 2, endpoint=False).astype(int)
    return np.array(sorted(corners | set(even.tolist())))
