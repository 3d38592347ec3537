"""Postures of one finger that touch an object where they should, by scans over curvatures and contact positions."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.scan_curves import guess_table, sample, stretch
from continuum_grasp.grasp.scan_elastica import elastica_table, projection
from continuum_grasp.grasp.scan_task import ALLOWED, FingerTask, Postures, join, violation
from continuum_grasp.grasp.scan_touch import arc_tangent, tangent, touch
from continuum_grasp.grasp.shapes import Shape

__all__ = ["postures"]

Array = NDArray[Any]

_REACH, _GRID = 6.0, 29
_TIP_REACH, _TIP_GRID = 8.0, 33
_TILT, _OFF = 0.45, 0.25
_POSITIONS = 10
_BESIDE_CONE = 0.15
_BETWEEN = np.array([-0.67, -0.33, 0.33, 0.67])
_ENOUGH = 30


def postures(task: FingerTask, middles: tuple[bool, ...], tip: bool) -> Postures | None:
    """All postures found with the middle contacts that are on and, if ``tip``, the tip touching.

    Parameters
    ----------
    task : FingerTask
    middles : tuple of bool
        Which middle contacts are on, from the base.
    tip : bool

    Returns
    -------
    Postures or None
        None where there is none, however much it penetrates.
    """
    if any(middles):
        family = _first_joint(task, middles)
        for k in range(middles.index(True) + 1, len(middles)):
            if middles[k] and family is not None:
                family = _next_joint(task, family, middles, k)
        if family is None:
            return None
        family = _with_tip(task, family) if tip else _free_end(family)
    else:
        joint = task.counts[0] / 2.0 if task.arcs and task.counts == (1, 1) else None
        family = _untouched(task) if not tip else _tip_only(task, joint) if task.arcs else _bent_by_tip(task)
    if family is None:
        return None
    joints = _all_joints(task, family.joints, middles)
    return Postures(
        family.knots,
        family.curvatures,
        joints,
        family.parts,
        family.points,
        family.angles,
        violation(task, family.knots, family.curvatures, joints),
    )


def _family(knots: Array, curvatures: Array, joints: Array, part: int, shape: Shape, walk: Array) -> Postures:
    at = shape.walk(walk)
    return Postures(
        knots,
        curvatures,
        joints,
        np.full((len(walk), 1), part),
        at.point[:, None],
        at.angle[:, None],
        np.zeros(len(walk)),
    )


def _first_joint(task: FingerTask, middles: tuple[bool, ...]) -> Postures | None:
    """Curves from the base to the first contact, tangent there."""
    grid, ends, turns, sane = guess_table(_REACH, _GRID)
    first, last = (g[sane] for g in np.meshgrid(grid, grid, indexing="ij"))
    ends, turns = ends[sane], turns[sane]
    here, size = middles.index(True), len(middles)
    low, high = task.bounds
    room = (high - low) / 20.0
    one_arc = task.arcs and sum(task.counts[: here + 1]) == 1
    positions = np.linspace(low + room * here, high - room * (size - 1 - here), _POSITIONS)
    groups = []
    for part, shape in enumerate(task.shapes):
        points = positions[:, None] * ends
        near = np.abs(points - shape.centre) < shape.extent + task.half + _OFF * positions[:, None]
        row, column = np.nonzero(near)
        if not len(row):
            continue
        gap, walk = shape.nearest(points[row, column])
        tilt = np.remainder(turns[column] - shape.walk(walk).angle + math.pi, math.tau) - math.pi
        merit = ((gap - task.half) / (_OFF * positions[row])) ** 2 + (tilt / _TILT) ** 2
        keep = _best_per_row(row, merit, 10)
        row, column, walk = row[keep], column[keep], walk[keep]
        if not len(row):
            continue
        ell = positions[row]
        guess = np.stack([first[column], last[column]], axis=1) / ell[:, None]
        found = [] if one_arc else [_joined(task, part, ell, guess, walk)]
        even = np.abs(guess[:, 0] - guess[:, 1]) * ell < (0.4 if one_arc else 0.2) * _REACH
        ell, bent, walk, good = arc_tangent(shape, ell[even], guess[even].mean(axis=1), walk[even])
        good &= (ell >= low) & (ell <= high)
        found.append(_to_joint(part, shape, ell[good], np.stack([bent, bent], axis=1)[good], walk[good]))
        groups += found
    family = _clear(task, join(groups))
    if family is None or one_arc or len(family) > _ENOUGH:
        return family
    step = positions[1] - positions[0]
    for part, shape in enumerate(task.shapes):
        mine = family.take(family.parts[:, 0] == part)
        if not len(mine):
            continue
        _, walk = shape.nearest(mine.points[:, 0])
        old = mine.knots[:, -1]
        ell = (old[:, None] + step * _BETWEEN).ravel()
        rows = np.repeat(np.arange(len(mine)), len(_BETWEEN))
        inside = (ell >= low) & (ell <= high)
        ell, rows = ell[inside], rows[inside]
        guess = mine.curvatures[rows] * (old[rows] / ell)[:, None]
        groups.append(_joined(task, part, ell, guess, walk[rows]))
    return _clear(task, join(groups))


def _joined(task: FingerTask, part: int, ell: Array, guess: Array, walk: Array) -> Postures:
    """Curves from the base, tangent at their ends to a part, from first guesses."""
    shape = task.shapes[part]
    start = (np.zeros(len(ell), complex), np.zeros(len(ell)))
    bent, walk, good = tangent(shape, start, ell[:, None], guess, (0, 1), walk)
    good &= np.abs(bent * ell[:, None]).max(axis=1) < 2.0 * _REACH
    return _to_joint(part, shape, ell[good], bent[good], walk[good])


def _to_joint(part: int, shape: Shape, ell: Array, bent: Array, walk: Array) -> Postures:
    knots = np.stack([np.zeros_like(ell), ell], axis=1)
    return _unique(_family(knots, bent, ell[:, None], part, shape, walk))


def _next_joint(task: FingerTask, family: Postures, middles: tuple[bool, ...], here: int) -> Postures | None:
    """Curves on from the last contact to one more, with a knot half-way."""
    high = task.bounds[1]
    last = family.knots[:, -1]
    groups = []
    point, angle = _ends(family)
    for share in (0.15, 0.3, 0.45, 0.6, 0.8):
        ell = share * (high - last)
        room = ell > 0.03
        if not room.any():
            continue
        rows = np.flatnonzero(room)
        ell = ell[rows]
        for part, shape in enumerate(task.shapes):
            begin = family.curvatures[rows, -1]
            for factor in (1.0, 0.5, 2.0):
                curve = np.stack([begin, factor * begin, factor * begin], axis=1)
                start = (point[rows], angle[rows])
                lengths = np.stack([0.5 * ell, 0.5 * ell], axis=1)
                end, _, _, _ = stretch(lengths, curve)
                _, walk = shape.nearest(start[0] + np.exp(1j * start[1]) * end)
                bent, walk, good = tangent(shape, start, lengths, curve, (1, 2), walk)
                good &= np.abs(bent).max(axis=1) < 30.0
                if not good.any():
                    continue
                kept = family.take(rows[good])
                at = shape.walk(walk[good])
                there = last[rows][good] + ell[good]
                groups.append(
                    Postures(
                        np.concatenate([kept.knots, (there - 0.5 * ell[good])[:, None], there[:, None]], axis=1),
                        np.concatenate([kept.curvatures, bent[good, 1:]], axis=1),
                        np.concatenate([kept.joints, there[:, None]], axis=1),
                        np.concatenate([kept.parts, np.full((len(there), 1), part)], axis=1),
                        np.concatenate([kept.points, at.point[:, None]], axis=1),
                        np.concatenate([kept.angles, at.angle[:, None]], axis=1),
                        kept.violation,
                    )
                )
    found = join(groups)
    return None if found is None else _clear(task, _unique(found))


def _with_tip(task: FingerTask, family: Postures) -> Postures | None:
    """The postures on to the tip, which touches."""
    point, angle = _ends(family)
    rest = 1.0 - family.knots[:, -1]
    count, tries = len(family), 33
    one_arc = task.arcs and task.counts[-1] == 1
    begin = family.curvatures[:, -1]
    grid = np.linspace(-8.0, 8.0, tries)[None, :] / rest[:, None]
    grid = np.clip(grid, -25.0, 25.0)
    first = grid if one_arc else np.broadcast_to(begin[:, None], grid.shape)
    pairs = np.stack([first, grid], axis=2).reshape(-1, 2)
    end, turn, _, _ = stretch(np.repeat(rest, tries)[:, None], pairs)
    tips = point[:, None] + np.exp(1j * angle)[:, None] * end.reshape(count, tries)
    facing = angle[:, None] + turn.reshape(count, tries)
    groups = []
    for part, shape in enumerate(task.shapes):
        gap = shape.distance(tips) - task.half
        row, column = np.nonzero((gap[:, :-1] * gap[:, 1:] <= 0.0) & (gap[:, :-1] != gap[:, 1:]))
        if not len(row):
            continue
        a, b = gap[row, column], gap[row, column + 1]
        share = a / (a - b)
        guess = grid[row, column] + share * (grid[row, column + 1] - grid[row, column])
        near = tips[row, column] + share * (tips[row, column + 1] - tips[row, column])
        _, walk = shape.nearest(near)
        ahead = np.cos(shape.walk(walk).angle - facing[row, column] - 0.5 * math.pi) < 0.4
        row, guess, walk = row[ahead], guess[ahead], walk[ahead]
        curve = np.stack([guess if one_arc else begin[row], guess], axis=1)
        columns = (0, 1) if one_arc else (1,)
        bent, walk, good = touch(shape, (point[row], angle[row]), rest[row, None], curve, columns, walk)
        good &= _in_front(shape, walk, angle[row] + 0.5 * rest[row] * (bent[:, 0] + bent[:, 1]))
        kept = family.take(row[good])
        groups.append(_ended(_stepped(kept, bent[good, 0]), bent[good, 1], part, shape, walk[good]))
    found = join(groups)
    return None if found is None else _unique(found)


def _in_front(shape: Shape, walk: Array, facing: Array) -> Array:
    """Whether the front half of the rounded tip touches."""
    return np.asarray(np.cos(shape.walk(walk).angle - facing - 0.5 * math.pi) <= 1e-9)


def _stepped(kept: Postures, bent: Array) -> Postures:
    """With a step of the curvature at the end."""
    if np.array_equal(kept.curvatures[:, -1], bent):
        return kept
    knots = np.concatenate([kept.knots, kept.knots[:, -1:]], axis=1)
    curvatures = np.concatenate([kept.curvatures, bent[:, None]], axis=1)
    return Postures(knots, curvatures, kept.joints, kept.parts, kept.points, kept.angles, kept.violation)


def _ended(kept: Postures, bent: Array, part: int, shape: Shape, walk: Array) -> Postures:
    at = shape.walk(walk)
    count = len(kept)
    return Postures(
        np.concatenate([kept.knots, np.ones((count, 1))], axis=1),
        np.concatenate([kept.curvatures, bent[:, None]], axis=1),
        kept.joints,
        np.concatenate([kept.parts, np.full((count, 1), part)], axis=1),
        np.concatenate([kept.points, at.point[:, None]], axis=1),
        np.concatenate([kept.angles, at.angle[:, None]], axis=1),
        kept.violation,
    )


def _free_end(family: Postures) -> Postures:
    """The postures on to a free tip: constant curvature, which no force bends."""
    return Postures(
        np.concatenate([family.knots, np.ones((len(family), 1))], axis=1),
        np.concatenate([family.curvatures, family.curvatures[:, -1:]], axis=1),
        family.joints,
        family.parts,
        family.points,
        family.angles,
        family.violation,
    )


def _tip_only(task: FingerTask, joint: float | None, sparse: bool = False) -> Postures | None:
    """Curves from the base whose tip touches: a family of two parameters, cut along a grid both ways.

    Where ``joint`` is given they are two arcs that meet there.
    """
    grid, ends, turns, sane = guess_table(_TIP_REACH, _TIP_GRID // 2 + 1 if sparse else _TIP_GRID, joint)
    knots = np.array([0.0, 1.0] if joint is None else [0.0, joint, joint, 1.0])
    groups = []
    for part, shape in enumerate(task.shapes):
        gap = shape.distance(ends) - task.half
        straight = _straight(shape)
        if straight is not None:
            groups.append(_tips(knots, np.zeros((1, len(knots))), part, shape, straight))
        for axis in (0, 1):
            one, two = (slice(None, -1), slice(None)), (slice(1, None), slice(None))
            if axis == 1:
                one, two = one[::-1], two[::-1]
            a, b = gap[one], gap[two]
            crossed = (a * b <= 0.0) & (a != b) & sane[one] & sane[two]
            i, j = np.nonzero(crossed)
            if not len(i):
                continue
            share = (a / np.where(crossed, a - b, 1.0))[i, j]
            near = ends[one][i, j] + share * (ends[two][i, j] - ends[one][i, j])
            _, walk = shape.nearest(near)
            ahead = np.cos(shape.walk(walk).angle - turns[one][i, j] - 0.5 * math.pi) < 0.4
            i, j, share, walk = i[ahead], j[ahead], share[ahead], walk[ahead]
            count, half = len(i), len(knots) // 2
            curve = np.repeat(np.stack([grid[i], grid[j]], axis=1), half, axis=1)
            columns = tuple(range(axis * half, axis * half + half))
            curve[:, columns] += (share * (grid[1] - grid[0]))[:, None]
            start = (np.zeros(count, complex), np.zeros(count))
            lengths = np.broadcast_to(np.diff(knots), (count, len(knots) - 1))
            bent, walk, good = touch(shape, start, lengths, curve, columns, walk)
            _, turn, _, _ = stretch(lengths, bent)
            good &= _in_front(shape, walk, turn)
            groups.append(_tips(knots, bent[good], part, shape, walk[good]))
    found = join(groups)
    return None if found is None else _unique(found)


def _bent_by_tip(task: FingerTask) -> Postures | None:
    """Fingers bent by a force at their tips, which touch with that force in the friction cone."""
    table = elastica_table()
    knots = np.array(task.nodes)
    groups = [_tip_only(task, None, sparse=True)]
    cone = math.atan(task.friction) + _BESIDE_CONE
    for part, shape in enumerate(task.shapes):
        near = np.abs(table.tips - shape.centre) < shape.extent + task.half + 0.7
        gap = np.full(table.tips.shape, np.nan)
        gap[near] = shape.distance(table.tips[near]) - task.half
        with np.errstate(invalid="ignore"):
            crossed = (gap[:, :-1] * gap[:, 1:] <= 0.0) & table.sane[:, :-1] & table.sane[:, 1:]
        i, j = np.nonzero(crossed)
        share = gap[i, j] / np.where(gap[i, j] == gap[i, j + 1], 1.0, gap[i, j] - gap[i, j + 1])
        tips = table.tips[i, j] + share * (table.tips[i, j + 1] - table.tips[i, j])
        _, walk = shape.nearest(tips)
        normal = shape.walk(walk).angle
        facing = table.turns[i, j] + share * (table.turns[i, j + 1] - table.turns[i, j])
        kept = np.cos(normal - facing - 0.5 * math.pi) < 0.1
        kept &= (np.cos(table.directions[i] - normal) > math.cos(cone)) | (table.forces[i] == 0.0)
        i, j, share, walk = i[kept], j[kept], share[kept], walk[kept]
        if not len(i):
            continue
        bent = table.curvatures[i, j] + share[:, None] * (table.curvatures[i, j + 1] - table.curvatures[i, j])
        bent = bent @ projection(task.nodes).T
        count = len(i)
        start = (np.zeros(count, complex), np.zeros(count))
        lengths = np.broadcast_to(np.diff(knots), (count, len(knots) - 1))
        bent, walk, good = touch(shape, start, lengths, bent, tuple(range(len(knots))), walk)
        _, turn, _, _ = stretch(lengths, bent)
        good &= _in_front(shape, walk, turn)
        groups.append(_tips(knots, bent[good], part, shape, walk[good]))
    found = join([g for g in groups if g is not None])
    return None if found is None else _unique(found)


def _straight(shape: Shape) -> Array | None:
    """The place where the tip of the straight finger touches."""
    _, walk = shape.nearest(np.array([1j]))
    touches = abs(complex(shape.walk(walk).point[0]) - 1j) < 1e-9
    return walk if touches and _in_front(shape, walk, np.zeros(1)).all() else None


def _tips(knots: Array, bent: Array, part: int, shape: Shape, walk: Array) -> Postures:
    count = len(walk)
    return _family(np.broadcast_to(knots, (count, len(knots))), bent, np.zeros((count, 0)), part, shape, walk)


def _untouched(task: FingerTask) -> Postures:
    """A finger that touches nothing: at rest."""
    none = np.zeros((1, 0))
    bent = np.full((1, 2), task.rest)
    return Postures(np.array([[0.0, 1.0]]), bent, none, none.astype(int), none.astype(complex), none, np.zeros(1))


def _all_joints(task: FingerTask, on: Array, middles: tuple[bool, ...]) -> Array:
    """Positions of all middle contacts: those that are off spread evenly between those that are on."""
    low, high = task.bounds
    count, size = len(on), len(middles)
    if not any(middles):
        shares = np.cumsum(task.counts)[:-1] / sum(task.counts)
        return np.broadcast_to(shares, (count, size)).copy()
    out = np.zeros((count, size))
    places = [k for k in range(size) if middles[k]]
    for column, k in enumerate(places):
        out[:, k] = on[:, column]
    for a, b in pairwise([-1, *places, size]):
        left = out[:, a] if a >= 0 else np.zeros(count)
        right = out[:, b] if b < size else np.ones(count)
        for k in range(a + 1, b):
            out[:, k] = np.clip(left + (right - left) * (k - a) / (b - a), low, high)
    return out


def _ends(family: Postures) -> tuple[Array, Array]:
    """Where the curves end so far: point and angle."""
    end, turn, _, _ = stretch(np.diff(family.knots, axis=1), family.curvatures)
    return end, turn


def _best_per_row(row: Array, merit: Array, most: int) -> Array:
    """Indices of the ``most`` least merits below one of each row."""
    order = np.lexsort((merit, row))
    order = order[merit[order] < 1.0]
    if not len(order):
        return order
    starts = np.searchsorted(row[order], row[order], side="left")
    return order[np.arange(len(order)) - starts < most]


def _unique(family: Postures) -> Postures:
    """Each posture once."""
    key = np.round(np.concatenate([family.knots, 0.1 * family.curvatures], axis=1), 5)
    _, index = np.unique(key, axis=0, return_index=True)
    return family.take(np.sort(index))


def _clear(task: FingerTask, family: Postures | None) -> Postures | None:
    """Those that keep clear of the object so far, or the least deep ones where none does."""
    if family is None:
        return None
    share = np.linspace(0.0, 1.0, 33)
    at = family.knots[:, -1:] * share
    points, _ = sample(family.knots, family.curvatures, at)
    depth = task.half - task.distance(points).min(axis=1)
    good = depth <= ALLOWED
    if good.any():
        return family.take(np.flatnonzero(good))
    return family.take(np.argsort(depth, kind="stable")[:4])
