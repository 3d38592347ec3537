"""Curves from the base on which the finger lies tangent to an object at its middle contacts."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.starts.scan.curves import sample, segment_end, tangent
from continuum_grasp.grasp.starts.scan.task import ALLOWED, FingerTask, Postures, join, unique
from continuum_grasp.grasp.starts.scan.touching import Ring, scanned

Array = NDArray[Any]


def first_joint(task: FingerTask) -> Postures | None:
    """Curves from the base to the first contact, tangent there, with the object on their left."""
    some = scanned(replace(task, tip=False), Ring(task))
    some = some.take(some.side > 0)
    if not len(some):
        return None
    joints, parts, points, angles = (each[:, None] for each in (some.joint, some.part, some.point, some.normal))
    bent = some.ends[:, :2]
    return _clear(task, Postures(some.knots[:, :2], bent, joints, parts, points, angles, np.zeros(len(some))))


def next_joint(task: FingerTask, family: Postures) -> Postures | None:
    """Curves on from the last contact to one more, with a knot half-way."""
    last = family.knots[:, -1]
    groups = []
    point, angle = ends_of(family)
    for share in (0.15, 0.3, 0.45, 0.6, 0.8):
        ell = share * (task.bounds[1] - last)
        # Shorter than 3 % of the length, no curve is worth a start.
        rows = np.flatnonzero(ell > 0.03)
        if not len(rows):
            continue
        ell, begin, start = ell[rows], family.curvatures[rows, -1], (point[rows], angle[rows])
        lengths = np.stack([0.5 * ell, 0.5 * ell], axis=1)
        for part, shape in enumerate(task.shapes):
            # On as before, straighter, or more bent.
            for factor in (1.0, 0.5, 2.0):
                curve = np.stack([begin, factor * begin, factor * begin], axis=1)
                end, _, _, _ = segment_end(lengths, curve)
                _, walk = shape.nearest(start[0] + np.exp(1j * start[1]) * end)
                bent, walk, good = tangent(shape, start, lengths, curve, (1, 2), walk)
                if not good.any():
                    continue
                retained = family.take(rows[good])
                there = last[rows][good] + ell[good]
                knots = np.stack([there - 0.5 * ell[good], there], axis=1)
                at = shape.walk(walk[good])
                parts = np.full(len(retained), part)
                longer = retained.on_to(knots, bent[good, 1:], parts, at.point, at.angle)
                groups.append(replace(longer, joints=np.concatenate([retained.joints, there[:, None]], axis=1)))
    found = join(groups)
    return None if found is None else _clear(task, unique(found))


def ends_of(family: Postures) -> tuple[Array, Array]:
    """Where the curves end so far: point and angle."""
    end, turn, _, _ = segment_end(np.diff(family.knots, axis=1), family.curvatures)
    return end, turn


def _clear(task: FingerTask, family: Postures | None) -> Postures | None:
    """Those clear of the object so far, or the least deep ones where none is."""
    if family is None:
        return None
    at = family.knots[:, -1:] * np.linspace(0.0, 1.0, 33)
    depth = task.half - task.distance(sample(family.knots, family.curvatures, at)).min(axis=1)
    good = depth <= ALLOWED
    return family.take(np.flatnonzero(good) if good.any() else np.argsort(depth, kind="stable")[:4])
