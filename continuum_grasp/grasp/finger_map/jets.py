"""Values of many rows with their derivatives by the rows' unknowns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from continuum_grasp.base import Numbers as Array


@dataclass(frozen=True)
class Jet:
    """Values (B, ...) and their slopes (B, ..., n)."""

    value: Array
    slope: Array

    def __sub__(self, other: Jet) -> Jet:
        return Jet(self.value - other.value, self.slope - other.slope)

    def __mul__(self, other: Jet | float) -> Jet:
        if isinstance(other, Jet):
            slope = self.value[..., None] * other.slope + other.value[..., None] * self.slope
            return Jet(self.value * other.value, slope)
        return Jet(self.value * other, self.slope * other)

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
        """Values (B, C) and the values of others (B, D)."""
        parts = self, *others
        return Jet(
            np.concatenate([part.value for part in parts], axis=1),
            np.concatenate([part.slope for part in parts], axis=1),
        )

    def beside(self) -> Jet:
        """Values (B,) as (B, 1)."""
        return Jet(self.value[:, None], self.slope[:, None])
