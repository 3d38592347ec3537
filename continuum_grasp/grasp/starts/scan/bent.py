"""Fingers bent by a force at their tips, which alone touch.

Of more than two elements, the shapes that a rod takes; of two elements of linear curvature any shape is in balance
under some force and tension, so all of them are looked at, by the curvatures at base and joint.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.starts.scan.curves import table_of
from continuum_grasp.grasp.starts.scan.elastica import elastica_table, projection
from continuum_grasp.grasp.starts.scan.task import FingerTask, Postures, join, unique
from continuum_grasp.grasp.starts.scan.tip import crossings, tip_only, touching

Array = NDArray[Any]

_BESIDE_CONE = 0.15
"""Angle outside the friction cone up to which a start is used [rad]: half a spacing of the directions of `elastica`."""
_REACH, _COUNT = 10.0, 41
"""Greatest curvature at base and joint [1/L], and their number: 0.5 1/L apart, as in the scans of tips."""
_TIP_REACH, _TIP_COUNT = 15.0, 41
"""The same at the tip, which a short end bends."""


def bent_by_tip(task: FingerTask) -> Postures | None:
    """Fingers bent by a force at their tips, which touch; of more than two elements, with the force in the friction
    cone.
    """
    knots = np.array(task.nodes)
    groups: list[Postures | None] = []
    clothoids = tip_only(task)
    if clothoids is not None:  # the same curves, whose curvature is linear all along, with more knots
        first, last = clothoids.curvatures[:, :1], clothoids.curvatures[:, 1:]
        bent = first + (last - first) * knots
        groups.append(replace(clothoids, knots=np.broadcast_to(knots, bent.shape), curvatures=bent))
    groups.append(_two_clothoids(task) if len(knots) == 3 else _elastica(task))
    found = join([group for group in groups if group is not None])
    return None if found is None else unique(found)


def _elastica(task: FingerTask) -> Postures | None:
    """Shapes that a rod takes under a force at its tip in the friction cone."""
    table = elastica_table()
    knots = np.array(task.nodes)
    groups = []
    cone = math.atan(task.friction) + _BESIDE_CONE
    for part, shape in enumerate(task.shapes):
        # Neighbors in the table are up to 0.7 apart (99 % are closer): farther away no crossing is to be expected.
        near = np.abs(table.tips - shape.center) < shape.extent + task.half + 0.7
        gap = np.full(table.tips.shape, np.nan)
        gap[near] = shape.distance(table.tips[near]) - task.half
        i, j, share, walk = crossings(shape, gap, table.tips)
        pushed = np.cos(table.directions[i] - shape.walk(walk).angle) > math.cos(cone)
        retained = pushed | (table.forces[i] == 0.0)
        i, j, share, walk = i[retained], j[retained], share[retained], walk[retained]
        if len(i):
            bent = table.curvatures[i, j] + share[:, None] * (table.curvatures[i, j + 1] - table.curvatures[i, j])
            every = tuple(range(len(knots)))
            groups.append(touching(knots, bent @ projection(task.nodes).T, every, part, shape, walk))
    return join(groups)


@lru_cache(1)
def _halves() -> tuple[Array, Array, Array, Array, Array]:
    """Curvatures, ends of both halves (of length 1/2), and angles of the first, by first and last curvature."""
    line, ends = np.linspace(-_REACH, _REACH, _COUNT), np.linspace(-_TIP_REACH, _TIP_REACH, _TIP_COUNT)
    # A curve of half the length is half as long with twice the curvature.
    return line, ends, *_half(line, line), _half(line, ends)[0]


def _half(firsts: Array, lasts: Array) -> tuple[Array, Array]:
    tips, turns = table_of(0.5 * firsts, 0.5 * lasts, None)
    return 0.5 * tips, turns


def _two_clothoids(task: FingerTask) -> Postures | None:
    """All postures, one or more for each pair of curvatures at base and joint from which the tip touches."""
    line, ends, joints, bends, tips = _halves()
    groups = []
    for part, shape in enumerate(task.shapes):
        near = np.abs(joints - shape.center) < shape.extent + task.half + 0.5
        i, j = np.nonzero(near)
        at = joints[i, j][:, None] + np.exp(1j * bends[i, j])[:, None] * tips[j]
        row, k, share, walk = crossings(shape, shape.distance(at) - task.half, at)
        if len(row):
            last = ends[k] + share * (ends[1] - ends[0])
            bent = np.stack([line[i[row]], line[j[row]], last], axis=1)
            groups.append(touching(np.array(task.nodes), bent, (2,), part, shape, walk))
    return join(groups)
