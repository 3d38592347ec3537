"""Fingers of two arcs that touch with the tip alone: curves in the plane of the two bends. Each arc is half of the
finger, since no contact is between them.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from continuum_grasp.base import Numbers as Array
from continuum_grasp.grasp.starts.scan.curves import table_of
from continuum_grasp.grasp.starts.scan.task import FRONT, FingerTask
from continuum_grasp.grasp.starts.scan.touching import ABOVE, Branch, bracketed_root

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
    return bends, table_of(2.0 * bends, 2.0 * bends, 0.5)[0]


def scanned_arcs(task: FingerTask) -> Branch:
    """All postures, by crossings of the curves with the lines of a grid of both bends."""
    bends, tips = _table(task.bending_range)
    near = np.zeros(tips.shape, bool)
    cell = 2.0 * (bends[1] - bends[0])
    for shape in task.shapes:
        near |= np.abs(tips - shape.center) < shape.extent + task.half + cell
    reach = (1.0 + ABOVE) * np.max(task.limits) * 0.5 + bends[1] - bends[0]
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
    return _rooted(task, low, high, at_low, at_high)[0]


def beside_arcs(task: FingerTask, some: Branch, steps: Array) -> tuple[Branch, Array]:
    """The postures next to some, by steps (P, S) of the bends along the curves [rad], and the row that each is from."""
    bends = 0.5 * some.ends[:, [0, 2]]
    # Along the curve: across the gradient of the gap.
    gradient = np.stack([_gap(task, bends + d) - _gap(task, bends - d) for d in 1e-4 * np.eye(2)], axis=1)
    across = gradient / np.maximum(np.linalg.norm(gradient, axis=1), 1e-12)[:, None]
    along = np.stack([-across[:, 1], across[:, 0]], axis=1)
    rows = np.repeat(np.arange(len(some)), steps.shape[1])
    size = steps.reshape(-1, 1)
    start, aside = bends[rows] + size * along[rows], np.abs(size) * across[rows]
    # The curve is as far aside as it is followed at most.
    low, high = start - aside, start + aside
    at_low, at_high = _gap(task, low), _gap(task, high)
    row = np.flatnonzero(at_low * at_high <= 0.0)
    branch, index = _rooted(task, low[row], high[row], at_low[row], at_high[row])
    return branch, rows[row][index]


def _tips(bends: Array) -> tuple[Array, Array]:
    """Tips and angles of the section there, by the two bends (B, 2)."""
    half = 0.5 * bends
    chord = 0.5 * np.sinc(half / math.pi)
    tip = 1j * (chord[:, 0] * np.exp(1j * half[:, 0]) + chord[:, 1] * np.exp(1j * (bends[:, 0] + half[:, 1])))
    return tip, bends[:, 0] + bends[:, 1]


def _gap(task: FingerTask, bends: Array) -> Array:
    return task.gap(_tips(bends)[0])


def _rooted(task: FingerTask, low: Array, high: Array, at_low: Array, at_high: Array) -> tuple[Branch, Array]:
    """The postures between pairs of bends (B, 2), and their rows."""

    def gap(part: Array) -> Array:
        return _gap(task, low + part[:, None] * (high - low))

    part = bracketed_root(gap, np.zeros(len(low)), np.ones(len(low)), at_low, at_high)
    bends = low + part[:, None] * (high - low)
    tip, facing = _tips(bends)
    parts, point, normal = task.touched(tip)
    good = np.cos(normal - facing - 0.5 * math.pi) <= FRONT
    good &= (np.abs(bends).max(axis=1, initial=0.0) <= task.bending_range * (1.0 + 1e-6)) & (np.abs(gap(part)) < 1e-6)
    bends, parts, point, normal = bends[good], parts[good], point[good], normal[good]
    none = np.zeros(len(bends))
    branch = Branch(
        part=parts,
        side=none.astype(int) + 1,
        place=none,
        point=none + 0j,
        normal=none,
        turn=bends[:, 0],
        joint=none + 0.5,
        ends=np.repeat(2.0 * bends, 2, axis=1),
        tip=parts,
        tip_point=point,
        tip_normal=normal,
    )
    return branch, np.flatnonzero(good)
