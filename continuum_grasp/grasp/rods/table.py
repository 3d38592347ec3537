"""A body's distance in the plane as a cubic spline of exact distances on an even grid."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from continuum_grasp.base import Array

TABLE, CELL = 6, 18
"""Numbers of a table: origin (2), one per step, first coefficient, counts (2); and of a cell with its coefficients."""


def cell(point: Any, table: Any) -> Any:
    """Place in a table (2,), in steps."""
    return ca.vertcat(*((point[k] - table[k]) * table[2] for k in range(2)))


def spline(point: Any, table: Any, found: Any) -> Any:
    """Distance at a point by a cell and its coefficients; beyond the table, the distance to it is added."""
    place = cell(point, table)
    # 1e-9: share of a cell by which the last place is within the last cell
    inside = [ca.fmin(ca.fmax(place[k], 1.0), table[4 + k] - 2.0 - 1e-9) for k in range(2)]
    across, along = (_weights(inside[k] - found[k]) for k in range(2))
    value = sum(across[i] * sum(along[j] * found[2 + 4 * i + j] for j in range(4)) for i in range(4))
    # 0.7: slope of the distance beyond the table, per direction
    beyond = ca.sqrt(sum((place[k] - inside[k]) ** 2 for k in range(2)) + 1e-30) / table[2]
    return value + 0.7 * beyond


def _weights(t: Any) -> list[Any]:
    """Weights of the four coefficients of a cubic B-spline."""
    return [w / 6.0 for w in ((1 - t) ** 3, 4 - 6 * t**2 + 3 * t**3, 1 + 3 * t + 3 * t**2 - 3 * t**3, t**3)]


@dataclass(frozen=True, eq=False)
class DistanceTable:
    """A table of a body."""

    numbers: Array  # (TABLE,)
    coefficients: Array

    @staticmethod
    def of(distance: Callable[[Array, Array], Array], reach: float, count: int) -> DistanceTable:
        """A table of distances on a square of half a side ``reach`` about the origin."""
        from scipy.ndimage import spline_filter

        along = np.linspace(-reach, reach, count)
        x, y = np.meshgrid(along, along, indexing="ij")
        values = distance(x.ravel(), y.ravel()).reshape(count, count)
        numbers = np.array([-reach, -reach, (count - 1) / (2.0 * reach), 0.0, count, count])
        return DistanceTable(numbers, spline_filter(values, order=3, mode="mirror").ravel())

    def seen(self, points: Array) -> tuple[Array, Array]:
        """Distances (n,) and unit normals (n, 2) at points (n, 2)."""
        step = 1e-6 / self.numbers[2]
        slopes = [
            (self._at(points + step * axis) - self._at(points - step * axis)) / (2.0 * step) for axis in np.eye(2)
        ]
        gradient = np.stack(slopes, axis=-1)
        return self._at(points), gradient / (np.linalg.norm(gradient, axis=-1, keepdims=True) + 1e-30)

    def _at(self, points: Array) -> Array:
        counts = self.numbers[4:6].astype(int)
        grid = self.coefficients.reshape(counts)
        place = (points - self.numbers[:2]) * self.numbers[2]
        inside = np.clip(place, 1.0, counts - 2.0 - 1e-9)
        corner = np.floor(inside).astype(int)
        across, along = (_weights(inside[:, k] - corner[:, k]) for k in range(2))
        value = np.zeros(len(points))
        for i in range(4):
            for j in range(4):
                value += across[i] * along[j] * grid[corner[:, 0] - 1 + i, corner[:, 1] - 1 + j]
        beyond = np.linalg.norm(place - inside, axis=1) / self.numbers[2]
        return np.asarray(value + 0.7 * beyond)
