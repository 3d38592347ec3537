"""Least gaps along fingers: densely sampled, then closer and closer about the least."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from continuum_grasp.base import Numbers as Array
from continuum_grasp.grasp.judge.space_rod import SpaceRod

SAMPLES = 401
"""Places along a finger at which gaps are sampled first."""
_ROUNDS = 4
"""Rounds about a least gap, each eight times as fine: to 6e-7 of the length, and gaps to the square of that."""
_FINE = np.linspace(0.0, 1.0, 17)

Gap = Callable[[Array, Array], Array]
"""Gaps (n,) [m] at positions (n,) along a rod [m], whose points are (n, 3) [m]."""


class SampledRod:
    """A rod with its center line densely sampled."""

    def __init__(self, rod: SpaceRod) -> None:
        self.rod = rod
        self.s = np.unique(np.concatenate([np.linspace(0.0, rod.length, SAMPLES), rod.edges]))
        self.places = rod.at(self.s)
        self.points, self.half = self.places.points, rod.half(self.s)

    @property
    def step(self) -> float:
        """Greatest distance between samples along the rod [m]."""
        return float(np.diff(self.s).max())

    def least(self, gap: Gap, start: float = 0.0) -> float:
        """Least gap [m] from a position on; a gap changes by no more than the position does."""
        s = self.s[self.s >= start]
        if not s.size:
            return np.inf
        sampled = gap(s, self.points[self.s >= start])
        if not np.isfinite(sampled).all():
            return np.nan
        padded = np.concatenate([[np.inf], sampled, [np.inf]])
        least = (sampled <= padded[:-2]) & (sampled <= padded[2:]) & (sampled <= sampled.min() + 2.0 * self.step)
        k = np.flatnonzero(least)
        low, high = s[np.maximum(k - 1, 0)], s[np.minimum(k + 1, s.size - 1)]
        for _ in range(_ROUNDS):
            fine = low[:, None] + _FINE * (high - low)[:, None]
            found = gap(fine.ravel(), self.rod.at(fine.ravel()).points).reshape(fine.shape)
            j, rows = found.argmin(axis=1), np.arange(k.size)
            low, high = fine[rows, np.maximum(j - 1, 0)], fine[rows, np.minimum(j + 1, _FINE.size - 1)]
        return min(float(sampled.min()), float(found.min()))


def apart(first: SampledRod, other: SampledRod) -> float:
    """Least gap between two fingers [m]: the distance of their center lines less half of both thicknesses."""
    p, q = np.meshgrid(np.arange(first.s.size - 1), np.arange(other.s.size - 1), indexing="ij")
    return _least_gap(first, other, p.ravel(), q.ravel())


def apart_from_itself(rod: SampledRod) -> float:
    """Least gap between parts of a finger [m]; its length where none can meet.

    Parts are half a circle of the finger's half thickness from each other along it: a rod that bends no sharper than
    its skin allows cannot touch itself closer by.
    """
    tangents = rod.places.axes[:, :, 1]
    turn = np.arccos(np.clip((tangents[:-1] * tangents[1:]).sum(axis=1), -1.0, 1.0))
    if turn.sum() < np.pi and (turn * np.maximum(rod.half[1:], rod.half[:-1]) <= np.diff(rod.s)).all():
        return rod.rod.length
    p, q = np.triu_indices(rod.s.size - 1, 1)
    far = rod.s[q] - rod.s[p + 1] > np.pi * np.maximum(rod.half[p], rod.half[q])
    return _least_gap(rod, rod, p[far], q[far]) if far.any() else rod.rod.length


def _least_gap(first: SampledRod, other: SampledRod, p: Array, q: Array) -> float:
    """Least gap of pairs (m,) of chords, each as thick as its thicker end."""
    a, b, c, d = first.points[p], first.points[p + 1], other.points[q], other.points[q + 1]
    thick = np.maximum(first.half[p], first.half[p + 1]) + np.maximum(other.half[q], other.half[q + 1])
    # Chords whose ends are far apart are farther than others, whatever lies between.
    ends = np.linalg.norm(a - c, axis=1) - thick
    if np.isnan(ends).any():
        return np.nan
    near = ends <= ends.min() + 2.0 * (first.step + other.step)
    return float((chord_distance(a[near], b[near], c[near], d[near]) - thick[near]).min())


def chord_distance(a: Array, b: Array, c: Array, d: Array) -> Array:
    """Distances (m,) of chords a b and c d in space; zero where they cross.

    The distance is convex in both places: the nearest places of the lines, moved into the chords one after the other.
    """
    u, v, w = b - a, d - c, c - a
    uu, vv, uv = (u * u).sum(axis=1), (v * v).sum(axis=1), (u * v).sum(axis=1)
    uw, vw = (u * w).sum(axis=1), (v * w).sum(axis=1)
    square = uu * vv - uv**2
    tiny = 1e-300
    x = np.clip(np.where(square > 1e-12 * uu * vv, (uw * vv - vw * uv) / np.maximum(square, tiny), 0.0), 0.0, 1.0)
    y = np.clip((x * uv - vw) / np.maximum(vv, tiny), 0.0, 1.0)
    x = np.clip((y * uv + uw) / np.maximum(uu, tiny), 0.0, 1.0)
    return np.asarray(np.linalg.norm(w + y[:, None] * v - x[:, None] * u, axis=1))
