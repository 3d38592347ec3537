"""Distances of a body as a smooth function for a solver: a cubic spline on an even grid, in the plane and in space.

The exact distance of a body has kinks and jumps of its curvature, at which solvers with exact Hessians stop. Here

    u(p) = sum_k c_k prod_j B(x_j - k_j),     x = (p - origin) / step,

with B the cubic B-spline: it interpolates the exact distances at the places of the grid and has two continuous
derivatives. Its error falls with the fourth power of the step if the distance is smooth. Within a cell of the grid, u
depends on 4^d coefficients, which are data for the solver: they change only between cells, and there u and two
derivatives are the same from both sides. So one CasADi function serves all bodies.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import casadi as ca
import numpy as np
from scipy.linalg import solve_banded

from continuum_grasp.base import Numbers as Array
from continuum_grasp.grasp.body.body import Body

_AWAY = 0.7
"""Part of the distance from the grid that is added beyond it [1]: cos 45 degrees. If a body fills its box, the gradient
at the border is within 45 degrees of the border's normal: the sum grows outward and is at most the distance."""
_INSIDE = 1e-9
"""Distance between the last place of a grid and its border [cells], so that rounding leaves it in the last cell."""


@dataclass(frozen=True)
class DistanceTable:
    """A C2 table of signed distances, in the body's frame, with lengths in a unit.

    A point beyond the grid has the distance at the border, and 0.7 of the way to it.

    Attributes
    ----------
    body
        The exact body.
    data
        Numbers (2 d + 2,) of the table: its origin (d,), 1 / step, index of its first coefficient, counts (d,) of
        coefficients along the axes.
    coefficients
        Coefficients (m,) of the table, then of all its patches; the last axis runs fastest.
    unit
        Length [m] that is 1 in the table.
    patches
        Data of fine tables around places, by name.
    """

    body: Body
    data: Array
    coefficients: Array
    unit: float = 1.0
    patches: Mapping[str, Array] = field(default_factory=dict)

    @classmethod
    def of(cls, body: Body, low: Array, high: Array, step: float) -> DistanceTable:
        """Make the table of a body for places from ``low`` (d,) to ``high`` (d,) [m], ``step`` [m] apart.

        The grid extends beyond both by the same length, so that images of a body have images of its table.
        Its step is at least `Body.least_step`.
        """
        step = max(step, body.least_step)
        low, high = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
        counts = np.maximum(np.ceil((high - low) / step - _INSIDE).astype(int) + 1, 4)
        axes = [step * (np.arange(n) - 0.5 * (n - 1)) for n in counts]
        values = body.on_grid(tuple(axis + middle for axis, middle in zip(axes, 0.5 * (low + high), strict=True)))
        for axis in range(body.dimensions):
            values = np.moveaxis(_spline(np.moveaxis(values, axis, 0)), 0, axis)
        # The first coefficient belongs to a place before the first one of the grid.
        origin = 0.5 * (low + high) - 0.5 * step * (counts + 1)
        data = np.array([*origin, 1.0 / step, 0.0, *values.shape])
        return cls(body, data, values.ravel())

    @classmethod
    def around(cls, body: Body, reach: float, step: float) -> DistanceTable:
        """Make the table of a body for all places within a ``reach`` of its box, ``step`` apart [m]."""
        low, high = body.box
        return cls.of(body, low - reach, high + reach, step)

    @property
    def size(self) -> int:
        """Number of the data of a block."""
        return len(self.data)

    def scaled(self, length: float) -> DistanceTable:
        """Return the table with lengths in another unit, of so many meters."""
        factor = self.unit / length
        patches = {name: _scaled(data, factor) for name, data in self.patches.items()}
        return replace(
            self,
            data=_scaled(self.data, factor),
            coefficients=self.coefficients * factor,
            unit=length,
            patches=patches,
        )

    def refined(self, places: Mapping[str, Array], step: float, count: int = 13) -> DistanceTable:
        """Return the table with fine tables around named places (d,), which replace former ones.

        Each has ``count`` places along each axis, ``step`` apart; all lengths are in the table's unit. A mesh gets none
        below its `Body.least_step`.
        """
        if self.unit * step < self.body.least_step:
            places = {}
        whole = int(np.prod(self.data[-self.body.dimensions :]))
        coefficients = [self.coefficients[:whole]]
        patches = {}
        for name, place in places.items():
            center = self.unit * np.asarray(place)
            half = 0.5 * (count - 1) * self.unit * step
            patch = DistanceTable.of(self.body, center - half, center + half, self.unit * step).scaled(self.unit)
            patches[name] = patch.data
            patches[name][self.body.dimensions + 1] = sum(map(len, coefficients))
            coefficients.append(patch.coefficients)
        return replace(self, coefficients=np.concatenate(coefficients), patches=patches)

    def of_body(self, body: Body, unit: float) -> DistanceTable:
        """Return the table of another body on the same grids, with lengths in another unit, of so many meters."""
        whole = self._on_grid(self.data, body, unit)
        parts, patches = [whole.coefficients], {}
        for name, data in self.patches.items():
            patch = self._on_grid(data, body, unit)
            patches[name] = patch.data
            patches[name][body.dimensions + 1] = sum(map(len, parts))
            parts.append(patch.coefficients)
        return replace(whole, coefficients=np.concatenate(parts), patches=patches)

    @staticmethod
    def _on_grid(data: Array, body: Body, unit: float) -> DistanceTable:
        """Return a table of a body on the grid of some data."""
        d = body.dimensions
        step = 1.0 / data[d]
        low = data[:d] + step
        high = low + step * (data[d + 2 :] - 3.0)
        return DistanceTable.of(body, unit * low, unit * high, unit * step).scaled(unit)

    def data_at(self, name: str) -> Array:
        """Return the data of the fine table around a named place, or of the whole table if there is none."""
        return self.patches.get(name, self.data)

    # -- for a solver --------------------------------------------------------------------------------------------

    @staticmethod
    def cell(point: Any, data: Any) -> Any:
        """Return the place of a CasADi point (d,) on the grid (d,) in cells, clipped to its border.

        The whole part is the ``cell`` of `distance`. `nlp.Lookup` takes it, the first index and the counts.
        """
        d = point.numel()
        return ca.fmin(ca.fmax((point - data[:d]) * data[d], 1.0), data[d + 2 :] - 2.0 - _INSIDE)

    @staticmethod
    def distance(point: Any, data: Any, cell: Any, coefficients: Any) -> Any:
        """Return the CasADi distance of a point (d,).

        ``cell`` (d,), whole numbers, and its ``coefficients`` (4^d,), which begin one before it along each axis, the
        last axis fastest, are data, too: derivatives by them do not count.
        """
        d = point.numel()
        at = DistanceTable.cell(point, data)
        values = coefficients
        for axis in range(d):
            t = at[axis] - cell[axis]
            weights = ca.vertcat((1 - t) ** 3, 4 - 6 * t**2 + 3 * t**3, 1 + 3 * t + 3 * t**2 - 3 * t**3, t**3) / 6
            # The first axis that is left runs slowest.
            values = ca.reshape(values, values.numel() // 4, 4) @ weights
        away = (point - data[:d]) * data[d] - at
        # 1e-30: keeps the root differentiable on the grid
        return values + _AWAY / data[d] * ca.sqrt(ca.sumsqr(away) + 1e-30)

    # -- in numpy ------------------------------------------------------------------------------------------------

    def values(self, points: Array, name: str = "") -> tuple[Array, Array]:
        """Return distances (n,) and their gradients (n, d) at points (n, d), the same as the solver's.

        A ``name`` chooses the fine table around that place.
        """
        d = self.body.dimensions
        data = self.data_at(name)
        counts = data[d + 2 :].astype(int)
        on_grid = (np.reshape(points, (-1, d)) - data[:d]) * data[d]
        at = np.clip(on_grid, 1.0, counts - 2.0 - _INSIDE)
        cell = np.floor(at).astype(int)
        index = np.full((len(at), 1), 0)
        for axis in range(d):
            # The next axis runs faster.
            along = cell[:, [axis]] + np.arange(-1, 3)
            index = (index[:, :, None] * counts[axis] + along[:, None]).reshape(len(at), -1)
        near = self.coefficients[int(data[d + 1]) + index].reshape(-1, *[4] * d)
        weights, slopes = _weights(at - cell)
        away = on_grid - at
        apart = np.linalg.norm(away, axis=1)
        distance = _summed(near, weights) + _AWAY / data[d] * apart
        gradient = _AWAY * away / np.maximum(apart, 1e-300)[:, None]
        for axis in range(d):
            mixed = np.concatenate([weights[:, :axis], slopes[:, axis : axis + 1], weights[:, axis + 1 :]], axis=1)
            gradient[:, axis] += np.where(away[:, axis] == 0.0, data[d] * _summed(near, mixed), 0.0)
        return distance, gradient


def _weights(t: Array) -> tuple[Array, Array]:
    """Weights of four coefficients (n, d, 4) at parts (n, d) of a cell, and their slopes."""
    weights = [(1.0 - t) ** 3, 4.0 - 6.0 * t**2 + 3.0 * t**3, 1.0 + 3.0 * t + 3.0 * t**2 - 3.0 * t**3, t**3]
    slopes = [-((1.0 - t) ** 2), -4.0 * t + 3.0 * t**2, 1.0 + 2.0 * t - 3.0 * t**2, t**2]
    return np.stack(weights, axis=-1) / 6.0, np.stack(slopes, axis=-1) / 2.0


def _summed(near: Array, weights: Array) -> Array:
    """Sums (n,) of coefficients (n, 4, ...) with weights (n, d, 4)."""
    for axis in reversed(range(weights.shape[1])):
        near = (near * weights[:, axis].reshape(-1, *[1] * axis, 4)).sum(axis=-1)
    return near


def _spline(values: Array) -> Array:
    """Coefficients (n + 2, ...) of the spline through values (n, ...), n >= 4: at the second place from either end its
    third derivative does not jump, so that the ends are as exact as the middle.
    """
    count = len(values) + 2
    bands = np.zeros((9, count))
    for shift, weight in zip((-1, 0, 1), (1.0, 4.0, 1.0), strict=True):
        bands[4 - shift, 1 + shift : count - 1 + shift] = weight / 6.0
    for k, weight in enumerate((1.0, -4.0, 6.0, -4.0, 1.0)):
        bands[4 - k, k] = bands[4 + k, count - 1 - k] = weight
    zero = np.zeros((1, *values.shape[1:]))
    right = np.concatenate([zero, values, zero]).reshape(count, -1)
    return np.asarray(solve_banded((4, 4), bands, right).reshape(count, *values.shape[1:]))


def _scaled(data: Array, factor: float) -> Array:
    """Data of a table whose lengths are multiplied by a factor."""
    d = (len(data) - 2) // 2
    return np.concatenate([data[:d] * factor, data[d : d + 1] / factor, data[d + 1 :]])
