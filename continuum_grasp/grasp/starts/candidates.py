"""Postures of one finger at one pose of the object, from both sides and all poses of its base."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.starts.scan.postures import neighbors, postures
from continuum_grasp.grasp.starts.scan.task import FingerTask, Postures, join, make_task
from continuum_grasp.scene.grasp import FingerSetup, GraspScene

__all__ = ["Candidates", "find_candidates", "near_candidates"]

Array = NDArray[Any]
Pose = tuple[float, float, float]


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
