"""Fit lines and arcs to measured curves, from pictures or digitized points, within their noise."""

from __future__ import annotations

from typing import NamedTuple


class Sampling(NamedTuple):
    """Sampling of an edge by a picture, in the unit of its points.

    Attributes
    ----------
    variance : float
        Variance of a point from the pixel spacing, even in a noise-free picture.
    blur : float
        Standard deviation of the blur across the edge.
    """

    variance: float = 0.0
    blur: float = 0.0

    def scaled(self, factor: float) -> Sampling:
        """Return the sampling in a unit of another length."""
        return Sampling(factor**2 * self.variance, factor * self.blur)
