"""A closed chain of lines and arcs: joints, bulges, and derivatives by both."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.base import Array
from continuum_grasp.scene.objects.measured.noise import frames
from continuum_grasp.scene.value import SAME

_STEP = 1e-6
"""Step of the differences that differentiate residuals, per length of a piece [1]: near the cube root of rounding."""


@dataclass(frozen=True)
class LineArcChain:
    """Pieces between joints.

    Attributes
    ----------
    joints : Array
        Start of each piece (k, 2).
    bulges : Array
        Height of each arc over half its chord, positive to the left of it (k,) [1]; zero of lines.
    is_arc : Array
        Whether each piece is an arc (k,).
    smooth : Array
        Whether the direction is continuous at each joint (k,).
    """

    joints: Array
    bulges: Array
    is_arc: Array
    smooth: Array

    @property
    def chords(self) -> Array:
        return np.asarray(np.roll(self.joints, -1, axis=0) - self.joints)

    @property
    def turns(self) -> Array:
        """Turn of the direction at each joint [rad]."""
        along = np.arctan2(self.chords[:, 1], self.chords[:, 0])
        half = 2.0 * np.arctan(self.bulges)
        return np.asarray(np.remainder(along + half - np.roll(along - half, 1) + np.pi, 2.0 * np.pi) - np.pi)

    def moved(self, by: Array) -> LineArcChain:
        """The chain with joints and bulges changed (k, 3)."""
        return replace(self, joints=self.joints + by[:, :2], bulges=self.bulges + np.where(self.is_arc, by[:, 2], 0.0))

    @property
    def reach(self) -> Array:
        """Length of the shorter piece at each joint."""
        lengths = np.linalg.norm(self.chords, axis=1)
        return np.asarray(np.minimum(lengths, np.roll(lengths, 1)))

    def distances(self, points: Array, owner: NDArray[np.int_]) -> Array:
        """Signed distance of each point from the line or circle of its piece, positive to the left."""
        return _distances(self.joints, self.chords, self.bulges, points, owner)

    def drawn(self, turn: float, parts: int) -> tuple[Array, Array]:
        """Return points of the chain, and whether each is a joint or divides an arc by the greatest turn [rad];
        ``parts`` lie between these.
        """
        rows, knots = [], []
        for start, chord, bulge in zip(self.joints, self.chords, self.bulges, strict=True):
            half = 2.0 * np.arctan(bulge)
            count = parts * int(np.ceil(2.0 * abs(half) / turn)) if abs(half) > SAME else 1
            at = half * (1.0 - 2.0 * np.arange(count) / count)
            # From the start, in the frame of the chord, of length 1; angles from the middle of the arc.
            radius = 0.5 / np.sin(half) if count > 1 else 0.0
            u = 0.5 - radius * np.sin(at) if count > 1 else np.zeros(1)
            v = radius * (np.cos(at) - np.cos(half))
            left = np.array([-chord[1], chord[0]])
            rows.append(start + u[:, None] * chord + v[:, None] * left)
            knots.append(np.arange(count) % parts == 0)
        return np.concatenate(rows), np.concatenate(knots)


def slopes_of(chain: LineArcChain, points: Array, owner: NDArray[np.int_]) -> Array:
    """Derivatives of the distances (n, 5) by the start of each point's piece, its bulge, and its end."""
    lengths = np.linalg.norm(chain.chords, axis=1)
    columns = []
    for k in range(5):
        step = _STEP * (lengths if k != 2 else np.ones_like(lengths))
        ends = []
        for sign in (1.0, -1.0):
            # Both ends of all pieces apart from each other, so that one difference serves all pieces.
            start, end, bulges = chain.joints.copy(), chain.joints + chain.chords, chain.bulges.copy()
            if k == 2:
                bulges += sign * step
            else:
                (start if k < 2 else end)[:, k % 3] += sign * step
            ends.append(_distances(start, end - start, bulges, points, owner))
        columns.append((ends[0] - ends[1]) / (2.0 * step[owner]))
    return np.stack(columns, axis=1)


def turn_slopes_of(chain: LineArcChain) -> Array:
    """Derivatives of the turns at the joints by all parameters (k, 3k)."""
    count = len(chain.joints)
    lengths = np.linalg.norm(chain.chords, axis=1)
    squares = lengths**2
    # The angle of a chord (x, y) changes by (-y, x) / length2 with its end.
    by_end = np.stack([-chain.chords[:, 1], chain.chords[:, 0]], axis=1) / squares[:, None]
    by_bulge = 2.0 / (1.0 + chain.bulges**2)
    rows = np.zeros((count, 3 * count))
    for k in range(count):
        before, after = (k - 1) % count, (k + 1) % count
        rows[k, 3 * after : 3 * after + 2] += by_end[k]
        rows[k, 3 * k : 3 * k + 2] -= by_end[k]
        rows[k, 3 * k : 3 * k + 2] -= by_end[before]
        rows[k, 3 * before : 3 * before + 2] += by_end[before]
        rows[k, 3 * k + 2] += by_bulge[k]
        rows[k, 3 * before + 2] += by_bulge[before]
    return rows


def _distances(starts: Array, chords: Array, bulges: Array, points: Array, owner: NDArray[np.int_]) -> Array:
    """Signed distances of points from the lines and circles of their pieces."""
    chord = chords[owner]
    length = np.linalg.norm(chord, axis=1)
    middle = starts[owner] + 0.5 * chord
    u, v = (c[:, 0] for c in frames((points - middle)[:, None], chord / length[:, None]))
    half = 0.5 * length
    height = bulges[owner] * half
    # The circle through the ends is height (u2 + v2 - half2) + v (half2 - height2) = 0: no radius becomes infinite.
    value = height * (u * u + v * v - half * half) + v * (half * half - height * height)
    slope = half * half + height * height
    return np.asarray(2.0 * value / (slope + np.sqrt(np.maximum(slope * slope + 4.0 * height * value, 0.0))))
