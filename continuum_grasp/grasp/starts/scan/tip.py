"""Fingers whose tips touch: on from a middle contact, or alone."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.starts.scan.curves import guess_table, segment_end, touch
from continuum_grasp.grasp.starts.scan.joint import ends_of
from continuum_grasp.grasp.starts.scan.task import (
    FRONT,
    TIP_REACH,
    TIPS,
    FingerTask,
    Postures,
    join,
    touching_family,
    unique,
)
from continuum_grasp.grasp.starts.scan.touching import onwards, started
from continuum_grasp.model.surfaces.outline import Outline

Array = NDArray[Any]


def with_tip(task: FingerTask, family: Postures) -> Postures | None:
    """The postures on to the tip, which touches."""
    point, angle = ends_of(family)
    none, bent = np.zeros(len(family)), np.repeat(family.curvatures[:, -1:], 2, axis=1)
    last = started(none.astype(int), none, none, point, none, angle, family.knots[:, -1], bent)
    found, rows = onwards(task, last)
    if not len(rows):
        return None
    # The curvature may step at the last contact.
    on = found.knots[:, 2:], found.ends[:, 2:], found.tip, found.tip_point, found.tip_normal
    return family.take(rows).on_to(*on)


def crossings(shape: Outline, gap: Array, tips: Array, *, axis: int = 1) -> tuple[Array, Array, Array, Array]:
    """Where neighbors along an axis of tables have their tips on either side of a grown outline: indices of the first
    of both, the share of the way to the second, and the walk of the nearest place.
    """
    one = tuple(slice(None, -1) if k == axis else slice(None) for k in (0, 1))
    two = tuple(slice(1, None) if k == axis else slice(None) for k in (0, 1))
    a, b = gap[one], gap[two]
    with np.errstate(invalid="ignore"):
        i, j = np.nonzero((a * b <= 0.0) & (a != b))
    share = a[i, j] / (a[i, j] - b[i, j])
    tip = tips[one][i, j] + share * (tips[two][i, j] - tips[one][i, j])
    return i, j, share, shape.nearest(tip)[1]


def _in_front(shape: Outline, walk: Array, facing: Array) -> Array:
    """Whether the front half of the rounded tip touches."""
    return np.asarray(np.cos(shape.walk(walk).angle - facing - 0.5 * math.pi) <= FRONT)


def tip_only(task: FingerTask) -> Postures | None:
    """Curves from the base whose tip touches: a family of two parameters, cut along a grid both ways.

    The parameters are the curvatures at both ends, or those of two arcs.
    """
    joint = task.counts[0] / 2.0 if task.arcs and task.counts == (1, 1) else None
    # Beside the shapes of `bent_by_tip`, which have clothoids only, every other line of the grid is enough.
    reach, count = TIP_REACH, TIPS if task.arcs else TIPS // 2 + 1
    if joint is not None:  # each of two arcs has a part of the length for its bend
        reach, count = 2.0 * TIP_REACH, 2 * TIPS - 1
    grid, ends, _ = guess_table(reach, count, joint)
    knots = np.array([0.0, 1.0] if joint is None else [0.0, joint, joint, 1.0])
    groups = []
    for part, shape in enumerate(task.shapes):
        gap = shape.distance(ends) - task.half
        _, walk = shape.nearest(np.array([1j]))  # the straight finger's tip
        touches = abs(complex(shape.walk(walk).point[0]) - 1j) < 1e-9
        if touches and _in_front(shape, walk, np.zeros(1)).all():
            groups.append(_tips(knots, np.zeros((1, len(knots))), part, shape, walk))
        groups += _cuts(part, shape, knots, grid, gap, ends)
    every = join(groups)
    return None if every is None else unique(every)


def _cuts(part: int, shape: Outline, knots: Array, grid: Array, gap: Array, ends: Array) -> list[Postures]:
    """Curves whose tip touches, between neighbors on a grid of first and last curvatures."""
    groups = []
    half = len(knots) // 2
    for axis in (0, 1):
        i, j, share, walk = crossings(shape, gap, ends, axis=axis)
        if len(i):
            curve = np.repeat(np.stack([grid[i], grid[j]], axis=1), half, axis=1)
            columns = tuple(range(axis * half, axis * half + half))
            curve[:, columns] += (share * (grid[1] - grid[0]))[:, None]
            groups.append(touching(knots, curve, columns, part, shape, walk))
    return groups


def touching(knots: Array, bent: Array, columns: tuple[int, ...], part: int, shape: Outline, walk: Array) -> Postures:
    """Curves from the base whose tips touch a part with their fronts, from first guesses."""
    start = (np.zeros(len(bent), complex), np.zeros(len(bent)))
    lengths = np.broadcast_to(np.diff(knots), (len(bent), len(knots) - 1))
    bent, walk, good = touch(shape, start, lengths, bent, columns, walk)
    _, turn, _, _ = segment_end(lengths, bent)
    good &= _in_front(shape, walk, turn)
    return _tips(knots, bent[good], part, shape, walk[good])


def _tips(knots: Array, bent: Array, part: int, shape: Outline, walk: Array) -> Postures:
    count = len(walk)
    return touching_family(np.broadcast_to(knots, (count, len(knots))), bent, np.zeros((count, 0)), part, shape, walk)
