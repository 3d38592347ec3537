"""Curves from the base on which the finger lies tangent to an object at its middle contacts."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.starts.scan.curves import arc_tangent, guess_table, sample, segment_end, tangent, wrapped
from continuum_grasp.grasp.starts.scan.task import ALLOWED, FingerTask, Postures, join, touching_family, unique
from continuum_grasp.model.surfaces.outline import Outline

Array = NDArray[Any]

_REACH, _GRID = 6.0, 29
"""Greatest bend of a curve to the first contact [rad], a turn, and how many curvatures of either end are tried: one per
0.43 rad."""
_TILT, _OFF = 0.45, 0.25
"""Angle [rad] and distance [of the contact's position] by which a tried curve may miss tangency: the spacing of the
grid, so that the curve next to a solution is within."""
_POSITIONS = 10
"""Positions of a contact along the finger that are tried first; `_BETWEEN` adds more where few postures are found."""
_BETWEEN = (np.array([-0.67, -0.33, 0.33, 0.67]), np.array([-0.5, -0.17, 0.17, 0.5]))
"""Shifts of the contacts found, in spacings of the positions, in two rounds."""
_ENOUGH = 16
"""Postures clear of the object from which on no more positions are tried: with fewer, short feasible pieces of a branch
are missed."""
_ARCS = 49
"""Bends of the arcs that are tried, as there is one number to scan: one per 0.25 rad."""
_NEAR, _STEEP = 0.12, 0.7
"""Distance of two neighbors [L] up to which, and change of their bends [rad] from which on, curves between them are
sought: a branch is steep there."""


def first_joint(task: FingerTask) -> Postures | None:
    """Curves from the base to the first contact, tangent there."""
    here, size = task.middles.index(True), len(task.middles)
    low, high = task.bounds
    # Of several contacts each leaves space for the others: a twentieth of the range, half a spacing of the positions.
    spare = (high - low) / 20.0
    positions = np.linspace(low + spare * here, high - spare * (size - 1 - here), _POSITIONS)
    if task.one_arc_to_joint:
        bends = np.linspace(-_REACH, _REACH, _ARCS)
        ends, turns, _, _ = segment_end(np.ones((_ARCS, 1)), np.stack([bends, bends], axis=1))
        groups = []
        for part, shape in enumerate(task.shapes):
            row, column, walk = _guesses(task, shape, positions, ends, turns)
            ell = positions[row]
            groups.append(_arcs_to_joint(task, part, ell, bends[column] / ell, walk))
        return _clear(task, join(groups))
    grid, ends, turns = guess_table(_REACH, _GRID)
    bent = np.stack([v.ravel() for v in np.meshgrid(grid, grid, indexing="ij")], axis=1)
    groups = []
    for part, shape in enumerate(task.shapes):
        row, column, walk = _guesses(task, shape, positions, ends.ravel(), turns.ravel())
        ell = positions[row]
        guess = bent[column] / ell[:, None]
        groups.append(_to_joint(task, part, ell, guess, walk))
        # Where both ends are curved nearly alike, the arc nearby is tried too.
        even = np.abs(guess[:, 0] - guess[:, 1]) * ell < 0.2 * _REACH
        groups.append(_arcs_to_joint(task, part, ell[even], guess[even].mean(axis=1), walk[even]))
    family = _clear(task, join(groups))
    for between in _BETWEEN:
        if family is None or len(family) > _ENOUGH:
            break
        more = moved_joint(task, family, (positions[1] - positions[0]) * between)
        family = _clear(task, join([family] if more is None else [family, more]))
    more = None if family is None else _between(task, family)
    return family if family is None or more is None else _clear(task, join([family, more]))


def _between(task: FingerTask, family: Postures) -> Postures | None:
    """Curves between neighbors of a family that differ much."""
    groups = []
    for part, shape in enumerate(task.shapes):
        mine = family.take(family.parts[:, 0] == part)
        mine = mine.take(np.argsort(mine.knots[:, 1], kind="stable"))
        at, bent = mine.knots[:, 1], mine.curvatures[:, :2] * mine.knots[:, 1:2]
        change = np.abs(np.diff(bent, axis=0)).max(axis=1, initial=0.0)
        # Those that differ by far more are no neighbors but of two branches.
        rows = np.flatnonzero((np.diff(at) < _NEAR) & (np.diff(at) > 1e-3) & (change > _STEEP) & (change < 8 * _STEEP))
        if not len(rows):
            continue
        _, walk = shape.nearest(mine.points[:, 0])
        shares = np.array([0.25, 0.5, 0.75])
        ell = (at[rows, None] + shares * np.diff(at)[rows, None]).ravel()
        first, second = bent[rows, None, :], bent[rows + 1, None, :]
        guess = (first + shares[:, None] * (second - first)).reshape(-1, 2) / ell[:, None]
        groups.append(_to_joint(task, part, ell, guess, np.repeat(walk[rows], 3)))
    return join(groups)


def _guesses(
    task: FingerTask, shape: Outline, positions: Array, ends: Array, turns: Array
) -> tuple[Array, Array, Array]:
    """Curves, of a table of length one, that come near to being tangent at given positions, to which they are scaled:
    indices of positions and curves, and walks.
    """
    points = positions[:, None] * ends
    row, column = np.nonzero(np.abs(points - shape.center) < shape.extent + task.half + _OFF * positions[:, None])
    gap, walk = shape.nearest(points[row, column])
    tilt = wrapped(turns[column] - shape.walk(walk).angle)
    merit = ((gap - task.half) / (_OFF * positions[row])) ** 2 + (tilt / _TILT) ** 2
    near = merit < 1.0
    return row[near], column[near], walk[near]


def _round_corners(shape: Outline) -> tuple[Array, Array, Array]:
    """Arcs from the base that are tangent to the circles round the corners of a grown outline.

    The center of an arc that starts along +Y is at (-radius, 0); it touches a circle of radius ``grown`` round a corner
    where their centers are ``radius - grown`` apart.
    """
    corners, grown = shape.corners, shape.grown
    radius = (grown**2 - np.abs(corners) ** 2) / (2.0 * _away_from_zero(corners.real + grown))
    turn = np.angle((corners + radius) / _away_from_zero(radius - grown))
    ell = np.mod(turn * np.sign(radius), math.tau) * np.abs(radius)
    _, walk = shape.nearest(corners + grown * np.exp(1j * turn))
    return ell, 1.0 / _away_from_zero(radius), walk


def _away_from_zero(x: Array) -> Array:
    return np.where(np.abs(x) < 1e-9, 1e-9, x)


def _arcs_to_joint(task: FingerTask, part: int, ell: Array, bent: Array, walk: Array) -> Postures:
    """Circular arcs from the base, tangent at their ends to a part, from first guesses and those round its corners."""
    (low, high), shape = task.bounds, task.shapes[part]
    more = _round_corners(shape)
    ell, bent, walk = (np.concatenate(pair) for pair in zip((ell, bent, walk), more, strict=True))
    ell, bent, walk, good = arc_tangent(shape, np.clip(ell, low, high), bent, walk)
    good &= (ell >= low) & (ell <= high)
    return _ending(part, shape, ell[good], np.stack([bent, bent], axis=1)[good], walk[good])


def _to_joint(task: FingerTask, part: int, ell: Array, guess: Array, walk: Array) -> Postures:
    """Curves from the base, tangent at their ends to a part, from first guesses."""
    shape = task.shapes[part]
    start = (np.zeros(len(ell), complex), np.zeros(len(ell)))
    bent, walk, good = tangent(shape, start, ell[:, None], guess, (0, 1), walk)
    good &= np.abs(bent * ell[:, None]).max(axis=1) < 2.0 * _REACH
    return _ending(part, shape, ell[good], bent[good], walk[good])


def _ending(part: int, shape: Outline, ell: Array, bent: Array, walk: Array) -> Postures:
    knots = np.stack([np.zeros_like(ell), ell], axis=1)
    return unique(touching_family(knots, bent, ell[:, None], part, shape, walk))


def moved_joint(task: FingerTask, family: Postures, shifts: Array) -> Postures | None:
    """Curves to the first contact, moved along the finger by ``shifts`` from those of a family."""
    low, high = task.bounds
    groups = []
    for part, shape in enumerate(task.shapes):
        mine = family.take(family.parts[:, 0] == part)
        if not len(mine):
            continue
        _, walk = shape.nearest(mine.points[:, 0])
        old = mine.knots[:, 1]
        ell = (old[:, None] + shifts).ravel()
        rows = np.repeat(np.arange(len(mine)), len(shifts))
        inside = (ell >= low) & (ell <= high)
        ell, rows = ell[inside], rows[inside]
        # A shorter curve with the same bends is the same shape, smaller.
        guess = mine.curvatures[rows, :2] * (old[rows] / ell)[:, None]
        groups.append(_to_joint(task, part, ell, guess, walk[rows]))
    return join(groups)


def next_joint(task: FingerTask, family: Postures) -> Postures | None:
    """Curves on from the last contact to one more, with a knot half-way."""
    last = family.knots[:, -1]
    groups = []
    point, angle = ends_of(family)
    for share in (0.15, 0.3, 0.45, 0.6, 0.8):
        ell = share * (task.bounds[1] - last)
        # Shorter than 3 % of the length, no curve is worth a start.
        rows = np.flatnonzero(ell > 0.03)
        if not len(rows):
            continue
        ell, begin, start = ell[rows], family.curvatures[rows, -1], (point[rows], angle[rows])
        lengths = np.stack([0.5 * ell, 0.5 * ell], axis=1)
        for part, shape in enumerate(task.shapes):
            # On as before, straighter, or more bent.
            for factor in (1.0, 0.5, 2.0):
                curve = np.stack([begin, factor * begin, factor * begin], axis=1)
                end, _, _, _ = segment_end(lengths, curve)
                _, walk = shape.nearest(start[0] + np.exp(1j * start[1]) * end)
                bent, walk, good = tangent(shape, start, lengths, curve, (1, 2), walk)
                if not good.any():
                    continue
                retained = family.take(rows[good])
                there = last[rows][good] + ell[good]
                knots = np.stack([there - 0.5 * ell[good], there], axis=1)
                longer = retained.on_to(knots, bent[good, 1:], part, shape.walk(walk[good]))
                groups.append(replace(longer, joints=np.concatenate([retained.joints, there[:, None]], axis=1)))
    found = join(groups)
    return None if found is None else _clear(task, unique(found))


def ends_of(family: Postures) -> tuple[Array, Array]:
    """Where the curves end so far: point and angle."""
    end, turn, _, _ = segment_end(np.diff(family.knots, axis=1), family.curvatures)
    return end, turn


def _clear(task: FingerTask, family: Postures | None) -> Postures | None:
    """Those clear of the object so far, or the least deep ones where none is."""
    if family is None:
        return None
    at = family.knots[:, -1:] * np.linspace(0.0, 1.0, 33)
    depth = task.half - task.distance(sample(family.knots, family.curvatures, at)).min(axis=1)
    good = depth <= ALLOWED
    return family.take(np.flatnonzero(good) if good.any() else np.argsort(depth, kind="stable")[:4])
