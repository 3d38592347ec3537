"""Fingers of two elements of linear curvature that touch with their tips alone: any such shape is in balance under some
force and tension, so all of them are looked at, by the curvatures at base and joint.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.starts.scan.curves import table_of
from continuum_grasp.grasp.starts.scan.task import FingerTask, Postures, join

Array = NDArray[Any]

_REACH, _COUNT = 10.0, 41
"""Greatest curvature at base and joint [1/L], and their number: 0.5 1/L apart, as in the scans of tips."""
_TIP_REACH, _TIP_COUNT = 15.0, 41
"""The same at the tip, which a short end bends."""
_APART = 0.35
"""Greatest distance of the tips of neighbors in the table [L]: farther away from the object no crossing is possible."""


@lru_cache(1)
def _halves() -> tuple[Array, Array, Array, Array, Array, Array]:
    """Curvatures, and ends and angles of both halves (of length 1/2) by first and last curvature."""
    line, ends = np.linspace(-_REACH, _REACH, _COUNT), np.linspace(-_TIP_REACH, _TIP_REACH, _TIP_COUNT)
    # A curve of half the length is half as long with twice the curvature.
    return line, ends, *_half(line, line), *_half(line, ends)


def _half(firsts: Array, lasts: Array) -> tuple[Array, Array]:
    tips, turns = table_of(0.5 * firsts, 0.5 * lasts, None)
    return 0.5 * tips, turns


def two_clothoids(task: FingerTask) -> Postures | None:
    """All postures, one or more for each pair of curvatures at base and joint from which the tip touches."""
    from continuum_grasp.grasp.starts.scan.tip import crossings, touching

    line, ends, joints, bends, tips, turns = _halves()
    groups = []
    for part, shape in enumerate(task.shapes):
        near = np.abs(joints - shape.center) < shape.extent + task.half + 0.5
        i, j = np.nonzero(near)
        at = joints[i, j][:, None] + np.exp(1j * bends[i, j])[:, None] * tips[j]
        angle = bends[i, j][:, None] + turns[j]
        gap = np.abs(at - shape.center) - shape.extent - task.half
        close = gap < _APART
        gap[close] = shape.distance(at[close]) - task.half
        row, k, share, walk = crossings(shape, gap, at, angle)
        if len(row):
            last = ends[k] + share * (ends[1] - ends[0])
            bent = np.stack([line[i[row]], line[j[row]], last], axis=1)
            groups.append(touching(np.array(task.nodes), bent, (2,), part, shape, walk))
    return join(groups)
