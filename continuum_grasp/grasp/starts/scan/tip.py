"""Fingers whose tips touch: on from a middle contact, or alone."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.starts.scan.curves import guess_table, segment_end, table_of, touch
from continuum_grasp.grasp.starts.scan.elastica import elastica_table, projection
from continuum_grasp.grasp.starts.scan.joint import ends_of
from continuum_grasp.grasp.starts.scan.task import FingerTask, Postures, join, touching_family, unique
from continuum_grasp.model.surfaces.outline import Outline

Array = NDArray[Any]

_TIP_REACH, _TIP_GRID = 8.0, 33
"""Greatest end curvature [1/L] and size of the grid of clothoids whose tips may touch: 0.5 1/L apart."""
_ARCS_REACH, _ARCS_GRID = 13.0, 53
"""The same of two arcs, each of which has a part of the length for its bend."""
_BESIDE_CONE = 0.15
"""Angle outside the friction cone up to which a start is used [rad]: half a spacing of the directions of `elastica`."""
_BESIDE = 0.01
"""Cosine between tangent and normal up to which a tip still touches with its front."""
_FEW, _ZOOMS, _ZOOMED = 3, 3, 11
"""Where fewer than 3 tips touch, the grid is refined up to 3 times by 11 x 11 around the nearest miss: an object hardly
in reach is touched in a patch smaller than the grid's cells."""


def with_tip(task: FingerTask, family: Postures) -> Postures | None:
    """The postures on to the tip, which touches."""
    point, angle = ends_of(family)
    rest = 1.0 - family.knots[:, -1]
    count, tries = len(family), 33
    one_arc = task.arcs and task.counts[-1] == 1
    begin = family.curvatures[:, -1]
    grid = np.linspace(-8.0, 8.0, tries)[None, :] / rest[:, None]
    grid = np.clip(grid, -25.0, 25.0)
    first = grid if one_arc else np.broadcast_to(begin[:, None], grid.shape)
    pairs = np.stack([first, grid], axis=2).reshape(-1, 2)
    end, turn, _, _ = segment_end(np.repeat(rest, tries)[:, None], pairs)
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
        turn = facing[row, column] + share * (facing[row, column + 1] - facing[row, column])
        # Newton's method may still turn the tip: only crossings well behind its front are dropped; `_in_front` decides.
        ahead = np.cos(shape.walk(walk).angle - turn - 0.5 * math.pi) < 0.4
        row, guess, walk = row[ahead], guess[ahead], walk[ahead]
        curve = np.stack([guess if one_arc else begin[row], guess], axis=1)
        columns = (0, 1) if one_arc else (1,)
        bent, walk, good = touch(shape, (point[row], angle[row]), rest[row, None], curve, columns, walk)
        good &= _in_front(shape, walk, angle[row] + 0.5 * rest[row] * (bent[:, 0] + bent[:, 1]))
        retained = family.take(row[good])
        groups.append(_ended(_stepped(retained, bent[good, 0]), bent[good, 1], part, shape, walk[good]))
    found = join(groups)
    return None if found is None else unique(found)


def _in_front(shape: Outline, walk: Array, facing: Array) -> Array:
    """Whether the front half of the rounded tip touches."""
    return np.asarray(np.cos(shape.walk(walk).angle - facing - 0.5 * math.pi) <= _BESIDE)


def _stepped(retained: Postures, bent: Array) -> Postures:
    """With a step of the curvature at the end."""
    if np.array_equal(retained.curvatures[:, -1], bent):
        return retained
    knots = np.concatenate([retained.knots, retained.knots[:, -1:]], axis=1)
    curvatures = np.concatenate([retained.curvatures, bent[:, None]], axis=1)
    return replace(retained, knots=knots, curvatures=curvatures)


def _ended(retained: Postures, bent: Array, part: int, shape: Outline, walk: Array) -> Postures:
    return retained.on_to(np.ones((len(retained), 1)), bent[:, None], part, shape.walk(walk))


def tip_only(task: FingerTask, joint: float | None, sparse: bool = False) -> Postures | None:
    """Curves from the base whose tip touches: a family of two parameters, cut along a grid both ways.

    Where ``joint`` is given they are two arcs that meet there.
    """
    reach, count = (_TIP_REACH, _TIP_GRID // 2 + 1) if sparse else (_TIP_REACH, _TIP_GRID)
    if joint is not None:
        reach, count = _ARCS_REACH, _ARCS_GRID
    grid, ends, turns, sane = guess_table(reach, count, joint)
    knots = np.array([0.0, 1.0] if joint is None else [0.0, joint, joint, 1.0])
    groups = []
    for part, shape in enumerate(task.shapes):
        gap = shape.distance(ends) - task.half
        straight = _straight(shape)
        if straight is not None:
            groups.append(_tips(knots, np.zeros((1, len(knots))), part, shape, straight))
        found = _crossings(part, shape, knots, (grid, grid), (gap, ends, turns, sane))
        width, at = grid[1] - grid[0], (grid, grid)
        for _ in range(_ZOOMS):  # hardly in reach: what touches may lie between the grid's lines
            if sum(len(g) for g in found) >= _FEW:
                break
            _, walk = shape.nearest(ends)
            ahead = sane & (np.cos(shape.walk(walk).angle - turns - 0.5 * math.pi) < 0.0)
            if not ahead.any():
                break
            i, j = np.unravel_index(np.argmin(np.where(ahead, np.abs(gap), np.inf)), gap.shape)
            near = width * np.linspace(-1.0, 1.0, _ZOOMED)
            at, width = (at[0][i] + near, at[1][j] + near), near[1] - near[0]
            ends, turns, sane = table_of(*at, joint)
            gap = shape.distance(ends) - task.half
            found += _crossings(part, shape, knots, at, (gap, ends, turns, sane))
        groups += found
    every = join(groups)
    return None if every is None else unique(every)


def _crossings(
    part: int, shape: Outline, knots: Array, grids: tuple[Array, Array], table: tuple[Array, Array, Array, Array]
) -> list[Postures]:
    """Curves whose tip touches, between neighbors on a grid of first and last curvatures."""
    gap, ends, turns, sane = table
    groups = []
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
        turn = turns[one][i, j] + share * (turns[two][i, j] - turns[one][i, j])
        ahead = np.cos(shape.walk(walk).angle - turn - 0.5 * math.pi) < 0.4
        i, j, share, walk = i[ahead], j[ahead], share[ahead], walk[ahead]
        half = len(knots) // 2
        curve = np.repeat(np.stack([grids[0][i], grids[1][j]], axis=1), half, axis=1)
        columns = tuple(range(axis * half, axis * half + half))
        curve[:, columns] += (share * (grids[axis][1] - grids[axis][0]))[:, None]
        groups.append(_touching(knots, curve, columns, part, shape, walk))
    return groups


def bent_by_tip(task: FingerTask) -> Postures | None:
    """Fingers bent by a force at their tips, which touch with that force in the friction cone."""
    table = elastica_table()
    knots = np.array(task.nodes)
    groups = [_at_nodes(tip_only(task, None, sparse=True), knots)]
    cone = math.atan(task.friction) + _BESIDE_CONE
    for part, shape in enumerate(task.shapes):
        near = np.abs(table.tips - shape.center) < shape.extent + task.half + 0.7
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
        retained = np.cos(normal - facing - 0.5 * math.pi) < 0.1
        retained &= (np.cos(table.directions[i] - normal) > math.cos(cone)) | (table.forces[i] == 0.0)
        i, j, share, walk = i[retained], j[retained], share[retained], walk[retained]
        if not len(i):
            continue
        bent = table.curvatures[i, j] + share[:, None] * (table.curvatures[i, j + 1] - table.curvatures[i, j])
        groups.append(_touching(knots, bent @ projection(task.nodes).T, tuple(range(len(knots))), part, shape, walk))
    found = join([g for g in groups if g is not None])
    return None if found is None else unique(found)


def _at_nodes(family: Postures | None, knots: Array) -> Postures | None:
    """The same curves, whose curvature is linear all along, with more knots."""
    if family is None:
        return None
    bent = family.curvatures[:, :1] + (family.curvatures[:, 1:] - family.curvatures[:, :1]) * knots
    every = np.broadcast_to(knots, bent.shape)
    return replace(family, knots=every, curvatures=bent)


def _straight(shape: Outline) -> Array | None:
    """The place where the tip of the straight finger touches."""
    _, walk = shape.nearest(np.array([1j]))
    touches = abs(complex(shape.walk(walk).point[0]) - 1j) < 1e-9
    return walk if touches and _in_front(shape, walk, np.zeros(1)).all() else None


def _touching(knots: Array, bent: Array, columns: tuple[int, ...], part: int, shape: Outline, walk: Array) -> Postures:
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


def moved_tip(task: FingerTask, family: Postures, step: float) -> Postures | None:
    """Fingers whose tips alone touch, next to those of a family: each knot's curvature changed both ways."""
    knots = family.knots[0]
    if len(knots) < 3 or not np.array_equal(family.knots, np.broadcast_to(knots, family.knots.shape)):
        return None
    groups = []
    size = len(knots)
    changes = step * np.concatenate([np.eye(size), -np.eye(size)])
    columns = tuple(range(size))
    if size == 4 and knots[1] == knots[2]:  # two arcs
        changes = step * np.array([-1.0, -0.5, -0.2, 0.2, 0.5, 1.0])[:, None] * np.array([1.0, 1.0, 0.0, 0.0])
        columns = (2, 3)
    for part, shape in enumerate(task.shapes):
        mine = family.take(family.parts[:, 0] == part)
        if not len(mine):
            continue
        _, walk = shape.nearest(mine.points[:, 0])
        bent = (mine.curvatures[:, None, :] + changes).reshape(-1, size)
        groups.append(_touching(knots, bent, columns, part, shape, np.repeat(walk, len(changes))))
    return join(groups)
