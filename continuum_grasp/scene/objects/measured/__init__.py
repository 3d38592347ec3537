"""Measured curves, of pictures and digitized points, as lines and arcs within their noise."""

from __future__ import annotations

from typing import NamedTuple


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
