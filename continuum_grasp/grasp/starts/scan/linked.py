"""Which postures are next to each other on the curves of touching postures, and the minima along these."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.starts.scan.curves import wrapped
from continuum_grasp.grasp.starts.scan.touching import Branch

Array = NDArray[Any]

MOST = 12
"""Basins of a set of contacts at most; of 13 hard scenes and 200 random ones none had more than 8."""
_NEIGHBORS = 1.6
"""Spacings of a scan up to which postures are neighbors; of two arcs, of both bends in sum."""
_JOINT, _CURVATURE, _NORMAL = 0.08, 2.5, 0.5
"""Greatest differences of neighbors on one curve: joints [L], curvatures [1/L] and normals [rad]."""


def along_outline(branch: Branch, count: int) -> Array:
    """Which pairs (P, P) of postures on a ring with so many places are neighbors."""
    apart = np.remainder(branch.place[:, None] - branch.place + 0.5 * count, count) - 0.5 * count
    one, two = np.nonzero(np.abs(apart) <= _NEIGHBORS)

    def differ(values: Array) -> Array:
        return np.asarray(np.abs(values[one] - values[two]))

    alike = (branch.side[one] == branch.side[two]) & (branch.part[one] == branch.part[two])
    alike &= (differ(branch.joint) < _JOINT) & _alike_normals(branch, one, two)
    for end in (0, 1, 3):
        alike &= differ(branch.ends[:, end]) < _CURVATURE
    return _pairs(len(branch), one[alike], two[alike])


def _pairs(count: int, one: Array, two: Array) -> Array:
    """A table (P, P) of pairs."""
    out = np.zeros((count, count), bool)
    out[one, two] = True
    return out


def in_bends(branch: Branch, spacing: float) -> Array:
    """Which pairs (P, P) of postures of two arcs are neighbors, of a scan with a spacing [rad]."""
    one = branch.ends[:, 0] * branch.joint
    two = branch.ends[:, 2] * (1.0 - branch.joint)
    first, second = np.nonzero(np.abs(one[:, None] - one) + np.abs(two[:, None] - two) <= _NEIGHBORS * spacing)
    alike = (branch.tip[first] == branch.tip[second]) & _alike_normals(branch, first, second)
    return _pairs(len(branch), first[alike], second[alike])


def _alike_normals(branch: Branch, one: Array, two: Array) -> Array:
    return np.asarray(np.abs(wrapped(branch.tip_normal[one] - branch.tip_normal[two])) < _NORMAL)


def minima(score: Array, linked: Array) -> Array:
    """Indices of the least (P,) of each neighborhood (P, P), at most so many, the best first."""
    # Of equal ones the first.
    order = np.argsort(score, kind="stable")
    rank = np.empty(len(order), int)
    rank[order] = np.arange(len(order))
    least = np.where(linked, rank[None, :], len(order)).min(axis=1)
    return np.asarray(order[least[order] >= rank[order]][:MOST])


def best_of(score: Array, rows: Array, count: int) -> Array:
    """Index of the least score of each of so many rows; -1 where there is none."""
    out = np.full(count, -1)
    order = np.lexsort((-score, rows))
    out[rows[order]] = order
    return out
