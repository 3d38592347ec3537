"""Postures of all fingers at poses of the object: which go together, weighed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.starts.candidates import Candidates, find_candidates
from continuum_grasp.grasp.starts.crossing import overlaps
from continuum_grasp.grasp.starts.fingertips import matched_sets
from continuum_grasp.grasp.starts.force import Block, Loads, finger_block, imbalance, loads_of, support_block
from continuum_grasp.grasp.starts.polish import polished
from continuum_grasp.grasp.starts.spread import spread_order
from continuum_grasp.grasp.starts.supports import base_poses, support_contacts
from continuum_grasp.model.family import family_class
from continuum_grasp.scene.grasp import GraspScene
from continuum_grasp.scene.objects.body import Pose

Array = NDArray[Any]

NEARLY_BALANCED = 0.02
"""Relative imbalance up to which its size ranks starts; IPOPT brings a few parts in a hundred to zero."""
_PER_FINGER = {2: 14, 3: 8, 4: 6}
"""Postures per finger that are combined, by number of fingers: 200 to 1300 combinations."""
_CLEAREST = 100
"""Postures of one finger that are weighed, those with least in the way: all that 8 scenes chose have nothing."""
_SETS = {2: 48, 3: 96, 4: 96}
"""Sets of so many fingers that touch with their tips alone, at a pose of the object."""


@dataclass(frozen=True)
class Weighed:
    """B combinations of postures of all fingers at one pose of the object."""

    pose: Pose  # of the object in the world [m, rad]
    candidates: list[Candidates]  # per finger
    index: list[Array]  # per finger, the posture of each combination (B,)
    left: Array  # (B,) relative imbalance
    score: Array  # (B,) less is better
    wrong: Array  # (B,) by how much something is in the way
    features: Array  # (B, F) numbers in which different combinations differ
    forces: Array  # (B, n) [N]


class Weighing:
    """Weighs postures of a scene with the contacts that are on, by name."""

    def __init__(self, scene: GraspScene, on: frozenset[str]) -> None:
        self.scene, self.on = scene, on
        self.setups, self.loads = scene.setups, loads_of(scene)
        # Arcs have too few curvatures to be bent towards balance.
        alone = [
            setup.switches.keys() & on == {setup.tip_name} and family_class(setup.family).degree > 0
            for setup in self.setups
        ]
        self._tips_alone = len(alone) > 1 and all(alone)

    def at_pose(self, pose: Pose, number: int) -> list[Weighed]:
        """Candidates at the ``number``-th pose of the object; nothing where a finger does not reach it."""
        found: list[Candidates] = []
        for setup in self.setups:
            candidates = find_candidates(self.scene, setup, base_poses(setup, number), pose, self.on)
            if candidates is None:
                return []
            if len(self.setups) == 1 and len(candidates) > _CLEAREST:
                wrong = candidates.violation
                candidates = candidates.take(wrong <= np.partition(wrong, _CLEAREST)[_CLEAREST])
            found.append(candidates)
        blocks = self._blocks(pose, found)
        plain = self._weigh(pose, found, blocks, combinations(self.loads, blocks, self._features(found)))
        if not self._tips_alone:
            return [plain]
        touched = support_contacts(self.scene, pose, self.on)
        supports = support_block(self.scene, self.loads, touched, pose), touched
        sets = matched_sets(self.scene, self.loads, found, pose, supports, _SETS[len(self.setups)])
        bent = polished(self.scene, self.loads, sets, pose, supports)
        pairs = [np.arange(len(bent[0].knots))] * len(bent)
        return [self._weigh(pose, bent, self._blocks(pose, bent), pairs), plain]

    def _blocks(self, pose: Pose, found: list[Candidates]) -> list[Block]:
        pairs = zip(self.setups, found, strict=True)
        return [finger_block(self.scene, self.loads, setup, candidates, pose) for setup, candidates in pairs]

    def _features(self, found: list[Candidates]) -> list[Array]:
        return [c.features(setup.finger.rod.length) for setup, c in zip(self.setups, found, strict=True)]

    def _weigh(self, pose: Pose, found: list[Candidates], blocks: list[Block], index: list[Array]) -> Weighed:
        supports = support_block(self.scene, self.loads, support_contacts(self.scene, pose, self.on), pose)
        every = [*index, np.zeros(len(index[0]), int)]
        left, cost, forces = imbalance(self.loads, [*blocks, supports], every)
        wrong = np.stack([c.violation[i] for c, i in zip(found, index, strict=True)]).sum(axis=0)
        wrong += overlaps(self.scene, found, index)
        # What is in the way counts from half a unit on: any amount of it may cost the start.
        score = doubt(left) + cost + np.where(wrong > 0.0, 0.5 + 10.0 * np.minimum(wrong, 0.2), 0.0)
        size = self.scene.object.size
        place = np.broadcast_to([pose[0] / size, pose[1] / size, pose[2]], (len(left), 3))
        unlike = (what[i] for what, i in zip(self._features(found), index, strict=True))
        features = np.concatenate([*unlike, place], axis=1)
        return Weighed(pose, found, index, left, score, wrong, features, forces)


def combinations(loads: Loads, blocks: list[Block], features: list[Array]) -> list[Array]:
    """Combinations of the postures of all fingers, of which ``features`` (P, F) are in what they differ, by indices."""
    if len(blocks) == 1:
        return [np.arange(len(blocks[0].needed))]
    alone = [_alone(loads, block) for block in blocks]
    most = _PER_FINGER[len(blocks)]
    picks = [
        np.array(spread_order(doubt(left) + cost, what, most))
        for (left, cost, _), what in zip(alone, features, strict=True)
    ]
    return [index.ravel() for index in np.meshgrid(*picks, indexing="ij")]


def doubt(left: Array) -> Array:
    """Doubt of a grasp where forces and tensions leave this imbalance: beyond a few parts in a hundred, how much it is
    means little.
    """
    return np.where(left < NEARLY_BALANCED, 10.0 * left, 10.0 * NEARLY_BALANCED + 2.0 * (left - NEARLY_BALANCED))


def _alone(loads: Loads, block: Block) -> tuple[Array, Array, Array]:
    """Remainder of the fingers' own balance, its cost, and what the forces then do to the object."""
    # No load, and forces without effect on the object: its rows are zero and drop out of the least squares.
    free = Loads(loads.force, loads.length, 0j, 0.0, loads.gravity, False)
    own = Block(0.0 * block.onto[:, :3], block.moments, block.needed, block.low, block.high, block.cost)
    left, cost, forces = imbalance(free, [own], [np.arange(len(block.needed))])
    return left, cost, (block.onto[:, :3] @ forces[..., None])[..., 0] / loads.force
