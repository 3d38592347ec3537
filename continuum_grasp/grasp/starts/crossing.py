"""Fingers of a start that are in each other's way."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.starts.candidates import Candidates
from continuum_grasp.grasp.starts.scan.curves import sample
from continuum_grasp.scene.grasp import GraspScene

Array = NDArray[Any]

_AT = np.linspace(0.0, 1.0, 25)
"""Places along a finger: the segments between them are 4 % of its length."""


def overlaps(scene: GraspScene, found: list[Candidates], index: list[Array]) -> Array:
    """Depth of the fingers of B combinations in each other, in sum, per length (B,); ``index`` (B,) per finger are the
    postures combined.
    """
    names = [setup.name for setup in scene.setups]
    pairs = [(names.index(one.name), names.index(other.name)) for one, other in scene.pairs]
    deep = np.zeros(len(index[0]))
    if not pairs:
        return deep
    lines = []
    for setup, candidates in zip(scene.setups, found, strict=True):
        bent = sample(candidates.knots, candidates.curvatures, np.tile(_AT, (len(candidates.knots), 1)))
        x, y, turn = candidates.bases.T
        lines.append((x + 1j * y)[:, None] + np.exp(1j * turn)[:, None] * setup.finger.rod.length * bent)
    for k, m in pairs:
        one, other = scene.setups[k].finger, scene.setups[m].finger
        a, b = lines[k][index[k]], lines[m][index[m]]
        apart = np.minimum(_distance(a, b), _distance(b, a))
        needed = one.thickness_radius + other.thickness_radius
        deep += np.maximum(needed - apart, 0.0) / min(one.rod.length, other.rod.length)
    return deep


def _distance(points: Array, line: Array) -> Array:
    """Least distance (B,) of points (B, K) from the segments between others (B, M)."""
    start, span = line[:, None, :-1], np.diff(line)[:, None]
    off = points[:, :, None] - start
    share = np.clip((off * span.conj()).real / np.abs(span) ** 2, 0.0, 1.0)
    return np.asarray(np.abs(off - share * span).min(axis=(1, 2)))
