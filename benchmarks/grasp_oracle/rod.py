"""The backbone integrated from its curvature, and how it moves with it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

_X, _W = np.polynomial.legendre.leggauss(28)
NODES, WEIGHTS = 0.5 * (_X + 1.0), 0.5 * _W
_FEW_X, _FEW_W = np.polynomial.legendre.leggauss(5)
FEW_NODES, FEW_WEIGHTS = 0.5 * (_FEW_X + 1.0), 0.5 * _FEW_W


def walk(angle: Any, start: Any, end: Any, length: Any) -> Array:
    """Step from begin to end of an element whose curvature goes linearly from start to end: (..., 2) [m]."""
    angle, start, end, length = np.broadcast_arrays(angle, start, end, length)
    x = NODES
    phi = angle[..., None] + length[..., None] * (start[..., None] * x + (end - start)[..., None] * (0.5 * x * x))
    return np.stack([-(np.sin(phi) @ WEIGHTS), np.cos(phi) @ WEIGHTS], axis=-1) * length[..., None]


def trace(base: Any, angle: Any, ends: Array, lengths: Array, count: int = 60) -> tuple[Array, Array]:
    """Points (..., N, count + 1, 2) [m] and bending angles (..., N, count + 1) [rad] of backbones from a base.

    ``ends`` (..., N, 2) are the curvatures at begin and end of each element [1/m], ``lengths`` (..., N) theirs [m];
    each element has ``count`` points beside its begin.
    """
    edges = np.linspace(0.0, 1.0, count + 1)
    x = (edges[:-1, None] + np.diff(edges)[:, None] * FEW_NODES).ravel()
    points, angles = [], []
    here = np.broadcast_to(np.asarray(base, dtype=float), (*ends.shape[:-2], 2))
    turn = np.broadcast_to(np.asarray(angle, dtype=float), ends.shape[:-2])
    for k in range(ends.shape[-2]):
        a, b, length = ends[..., k, 0, None], ends[..., k, 1, None], lengths[..., k, None]
        phi = turn[..., None] + length * (a * x + (b - a) * 0.5 * x * x)
        steps = np.stack([-np.sin(phi), np.cos(phi)], axis=-1).reshape(*phi.shape[:-1], count, FEW_NODES.size, 2)
        moved = np.cumsum(np.einsum("...cnd,n->...cd", steps, FEW_WEIGHTS), axis=-2) * (length / count)[..., None]
        along = np.concatenate([here[..., None, :], here[..., None, :] + moved], axis=-2)
        points.append(along)
        angles.append(turn[..., None] + length * (a * edges + (b - a) * 0.5 * edges**2))
        here, turn = along[..., -1, :], angles[-1][..., -1]
    return np.stack(points, axis=-3), np.stack(angles, axis=-2)


@dataclass
class Section:
    """A section of a backbone, and how it moves with the curvatures at the elements' ends."""

    point: Array
    """(2,) [m]"""
    angle: float
    """[rad]"""
    moves: Array
    """Change (2N, 2) of ``point`` per curvature [m2]."""
    turns: Array
    """Change (2N,) of ``angle`` per curvature [m]."""
    mean: Array
    """Integral (2,) of the position from the base to here [m2]."""
    mean_moves: Array
    """Change (2N, 2) of it per curvature [m3]."""


def section(base: Any, angle: float, ends: Array, lengths: Array, at: float) -> Section:
    """The section of one backbone at a position along it [m]."""
    count = len(lengths)
    point, turn = np.array(base, dtype=float), float(angle)
    moves, turns = np.zeros((2 * count, 2)), np.zeros(2 * count)
    mean, mean_moves = np.zeros(2), np.zeros((2 * count, 2))
    left = float(at)
    for k, (full, (a, b)) in enumerate(zip(lengths, ends, strict=True)):
        part = min(full, left)
        if part <= 1e-14 * full:
            break
        s = part * NODES
        phi = turn + a * s + (b - a) * s**2 / (2.0 * full)
        tangent = np.stack([-np.sin(phi), np.cos(phi)], axis=-1)
        inward = np.stack([-np.cos(phi), -np.sin(phi)], axis=-1)
        swing = np.zeros((2 * count, NODES.size)) + turns[:, None]
        swing[2 * k] += s - s**2 / (2.0 * full)
        swing[2 * k + 1] += s**2 / (2.0 * full)
        w = part * WEIGHTS
        mean = mean + part * point + (tangent * (part - s)[:, None]).T @ w
        mean_moves = mean_moves + part * moves + np.einsum("an,nd,n->ad", swing, inward, w * (part - s))
        point = point + tangent.T @ w
        moves = moves + np.einsum("an,nd,n->ad", swing, inward, w)
        turn += a * part + (b - a) * part**2 / (2.0 * full)
        turns = turns.copy()
        turns[2 * k] += part - part**2 / (2.0 * full)
        turns[2 * k + 1] += part**2 / (2.0 * full)
        left -= part
    return Section(point, turn, moves, turns, mean, mean_moves)
