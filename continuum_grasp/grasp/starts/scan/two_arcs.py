"""Fingers of two arcs that touch with the tip alone: curves in the plane of the two bends."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from continuum_grasp.arrays import Numbers as Array
from continuum_grasp.grasp.starts.scan.curves import table_of
from continuum_grasp.grasp.starts.scan.task import FRONT, FingerTask
from continuum_grasp.grasp.starts.scan.touching import Branch, bracketed_root

SHARE = 0.5
"""Part of the length of each of the two arcs, where no contact is between them."""
_LINES = 401
"""Bends of each arc that are tried, over the bending range both ways: 0.031 rad apart for a whole turn. On a corner the
normal turns by a right angle in about as much."""


def arc_spacing(task: FingerTask) -> float:
    """Difference of neighboring bends that are tried [rad]."""
    return 2.0 * task.bending_range / (_LINES - 1)


@lru_cache(8)
def _table(reach: float) -> tuple[Array, Array]:
    """Bends of the arcs of a finger, and tips."""
    bends = np.linspace(-reach, reach, _LINES)
    return bends, table_of(bends / SHARE, bends / SHARE, SHARE)[0]


def scanned_arcs(task: FingerTask) -> Branch:
    """All postures, by crossings of the curves with the lines of a grid of both bends."""
    bends, tips = _table(task.bending_range)
    near = np.zeros(tips.shape, bool)
    cell = 2.0 * (bends[1] - bends[0])
    for shape in task.shapes:
        near |= np.abs(tips - shape.center) < shape.extent + task.half + cell
    reach = 1.02 * np.max(task.limits) * np.array(SHARE) + bends[1] - bends[0]
    near &= (np.abs(bends) < reach)[:, None] & (np.abs(bends) < reach)
    gap = np.full(tips.shape, np.nan)
    gap[near] = task.gap(tips[near])
    crossings = []
    for axis in (0, 1):
        here = tuple(slice(None, -1) if k == axis else slice(None) for k in (0, 1))
        ahead = tuple(slice(1, None) if k == axis else slice(None) for k in (0, 1))
        i, j = np.nonzero(gap[here] * gap[ahead] <= 0.0)
        pair = np.stack([bends[i], bends[j]], axis=1)
        other = np.stack([bends[i + (axis == 0)], bends[j + (axis == 1)]], axis=1)
        crossings.append((pair, other, gap[here][i, j], gap[ahead][i, j]))
    low, high, at_low, at_high = (np.concatenate(part) for part in zip(*crossings, strict=True))

    def miss(share: Array) -> Array:
        return task.gap(_tips(low + share[:, None] * (high - low))[0])

    share = bracketed_root(miss, np.zeros(len(low)), np.ones(len(low)), at_low, at_high)
    pair = low + share[:, None] * (high - low)
    tip, facing = _tips(pair)
    parts, point, normal = task.touched(tip)
    good = np.cos(normal - facing - 0.5 * math.pi) <= FRONT
    good &= (np.abs(pair).max(axis=1, initial=0.0) <= task.bending_range * (1.0 + 1e-6)) & (np.abs(miss(share)) < 1e-6)
    none = np.zeros(len(pair))
    branch = Branch(
        part=parts,
        side=none.astype(int) + 1,
        place=none,
        point=none + 0j,
        normal=none,
        turn=pair[:, 0],
        joint=none + SHARE,
        ends=np.repeat(pair / SHARE, 2, axis=1),
        tip=parts,
        tip_point=point,
        tip_normal=normal,
    )
    return branch.take(good)


def _tips(bends: Array) -> tuple[Array, Array]:
    """Tips and angles of the section there, by the two bends (B, 2)."""
    half = 0.5 * bends
    chord = np.sinc(half / math.pi) * SHARE
    tip = 1j * (chord[:, 0] * np.exp(1j * half[:, 0]) + chord[:, 1] * np.exp(1j * (bends[:, 0] + half[:, 1])))
    return tip, bends[:, 0] + bends[:, 1]
