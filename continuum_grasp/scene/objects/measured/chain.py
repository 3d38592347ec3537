"""A closed chain of lines and arcs through measured points, by least squares: joints, bulges, and their uncertainty."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.scene.objects.measured.noise import Noise, frames
from continuum_grasp.scene.objects.measured.pieces import Piece

_STEP = 1e-6
"""Difference, per length of a piece, by which residuals are differentiated [1]: near the cube root of rounding."""
_STEPS = 20
"""Steps of Gauss and Newton at most; a chain next to its points takes three to six."""
_STIFF = 1e3
"""How many times stiffer than the points a joint is that is smooth [1]: it turns by a thousandth of the noise."""
_HUBER = 2.0
"""Residual, per scatter, beyond which points pull no stronger [1]: 95 % of normal noise are within."""


@dataclass(frozen=True)
class Chain:
    """Pieces between joints.

    Attributes
    ----------
    joints : Array
        Where piece k begins (k, 2).
    bulges : Array
        Height of each arc over half its chord, positive to the left of it (k,) [1]; zero of lines.
    is_arc : Array
        Which pieces are arcs (k,).
    smooth : Array
        Joints at which the direction does not change (k,).
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

    def moved(self, by: Array) -> Chain:
        """The chain with joints and bulges changed (k, 3)."""
        return replace(self, joints=self.joints + by[:, :2], bulges=self.bulges + np.where(self.is_arc, by[:, 2], 0.0))

    def distances(self, points: Array, owner: Array) -> Array:
        """Signed distance of each point from the line or circle of its piece, positive to the left."""
        return _distances(self.joints, self.chords, self.bulges, points, owner)

    def drawn(self, chord_turn: float) -> Array:
        """Points of the chain: its joints, and points of arcs no more than an angle apart [rad]."""
        rows = []
        for start, chord, bulge in zip(self.joints, self.chords, self.bulges, strict=True):
            count = max(int(np.ceil(4.0 * abs(np.arctan(bulge)) / chord_turn)), 1)
            half = 2.0 * np.arctan(bulge)
            at = half * (1.0 - 2.0 * np.arange(count) / count)
            if count == 1 or abs(half) < 1e-12:
                rows.append(start[None])
                continue
            radius = 0.5 / np.sin(half)
            # In the frame of the chord, of length 1, from its middle: angles from the middle of the arc.
            u = 0.5 - radius * np.sin(at)
            v = radius * (np.cos(at) - np.cos(half))
            left = np.array([-chord[1], chord[0]])
            rows.append(start + u[:, None] * chord + v[:, None] * left)
        return np.concatenate(rows)


def chain_through(points: Array, pieces: list[Piece], noise: Noise) -> tuple[Chain, float]:
    """Fit a chain to points (n, 2) that are divided into pieces.

    Joints at which the direction changes no more than noise explains are smooth: by the criterion by which pieces are
    chosen, a parameter less against a greater sum of squares.

    Returns
    -------
    chain : Chain
    off : float
        Standard deviation of the chain's distance from the curve where it is greatest.
    """
    runs = [points[np.arange(p.first, p.last) % len(points)] for p in pieces if not p.is_blur]
    pieces = [piece for piece in pieces if not piece.is_blur]
    joints = np.array([0.5 * (before[-1] + run[0]) for before, run in zip([runs[-1], *runs], runs, strict=False)])
    owner = np.repeat(np.arange(len(pieces)), [len(run) for run in runs])
    points = np.concatenate(runs)
    is_arc = np.array([piece.is_arc for piece in pieces])
    bulges = np.array([_bulge(run) if piece.is_arc else 0.0 for run, piece in zip(runs, pieces, strict=True)])
    chain = Chain(joints, bulges, is_arc, np.zeros(len(pieces), dtype=bool))
    chain, covariance = _settled(chain, points, owner, noise)
    worth = np.log(max(len(points) / noise.share, 2.0))
    slopes = _turn_slopes(chain)
    spread = np.einsum("ki,ij,kj->k", slopes, covariance, slopes)
    smooth = chain.turns**2 <= worth * spread
    # A line needs no joint in its middle; pieces that should be one are not two.
    smooth &= chain.is_arc | np.roll(chain.is_arc, 1)
    if smooth.any():
        chain, covariance = _settled(replace(chain, smooth=smooth), points, owner, noise)
    slopes = _slopes(chain, points, owner)
    columns = 3 * np.stack([owner, (owner + 1) % len(pieces)], axis=1)
    rows = np.zeros((len(points), 3 * len(pieces)))
    at = np.arange(len(points))
    for k in range(3):
        rows[at, columns[:, 0] + k] += slopes[:, k]
    for k in range(2):
        rows[at, columns[:, 1] + k] += slopes[:, 3 + k]
    off = np.sqrt(np.maximum(np.einsum("ni,ij,nj->n", rows, covariance, rows), 0.0))
    return chain, float(off.max())


def _bulge(run: Array) -> float:
    """Height of an arc's middle over half its chord, by its points [1]."""
    chord = run[-1] - run[0]
    length = float(np.linalg.norm(chord))
    along, across = frames((run - 0.5 * (run[0] + run[-1]))[None], (chord / length)[None])
    # By the area between chord and arc, 2/3 of height times chord where that is flat.
    area = float(np.trapezoid(across[0], along[0]))
    flat = 1.5 * area / length
    middle = float(across[0][len(run) // 2])
    return 2.0 * (middle if abs(middle) > abs(flat) else flat) / length


def _settled(chain: Chain, points: Array, owner: Array, noise: Noise) -> tuple[Chain, Array]:
    """The chain of least squares next to one, by Gauss-Newton steps, and the covariance of its parameters (3k, 3k)."""
    count = len(chain.joints)
    free = np.stack([np.ones(count), np.ones(count), chain.is_arc], axis=1).ravel() > 0.0
    start = chain
    trust = 1e-6
    cost, gram, slope = _normal(chain, start, points, owner, noise.scatter)
    for _ in range(_STEPS):
        damped = gram + trust * np.diag(np.diag(gram))
        step = np.zeros(3 * count)
        step[free] = -np.linalg.solve(damped[np.ix_(free, free)], slope[free])
        moved = chain.moved(step.reshape(-1, 3))
        less, *rest = _normal(moved, start, points, owner, noise.scatter)
        near = np.linalg.norm(moved.joints - start.joints, axis=1) < _reach(start)
        if not (less < cost and near.all()):
            trust *= 10.0
            continue
        gained = cost - less
        chain, cost, (gram, slope) = moved, less, rest
        trust *= 0.1
        if gained < 1e-3:
            break
    covariance = np.zeros((3 * count, 3 * count))
    covariance[np.ix_(free, free)] = noise.share * np.linalg.inv(gram[np.ix_(free, free)])
    return chain, covariance


def _reach(chain: Chain) -> Array:
    """Length of the shorter piece at each joint."""
    lengths = np.linalg.norm(chain.chords, axis=1)
    return np.asarray(np.minimum(lengths, np.roll(lengths, 1)))


def _normal(
    chain: Chain, start: Chain, points: Array, owner: Array, scatter: float
) -> tuple[float, Array, Array]:
    """Half the sum of squares, per variance of a point, and its Gauss-Newton matrix and slope by the parameters."""
    count = len(chain.joints)
    rest = chain.distances(points, owner) / scatter
    slopes = _slopes(chain, points, owner) / scatter
    size = np.abs(rest)
    weight = np.where(size <= _HUBER, 1.0, _HUBER / np.maximum(size, _HUBER))
    cost = float(np.where(size <= _HUBER, 0.5 * rest**2, _HUBER * (size - 0.5 * _HUBER)).sum())
    gram = np.zeros((3 * count, 3 * count))
    slope = np.zeros(3 * count)
    first = np.searchsorted(owner, np.arange(count + 1))
    for k in range(count):
        rows = slopes[first[k] : first[k + 1]]
        weighted = rows.T * weight[first[k] : first[k + 1]]
        after = 3 * ((k + 1) % count)
        at = [3 * k, 3 * k + 1, 3 * k + 2, after, after + 1]
        gram[np.ix_(at, at)] += weighted @ rows
        slope[at] += weighted @ rest[first[k] : first[k + 1]]
    # Where a joint slides along both its pieces, it stays within the length of the shorter one.
    stays = np.repeat(_reach(start) ** -2.0, 2).reshape(-1, 2)
    away = chain.joints - start.joints
    cost += 0.5 * float((stays * away**2).sum())
    at = np.arange(3 * count).reshape(-1, 3)[:, :2].ravel()
    gram[at, at] += stays.ravel()
    slope[at] += (stays * away).ravel()
    if chain.smooth.any():
        stiff = _STIFF * _reach(start) / scatter
        rows = (_turn_slopes(chain) * stiff[:, None])[chain.smooth]
        off = (chain.turns * stiff)[chain.smooth]
        cost += 0.5 * float(off @ off)
        gram += rows.T @ rows
        slope += rows.T @ off
    return cost, gram, slope


def _slopes(chain: Chain, points: Array, owner: Array) -> Array:
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


def _distances(starts: Array, chords: Array, bulges: Array, points: Array, owner: Array) -> Array:
    """Signed distances of points from the lines and circles of their pieces."""
    chord = chords[owner]
    length = np.linalg.norm(chord, axis=1)
    middle = starts[owner] + 0.5 * chord
    u, v = (c[:, 0] for c in frames((points - middle)[:, None], chord / length[:, None]))
    half = 0.5 * length
    height = bulges[owner] * half
    # Of height (u2 + v2 - half2) + v (half2 - height2) = 0, the circle through the ends: no radius becomes infinite.
    value = height * (u * u + v * v - half * half) + v * (half * half - height * height)
    slope = half * half + height * height
    return np.asarray(2.0 * value / (slope + np.sqrt(np.maximum(slope * slope + 4.0 * height * value, 0.0))))


def _turn_slopes(chain: Chain) -> Array:
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
