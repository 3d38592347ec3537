"""Postures of one finger that touch an object at one pose, from both sides and all poses of its base, by scans over
curvatures and contact positions.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.starts.scan.joint import first_joint, moved_joint, next_joint
from continuum_grasp.grasp.starts.scan.task import FingerTask, Postures, join, make_task, violation
from continuum_grasp.grasp.starts.scan.tip import bent_by_tip, moved_tip, tip_only, with_tip
from continuum_grasp.scene.grasp import FingerSetup, GraspScene
from continuum_grasp.scene.objects.body import Pose

Array = NDArray[Any]

_SHIFTS = 0.01 * np.array([-1.5, -0.5, 0.5, 1.5])
"""Shifts of the first contact along the finger [L] in a refinement of size one: a sixth of the spacing of the scan."""
_CHANGE = 0.4
"""Change of a knot's curvature [1/L] in a refinement of size one: the spacing of the scans of tips, about."""


@dataclass(frozen=True)
class Candidates(Postures):
    """P postures of one finger: curvatures with the finger's own sign, places in the object's frame.

    Attributes
    ----------
    bases : ndarray, (P, 3)
        World pose of the base [m, rad].
    sides : ndarray of int, (P,)
        +1: the object on the finger's left.
    stations : ndarray, (P, C)
        Positions of the contacts that are on, per length.
    points : ndarray of complex, (P, C)
        On the object's surface, in its frame [m].
    angles : ndarray, (P, C)
        Outward normals in the object's frame [rad].
    """

    bases: Array
    sides: Array
    stations: Array

    @property
    def features(self) -> Array:
        """Numbers in which different postures differ (P, F)."""
        return np.concatenate(
            [
                2.0 * self.joints,
                0.15 * self.curvatures,
                np.cos(self.angles),
                np.sin(self.angles),
                0.5 * self.sides[:, None],
                self.bases,
            ],
            axis=1,
        )


def find_candidates(
    scene: GraspScene,
    setup: FingerSetup,
    bases: list[Pose],
    pose: Pose,
    middles: tuple[bool, ...],
    tip: bool,
) -> Candidates | None:
    """Postures of a finger that touch the object at a pose of its, fewest violations first.

    Parameters
    ----------
    scene : GraspScene
    setup : FingerSetup
    bases : list of (float, float, float)
        World poses of the base to try [m, rad].
    pose : (float, float, float)
        World pose of the object [m, rad].
    middles : tuple of bool
        Which middle contacts are on.
    tip : bool
        Whether the tip's is.
    """
    groups = []
    sides = (1, -1) if any(middles) else (1,)
    for base in bases:
        for side in sides:
            task = make_task(scene, setup, base, pose, side)
            family = postures(task, middles, tip)
            if family is not None:
                groups.append(_as_candidates(task, family, base, side, middles, tip))
    return join(groups)


def near_candidates(
    scene: GraspScene,
    setup: FingerSetup,
    some: Candidates,
    pose: Pose,
    middles: tuple[bool, ...],
    tip: bool,
    scale: float,
) -> Candidates | None:
    """Postures next to some, with changes of a relative size, and these themselves."""
    groups = [some]
    keys = np.concatenate([some.bases, some.sides[:, None]], axis=1)
    for key in np.unique(keys, axis=0):
        mine = some.take((keys == key).all(axis=1))
        base, side = (float(key[0]), float(key[1]), float(key[2])), int(key[3])
        task = make_task(scene, setup, base, pose, side)
        on = mine.joints[:, [k for k, m in enumerate(middles) if m]]
        angles = task.frame.angle(mine.angles)
        family = Postures(
            mine.knots,
            side * mine.curvatures,
            on,
            mine.parts,
            task.frame.point(mine.points) + task.half * np.exp(1j * angles),
            angles,
            mine.violation,
        )
        found = neighbors(task, family, middles, tip, scale)
        if found is not None:
            groups.append(_as_candidates(task, found, base, side, middles, tip))
    return join(groups)


def _as_candidates(
    task: FingerTask, family: Postures, base: Pose, side: int, middles: tuple[bool, ...], tip: bool
) -> Candidates:
    count = len(family)
    on = family.joints[:, [k for k, m in enumerate(middles) if m]]
    return Candidates(
        bases=np.tile(base, (count, 1)),
        sides=np.full(count, side),
        knots=family.knots,
        curvatures=side * family.curvatures,
        joints=family.joints,
        stations=np.concatenate([on, np.ones((count, 1))], axis=1) if tip else on,
        parts=family.parts,
        points=task.frame.back(family.points - task.half * np.exp(1j * family.angles)),
        angles=task.frame.angle_back(family.angles),
        violation=family.violation,
    )


def postures(task: FingerTask, middles: tuple[bool, ...], tip: bool) -> Postures | None:
    """All postures found with the middle contacts that are on and, if ``tip``, the tip touching.

    Parameters
    ----------
    task : FingerTask
    middles : tuple of bool
        Which middle contacts are on, from the base.
    tip : bool

    Returns
    -------
    Postures or None
        None where there is none, however much it penetrates.
    """
    if any(middles):
        family = first_joint(task, middles)
        for k in range(middles.index(True) + 1, len(middles)):
            if middles[k] and family is not None:
                family = next_joint(task, family)
        if family is None:
            return None
        family = with_tip(task, family) if tip else _free_end(family)
    else:
        joint = task.counts[0] / 2.0 if task.arcs and task.counts == (1, 1) else None
        family = _untouched(task) if not tip else tip_only(task, joint) if task.arcs else bent_by_tip(task)
    if family is None:
        return None
    return _finished(task, family, middles)


def neighbors(
    task: FingerTask, family: Postures, middles: tuple[bool, ...], tip: bool, scale: float
) -> Postures | None:
    """Postures next to those of a family, with the same contacts, at changes of a relative size ``scale``.

    None where there are none or the family has no free parameter.
    """
    found: Postures | None = None
    if sum(middles) == 1 and not (task.arcs and sum(task.counts[: middles.index(True) + 1]) == 1):
        found = moved_joint(task, family, scale * _SHIFTS)
        if found is not None:
            found = with_tip(task, found) if tip else _free_end(found)
    elif not any(middles) and tip:
        found = moved_tip(task, family, scale * _CHANGE)
    return None if found is None else _finished(task, found, middles)


def _finished(task: FingerTask, family: Postures, middles: tuple[bool, ...]) -> Postures:
    joints = _all_joints(task, family.joints, middles)
    wrong = violation(task, family.knots, family.curvatures, joints)
    return replace(family, joints=joints, violation=wrong)


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


def _all_joints(task: FingerTask, on: Array, middles: tuple[bool, ...]) -> Array:
    """Positions of all middle contacts: those that are off spread evenly between those that are on."""
    low, high = task.bounds
    count, size = len(on), len(middles)
    if not any(middles):
        shares = np.cumsum(task.counts)[:-1] / sum(task.counts)
        return np.broadcast_to(shares, (count, size)).copy()
    out = np.zeros((count, size))
    places = [k for k in range(size) if middles[k]]
    for column, k in enumerate(places):
        out[:, k] = on[:, column]
    for a, b in pairwise([-1, *places, size]):
        left = out[:, a] if a >= 0 else np.zeros(count)
        right = out[:, b] if b < size else np.ones(count)
        for k in range(a + 1, b):
            out[:, k] = np.clip(left + (right - left) * (k - a) / (b - a), low, high)
    return out
