"""Values of many rows with their derivatives by the rows' unknowns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from continuum_grasp.base import Numbers as Array


@dataclass(frozen=True)
class Jet:
    """Values (B,) and their slopes (B, n)."""

    value: Array
    slope: Array

    def __add__(self, other: Jet | float | Array) -> Jet:
        if isinstance(other, Jet):
            return Jet(self.value + other.value, self.slope + other.slope)
        return Jet(self.value + other, self.slope)

    __radd__ = __add__

    def __neg__(self) -> Jet:
        return Jet(-self.value, -self.slope)

    def __sub__(self, other: Jet | float | Array) -> Jet:
        return self + -other

    def __rsub__(self, other: float | Array) -> Jet:
        return -self + other

    def __mul__(self, other: Jet | float | Array) -> Jet:
        if isinstance(other, Jet):
            slope = self.value[:, None] * other.slope + other.value[:, None] * self.slope
            return Jet(self.value * other.value, slope)
        factor = np.broadcast_to(np.asarray(other, dtype=float), self.value.shape)
        return Jet(self.value * factor, self.slope * factor[:, None])

    __rmul__ = __mul__

    def of(self, value: Array, slope: Array) -> Jet:
        """A function of it, by the function's values and slopes (B,)."""
        return Jet(value, slope[:, None] * self.slope)

    def excess(self) -> Jet:
        """Excess above zero."""
        above = self.value > 0.0
        return Jet(np.where(above, self.value, 0.0), np.where(above[:, None], self.slope, 0.0))

    def size(self, rounded: float = 0.0) -> Jet:
        """Absolute value, near zero ``rounded``."""
        size = np.sqrt(self.value**2 + rounded**2)
        return self.of(size, self.value / np.maximum(size, 1e-300))

    @staticmethod
    def norm(parts: Sequence[Jet], rounded: float) -> Jet:
        """Root of the sum of squares, near zero ``rounded``."""
        value = np.sqrt(sum((part.value**2 for part in parts), np.full(len(parts[0].value), rounded**2)))
        slope = sum((part.value[:, None] * part.slope for part in parts), np.zeros(parts[0].slope.shape))
        return Jet(value, slope / value[:, None])

    @staticmethod
    def stacked(rows: Sequence[Jet]) -> tuple[Array, Array]:
        """Values (B, m) and slopes (B, m, n) of several."""
        return np.stack([row.value for row in rows], axis=1), np.stack([row.slope for row in rows], axis=1)
