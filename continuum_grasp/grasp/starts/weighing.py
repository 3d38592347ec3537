"""Postures of all fingers at poses of the object, weighed, and refined where they come near to holding it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.starts.candidates import Candidates, find_candidates, near_candidates
from continuum_grasp.grasp.starts.combine import combine, doubt
from continuum_grasp.grasp.starts.force import finger_block, loads_of, support_block
from continuum_grasp.grasp.starts.order import spread_order
from continuum_grasp.grasp.starts.polish import polished
from continuum_grasp.grasp.starts.poses import base_poses
from continuum_grasp.grasp.starts.supports import support_contacts
from continuum_grasp.scene.grasp import GraspScene

__all__ = ["Weighed", "Weighing"]

Array = NDArray[Any]
Pose = tuple[float, float, float]

_BALANCED = 3e-3
"""What is left where a posture is in balance but for the weight of its tension in the least squares."""
_NEARLY = 0.05
"""Violation, about in lengths of the finger, up to which a posture may have a good one next to it."""
_ENOUGH, _BEST, _POLISHED, _POSES, _FEW = 6, 12, 16, 2, 8
"""Balanced starts from which on nothing is refined; how many are refined, and at how many poses."""
_ROUNDS, _ONE_ROUND = (2.0, 0.7), (1.0,)
"""Sizes of the changes with which they are refined, the latter for several fingers that are close to balance."""
_CLOSE = 0.05
"""Relative imbalance from which on several fingers are refined in one round instead of two."""


@dataclass(frozen=True)
class Weighed:
    """Combinations of postures at one pose of the object.

    Attributes
    ----------
    pose : (float, float, float)
        World x, y [m] and angle [rad] of the object.
    candidates : list of Candidates
        Per finger.
    index : list of ndarray of int, (B,)
        Per finger, the posture of each combination.
    left, score, wrong : ndarray, (B,)
        Relative imbalance; what ranks it, less is better; by how much something is in the way.
    features : ndarray, (B, F)
    forces : ndarray, (B, n)
        [N]
    """

    pose: Pose
    candidates: list[Candidates]
    index: list[Array]
    left: Array
    score: Array
    wrong: Array
    features: Array
    forces: Array


class Weighing:
    """Weighs postures of a scene with given contacts.

    Parameters
    ----------
    scene : GraspScene
    on : frozenset of str
        Names of the contacts that are on.
    """

    def __init__(self, scene: GraspScene, on: frozenset[str]) -> None:
        self.scene, self.on = scene, on
        self.setups, self.loads = scene.setups, loads_of(scene)
        self._supported = any(wall.name in on for wall in scene.walls) or any(peg.name in on for peg in scene.pegs)
        self._touches = [(tuple(n in on for n in s.middle_names), s.tip_name in on) for s in self.setups]

    def at_pose(self, pose: Pose, number: int) -> Weighed | None:
        """What is found at the ``number``-th pose of the object; None where a finger does not reach it."""
        found: list[Candidates] = []
        for setup, (middles, tip) in zip(self.setups, self._touches, strict=True):
            candidates = find_candidates(self.scene, setup, base_poses(setup, number), pose, middles, tip)
            if candidates is None:
                return None
            found.append(candidates.take(_least_violation(candidates)))
        return self._weigh(pose, found)

    def refined(self, found: list[Weighed]) -> list[Weighed]:
        """What is next to the best that was found, unless enough of it is in balance."""
        if not found or sum(int(((at.left < _BALANCED) & (at.wrong <= 0.0)).sum()) for at in found) >= _ENOUGH:
            return []
        out: list[Weighed] = []
        poses = sorted(found, key=lambda at: float(at.score.min()))[:_POSES]
        for at in poses:
            better = self._polished(at)
            if better is not None:
                out.append(better)
                continue
            close = len(self.setups) > 1 and at.left.min() < _CLOSE
            for scale in _ONE_ROUND if close else _ROUNDS:
                at = self._next_to(at, scale)
                out.append(at)
        return out

    def _polished(self, at: Weighed) -> Weighed | None:
        """The best sets of several fingers that touch with their tips alone, brought nearer to balance."""
        if len(self.setups) == 1 or self._supported:
            return None
        best = spread_order(at.score, at.features, _POLISHED)
        sets = [c.take(i[best]) for c, i in zip(at.candidates, at.index, strict=True)]
        better = polished(self.scene, self.loads, self.setups, sets, at.pose)
        return None if better is None else self._weigh(at.pose, better, paired=True)

    def _next_to(self, at: Weighed, scale: float) -> Weighed:
        best = spread_order(at.score, at.features, _BEST)
        more: list[Candidates] = []
        for setup, candidates, index, (middles, tip) in zip(
            self.setups, at.candidates, at.index, self._touches, strict=True
        ):
            some = candidates.take(np.unique(index[best]))
            near = near_candidates(self.scene, setup, some, at.pose, middles, tip, scale)
            more.append(some if near is None else near.take(_least_violation(near)))
        return self._weigh(at.pose, more)

    def _weigh(self, pose: Pose, found: list[Candidates], paired: bool = False) -> Weighed:
        supports = support_block(self.scene, self.loads, support_contacts(self.scene, pose, self.on), pose)
        blocks = [
            finger_block(self.scene, self.loads, setup, candidates, pose)
            for setup, candidates in zip(self.setups, found, strict=True)
        ]
        index, left, cost, forces = combine(self.loads, blocks, supports, [c.features for c in found], paired)
        wrong = np.stack([c.violation[i] for c, i in zip(found, index, strict=True)]).sum(axis=0)
        score = doubt(left) + cost + np.where(wrong > 0.0, 0.5 + 10.0 * np.minimum(wrong, 0.2), 0.0)
        size = self.scene.object.size
        place = np.broadcast_to([pose[0] / size, pose[1] / size, pose[2]], (len(left), 3))
        features = np.concatenate([*(c.features[i] for c, i in zip(found, index, strict=True)), place], axis=1)
        return Weighed(pose, found, index, left, score, wrong, features, forces)


def _least_violation(candidates: Candidates) -> Array:
    """Those with nothing much in the way, and the few next to them."""
    good = np.flatnonzero(candidates.violation <= _NEARLY)
    return np.union1d(good, np.argsort(candidates.violation, kind="stable")[:_FEW])
