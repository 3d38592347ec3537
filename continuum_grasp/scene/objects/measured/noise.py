"""Estimate the noise of measured points along a closed curve from the points alone, for any shape."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.base import Array

_WINDOW = 5
"""Points of a parabola: the fewest that leave two residuals; few windows contain a corner."""
_QUARTILE = 0.28768
"""First quartile of the mean of two squared residuals, per variance: -ln(3/4), of a chi-square of two degrees. Up to
three windows in four may hold corners."""
_BETWEEN = 4.0
"""Threshold for the ratio of the variances of means when the number of neighbors doubles [1]. Noise has the ratio 1/2;
a smooth curve has 64, because its third derivative leaves residuals that grow with the cube of the scale. Few windows
scatter much."""
_SMOOTH = 0.7
"""Threshold between noise and smooth curves: share of third differences with the sign of the next one [1]."""
_LAGS, _ALIKE = 16, 0.5
"""Greatest number of points of a tooth, and least correlation of its points with the next tooth [1]: 40 points of noise
have 0.16."""
_BESIDE = range(4, 10)
"""Neighbors on each side that show whether a point is an outlier: a wrong pixel at the edge moves up to seven
points."""
_EVEN, _FAR = 2.0, 4.0
"""Greatest scatter of these neighbors, and least distance of an outlier, per scatter of all points [1]."""
_SECTION, _SECTIONS = 100, 8
"""Least number of points per section of the curve (noise known to 15 %), and greatest number of sections."""


class Noise(NamedTuple):
    """Noise of points across a curve.

    Attributes
    ----------
    scatter : float
        Standard deviation of one point [m].
    share : float
        Variance of the mean of many points, per variance of as many independent ones [1]: 1 for independent points,
        the number of points that move together for correlated ones.
    """

    scatter: float
    share: float

    @property
    def density(self) -> float:
        """Variance of the mean of points, times their number [m2]."""
        return self.scatter**2 * self.share


def noise_of(points: Array) -> Noise | None:
    """Estimate the noise of the points (n, 2) of a closed curve at its greatest; None for exact points.

    Noise differs from shape by scale: the mean over twice as many neighbors scatters less, whereas the bends of a
    shape stand out more. So the function compares means over 1, 2, 4 ... neighbors with parabolas through five of
    them, and measures the noise on the first scales with falling scatter.
    """
    # Light and focus differ from side to side.
    sections = np.array_split(points, max(min(len(points) // _SECTION, _SECTIONS), 1))
    every = [noise for noise in map(_of_section, sections) if noise is not None]
    return max(every, key=lambda noise: noise.density, default=None)


def _of_section(points: Array) -> Noise | None:
    """Estimate the noise of points along an open curve."""
    counts = [2**k for k in range(16) if len(points) >> k >= 2 * _WINDOW]
    variances = [_variance(_means(points, count)) for count in counts]
    if len(variances) < 2:
        return None
    if len(points) < _SECTION:
        # All windows of means would contain corners.
        return None if _is_smooth(points) else Noise(variances[0] ** 0.5, 1.0)
    steps = enumerate(pairwise(variances))
    first = next((k for k, (a, b) in steps if b < (_BETWEEN if k == 0 else 1.0) * a), None)
    if first is None:
        return None
    last = first + 1
    while last + 1 < len(counts) and variances[last + 1] < variances[last]:
        last += 1
    scatter = max(variances[: first + 1]) ** 0.5
    density = max(count * variance for count, variance in zip(counts[: last + 1], variances, strict=False))
    return Noise(scatter, density / scatter**2)


def is_pattern(rest: Array) -> bool:
    """Whether residuals along a curve repeat, as on teeth, unlike noise: they resemble the residuals some points later,
    but not the ones between.
    """
    rest = rest - rest.mean()
    lags = np.arange(1, min(_LAGS, len(rest) // 4) + 1)
    alike = np.array([float(rest @ np.roll(rest, lag)) for lag in lags]) / max(float(rest @ rest), np.finfo(float).tiny)
    return bool((alike[np.minimum.accumulate(alike) < 0.0] > _ALIKE).any())


def _means(points: Array, count: int) -> Array:
    """Means over ``count`` neighbors each."""
    whole = len(points) // count * count
    return np.asarray(points[:whole].reshape(-1, count, 2).mean(axis=1))


def _variance(points: Array) -> float:
    """Variance of points across a smooth curve, by the first quartile of their residuals from parabolas [m2]."""
    around = _windows(points)
    rest, _ = _beside_parabolas(around, around[:, :1])
    return float(np.quantile((rest**2).sum(axis=1) / (_WINDOW - 3), 0.25)) / _QUARTILE


def outliers_of(points: Array, scatter: float) -> NDArray[np.bool_]:
    """Return which points of a closed curve are outliers, such as dust or a wrong pixel.

    The neighbors on both sides of an outlier lie on one parabola; the neighbors of a corner do not.
    """
    if len(points) < 4 * _BESIDE[-1]:
        return np.zeros(len(points), dtype=bool)
    offsets = np.array([-k for k in reversed(_BESIDE)] + list(_BESIDE))
    around = points[(np.arange(len(points))[:, None] + offsets) % len(points)]
    rest, off = _beside_parabolas(around, points[:, None])
    even = np.sqrt((rest**2).sum(axis=1) / (len(offsets) - 3)) < _EVEN * scatter
    return np.asarray(even & (np.abs(off[:, 0]) > _FAR * scatter))


def _is_smooth(points: Array) -> bool:
    """Whether third differences have the sign of their neighbors: almost all on a smooth curve, 37 % for noise, whose
    neighboring differences have a correlation of -0.4.
    """
    rest, _ = _beside_parabolas(_windows(points), points[: 1 - _WINDOW, None])
    third = rest @ [-1.0, 2.0, 0.0, -2.0, 1.0]
    return bool(np.mean(third[1:] * third[:-1] > 0.0) > _SMOOTH)


def _windows(points: Array) -> Array:
    """Return each point with the following ones (n, 5, 2)."""
    return np.asarray(points[np.arange(len(points) - _WINDOW + 1)[:, None] + np.arange(_WINDOW)])


def _beside_parabolas(around: Array, others: Array) -> tuple[Array, Array]:
    """Return residuals of points (n, k, 2) from their parabola, and of other points (n, m, 2) near it."""
    chord = around[:, -1] - around[:, 0]
    length = np.maximum(np.linalg.norm(chord, axis=1), np.finfo(float).tiny)[:, None]
    middle = around.mean(axis=1, keepdims=True)
    along, across = frames(np.concatenate([around, others], axis=1) - middle, chord / length)
    powers = (along / length)[..., None] ** np.arange(3)
    own = powers[:, : around.shape[1]]
    transposed = np.swapaxes(own, 1, 2)
    gram = transposed @ own + 1e-12 * np.eye(3)
    fit = np.linalg.solve(gram, transposed @ across[:, : around.shape[1], None])
    rest = across - (powers @ fit)[..., 0]
    return rest[:, : around.shape[1]], rest[:, around.shape[1] :]


def frames(offsets: Array, directions: Array) -> tuple[Array, Array]:
    """Components of offsets (n, k, 2) along directions (n, 2) and to the left of them."""
    along = offsets[..., 0] * directions[:, None, 0] + offsets[..., 1] * directions[:, None, 1]
    across = offsets[..., 1] * directions[:, None, 0] - offsets[..., 0] * directions[:, None, 1]
    return along, across
