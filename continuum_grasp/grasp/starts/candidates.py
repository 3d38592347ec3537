"""Postures of one finger that touch an object at one pose, from both sides and all poses of its base, by scans over
curvatures and contact positions.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.starts.scan.families import bent_by_tip, first_joint, next_joint, with_tip
from continuum_grasp.grasp.starts.scan.task import FingerTask, Postures, join, make_task, violation
from continuum_grasp.grasp.starts.scan.two_arcs import scanned_arcs
from continuum_grasp.scene.grasp import FingerSetup, GraspScene
from continuum_grasp.scene.objects.body import Pose

Array = NDArray[Any]


@dataclass(frozen=True)
class Candidates(Postures):
    """P postures of one finger: curvatures with the finger's own sign; points [m] on the object's surface and normals
    in its frame.
    """

    bases: Array  # (P, 3) world pose of the base [m, rad]
    sides: Array  # (P,) +1: the object on the finger's left
    stations: Array  # (P, C) positions of the contacts that are on, per length

    def features(self, length: float) -> Array:
        """Numbers in which different postures of a finger of a length [m] differ (P, F)."""
        # Scaled so that 0.5 is a likeness: a quarter of the length, 3 1/L, 30 degrees of a normal.
        return np.concatenate(
            [
                2.0 * self.joints,
                0.15 * self.curvatures,
                np.cos(self.angles),
                np.sin(self.angles),
                0.5 * self.sides[:, None],
                self.bases * (2.0 / length, 2.0 / length, 1.0),
            ],
            axis=1,
        )


def find_candidates(
    scene: GraspScene, setup: FingerSetup, bases: list[Pose], pose: Pose, on: frozenset[str]
) -> Candidates | None:
    """Postures of a finger with the contacts ``on`` at a world pose of the object, from all poses of its base [m, rad];
    None where there is none, however much it penetrates.
    """
    # A tip touches on either side alike; a middle contact lies on one side.
    sides = (1, -1) if any(name in on for name in setup.middle_names) else (1,)
    tasks = [make_task(scene, setup, base, pose, side, on) for base in bases for side in sides]
    families = [(task, _postures(task)) for task in tasks]
    return join([as_candidates(task, family) for task, family in families if family is not None])


def as_candidates(task: FingerTask, family: Postures) -> Candidates:
    """Postures in numbers of their task as those of the finger."""
    count = len(family)
    return Candidates(
        bases=np.tile(task.base, (count, 1)),
        sides=np.full(count, task.side),
        knots=family.knots,
        curvatures=task.side * family.curvatures,
        joints=family.joints,
        stations=np.concatenate(
            [family.joints[:, np.flatnonzero(task.middles)], np.ones((count, int(task.tip)))], axis=1
        ),
        parts=family.parts,
        points=task.frame.back(family.points - task.half * np.exp(1j * family.angles)),
        angles=task.frame.angle_back(family.angles),
        violation=family.violation,
    )


def _postures(task: FingerTask) -> Postures | None:
    """All postures found with the contacts of a task, from the base on: first contact, further ones, tip."""
    family: Postures | None
    if any(task.middles):
        family = first_joint(task)
        for _ in range(sum(task.middles) - 1):
            family = None if family is None else next_joint(task, family)
        if family is not None:
            family = with_tip(task, family) if task.tip else _free_end(family)
    elif task.tip:
        family = _two_arcs(task) if task.arcs and task.counts == (1, 1) else bent_by_tip(task)
    else:
        family = _untouched(task)
    return None if family is None else _finished(task, family)


def _finished(task: FingerTask, family: Postures) -> Postures:
    joints = all_joints(task, family.joints)
    wrong = violation(task, family.knots, family.curvatures, joints)
    return replace(family, joints=joints, violation=wrong)


def _two_arcs(task: FingerTask) -> Postures:
    """Fingers of two arcs whose tips touch."""
    some = scanned_arcs(task)
    none, touched = np.zeros((len(some), 0)), (some.tip, some.tip_point, some.tip_normal)
    parts, points, angles = (each[:, None] for each in touched)
    return Postures(some.knots, some.ends, none, parts, points, angles, np.zeros(len(some)))


def _free_end(family: Postures) -> Postures:
    """The postures on to a free tip: constant curvature, which no force bends."""
    return replace(
        family,
        knots=np.concatenate([family.knots, np.ones((len(family), 1))], axis=1),
        curvatures=np.concatenate([family.curvatures, family.curvatures[:, -1:]], axis=1),
    )


def _untouched(task: FingerTask) -> Postures:
    """A finger that touches nothing: at rest."""
    none = np.zeros((1, 0))
    bent = np.full((1, 2), task.rest)
    return Postures(np.array([[0.0, 1.0]]), bent, none, none.astype(int), none.astype(complex), none, np.zeros(1))


def all_joints(task: FingerTask, on: Array) -> Array:
    """Positions of all middle contacts: those that are off spread evenly between those that are on."""
    low, high = task.bounds
    count, size = len(on), len(task.middles)
    if not any(task.middles):
        shares = np.cumsum(task.counts)[:-1] / sum(task.counts)
        return np.broadcast_to(shares, (count, size)).copy()
    out = np.zeros((count, size))
    places = np.flatnonzero(task.middles).tolist()
    out[:, places] = on
    for a, b in pairwise([-1, *places, size]):
        left = out[:, a] if a >= 0 else np.zeros(count)
        right = out[:, b] if b < size else np.ones(count)
        for k in range(a + 1, b):
            out[:, k] = np.clip(left + (right - left) * (k - a) / (b - a), low, high)
    return out
