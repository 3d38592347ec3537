"""Fit a curve to measured points."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.base import Array
from continuum_grasp.scene.curved_parts import BLUNT
from continuum_grasp.scene.objects.measured import Sampling
from continuum_grasp.scene.objects.measured.noise import Noise, is_pattern, noise_of, outliers_of
from continuum_grasp.scene.objects.measured.pieces import pieces_of
from continuum_grasp.scene.objects.measured.settle import ChainFit
from continuum_grasp.scene.polygons import PlanePoint
from continuum_grasp.scene.value import SAME

_MOST_NODES = 400
"""Greatest number of possible ends of pieces: the time of their search grows with the square, 0.1 s for this number."""
_GREATEST = 0.01
"""With more noise than this, per longer side of a curve, points are intended corners [1]: measurements are better."""
_TURN, _PARTS = 0.95 * BLUNT, 4
"""Turn between corners of an arc [rad]: an object has arcs between them, and chords within 7e-5 of the radius."""
_AROUND = 4.0
"""Length of a corner that blur has rounded, per standard deviation of the blur [1]: two to either side, where the half
level is within 0.03 standard deviations of the line."""
_NEWTON = 5
"""Newton steps for a circle, from the mean of its points."""
_FARTHEST = 6.0
"""A curve with points farther away than this, per scatter and beyond blur, does not fit [1]."""
_TOGETHER = 10
"""Number of consecutive far points that reject a curve: a wrong pixel at the edge moves fewer."""
_SURE = 3.0
"""Standard deviations of a significant difference, and of a stated error [1]: 99.7 % of normal noise are within. By G.
Schwarz's information, 40 to 4000 points see a bend from 1.9 to 2.9 on: one flat side in ten is round.
"""


class FittedCurve(NamedTuple):
    """Lines and arcs through measured points.

    Attributes
    ----------
    points : tuple of (float, float)
        Ends of the lines, and points of the arcs, as densely as in a drawing.
    error : float
        Distance from the true curve, in the unit of the points, that three standard deviations of the fit explain.
    knots : frozenset of int
        Indices of the points that are ends of lines, or corners of an arc.
    chain : ChainFit or None
        Lines and arcs; None for a circle.
    outliers : int
        Number of points whose distance from the curve noise does not explain.
    """

    points: tuple[PlanePoint, ...]
    error: float
    knots: frozenset[int] = frozenset()
    chain: ChainFit | None = None
    outliers: int = 0

    def level(self, normals: Iterable[PlanePoint]) -> FittedCurve:
        """Return the curve with its outermost points along each normal made level, if its error allows that: a flat
        side then lies flat.
        """
        chain = self.chain
        if chain is None:
            return self
        for normal in normals:
            chain = chain.level(normal, 2.0 * self.error)
        return _drawn(chain, self.error)._replace(outliers=self.outliers)


def fitted(ring: Sequence[PlanePoint], sampling: Sampling) -> FittedCurve | None:
    """Fit lines and arcs to the points of a closed curve; None for exact points, which show no noise.

    Parameters
    ----------
    ring : sequence of (float, float)
        Points, each once.
    sampling : Sampling
        Known sampling of the points.
    """
    import shapely

    points = np.asarray(ring, dtype=float)
    size = float(np.ptp(points, axis=0).max())
    least = sampling.variance**0.5
    noise = noise_of(points) or Noise(least, 1.0)
    noise = Noise(max(noise.scatter, least), noise.share)
    if not SAME * size < noise.scatter <= _GREATEST * size:
        return None
    wrong = outliers_of(points, noise.scatter)
    every, points = points, points[~wrong]
    worth = _SURE**2
    nodes = _nodes(points, noise.scatter)
    near = _FARTHEST * noise.scatter + 0.5 * _AROUND * sampling.blur
    for blurred in dict.fromkeys((_AROUND * sampling.blur, 0.0)):
        pieces, information = pieces_of(points, nodes, noise, sampling.variance, worth, blurred)
        if circle := _circle(points, noise, sampling.variance, information - 3.0 * worth):
            return circle._replace(outliers=int((wrong | _beside(circle, every, near)).sum()))
        if 2 * sum(3 if piece.is_arc else 2 for piece in pieces) > len(points):
            return None  # as many numbers as before: the points are the shape
        chain = ChainFit.through(points, pieces, noise, worth, near)
        fit = _drawn(chain, _SURE * chain.spread + (3.0 * sampling.variance) ** 0.5)
        outline = shapely.Polygon(fit.points)
        away = shapely.distance(outline.exterior, shapely.points(points))
        inside = shapely.contains_xy(outline, points)
        if not sampling.variance and is_pattern(np.where(inside, -away, away)):
            return None
        if not blurred:
            fit = fit._replace(error=max(fit.error, float(away.max()) - _SURE * noise.scatter))
        far = away > near
        if (
            outline.is_valid
            and not np.lib.stride_tricks.sliding_window_view(far, min(_TOGETHER, len(far))).all(1).any()
        ):
            return fit._replace(outliers=int((wrong | _beside(fit, every, near)).sum()))
    # Lines and arcs do not fit: retain the points with their noise.
    return FittedCurve(tuple(ring), _SURE * noise.scatter)


def _beside(fit: FittedCurve, points: Array, near: float) -> NDArray[np.bool_]:
    """Return which points are not near a curve."""
    import shapely

    return np.asarray(shapely.distance(shapely.LinearRing(fit.points), shapely.points(points)) > near)


def _drawn(fit: ChainFit, error: float) -> FittedCurve:
    points, knots = fit.chain.drawn(_TURN, _PARTS)
    return FittedCurve(_listed(points), error, frozenset(np.flatnonzero(knots).tolist()), fit)


def _listed(points: Array) -> tuple[PlanePoint, ...]:
    return tuple((float(x), float(y)) for x, y in points)


def _circle(points: Array, noise: Noise, spare: float, most: float) -> FittedCurve | None:
    """Fit a circle to points; None if its information exceeds a limit."""
    center = points.mean(axis=0)
    radius = 0.0
    for _ in range(_NEWTON):
        away = points - center
        reach = np.linalg.norm(away, axis=1)
        slopes = np.column_stack([away / reach[:, None], np.ones(len(points))])
        move, *_ = np.linalg.lstsq(slopes, reach - radius, rcond=None)
        center, radius = center + move[:2], radius + move[2]
    rest = np.linalg.norm(points - center, axis=1) - radius
    if not spare and is_pattern(rest):
        return None
    # The weight of a wrong pixel ends at the greatest plausible distance.
    squares = np.minimum(rest**2, (_FARTHEST * noise.scatter) ** 2)
    if max(float(squares.sum()) - spare * len(points), 0.0) / noise.density > most:
        return None
    count = _PARTS * math.ceil(2.0 * math.pi / _TURN)
    angles = np.arange(count) * 2.0 * np.pi / count
    drawn = center + radius * np.column_stack([np.cos(angles), np.sin(angles)])
    # n points settle three parameters: variance 1/n of the radius, 2/n of each coordinate of the center.
    off = (3.0 * noise.density / len(points)) ** 0.5
    return FittedCurve(_listed(drawn), _SURE * off + (3.0 * spare) ** 0.5, frozenset(range(0, count, _PARTS)))


def _nodes(points: Array, scatter: float) -> NDArray[np.int_]:
    """Return the indices of points that may be ends of pieces: corners of a polygon within the noise, and points
    between them.
    """
    import shapely

    if len(points) <= _MOST_NODES:
        return np.arange(len(points))
    places = {tuple(point): k for k, point in enumerate(points.tolist())}
    ring = shapely.LinearRing(points)
    tolerance, corners = scatter, list(places)
    while len(corners) > _MOST_NODES // 2:
        corners = list(map(tuple, shapely.get_coordinates(shapely.simplify(ring, tolerance, preserve_topology=False))))
        tolerance *= 2.0
    found = {places[corner] for corner in corners}
    even = np.linspace(0, len(points), _MOST_NODES // 2, endpoint=False).astype(int)
    return np.array(sorted(found | set(even.tolist())))
