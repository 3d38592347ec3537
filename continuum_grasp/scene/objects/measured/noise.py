"""Noise of measured points along a closed curve: estimated from the points alone, whatever the shape."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from continuum_grasp.base import Array

_WINDOW = 5
"""Neighbors through which a parabola is laid: the fewest that leave two residuals, so that few windows hold a corner."""
_QUARTILE = 0.28768
"""First quartile of the mean of two squared residuals, per variance: -ln(3/4), of a chi-square of two degrees. Up to
three windows in four may hold corners."""


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
    """Estimate the noise of the points (n, 2) of a closed curve; None where they show none.

    Noise differs from shape by scale: the mean over twice as many neighbors scatters less, whereas the bends of a
    shape stand out more. So the means over 1, 2, 4 ... neighbors are compared with parabolas through five of them,
    and the noise is measured on the first scale from which on the scatter falls.
    """
    by_scale = []
    count = 1
    while len(points) // count >= 4 * _WINDOW:
        by_scale.append((count, _variance(_means(points, count))))
        count *= 2
    for (count, here), (_, doubled) in zip(by_scale, by_scale[1:], strict=False):
        if doubled < here:
            if 4.0 * doubled < here:
                return None  # neighbors that alternate, as teeth do, scatter by turns and not by chance
            scatter = max(value for below, value in by_scale if below <= count) ** 0.5
            density = max(count * here, 2 * count * doubled)
            return Noise(scatter, max(density / scatter**2, 1.0)) if scatter > 0.0 else None
    return None


def _means(points: Array, count: int) -> Array:
    """Means over ``count`` neighbors each."""
    whole = len(points) // count * count
    return np.asarray(points[:whole].reshape(-1, count, 2).mean(axis=1))


def _variance(points: Array) -> float:
    """Variance of points across a smooth curve, by the first quartile of their residuals from parabolas [m2]."""
    places = (np.arange(len(points))[:, None] + np.arange(_WINDOW)) % len(points)
    around = points[places]
    chord = around[:, -1] - around[:, 0]
    length = np.maximum(np.linalg.norm(chord, axis=1), np.finfo(float).tiny)[:, None]
    along, across = frames(around - around[:, _WINDOW // 2, None], chord / length)
    scaled = along / length
    powers = np.stack([np.ones_like(scaled), scaled, scaled**2], axis=2)
    gram = np.swapaxes(powers, 1, 2) @ powers + 1e-12 * np.eye(3)
    fit = np.linalg.solve(gram, np.swapaxes(powers, 1, 2) @ across[..., None])
    rest = across - (powers @ fit)[..., 0]
    return float(np.quantile((rest**2).sum(axis=1) / (_WINDOW - 3), 0.25)) / _QUARTILE


def frames(offsets: Array, directions: Array) -> tuple[Array, Array]:
    """Components of offsets (n, k, 2) along directions (n, 2) and to the left of them."""
    along = offsets[..., 0] * directions[:, None, 0] + offsets[..., 1] * directions[:, None, 1]
    across = offsets[..., 1] * directions[:, None, 0] - offsets[..., 0] * directions[:, None, 1]
    return along, across
