"""All postures of a finger of two curves that touch an object at one middle contact, with its tip, or with both.

Those with a middle contact form curves over the place of that contact on the outline (of arcs, single points); those of
two arcs that touch with the tip alone are in `two_arcs`.

1. Even places on each part's outline, from the point on that is farthest from the base.
2. First curves to each place that are tangent there, on either side and with any turn: a table, then Newton's method.
3. Places between those where first curves change so fast that what follows would change, too.
4. Of each first curve a grid of end curvatures; where the gap of the tip changes its sign, or may between three of them
   (a fold), a bracketed root has the tip touch.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from continuum_grasp.base import Numbers as Array
from continuum_grasp.grasp.starts.scan import kernel
from continuum_grasp.grasp.starts.scan.curves import MOST_TURN, NODES, WEIGHTS, bends_to, exact_bends, wrapped
from continuum_grasp.grasp.starts.scan.task import FRONT, TIP_REACH, TIPS, FingerTask, Postures, Rows, object_numbers
from continuum_grasp.model import GrownOutline

_ROOT = 8
"""Steps of a bracketed root: after the first ones each gains digits as the secant method does."""
_ROUNDED = 1e-10
"""Gap that is none [L]."""


PLACES = 256
"""Places of a contact on each part's outline."""
_EVEN, _MOST = 0.12, 24
"""Difference of first curves at neighboring places, in the turn [rad] and the shift [L] of what follows, from which on
there are places between, and into how many parts the way is cut at most: folds have no end."""
_FOLD = (1.2, 0.6)
"""Differences of bend and turn of neighbors [rad] that are beyond a fold."""


class Ring:
    """Even places on the outlines of an object's parts, by a number in [0, `PLACES`) each, from the point on that is
    farthest from the base, so that they turn and mirror with the object.
    """

    def __init__(self, task: FingerTask) -> None:
        self.task, self._walks = task, []
        for shape in task.shapes:
            # Whole faces and corners, so that they are measured alike wherever the walk begins.
            fine = np.union1d(np.linspace(0.0, shape.period, 4 * PLACES + 1), shape.joints)
            middle = 0.5 * (fine[1:] + fine[:-1])
            at = shape.walk(middle)
            # Even in length and in the turn of the normal.
            share = np.diff(fine) * (np.abs(at.dpoint) / (shape.extent + task.half) + np.abs(at.dangle))
            passed = np.concatenate([[0.0], np.cumsum(share)])
            passed *= PLACES / passed[-1]
            k = int(np.argmax(np.abs(at.point)))
            low, high = fine[k] - np.diff(fine)[k - 1], fine[k + 1] + np.diff(fine)[(k + 1) % len(middle)]
            first = float(np.interp(np.mod(_farthest(shape, low, high), shape.period), fine, passed))
            self._walks.append((passed, fine, first))

    def at(self, parts: Array, places: Array) -> tuple[Array, Array]:
        """Points on the grown outlines and angles of the outward normals (B,)."""
        point, angle = np.zeros(len(parts), complex), np.zeros(len(parts))
        for part, (shape, (passed, fine, first)) in enumerate(zip(self.task.shapes, self._walks, strict=True)):
            mine = parts == part
            spot = shape.walk(np.interp(np.mod(places[mine] + first, PLACES), passed, fine))
            point[mine], angle[mine] = spot.point, spot.angle
        return point, angle


def _farthest(shape: GrownOutline, low: float, high: float) -> float:
    """The walk between two at which an outline is farthest from the base."""
    # To the last digit, which decides where curves of short pieces end.
    while low < 0.5 * (low + high) < high:
        walks = np.linspace(low, high, 9)
        at = shape.walk(walks)
        k = int(np.clip(np.sum((at.point.conj() * at.dpoint).real > 0.0) - 1, 0, 7))
        low, high = walks[k], walks[k + 1]
    return 0.5 * (low + high)


@dataclass(frozen=True)
class Branch(Rows):
    """P curves to a middle contact, and, where the tip touches too, on to the tip."""

    part: Array  # of the object that is touched
    side: Array  # +1: the object on the finger's left
    place: Array  # on the ring
    point: Array  # complex, on the grown outline
    normal: Array  # angle [rad]
    turn: Array  # of the section [rad]
    joint: Array  # position of the contact
    ends: Array  # (P, 4) curvatures at both ends of both curves
    tip: Array  # part that the tip touches
    tip_point: Array
    tip_normal: Array

    @property
    def knots(self) -> Array:
        """(P, 4)"""
        ones = np.ones(len(self))
        return np.stack([0.0 * ones, self.joint, self.joint, ones], axis=1)

    def postures(self, task: FingerTask) -> Postures:
        """The postures of a task with one middle contact at most."""
        middle, tip = int(any(task.middles)), int(task.tip)
        return Postures(
            knots=self.knots,
            curvatures=self.ends,
            joints=self.joint[:, None][:, :middle],
            parts=np.stack([self.part] * middle + [self.tip] * tip, axis=1),
            points=np.stack([self.point] * middle + [self.tip_point] * tip, axis=1),
            angles=np.stack([self.normal] * middle + [self.tip_normal] * tip, axis=1),
            violation=np.zeros(len(self)),
        )


def scanned(task: FingerTask) -> Branch:
    """All postures with a middle contact at the places of a ring, and between those where they change fast."""
    ring = Ring(task)
    parts = np.repeat(np.arange(len(task.shapes)), PLACES)
    places = np.tile(np.arange(float(PLACES)), len(task.shapes))
    point, normal = ring.at(parts, places)
    if task.one_arc_to_joint:
        first = _arcs(task, ring, point, normal)
    else:
        first = _clothoids(task, parts, places, point, normal)
        first = first.followed_by([_between(ring, first)])
        first = first.take(_within(task, first))
    return onwards(task, first)[0]


def beside(task: FingerTask, some: Branch, shifts: Array) -> tuple[Branch, Array]:
    """The postures next to some at places shifted along the ring by shifts (P, S), and the row that each is from."""
    ring, rows = Ring(task), np.repeat(np.arange(len(some)), shifts.shape[1])
    old = some.take(rows)
    new, good = _moved(ring, old, old.place + shifts.ravel(), old.turn, old.ends[:, 0] * old.joint)
    good &= _within(task, new)
    new, rows = new.take(good), rows[good]
    if not task.tip:
        return _free(new), rows
    # The tip's root next to the old one.
    last = new.ends[:, 3]
    # 2.5: greatest change of an end curvature, in spacings of the scan
    width = 2.5 * (2.0 * TIP_REACH / (TIPS - 1)) / (1.0 - new.joint)
    branch, index = _tips(task, new, last[:, None] + width[:, None] * np.linspace(-1.0, 1.0, 7))
    # Of several the nearest.
    away = np.abs(branch.ends[:, 3] - last[index])
    order = np.lexsort((away, index))
    _, unique = np.unique(index[order], return_index=True)
    return branch.take(order[unique]), rows[index[order[unique]]]


def _moved(ring: Ring, old: Branch, places: Array, turn: Array, bend: Array) -> tuple[Branch, Array]:
    """First curves like some at other places, next to guesses of turn and bend, and which were found."""
    point, normal = ring.at(old.part, places)
    turn = turn + wrapped(np.where(old.side > 0, normal, normal + math.pi) - turn)
    bend, length, good = exact_bends(point, turn, bend)
    ends = np.stack([bend / length, (2.0 * turn - bend) / length], axis=1)
    new = replace(old, place=places, point=point, normal=normal, turn=turn, joint=length)
    return replace(new, ends=np.concatenate([ends, old.ends[:, 2:]], axis=1)), good


def _between(ring: Ring, first: Branch) -> Branch:
    """First curves at places between those of neighbors that differ much, as what follows would, too."""
    first = first.take(np.argsort(first.place, kind="stable"))
    bend = first.ends[:, 0] * first.joint
    after = np.mod(first.place + 1.0, PLACES)
    low, high = (np.searchsorted(first.place, after + d) for d in (-0.5, 0.5))
    earlier = np.repeat(np.arange(len(first)), high - low)
    later = low[earlier] + np.arange(len(earlier)) - np.searchsorted(earlier, earlier)
    alike = (first.part[earlier] == first.part[later]) & (first.side[earlier] == first.side[later])
    off = np.abs(bend[later] - bend[earlier]), np.abs(first.turn[later] - first.turn[earlier])
    alike &= (off[0] < _FOLD[0]) & (off[1] < _FOLD[1])
    earlier, later, off = earlier[alike], later[alike], (off[0] + off[1])[alike]
    # Of several that follow one the nearest.
    order = np.lexsort((off, earlier))
    earlier, index = np.unique(earlier[order], return_index=True)
    later = later[order][index]
    late = first.ends[:, 1]
    change = np.abs(late[later] - late[earlier]) * (1.0 - np.minimum(first.joint[earlier], 1.0))
    change += np.abs(first.turn[later] - first.turn[earlier]) + np.abs(first.joint[later] - first.joint[earlier])
    parts = np.minimum(np.ceil(change / _EVEN), _MOST).astype(int)
    rows = np.repeat(np.arange(len(earlier)), np.maximum(parts - 1, 0))
    step = np.arange(len(rows)) - np.searchsorted(rows, rows) + 1.0
    share = step / np.maximum(parts[rows], 1)
    earlier, later = earlier[rows], later[rows]
    turn = first.turn[earlier] + share * (first.turn[later] - first.turn[earlier])
    branch, good = _moved(
        ring,
        first.take(earlier),
        first.place[earlier] + share,
        turn,
        bend[earlier] + share * (bend[later] - bend[earlier]),
    )
    return branch.take(good)


def _clothoids(task: FingerTask, parts: Array, places: Array, point: Array, normal: Array) -> Branch:
    high = task.bounds[1]
    near = np.flatnonzero(np.abs(point) <= high)
    # No curve is longer than the last position of the contact, so that its curvature bends it by this at most.
    limit = task.bending_range * sum(task.counts[: task.middles.index(True) + 1])
    limit = 1.05 * min(limit, float(np.max(task.limits)) * (1.0 + ABOVE) * high)
    every = np.meshgrid((1, -1), (-math.tau, 0.0, math.tau), near, indexing="ij")
    side, winding, row = (each.ravel() for each in every)
    turn = wrapped(normal[row] + np.where(side > 0, 0.0, math.pi)) + winding
    fits = np.abs(turn) < min(MOST_TURN, limit)
    row, side, turn = row[fits], side[fits], turn[fits]
    index, guess = bends_to(point[row], turn, limit)
    row, side, turn = row[index], side[index], turn[index]
    some = (np.abs(guess) < limit) & (np.abs(2.0 * turn - guess) < limit)
    row, side, turn, guess = row[some], side[some], turn[some], guess[some]
    bend, length, good = exact_bends(point[row], turn, guess)
    ends = np.stack([bend, 2.0 * turn - bend], axis=1) / length[:, None]
    branch = started(parts[row], side, places[row], point[row], normal[row], turn, length, ends)
    return branch.take(good)


def started(
    part: Array, side: Array, place: Array, point: Array, normal: Array, turn: Array, joint: Array, ends: Array
) -> Branch:
    """Curves to a contact, by curvatures at both ends (P, 2)."""
    none = np.zeros(len(part))
    ends = np.concatenate([ends, ends[:, 1:], ends[:, 1:]], axis=1)
    return Branch(part, side, place, point, normal, turn, joint, ends, none.astype(int), none + 0j, none)


def _arcs(task: FingerTask, ring: Ring, point: Array, normal: Array) -> Branch:
    """Circular arcs that are tangent at their ends: their turn is twice the angle of the chord."""

    def off(points: Array, normals: Array, side: Array) -> Array:
        return np.asarray(wrapped(2.0 * np.angle(-1j * points) - normals - np.where(side > 0, 0.0, math.pi)))

    both = np.array([1, -1])
    here = off(point, normal, both[:, None]).reshape(2, -1, PLACES)
    there = np.roll(here, -1, axis=2)
    which = np.nonzero((here * there <= 0.0) & (np.abs(here - there) < 0.5 * math.pi))
    sides, parts, start = both[which[0]], which[1], which[2].astype(float)

    def gap(share: Array) -> Array:
        points, normals = ring.at(parts, start + share)
        return off(points, normals, sides)

    share = bracketed_root(gap, np.zeros(len(start)), np.ones(len(start)), here[which], there[which])
    points, normals = ring.at(parts, start + share)
    turn = 2.0 * np.angle(-1j * points)
    half = np.where(np.abs(turn) < 1e-9, 1e-9, 0.5 * turn)
    length = np.abs(points) * half / np.sin(half)
    ends = (2.0 * half / length)[:, None] * np.ones(2)
    branch = started(parts, sides, start + share, points, normals, turn, length, ends)
    return branch.take((np.abs(gap(share)) < 1e-6) & _within(task, branch))


def _within(task: FingerTask, branch: Branch) -> Array:
    """Whether position and greatest curvature are within bounds, but for a little that the solver removes."""
    low, high = task.bounds
    greatest = np.abs(branch.ends[:, :2]).max(axis=1)
    range_ = task.bending_range * sum(task.counts[: task.middles.index(True) + 1])
    return np.asarray(
        (branch.joint >= low - 1e-9)
        & (branch.joint <= high + 1e-9)
        & (greatest * branch.joint <= range_ * (1.0 + 1e-6))
        & (greatest <= np.max(task.limits) * (1.0 + ABOVE))
    )


ABOVE = 0.02
"""Part by which a curvature may be above its limit."""


def _free(branch: Branch) -> Branch:
    """On to a free tip with constant curvature."""
    ends = branch.ends.copy()
    ends[:, 2:] = ends[:, 1:2]
    return replace(branch, ends=ends)


def onwards(task: FingerTask, first: Branch) -> tuple[Branch, Array]:
    """On from the last contact to the tip, and the row that each goes on from."""
    if not len(first) or not task.tip:
        return _free(first), np.arange(len(first))
    rest = 1.0 - first.joint
    reach = np.minimum(np.minimum(TIP_REACH, _range_after(task)) / rest, np.max(task.limits) * (1.0 + ABOVE))
    return _tips(task, first, reach[:, None] * np.linspace(-1.0, 1.0, TIPS))


def _range_after(task: FingerTask) -> float:
    """Greatest product of length and curvature of the last curve [rad]."""
    return task.bending_range * sum(task.counts[len(task.middles) - task.middles[::-1].index(True) :])


def _tips(task: FingerTask, first: Branch, grid: Array) -> tuple[Branch, Array]:
    """Curves on to a tip that touches, with end curvatures between those of a grid (P, G) for each, and the row that
    each goes on from.
    """
    one_arc = task.arcs and task.counts[-1] == 1
    rest, begin = 1.0 - first.joint, first.ends[:, 1]

    def tips(rows: Array, last: Array) -> tuple[Array, Array]:
        """Tips (R, G) and angles of the sections there."""
        ell = rest[rows, None]
        start = last if one_arc else begin[rows, None]
        late = 0.5 * NODES**2
        angle = first.turn[rows, None, None] + ell[..., None] * (
            start[..., None] * (NODES - late) + last[..., None] * late
        )
        move = ell * (-(np.sin(angle) @ WEIGHTS) + 1j * (np.cos(angle) @ WEIGHTS))
        return first.point[rows, None] + move, first.turn[rows, None] + 0.5 * ell * (start + last)

    start = np.stack([first.point.real, first.point.imag, first.turn, rest], axis=1)
    rule = object_numbers(task.shapes), NODES, WEIGHTS

    def gaps(rows: Array, last: Array) -> Array:
        """Gaps (R, G) between such tips and the object."""
        if kernel.library():
            numbers = *last.shape, len(NODES), int(one_arc), *rule, start[rows], begin[rows], last
            return kernel.called("tip_gaps", np.empty(last.shape), *numbers) - task.half
        return task.rough_distance(tips(rows, last)[0]) - task.half

    gap = gaps(np.arange(len(first)), grid)
    rows, columns = np.nonzero(gap[:, :-1] * gap[:, 1:] <= 0.0)
    # Both ends of each bracket, and the gaps there.
    after = columns + 1
    ends = np.stack([grid[rows, columns], grid[rows, after], gap[rows, columns], gap[rows, after]])
    # Where the curves of both roots fold, they lie between two lines of the grid.
    row, column, least = folds(grid, gap)
    if len(row):
        between = gaps(row, least[:, None])[:, 0]
        two = between * gap[row, column] < 0.0
        row, column, least, between = row[two], column[two], least[two], between[two]
        rows = np.concatenate([rows, row, row])
        left = np.stack([grid[row, column - 1], least, gap[row, column - 1], between])
        right = np.stack([least, grid[row, column + 1], between, gap[row, column + 1]])
        ends = np.concatenate([ends, left, right], axis=1)

    def miss(last: Array) -> Array:
        return np.asarray(gaps(rows, last[:, None])[:, 0])

    if kernel.library():
        numbers = len(rows), len(NODES), int(one_arc), _ROOT, task.half, _ROUNDED, *rule, start[rows], begin[rows], ends
        last = kernel.called("tip_roots", np.empty(len(rows)), *numbers)
    else:
        last = bracketed_root(miss, *ends)
    tip, facing = (v[:, 0] for v in tips(rows, last[:, None]))
    part, point, normal = task.touched(tip)
    ahead = np.cos(normal - facing - 0.5 * math.pi) <= FRONT
    if not one_arc:  # the second curve begins with the curvature that the first one ends with
        ahead &= np.abs(begin[rows]) * rest[rows] <= _range_after(task) * (1.0 + 1e-6)
    rows, last, part, point, normal = rows[ahead], last[ahead], part[ahead], point[ahead], normal[ahead]
    branch = first.take(rows)
    ends = np.stack([branch.ends[:, 0], branch.ends[:, 1], last if one_arc else branch.ends[:, 1], last], axis=1)
    return replace(branch, ends=ends, tip=part, tip_point=point, tip_normal=normal), rows


def folds(grid: Array, gap: Array) -> tuple[Array, Array, Array]:
    """Folds where gaps (P, G) on even grids turn back next to zero without a change of sign: rows, columns, and the
    vertices of the parabolas through three neighbors.
    """
    before, here, after = gap[:, :-2], gap[:, 1:-1], gap[:, 2:]
    bend = before - 2.0 * here + after
    turns = (before * here > 0.0) & (here * after > 0.0) & (here * bend > 0.0)
    turns &= np.abs(here) <= np.minimum(np.abs(before), np.abs(after))
    rows, columns = np.nonzero(turns)
    here, bend, slope = here[rows, columns], bend[rows, columns], (after - before)[rows, columns]
    # 0.05: least gap of a parabola through three end curvatures, per its second difference, from which on both roots
    # may lie between: the error of the parabola
    near = np.sign(here) * (here - 0.125 * slope**2 / bend) < 0.05 * np.abs(bend)
    rows, columns, share = rows[near], columns[near] + 1, -0.5 * (slope / bend)[near]
    at = grid[rows, columns]
    return rows, columns, at + share * (grid[rows, columns + 1] - at)


def bracketed_root(gap: Any, low: Array, high: Array, at_low: Array, at_high: Array) -> Array:
    """Roots in brackets (B,) by the method of false position with Illinois' halving, which never leaves them."""
    a, b, fa, fb = low, high, at_low, at_high
    for _ in range(_ROOT):
        x = b - fb * (b - a) / np.where(fb == fa, 1.0, fb - fa)
        fx = gap(x)
        crossed = fb * fx < 0.0
        # An end that stays counts half.
        a, fa = np.where(crossed, b, a), np.where(crossed, fb, 0.5 * fa)
        b, fb = x, fx
        if np.abs(fx).max(initial=0.0) < _ROUNDED:
            break
    return b
