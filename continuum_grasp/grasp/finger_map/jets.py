"""Values of many rows with their derivatives by the rows' unknowns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from continuum_grasp.base import Numbers as Array


@dataclass(frozen=True)
class Jet:
    """Values (B, ...) and their slopes (B, ..., n)."""

    value: Array
    slope: Array
    __array_ufunc__ = None  # arrays leave products with jets to these

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
            slope = self.value[..., None] * other.slope + other.value[..., None] * self.slope
            return Jet(self.value * other.value, slope)
        if isinstance(other, np.ndarray):
            return Jet(self.value * other, self.slope * other[..., None])
        return Jet(self.value * other, self.slope * other)

    __rmul__ = __mul__

    def of(self, value: Array, slope: Array) -> Jet:
        """A function of it, by the function's values and slopes (B, ...)."""
        return Jet(value, slope[..., None] * self.slope)

    def size(self, rounded: float = 0.0) -> Jet:
        """Absolute value, near zero ``rounded``."""
        size = np.sqrt(self.value**2 + rounded**2)
        return self.of(size, self.value / np.maximum(size, 1e-300))

    @staticmethod
    def norm(parts: Sequence[Jet], rounded: float) -> Jet:
        """Root of the sum of squares, near zero ``rounded``."""
        value = np.sqrt(sum((part.value**2 for part in parts), np.full(parts[0].value.shape, rounded**2)))
        slope = sum((part.value[..., None] * part.slope for part in parts), np.zeros(parts[0].slope.shape))
        return Jet(value, slope / value[..., None])

    # -- several beside each other: values (B, C, ...) -----------------------------------------------------------

    def taken(self, k: int) -> Jet:
        """One of the last axis of the values."""
        return Jet(self.value[..., k], self.slope[..., k, :])

    def grouped(self, groups: int) -> Jet:
        """Values (B, C) as (B, groups, C / groups)."""
        batch, count = self.value.shape
        shape = batch, groups, count // groups
        return Jet(self.value.reshape(shape), self.slope.reshape(*shape, self.slope.shape[-1]))

    def followed_by(self, *others: Jet) -> Jet:
        """Values (B, C) and those of others (B, D)."""
        parts = self, *others
        return Jet(
            np.concatenate([part.value for part in parts], axis=1),
            np.concatenate([part.slope for part in parts], axis=1),
        )

    def summed(self) -> Jet:
        """Sums (B,) of values (B, C)."""
        return Jet(self.value.sum(axis=1), self.slope.sum(axis=1))

    def beside(self) -> Jet:
        """Values (B,) as (B, 1)."""
        return Jet(self.value[:, None], self.slope[:, None])

    def among(self, first: int, count: int) -> Jet:
        """A jet of more unknowns, of which those from the ``first`` on are its own."""
        slope = np.zeros((*self.slope.shape[:-1], count))
        slope[..., first : first + self.slope.shape[-1]] = self.slope
        return Jet(self.value, slope)
