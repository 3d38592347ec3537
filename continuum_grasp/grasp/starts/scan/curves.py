"""Backbones for the search: curvature linear between knots, many curves at once; those that touch by Newton's method.

Lengths are in units of the finger's length; planar vectors are complex; a curve starts at 0 with tangent i. B curves
with K knots: ``knots`` (B, K), ``curvatures`` (B, K).
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from continuum_grasp.base import Numbers as Array
from continuum_grasp.grasp.starts.scan import kernel
from continuum_grasp.model import GrownOutline


def gauss_legendre(count: int) -> tuple[Array, Array]:
    """Nodes and weights (count,) of the Gauss-Legendre rule on [0, 1]."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return 0.5 * (nodes + 1.0), 0.5 * weights


NODES, WEIGHTS = gauss_legendre(12)
"""Rule on an interval, which may bend by more than a turn."""
EXACT = 1e-12
"""Residual, in lengths of the finger or sizes of the object and rad, at which something touches: rounding after a few
operations."""


def segment_end(lengths: Array, curvatures: Array) -> tuple[Array, Array, Array, Array]:
    """Ends of curves of several intervals of the given lengths (B, K - 1), with derivatives.

    Returns the end points (B,), from the start and turned so that the start's tangent is i, the angles (B,) there, and
    the derivatives (B, K) of both with respect to the curvatures (B, K).
    """
    count, size = curvatures.shape
    turn = np.zeros(count)
    dturn = np.zeros((count, size))
    end = np.zeros(count, complex)
    dend = np.zeros((count, size), complex)
    # Curvature is linear in the share u of an interval: per length its first value turns by u - u^2 / 2, its last by
    # u^2 / 2.
    late = NODES * (0.5 * NODES)
    early = NODES - late
    for k in range(size - 1):
        ell = lengths[:, k : k + 1]
        weights = ell * WEIGHTS
        angle = turn[:, None] + ell * (curvatures[:, k : k + 1] * early + curvatures[:, k + 1 : k + 2] * late)
        tangent = np.empty(angle.shape, complex)
        tangent.real, tangent.imag = -np.sin(angle) * weights, np.cos(angle) * weights
        end = end + tangent.sum(axis=1)
        across = 1j * tangent
        dend[:, :k] += across.sum(axis=1)[:, None] * dturn[:, :k]
        dend[:, k] += (across * (dturn[:, k : k + 1] + ell * early)).sum(axis=1)
        dend[:, k + 1] += (across * (ell * late)).sum(axis=1)
        dturn[:, k] += 0.5 * lengths[:, k]
        dturn[:, k + 1] += 0.5 * lengths[:, k]
        turn = turn + 0.5 * lengths[:, k] * (curvatures[:, k] + curvatures[:, k + 1])
    return end, turn, dend, dturn


def turning(knots: Array, curvatures: Array, at: Array) -> Array:
    """Angle of the section (B, S) at positions ``at`` (B, S)."""
    angle = np.zeros(at.shape)
    for k in range(knots.shape[1] - 1):
        if (knots[:, k] == knots[:, k + 1]).all():  # where the curvature may step
            continue
        ell = np.maximum(knots[:, k + 1 : k + 2] - knots[:, k : k + 1], 1e-300)
        u = np.clip(at - knots[:, k : k + 1], 0.0, ell)
        slope = (curvatures[:, k + 1 : k + 2] - curvatures[:, k : k + 1]) / ell
        angle += u * (curvatures[:, k : k + 1] + 0.5 * slope * u)
    return angle


def curvature_at(knots: Array, curvatures: Array, at: Array) -> Array:
    """Curvature (B, S) at positions ``at`` (B, S)."""
    out = np.broadcast_to(curvatures[:, :1], at.shape).copy()
    for k in range(knots.shape[1] - 1):
        ell = np.maximum(knots[:, k + 1 : k + 2] - knots[:, k : k + 1], 1e-300)
        share = np.clip((at - knots[:, k : k + 1]) / ell, 0.0, 1.0)
        out += share * (curvatures[:, k + 1 : k + 2] - curvatures[:, k : k + 1])
    return out


def sample(knots: Array, curvatures: Array, at: Array) -> Array:
    """Points (B, S) at increasing positions ``at`` (B, S), the first of which is 0."""
    if kernel.library():
        return kernel.called("sample", np.empty(at.shape, complex), *knots.shape, at.shape[1], knots, curvatures, at)
    step = np.diff(at, axis=1)
    # Samples lie close to each other.
    inner = at[:, :-1, None] + step[..., None] * gauss_legendre(2)[0]
    angle = turning(knots, curvatures, inner.reshape(len(inner), 2 * step.shape[1])).reshape(inner.shape)
    move = np.empty(step.shape, complex)
    # Real functions: numpy's complex exponential takes longer.
    move.real, move.imag = -0.5 * step * np.sin(angle).sum(axis=2), 0.5 * step * np.cos(angle).sum(axis=2)
    return np.concatenate([np.zeros((len(move), 1), complex), np.cumsum(move, axis=1)], axis=1)


def bends(knots: Array, curvatures: Array, joints: Array, counts: tuple[int, ...]) -> Array:
    """Greatest length times curvature of an element (B,), which is its bend where it is an arc; the segments between
    base, ``joints`` (B, J) and tip have ``counts`` equal elements each.
    """
    size = len(joints)
    marks = np.concatenate([np.zeros((size, 1)), joints, np.ones((size, 1))], axis=1)
    ends = [
        marks[:, k : k + 1] + (marks[:, k + 1 : k + 2] - marks[:, k : k + 1]) * (np.arange(n) / n)
        for k, n in enumerate(counts)
    ]
    at = np.concatenate([*ends, np.ones((size, 1))], axis=1)
    lengths = np.diff(at, axis=1)
    # Just inside the elements, since the curvature may step from one to the next.
    inside = 1e-9 * lengths
    near = np.maximum(
        np.abs(curvature_at(knots, curvatures, at[:, :-1] + inside)),
        np.abs(curvature_at(knots, curvatures, at[:, 1:] - inside)),
    )
    return np.asarray((lengths * near).max(axis=1))


def table_of(firsts: Array, lasts: Array, joint: float | None) -> tuple[Array, Array]:
    """End points and angles of curves of length one by first and last curvature."""
    first, last = np.meshgrid(firsts, lasts, indexing="ij")
    pairs = np.stack([first.ravel(), last.ravel()], axis=1)
    lengths = np.array([1.0])
    if joint is not None:
        pairs, lengths = pairs[:, [0, 0, 1, 1]], np.array([joint, 0.0, 1.0 - joint])
    end, turn, _, _ = segment_end(np.broadcast_to(lengths, (len(pairs), len(lengths))), pairs)
    return end.reshape(first.shape), turn.reshape(first.shape)


def touch(
    shape: GrownOutline, start: tuple[Array, Array], lengths: Array, curvatures: Array, ways: Array, walk: Array
) -> tuple[Array, Array, Array]:
    """Curves whose end lies on the grown outline; with two ways also with the section's X axis along its normal.

    They start at points and angles ``start`` (B,); from first guesses, changes of the curvatures (B, K) along ``ways``
    (n, K) and the place ``walk`` (B,) on the outline are sought. Returns curvatures, walks, and which were found (B,).
    """
    point, angle = start
    phase = np.exp(1j * angle)
    unknown = np.column_stack([np.zeros((len(walk), len(ways))), walk])
    good = np.zeros(len(walk), bool)
    rows = np.arange(len(walk))
    # 14: most Newton steps
    for _ in range(14):
        if not len(rows):
            break
        u = unknown[rows]
        end, turn, dend, dturn = segment_end(lengths[rows], curvatures[rows] + u[:, :-1] @ ways)
        at = shape.walk(u[:, -1])
        off = point[rows] + phase[rows] * end - at.point
        moves = phase[rows] * (dend @ ways.T).T
        left, slopes = [off.real, off.imag], [[*moves.real, -at.dpoint.real], [*moves.imag, -at.dpoint.imag]]
        if len(ways) == 2:
            left.append(wrapped(angle[rows] + turn - at.angle))
            slopes.append([*(dturn @ ways.T).T, -at.dangle])
        wrong = np.abs(left).max(axis=0)
        good[rows[wrong < EXACT]] = True
        going = (wrong >= EXACT) & np.isfinite(wrong)
        rows = rows[going]
        change = _solve([[part[going] for part in row] for row in slopes], [part[going] for part in left])
        # One factor for all unknowns keeps the direction of the step.
        cut = np.minimum(1.0, 0.15 * shape.period / np.maximum(np.abs(change[-1]), 1e-300))
        unknown[rows] -= cut[:, None] * np.stack(change, axis=1)
    return curvatures + unknown[:, :-1] @ ways, unknown[:, -1], good


def wrapped(angle: Array) -> Array:
    """Angles [rad] as they are within half a turn."""
    return np.asarray(np.remainder(angle + math.pi, math.tau) - math.pi)


def _solve(a: list[list[Array]], b: list[Array]) -> list[Array]:
    """Cramer's rule for many systems of two or three equations; `numpy.linalg.solve` loops over them."""
    if len(b) == 2:
        det = _safe(a[0][0] * a[1][1] - a[0][1] * a[1][0])
        return [(b[0] * a[1][1] - a[0][1] * b[1]) / det, (a[0][0] * b[1] - b[0] * a[1][0]) / det]
    (p, q, r), (u, v, w), (x, y, z) = a
    one, two, three = v * z - w * y, w * x - u * z, u * y - v * x
    det = _safe(p * one + q * two + r * three)
    return [
        (b[0] * one + b[1] * (r * y - q * z) + b[2] * (q * w - r * v)) / det,
        (b[0] * two + b[1] * (p * z - r * x) + b[2] * (r * u - p * w)) / det,
        (b[0] * three + b[1] * (q * x - p * y) + b[2] * (p * v - q * u)) / det,
    ]


def _safe(det: Array) -> Array:
    return np.where(np.abs(det) < 1e-14, 1e-14, det)


MOST_TURN = 6.6
"""Greatest turn of a tabulated curve [rad]: a whole one and 0.3 rad more, as elements are limited to a whole one."""
_MOST_BEND = 12.0
"""Greatest first curvature, per length: of a curve that turns by a whole turn and whose curvature grows from zero."""
_TURNS, _BENDS = 129, 97
"""Size of the table: 0.1 rad and 0.25 apart, so that linear interpolation is good to 2e-3 of the length."""
_EARLY, _LATE = NODES - NODES**2, NODES**2
_RULES = np.stack([WEIGHTS, WEIGHTS * _EARLY], axis=1)


@cache
def _table() -> tuple[Array, Array, Array, Array]:
    """Turns, first curvatures, chords (2, turn, first curvature) by their parts, and their changes to the next turn."""
    turns = np.linspace(-MOST_TURN, MOST_TURN, _TURNS)
    bends = np.linspace(-_MOST_BEND, _MOST_BEND, _BENDS)
    grid = np.meshgrid(turns, bends, indexing="ij")
    chord = chords(grid[1].ravel(), grid[0].ravel())[0].reshape(grid[0].shape)
    parts = np.stack([chord.real, chord.imag])
    return turns, bends, parts, np.diff(parts, axis=1)


def chords(bend: Array, turn: Array) -> tuple[Array, Array]:
    """From first curvatures and turns (B,) of curves of length one that start at 0 with tangent i: their ends (B,), and
    the derivatives of these by the first curvature.

    The curvature is linear: bend + 2 (turn - bend) s.
    """
    angle = bend[:, None] * _EARLY + turn[:, None] * _LATE
    # Real products: numpy takes mixed ones through complex copies.
    across, along = np.sin(angle) @ _RULES, np.cos(angle) @ _RULES
    return -across[:, 0] + 1j * along[:, 0], -along[:, 1] - 1j * across[:, 1]


def bends_to(aims: Array, turns: Array, limit: float = _MOST_BEND) -> tuple[Array, Array]:
    """All curves of length one whose chord has the direction of an aim (R,), given their turn (R,), with first
    curvatures up to a limit: row and first curvature of each.
    """
    tabled, bends, table, change = _table()
    at = (turns - tabled[0]) / (tabled[1] - tabled[0])
    if kernel.library():
        edges = max(int(np.searchsorted(bends, -limit)) - 1, 0), int(np.searchsorted(bends, limit)) + 1
        numbers = len(aims), _TURNS, _BENDS, edges[0], min(edges[1], _BENDS), table, aims / np.abs(aims), at
        crossings = kernel.called("crossings", np.empty(1 + 2 * _BENDS * len(aims)), *numbers)
        rows, column = crossings[1 : 1 + 2 * int(crossings[0])].reshape(-1, 2).T
        return rows.astype(int), bends[0] + (bends[1] - bends[0]) * column
    index = np.clip(at.astype(int), 0, _TURNS - 2)
    share = (at - index)[:, None]
    some = slice(max(int(np.searchsorted(bends, -limit)) - 1, 0), int(np.searchsorted(bends, limit)) + 1)
    bends = bends[some]
    x, y = (part[index, some] + step[index, some] * share for part, step in zip(table, change, strict=True))
    back = np.conj(aims / np.abs(aims))[:, None]
    off = x * back.imag + y * back.real
    right = off < 0.0
    rows, columns = np.nonzero(right[:, 1:] != right[:, :-1])
    # Those in the direction of the aim, not against it.
    middle = x[rows, columns] + x[rows, columns + 1], y[rows, columns] + y[rows, columns + 1]
    ahead = middle[0] * back.real[rows, 0] > middle[1] * back.imag[rows, 0]
    rows, columns = rows[ahead], columns[ahead]
    first, last = off[rows, columns], off[rows, columns + 1]
    return rows, bends[columns] + (bends[1] - bends[0]) * first / (first - last)


def exact_bends(aims: Array, turns: Array, guess: Array) -> tuple[Array, Array, Array]:
    """First curvatures (R,) next to a guess, with which the chord has the direction of the aim (R,); the curves'
    lengths then, and which were found near the guess.
    """
    back = np.conj(aims / np.abs(aims))
    if kernel.library():
        numbers = len(aims), len(NODES), NODES, WEIGHTS, np.conj(back), turns, guess
        bend, along, across = kernel.called("exact_bends", np.empty((3, len(aims))), *numbers)
        good = (np.abs(across) < 1e-9) & (along > 1e-3)
        return bend, np.abs(aims) / np.where(good, along, 1.0), good
    bend = guess
    off = chord = np.zeros(0, complex)
    for _ in range(4):
        chord, slope = chords(bend, turns)
        off, fall = chord * back, (slope * back).imag
        bend = bend - off.imag / np.where(np.abs(fall) < 1e-9, 1e-9, fall)
    chord, _ = chords(bend, turns)
    off = chord * back
    good = (np.abs(off.imag) < 1e-9) & (off.real > 1e-3)
    return bend, np.abs(aims) / np.where(good, off.real, 1.0), good
