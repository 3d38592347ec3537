"""Shapes that a rod takes under a force at its tip: the fingers that touch with their tips alone.

A table of them, computed once, in units of the finger's length L and of E I / L^2: initial curvature, force and its
direction against the base. Where the tip of one touches an object and the force points out of it within the friction
cone, a finger with the right tension is in balance there; its own weight is neglected.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

_FIRST = np.linspace(-10.0, 10.0, 65)
"""Initial curvatures [1/L]: up to one and a half turns over the length either way."""
_FORCES = np.array(
    [0.05, 0.2, 0.5, 1.0, 1.8, 3.0, 4.5, 6.5, 9.0, 12.0, 16.0, 21.0, 27.0, 35.0, 45.0, 60.0, 80.0, 110.0]
)
"""Forces at the tip [E I / L^2]: from those that hardly bend a straight finger, to 45 times the clamped-free
buckling load, pi^2 / 4."""
_DIRECTIONS = 36
"""Directions of the force: 10 degrees apart, well within the friction cones, of 53 degrees at a coefficient of 0.5."""
_STEPS = 32
"""Steps of the midpoint rule: the tip is off by 0.1 % of the length (median; 0.8 % at the 95th percentile), and
Newton's method makes every start touch exactly afterwards."""


@dataclass(frozen=True)
class ElasticaTable:
    """Shapes by case (force and its direction; the first is no force) and initial curvature."""

    directions: Array  # (F,) angle of the force on the finger [rad]
    forces: Array  # (F,)
    tips: Array  # (F, C) complex
    curvatures: Array  # (F, C, S) at evenly spaced positions


@lru_cache(1)
def elastica_table() -> ElasticaTable:
    """The table, from the midpoint rule."""
    angles = math.tau * (np.arange(_DIRECTIONS) + 0.5) / _DIRECTIONS
    directions = np.concatenate([[0.0], np.tile(angles, len(_FORCES))])
    forces = np.concatenate([[0.0], np.repeat(_FORCES, _DIRECTIONS)])
    pull = (forces * np.exp(1j * directions))[:, None]
    shape = (len(forces), len(_FIRST))
    bent = np.broadcast_to(_FIRST, shape).copy()
    turn, tip = np.zeros(shape), np.zeros(shape, complex)
    curvatures = np.empty((*shape, _STEPS + 1))
    curvatures[..., 0] = bent
    step = 1.0 / _STEPS
    # Balance of moments of the elastica, with E I = 1: d(curvature)/ds = -(tangent x force).
    for k in range(_STEPS):
        half_turn = turn + 0.5 * step * bent
        half_bent = bent - 0.5 * step * (np.conj(1j * np.exp(1j * turn)) * pull).imag
        tangent = 1j * np.exp(1j * half_turn)
        turn = turn + step * half_bent
        tip = tip + step * tangent
        bent = bent - step * (np.conj(tangent) * pull).imag
        curvatures[..., k + 1] = bent
    return ElasticaTable(directions, forces, tip, curvatures)


@lru_cache(32)
def projection(knots: tuple[float, ...]) -> Array:
    """Matrix (K, S) from curvatures at the table's positions to those at ``knots``, linear between, that are nearest
    to them in the mean square.
    """
    at = np.linspace(0.0, 1.0, _STEPS + 1)
    hats = np.stack([np.interp(at, knots, unit) for unit in np.eye(len(knots))])
    weights = np.full(len(at), 1.0 / _STEPS)
    weights[[0, -1]] *= 0.5
    return np.asarray(np.linalg.solve((hats * weights) @ hats.T, hats * weights))
