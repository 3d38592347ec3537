"""Clothoids of length one, from a table and exactly: curves to the first contact are these, scaled."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

MOST_TURN = 6.6
"""Greatest turn of a tabulated curve [rad]: a whole one and 0.3 rad more, as elements are limited to a whole one."""
_MOST_BEND = 12.0
"""Greatest first curvature, per length: of a curve that turns by a whole turn and whose curvature grows from zero."""
_TURNS, _BENDS = 129, 97
"""Size of the table: 0.1 rad and 0.25 apart, so that linear interpolation is good to 2e-3 of the length."""
_X, _W = np.polynomial.legendre.leggauss(12)
_AT, _WEIGHTS = 0.5 * (_X + 1.0), 0.5 * _W
"""Gauss-Legendre rule of 12 nodes on [0, 1]: good to 1e-8 for the most crooked curve of the table."""
_EARLY, _LATE = _AT - _AT**2, _AT**2
_RULES = np.stack([_WEIGHTS, _WEIGHTS * _EARLY], axis=1)


@cache
def _table() -> tuple[Array, Array, Array]:
    """Turns, first curvatures, and chords by turn and first curvature."""
    turns = np.linspace(-MOST_TURN, MOST_TURN, _TURNS)
    bends = np.linspace(-_MOST_BEND, _MOST_BEND, _BENDS)
    grid = np.meshgrid(turns, bends, indexing="ij")
    chord, _ = chords(grid[1].ravel(), grid[0].ravel())
    return turns, bends, chord.reshape(grid[0].shape)


def chords(bend: Array, turn: Array) -> tuple[Array, Array]:
    """From first curvatures and turns (B,) of curves of length one that start at 0 with tangent i: their ends (B,), and
    the derivatives of these by the first curvature.

    The curvature is linear: bend + 2 (turn - bend) s.
    """
    angle = bend[:, None] * _EARLY + turn[:, None] * _LATE
    # Real products: numpy takes mixed ones through complex copies.
    across, along = np.sin(angle) @ _RULES, np.cos(angle) @ _RULES
    return -across[:, 0] + 1j * along[:, 0], -along[:, 1] - 1j * across[:, 1]


def bends_to(aims: Array, turns: Array) -> tuple[Array, Array]:
    """All curves of length one whose chord has the direction of an aim (R,), given their turn (R,): row and first
    curvature of each.
    """
    tabled, bends, table = _table()
    at = (turns - tabled[0]) / (tabled[1] - tabled[0])
    index = np.clip(at.astype(int), 0, _TURNS - 2)
    share = (at - index)[:, None]
    chord = table[index] * (1.0 - share) + table[index + 1] * share
    off = chord * np.conj(aims / np.abs(aims))[:, None]
    low, high = off[:, :-1], off[:, 1:]
    rows, columns = np.nonzero((low.imag * high.imag <= 0.0) & (low.real + high.real > 0.0))
    first, last = low.imag[rows, columns], high.imag[rows, columns]
    guess = bends[columns] + (bends[1] - bends[0]) * first / np.where(first == last, 1.0, first - last)
    return rows, guess


def exact_bends(aims: Array, turns: Array, guess: Array, away: float) -> tuple[Array, Array, Array]:
    """First curvatures (R,) next to a guess, with which the chord has the direction of the aim (R,); the curves'
    lengths then, and which were found within ``away`` of the guess.
    """
    back = np.conj(aims / np.abs(aims))
    bend = guess
    off = chord = np.zeros(0, complex)
    for _ in range(4):
        chord, slope = chords(bend, turns)
        off, fall = chord * back, (slope * back).imag
        step = off.imag / np.where(np.abs(fall) < 1e-9, 1e-9, fall)
        bend = np.clip(bend - step, guess - away, guess + away)
    chord, _ = chords(bend, turns)
    off = chord * back
    good = (np.abs(off.imag) < 1e-9) & (off.real > 1e-3)
    return bend, np.abs(aims) / np.where(good, off.real, 1.0), good
