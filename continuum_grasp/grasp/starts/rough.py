"""Postures that nearly touch, where fingers have no maps, or empty ones: without a C compiler, or where a straight
finger just touches, which any bend undoes.

Curvature is linear along a finger, by its values at base and tip. A middle contact is where the finger is nearest to
the object, others are spread beyond it.
"""

from __future__ import annotations

import math
from itertools import product

import numpy as np

from continuum_grasp.base import Numbers as Array
from continuum_grasp.grasp.starts.curves import rough_distance, sample
from continuum_grasp.grasp.starts.supports import nearest_contact, object_outlines, support_contacts
from continuum_grasp.grasp.starts.values import FingerStart, GraspStart, Pose, all_joints
from continuum_grasp.scene import FingerSetup, GraspScene

_ENDS, _PLACES = 41, 65
"""Curvatures at each end, and places along the finger at which its distance from the object is looked at."""
_MOST_BEND = 10.0
"""Greatest curvature at an end, per length of the finger."""


def rough_starts(
    scene: GraspScene, on: frozenset[str], pose: Pose, bases: tuple[Pose, ...], count: int
) -> list[GraspStart]:
    """Starts with the contacts ``on`` by name, at most so many, those that come nearest to touching first."""
    each = max(1, math.ceil(count ** (1.0 / len(scene.setups))))
    fingers = [_postures(scene, setup, base, pose, on, each) for setup, base in zip(scene.setups, bases, strict=True)]
    supports = support_contacts(scene, pose, {name for name in on if scene.support_of(name) is not None})
    starts = []
    for chosen in sorted(product(*fingers), key=lambda chosen: sum(off for off, _, _ in chosen))[:count]:
        touches = {name: nearest_contact(scene, pose, at) for _, _, points in chosen for name, at in points.items()}
        postures = {setup.name: finger for setup, (_, finger, _) in zip(scene.setups, chosen, strict=True)}
        # 1: nothing is known of forces
        off = 1.0 + sum(off for off, _, _ in chosen)
        starts.append(GraspStart("rough", pose, postures, touches | supports, imbalance=off))
    return starts


def _postures(
    scene: GraspScene, setup: FingerSetup, base: Pose, pose: Pose, on: frozenset[str], count: int
) -> list[tuple[float, FingerStart, dict[str, complex]]]:
    """So many postures of a finger that differ: by how much they miss touching, per length, themselves, and world
    points of their contacts [m].
    """
    length = setup.finger.rod.length
    most = min(_MOST_BEND, setup.elements * setup.bending_range)
    ends = np.stack(np.meshgrid(*[np.linspace(-most, most, _ENDS)] * 2, indexing="ij"), axis=-1).reshape(-1, 2)
    knots = np.tile([0.0, 1.0], (len(ends), 1))
    places = np.linspace(0.0, 1.0, _PLACES)
    line = sample(knots, ends, np.tile(places, (len(ends), 1)))
    world = complex(*base[:2]) + length * np.exp(1j * base[2]) * line
    local = (world - complex(*pose[:2])) * np.exp(-1j * pose[2])
    gap = rough_distance(object_outlines(scene), local.ravel()).reshape(local.shape) / length
    gap -= np.array([setup.finger.profile.half_thickness(s) for s in length * places]) / length
    middles = [name for name in setup.middle_names if name in on]
    inside = (places >= setup.middle_bounds[0] / length) & (places <= setup.middle_bounds[1] / length)
    at, off = _places(gap, places, inside, len(middles))
    if setup.tip_name in on:
        off = off + np.abs(gap[:, -1])
    off = off + np.maximum(-gap.min(axis=1), 0.0)
    found = []
    for row in _different(ends, off, count):
        where = dict(zip(middles, (length * at[row]).tolist(), strict=True))
        points = {name: complex(np.interp(s, length * places, world[row])) for name, s in where.items()}
        if setup.tip_name in on:
            points[setup.tip_name] = complex(world[row, -1])
        bent = (ends[row] / length).tolist()
        # All middle contacts are on the side on which the object lies.
        side = 1 if _lies_left(world[row], complex(*pose[:2])) else -1
        joints = all_joints(setup, where)
        finger = FingerStart(base, joints, (side,) * len(setup.middle_names), (0.0, length), (bent[0], bent[1]))
        found.append((float(off[row]), finger, points))
    return found


def _places(gap: Array, places: Array, inside: Array, count: int) -> tuple[Array, Array]:
    """Places of so many contacts (B, count) of curves, and by how much these miss there."""
    size = len(gap)
    if not count:
        return np.zeros((size, 0)), np.zeros(size)
    first = np.where(inside, np.abs(gap), np.inf).argmin(axis=1)
    last = places[inside].max()
    begin = np.minimum(places[first], last - 0.1 * (count - 1) * last)
    at = begin[:, None] + (last - begin)[:, None] * np.arange(count) / count
    near = np.stack([np.interp(each, places, row) for each, row in zip(at, gap, strict=True)])
    return at, np.abs(near).sum(axis=1)


def _different(ends: Array, off: Array, count: int) -> list[int]:
    """The best curves, so many, none of them a neighbor of one before."""
    apart = 4.0 * _MOST_BEND / (_ENDS - 1)
    rows = list[int]()
    for row in np.argsort(off, kind="stable").tolist():
        if all(np.abs(ends[row] - ends[other]).max() > apart for other in rows):
            rows.append(row)
        if len(rows) == count:
            break
    return rows


def _lies_left(line: Array, point: complex) -> bool:
    """Whether a point is on the left of the nearest part of a line."""
    k = min(int(np.abs(line - point).argmin()), len(line) - 2)
    return bool((np.conj(line[k + 1] - line[k]) * (point - line[k])).imag > 0.0)
