"""Clothoids of length one, from a table and exactly: curves to the first contact are these, scaled."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.starts.scan import kernel
from continuum_grasp.grasp.starts.scan.curves import NODES, WEIGHTS

Array = NDArray[Any]

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
        found = kernel.called("crossings", np.empty(1 + 2 * _BENDS * len(aims)), *numbers)
        rows, column = found[1 : 1 + 2 * int(found[0])].reshape(-1, 2).T
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
