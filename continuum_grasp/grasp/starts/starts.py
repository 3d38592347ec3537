"""Starting points for the search: postures that touch, from geometry alone (numpy only).

For each pose of the object that is tried, the postures of every finger are found on their own, combined, and ranked by
how nearly contact forces and tensions within their limits could balance them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from continuum_grasp.base import Numbers as Array
from continuum_grasp.grasp.shape import ROUNDING
from continuum_grasp.grasp.starts.basins import Basins, is_scanned
from continuum_grasp.grasp.starts.candidates import Candidates, find_candidates, spread_order
from continuum_grasp.grasp.starts.fingertips import COUNTS, matched_sets, polished
from continuum_grasp.grasp.starts.force import (
    ForceBlock,
    Loads,
    contact_forces,
    finger_block,
    imbalance,
    loads_of,
    support_block,
)
from continuum_grasp.grasp.starts.scan.curves import sample
from continuum_grasp.grasp.starts.supports import base_poses, object_poses, support_contacts
from continuum_grasp.grasp.starts.values import ContactStart, FingerStart, GraspStart, Pose, interleaved
from continuum_grasp.model import Family
from continuum_grasp.scene import GraspScene


def make_starts(scene: GraspScene, on: frozenset[str], count: int) -> list[GraspStart]:
    """Starting points with the contacts wanted, ``on`` by name: those of fingers, and walls and pegs.

    There are ``count`` of them at most, the most promising first, then such that differ from those before; where all
    fingers touch with their tips alone, so many of sets that are bent into balance, and so many of others; none where a
    finger reaches nothing. Those labeled "scan" touch everywhere they should without penetration; "near" ones do so
    as nearly as was found.
    """
    weighing = Weighing(scene, on)
    kinds = zip(
        *(at for k, pose in enumerate(object_poses(scene, on)) if (at := weighing.at_pose(pose, k))), strict=True
    )
    chosen = []
    for kind in kinds:
        rows = [(at, row) for at in kind for row in range(len(at.score))]
        score, features = (np.concatenate(part) for part in zip(*((at.score, at.features) for at in kind), strict=True))
        chosen.append([_as_start(weighing, *rows[k]) for k in spread_order(score, features, count)])
    return interleaved(chosen)


def basin_starts(scene: GraspScene, on: frozenset[str]) -> tuple[list[GraspStart], Basins] | None:
    """Starts with the contacts ``on`` by name that stand for the basins of an exhaustive scan, the most
    promising first; None where postures are not of one parameter (see `is_scanned`).
    """
    if not is_scanned(scene, on):
        return None
    basins = Basins(scene, on)
    return starts_of(basins, refined=True), basins


def starts_of(basins: Basins, *, refined: bool = False) -> list[GraspStart]:
    """Starts from the basins of a scan, which may be ``refined``."""
    if not basins.postures:
        return []
    scored = basins.refined() if refined else basins.lowest()
    none, rows = np.zeros(len(scored.score)), np.arange(len(scored.score))
    at = Weighed(basins.pose, [scored.candidates], [rows], scored.left, scored.score, none, none, scored.forces)
    return [
        replace(_as_start(basins, at, row), estimate=float(scored.estimate[row]), imbalance=float(scored.left[row]))
        for row in rows.tolist()
    ]


def _as_start(made: Weighing | Basins, at: Weighed, row: int) -> GraspStart:
    scene, on = made.scene, made.on
    fingers: dict[str, FingerStart] = {}
    contacts: dict[str, ContactStart] = {}
    forces: dict[str, tuple[float, float, float]] = {}
    tensions: dict[str, tuple[float, float]] = {}
    loads, place, balanced = made.loads, 0, at.forces[row]
    for setup, candidates, index in zip(scene.setups, at.candidates, at.index, strict=True):
        posture = int(index[row])
        length = setup.finger.rod.length
        knots, bent = candidates.knots[posture], candidates.curvatures[posture]
        # Knots at one place with one curvature are padding; where the curvature steps, the first is moved back, since
        # interpolation needs increasing knots.
        retained = np.concatenate([[True], (np.diff(knots) > ROUNDING) | (np.abs(np.diff(bent)) > 1e-12)])
        knots, bent = knots[retained], bent[retained]
        knots[:-1] -= ROUNDING * (np.diff(knots) <= 0.0)
        x, y, angle = candidates.bases[posture].tolist()
        fingers[setup.name] = FingerStart(
            (x, y, angle),
            tuple((candidates.joints[posture] * length).tolist()),
            (int(candidates.sides[posture]),) * len(setup.middles),
            tuple((knots * length).tolist()),
            tuple((bent / length).tolist()),
        )
        names = [n for n in setup.switches if n in on]
        size = len(names) * loads.edges
        forces |= contact_forces(scene, loads, names, balanced[place : place + size])
        tensions[setup.name] = tuple(balanced[place + size : place + size + 2].tolist())
        place += size + 2
        for column, name in enumerate(names):
            point = complex(candidates.points[posture, column])
            contacts[name] = ContactStart(
                int(candidates.parts[posture, column]),
                (point.real, point.imag),
                math.remainder(candidates.angles[posture, column], math.tau),
            )
    touched = support_contacts(scene, at.pose, on)
    forces |= contact_forces(scene, loads, list(touched), balanced[place:])
    contacts |= touched
    estimate = sum(map(sum, tensions.values())) if at.left[row] < NEARLY_BALANCED else math.nan
    label = "near" if at.wrong[row] > 0.0 else "scan"
    return GraspStart(label, at.pose, fingers, contacts, forces, tensions, estimate, doubt=float(at.score[row]))


NEARLY_BALANCED = 0.02
"""Relative imbalance up to which its size ranks starts; IPOPT brings a few parts in a hundred to zero. With limits
relaxed, postures that hold had 0.003 at most, others 0.02 and more with few exceptions (28 scenes)."""
_CLEAREST = 100
"""Postures of one finger that are weighed, those with least in the way: all that 8 scenes chose have nothing."""


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
            setup.switches.keys() & on == {setup.tip_name} and Family.named(setup.family).degree > 0
            for setup in self.setups
        ]
        self._tips_alone = len(alone) > 1 and all(alone)

    def at_pose(self, pose: Pose, number: int) -> list[Weighed]:
        """Candidates at the ``number``-th pose of the object; nothing where a finger does not reach it."""
        postures: list[Candidates] = []
        for setup in self.setups:
            candidates = find_candidates(self.scene, setup, base_poses(setup, number), pose, self.on)
            if candidates is None:
                return []
            if len(self.setups) == 1 and len(candidates) > _CLEAREST:
                wrong = candidates.violation
                candidates = candidates.take(wrong <= np.partition(wrong, _CLEAREST)[_CLEAREST])
            postures.append(candidates)
        blocks, features = self._blocks(pose, postures), self._features(postures)
        plain = self._weigh(pose, postures, features, blocks, combinations(self.loads, blocks, features))
        if not self._tips_alone:
            return [plain]
        touched = support_contacts(self.scene, pose, self.on)
        supports = support_block(self.scene, self.loads, touched, pose), touched
        sets = matched_sets(self.scene, self.loads, postures, features, blocks, supports)
        bent = polished(self.scene, self.loads, sets, pose, supports)
        pairs = [np.arange(len(bent[0].knots))] * len(bent)
        return [self._weigh(pose, bent, self._features(bent), self._blocks(pose, bent), pairs), plain]

    def _features(self, postures: list[Candidates]) -> list[Array]:
        return [c.features(setup.finger.rod.length) for setup, c in zip(self.setups, postures, strict=True)]

    def _blocks(self, pose: Pose, postures: list[Candidates]) -> list[ForceBlock]:
        pairs = zip(self.setups, postures, strict=True)
        return [finger_block(self.scene, self.loads, setup, candidates, pose) for setup, candidates in pairs]

    def _weigh(
        self,
        pose: Pose,
        postures: list[Candidates],
        features: list[Array],
        blocks: list[ForceBlock],
        index: list[Array],
    ) -> Weighed:
        supports = support_block(self.scene, self.loads, support_contacts(self.scene, pose, self.on), pose)
        every = [*index, np.zeros(len(index[0]), int)]
        left, cost, forces = imbalance(self.loads, [*blocks, supports], every)
        wrong = np.stack([c.violation[i] for c, i in zip(postures, index, strict=True)]).sum(axis=0)
        wrong += overlaps(self.scene, postures, index)
        # What is in the way counts from half a unit on: any amount of it may cost the start.
        score = doubt(left) + cost + np.where(wrong > 0.0, 0.5 + 10.0 * np.minimum(wrong, 0.2), 0.0)
        size = self.scene.object.size
        place = np.broadcast_to([2.0 * pose[0] / size, 2.0 * pose[1] / size, 2.0 * pose[2]], (len(left), 3))
        unlike = np.concatenate([*(what[i] for what, i in zip(features, index, strict=True)), place], axis=1)
        return Weighed(pose, postures, index, left, score, wrong, unlike, forces)


def combinations(loads: Loads, blocks: list[ForceBlock], features: list[Array]) -> list[Array]:
    """Combinations of the postures of all fingers, of which ``features`` (P, F) are in what they differ, by indices."""
    if len(blocks) == 1:
        return [np.arange(len(blocks[0].needed))]
    # No load, and forces without effect on the object: its rows are zero and drop out of the least squares.
    free, picks = replace(loads, planar=0j, lift=0.0, balance=False), []
    for block, what in zip(blocks, features, strict=True):
        internal = replace(block, onto=0.0 * block.onto[:, :3])
        left, cost, _ = imbalance(free, [internal], [np.arange(len(block.needed))])
        picks.append(np.array(spread_order(doubt(left) + cost, what, COUNTS[len(blocks)][0])))
    return [index.ravel() for index in np.meshgrid(*picks, indexing="ij")]


def doubt(left: Array) -> Array:
    """Doubt of a grasp where forces and tensions leave this imbalance: beyond a few parts in a hundred, how much it is
    means little.
    """
    return np.where(left < NEARLY_BALANCED, 10.0 * left, 10.0 * NEARLY_BALANCED + 2.0 * (left - NEARLY_BALANCED))


_AT = np.linspace(0.0, 1.0, 25)
"""Places along a finger: the segments between them are 4 % of its length."""


def overlaps(scene: GraspScene, postures: list[Candidates], index: list[Array]) -> Array:
    """Depth of the fingers of B combinations in each other, in sum, per length (B,); ``index`` (B,) per finger are the
    postures combined.
    """
    deep, pairs, lines = np.zeros(len(index[0])), scene.pairs, []
    if not pairs:
        return deep
    for setup, candidates in zip(scene.setups, postures, strict=True):
        bent = sample(candidates.knots, candidates.curvatures, np.tile(_AT, (len(candidates.knots), 1)))
        x, y, turn = candidates.bases.T
        lines.append((x + 1j * y)[:, None] + np.exp(1j * turn)[:, None] * setup.finger.rod.length * bent)
    for k, m in pairs:
        finger, other = scene.setups[k].finger, scene.setups[m].finger
        a, b = lines[k][index[k]], lines[m][index[m]]
        apart = np.minimum(_distance(a, b), _distance(b, a))
        needed = finger.thickness_radius + other.thickness_radius
        deep += np.maximum(needed - apart, 0.0) / min(finger.rod.length, other.rod.length)
    return deep


def _distance(points: Array, line: Array) -> Array:
    """Least distance (B,) of points (B, K) from the segments between others (B, M)."""
    start, span = line[:, None, :-1], np.diff(line)[:, None]
    off = points[:, :, None] - start
    share = np.clip((off * span.conj()).real / np.abs(span) ** 2, 0.0, 1.0)
    return np.asarray(np.abs(off - share * span).min(axis=(1, 2)))
