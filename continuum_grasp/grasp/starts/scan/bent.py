"""Fingers bent by a force at their tips, which alone touch.

Of two elements of linear curvature any shape is in balance under some force and tension, so all of them are looked at,
by the curvatures at base and joint; fingers of more elements begin with the same shapes.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.starts.scan.curves import table_of
from continuum_grasp.grasp.starts.scan.task import FingerTask, Postures, join, unique
from continuum_grasp.grasp.starts.scan.tip import crossings, tip_only, touching

Array = NDArray[Any]

_REACH, _TIP_REACH, _COUNT = 10.0, 15.0, 41
"""Greatest curvature at base and joint, and at the tip, which a short end bends [1/L]; number of each."""


def bent_by_tip(task: FingerTask) -> Postures | None:
    """Fingers bent by a force at their tips, which touch."""
    knots = np.array(task.nodes)
    groups: list[Postures | None] = []
    clothoids = tip_only(task)
    if clothoids is not None:  # the same curves, whose curvature is linear all along, with more knots
        first, last = clothoids.curvatures[:, :1], clothoids.curvatures[:, 1:]
        bent = first + (last - first) * knots
        groups.append(replace(clothoids, knots=np.broadcast_to(knots, bent.shape), curvatures=bent))
    groups.append(_two_clothoids(task))
    found = join([group for group in groups if group is not None])
    return None if found is None else unique(found)


def _two_clothoids(task: FingerTask) -> Postures | None:
    """All postures, one or more for each pair of curvatures at base and joint from which the tip touches."""
    # A curve of half the length is half as long with twice the curvature.
    line, ends = np.linspace(-_REACH, _REACH, _COUNT), np.linspace(-_TIP_REACH, _TIP_REACH, _COUNT)
    joints, bends = table_of(0.5 * line, 0.5 * line, None)
    joints, tips = 0.5 * joints, 0.5 * table_of(0.5 * line, 0.5 * ends, None)[0]
    knots = np.array(task.nodes)
    hats = np.stack([np.interp(knots, (0.0, 0.5, 1.0), unit) for unit in np.eye(3)])
    beyond = tuple(np.flatnonzero(knots > 0.5).tolist())
    groups = []
    for part, shape in enumerate(task.shapes):
        near = np.abs(joints - shape.center) < shape.extent + task.half + 0.5
        i, j = np.nonzero(near)
        at = joints[i, j][:, None] + np.exp(1j * bends[i, j])[:, None] * tips[j]
        row, k, share, walk = crossings(shape, shape.distance(at) - task.half, at)
        if len(row):
            last = ends[k] + share * (ends[1] - ends[0])
            bent = np.stack([line[i[row]], line[j[row]], last], axis=1)
            groups.append(touching(knots, bent @ hats, beyond, part, shape, walk))
    return join(groups)
