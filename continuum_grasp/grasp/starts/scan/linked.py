"""Which postures are next to each other on the curves of touching postures, and the minima along these."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.starts.scan.touching import Branch

Array = NDArray[Any]

MOST = 12
"""Basins of a set of contacts at most; of 13 hard scenes and 200 random ones none had more than 8."""
_BETWEEN = np.array([0.25, 0.5, 0.75])
"""Places that are added to those of a scan, in spacings."""
_NEIGHBORS = 1.6
"""Spacings between places up to which postures are neighbors: from a place to the next with what was added."""
_ARCS_NEAR = 0.1
"""The same of two arcs: sum of the differences of both bends [rad], 1.6 lines of the grid."""
_JOINT, _CURVATURE, _NORMAL = 0.08, 2.5, 0.5
"""Greatest differences of neighbors on one curve: joints [L], curvatures [1/L] and normals [rad]."""


def gaps(some: Branch, spacing: Array) -> Array:
    """Shifts by which places are added, given their spacings (P,): on to the next place, and back where no posture lies
    before.
    """
    before = _linked(some, some.place[None, :] - some.place[:, None] + spacing[:, None], 0.01).any(axis=1)
    back = np.where(np.asarray(before)[:, None], np.nan, -_BETWEEN)
    return np.concatenate([np.broadcast_to(_BETWEEN, back.shape), back], axis=1) * spacing[:, None]


def _linked(branch: Branch, apart: Array, near: float) -> Array:
    """Which pairs (P, P) of postures are alike and next to each other by a distance (P, P)."""
    one, two = np.nonzero(np.abs(apart) <= near)

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


def along_outline(branch: Branch, count: int) -> Array:
    """Which pairs (P, P) of postures on a ring with so many places are neighbors."""
    apart = branch.place[:, None] - branch.place
    return _linked(branch, np.remainder(apart + 0.5 * count, count) - 0.5 * count, _NEIGHBORS)


def in_bends(branch: Branch) -> Array:
    """Which pairs (P, P) of postures of two arcs are neighbors."""
    one = branch.ends[:, 0] * branch.joint
    two = branch.ends[:, 2] * (1.0 - branch.joint)
    first, second = np.nonzero(np.abs(one[:, None] - one) + np.abs(two[:, None] - two) < _ARCS_NEAR)
    alike = (branch.tip[first] == branch.tip[second]) & _alike_normals(branch, first, second)
    return _pairs(len(branch), first[alike], second[alike])


def _alike_normals(branch: Branch, one: Array, two: Array) -> Array:
    turned = np.remainder(branch.tip_normal[one] - branch.tip_normal[two] + math.pi, math.tau) - math.pi
    return np.asarray(np.abs(turned) < _NORMAL)


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
