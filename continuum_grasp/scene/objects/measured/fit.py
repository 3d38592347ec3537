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
_AROUND = 4.0
"""Length of a curve about a corner that blur has rounded, per standard deviation of the blur [1]: two to either side,
where the half level is 0.03 of it off the line."""
_NEWTON = 5
"""Steps for a circle, from the mean of its points."""
_SURE = 3.0
"""Standard deviations by which an error is stated: 99.7 % of normal noise are within."""


class Sampling(NamedTuple):
    """How a picture shows an edge, in the unit of its points.

    Attributes
    ----------
    variance : float
        Variance of a point that the distance of the pixels leaves, however clear the picture.
    blur : float
        Standard deviation of the blur across the edge.
    """

    variance: float = 0.0
    blur: float = 0.0

    def scaled(self, factor: float) -> Sampling:
        """The same in a unit of another length."""
        return Sampling(factor**2 * self.variance, factor * self.blur)


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


def fitted(ring: Sequence[PlanePoint], sampling: Sampling) -> FittedCurve | None:
    """Fit lines and arcs to the points of a closed curve; None where these show no noise: they are exact.

    Parameters
    ----------
    ring : sequence of (float, float)
        Points, each once.
    sampling : Sampling
        What is known of the points beforehand.
    """
    points = np.asarray(ring, dtype=float)
    size = float(np.ptp(points, axis=0).max())
    least = sampling.variance**0.5
    noise = noise_of(points) or Noise(least, 1.0)
    noise = Noise(max(noise.scatter, least), noise.share)
    if not 0.0 < noise.scatter <= _GREATEST * size:
        return None
    worth = float(np.log(max(len(points) / noise.share, 2.0)))
    nodes = _nodes(points, noise.scatter)
    pieces, information = pieces_of(points, nodes, noise, sampling.variance, worth, _AROUND * sampling.blur)
    if circle := _circle(points, noise, sampling.variance, information - 3.0 * worth):
        return circle
    if 2 * sum(3 if piece.is_arc else 2 for piece in pieces) > len(points):
        return None  # as many numbers as before: the points are the shape
    chain, off = chain_through(points, pieces, noise)
    corners = chain.drawn(_CHORD)
    return FittedCurve(_listed(corners), _SURE * off + (3.0 * sampling.variance) ** 0.5)


def _listed(points: Array) -> tuple[PlanePoint, ...]:
    return tuple((float(x), float(y)) for x, y in points)


def _circle(points: Array, noise: Noise, spare: float, most: float) -> FittedCurve | None:
    """The circle through points, where its information is at most so much."""
    center = points.mean(axis=0)
    radius = 0.0
    for _ in range(_NEWTON):
        away = points - center
        reach = np.linalg.norm(away, axis=1)
        slopes = np.column_stack([away / reach[:, None], np.ones(len(points))])
        move, *_ = np.linalg.lstsq(slopes, reach - radius, rcond=None)
        center, radius = center + move[:2], radius + move[2]
    rest = np.linalg.norm(points - center, axis=1) - radius
    if max(float((rest**2).sum()) - spare * len(points), 0.0) / noise.density > most:
        return None
    angles = np.arange(0.0, 2.0 * np.pi, _CHORD)
    drawn = center + radius * np.column_stack([np.cos(angles), np.sin(angles)])
    # Of three parameters that n points settle: 1/n of the radius, 2/n of each coordinate of the center.
    off = (3.0 * noise.density / len(points)) ** 0.5
    return FittedCurve(_listed(drawn), _SURE * off + (3.0 * spare) ** 0.5)


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
