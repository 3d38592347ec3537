"""Postures that nearly touch, where fingers have no maps, or empty ones: without a C compiler, or where a straight
finger just touches, and any bend ends that.

Curvature is linear along a finger, by its values at base and tip. A middle contact is where the finger is nearest to
the object, others are spread beyond it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np

from continuum_grasp.base import Numbers as Array
from continuum_grasp.grasp.finger_map import rough_distance
from continuum_grasp.grasp.object_supports import Pose, TouchedPlace, nearest_contact, object_outlines, support_contacts
from continuum_grasp.scene import FingerSetup, GraspScene

_ENDS, _PLACES = 41, 65
"""Curvatures at each end, and places along the finger at which its distance from the object is looked at."""
_MOST_BEND = 10.0
"""Greatest curvature at an end, per length of the finger."""


_MOST_POSTURES = 8
"""Combinations of postures of a set of contacts."""


@dataclass(frozen=True)
class RoughPosture:
    """A posture of one finger, whose curvature changes linearly from base to tip."""

    joints: Mapping[str, float]  # places of the middle contacts that are on, by name [m]
    curvatures: tuple[float, float]  # at base and tip [1/m]
    points: Mapping[str, complex]  # of all its contacts in the world, by name [m]
    off: float  # by how much it misses touching, per length


@dataclass(frozen=True)
class RoughPostures:
    """A posture of each finger by name, and the places of all contacts on the object."""

    fingers: Mapping[str, RoughPosture]
    contacts: Mapping[str, TouchedPlace]

    @property
    def off(self) -> float:
        """Sum by which the fingers miss touching, per length."""
        return sum(finger.off for finger in self.fingers.values())


def rough_postures(
    scene: GraspScene, on: frozenset[str], pose: Pose, bases: tuple[Pose, ...], count: int = _MOST_POSTURES
) -> list[RoughPostures]:
    """Postures of all fingers with the contacts ``on`` by name, at most so many, the nearest to touching first."""
    each = max(1, math.ceil(count ** (1.0 / len(scene.setups))))
    names = [setup.name for setup in scene.setups]
    fingers = [_postures(scene, setup, base, pose, on, each) for setup, base in zip(scene.setups, bases, strict=True)]
    supports = support_contacts(scene, pose, {name for name in on if scene.support_of(name) is not None})
    combined = []
    for chosen in sorted(product(*fingers), key=lambda chosen: sum(one.off for one in chosen))[:count]:
        touches = {name: nearest_contact(scene, pose, at) for one in chosen for name, at in one.points.items()}
        combined.append(RoughPostures(dict(zip(names, chosen, strict=True)), touches | supports))
    return combined


def _postures(
    scene: GraspScene, setup: FingerSetup, base: Pose, pose: Pose, on: frozenset[str], count: int
) -> list[RoughPosture]:
    """So many postures of a finger that differ, the nearest to touching first."""
    length = setup.finger.rod.length
    ends = np.stack(np.meshgrid(*[np.linspace(-_MOST_BEND, _MOST_BEND, _ENDS)] * 2, indexing="ij"), axis=-1)
    ends = ends.reshape(-1, 2)
    places = np.linspace(0.0, 1.0, _PLACES)
    world = complex(*base[:2]) + length * np.exp(1j * base[2]) * _lines(ends, places)
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
        joints = dict(zip(middles, (length * at[row]).tolist(), strict=True))
        points = {name: complex(np.interp(s, length * places, world[row])) for name, s in joints.items()}
        if setup.tip_name in on:
            points[setup.tip_name] = complex(world[row, -1])
        first, last = (ends[row] / length).tolist()
        found.append(RoughPosture(joints, (first, last), points, float(off[row])))
    return found


def _lines(ends: Array, places: Array) -> Array:
    """Points (B, S) at places (S,) of lines from 0 along i, whose curvatures at both ends are (B, 2)."""
    # Between places, by the rule of Gauss with two nodes.
    step = np.diff(places)[:, None]
    at = places[:-1, None] + step * (0.5 + np.array([-0.5, 0.5]) / math.sqrt(3.0))
    first, last = ends[:, :1, None], ends[:, 1:, None]
    angle = at * (first + 0.5 * (last - first) * at)
    moves = 0.5 * step[:, 0] * (1j * np.exp(1j * angle)).sum(axis=2)
    return np.concatenate([np.zeros((len(moves), 1), complex), np.cumsum(moves, axis=1)], axis=1)


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
