"""Basins of one finger's grasps: minima of the estimated tension over all postures that touch as they should.

All postures of one finger with a fixed base before a fixed object are on curves with one parameter (see
`continuum_grasp.grasp.starts.scan.touching`). They are scanned, the forces of each are balanced, and the minima along
the curves are refined for models of two elements; those of more bend away from there.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace

import numpy as np

from continuum_grasp.base import Numbers as Array
from continuum_grasp.grasp.starts.candidates import Candidates, all_joints, as_candidates
from continuum_grasp.grasp.starts.force import finger_block, imbalance, loads_of, support_block
from continuum_grasp.grasp.starts.scan import touching
from continuum_grasp.grasp.starts.scan.curves import wrapped
from continuum_grasp.grasp.starts.scan.task import Rows, make_task, obstruction
from continuum_grasp.grasp.starts.scan.touching import Branch, beside, scanned
from continuum_grasp.grasp.starts.scan.two_arcs import arc_spacing, beside_arcs, scanned_arcs
from continuum_grasp.grasp.starts.supports import support_contacts
from continuum_grasp.model import Family
from continuum_grasp.scene import GraspScene

_WINDOW = 0.125 * np.array([*range(-8, 0), *range(1, 9)])
"""Neighbors that are tried where a basin is refined, in windows."""
_WINDOWS = (1.0, 0.125)
"""Windows of each round of that, in spacings of the scan: then in those of the neighbors."""
STRICT, _PENALTY = 2e-4, 100.0
"""Penetration that a posture may have, per length of the finger, and the relative imbalance that the weight of the
tensions leaves; score of penetration [1/L] and of imbalance beyond: lower, and postures that cannot hold would come
first."""
_NEIGHBORS = 1.6
"""Spacings of a scan up to which postures are neighbors; of two arcs, of both bends in sum."""
_JOINT, _CURVATURE, _NORMAL = 0.08, 2.5, 0.5
"""Greatest differences of neighbors on one curve: joints [L], curvatures [1/L] and normals [rad]."""


def is_scanned(scene: GraspScene, on: frozenset[str]) -> bool:
    """Whether the postures of a scene with the contacts ``on`` are curves with one parameter: those of one finger with
    fixed base before a fixed object, with one middle contact, or of two arcs with the tip alone.
    """
    if len(scene.setups) > 1 or scene.object.free is not None or scene.setups[0].finger.base_free is not None:
        return False
    (setup,) = scene.setups
    middles = sum(name in on for name in setup.middle_names)
    two_arcs = setup.elements == 2 and Family.named(setup.family).degree == 0
    return middles == 1 or (middles == 0 and two_arcs and setup.tip_name in on)


@dataclass(frozen=True)
class Scored(Rows):
    """P postures, the forces that come closest to balance, and what that takes."""

    branch: Branch
    candidates: Candidates
    forces: Array  # (P, n) [N]
    left: Array  # (P,) relative imbalance
    score: Array  # (P,) tensions by their limits, with penalties
    estimate: Array  # (P,) the same in N


class Basins:
    """The basins of a scene of one finger with the contacts ``on`` by name, by all postures that touch and are clear of
    everything.
    """

    def __init__(self, scene: GraspScene, on: frozenset[str]) -> None:
        self.on, self.pose = on, scene.object.pose
        base = scene.setups[0].finger.base
        self.task = task = make_task(scene, scene.setups[0], (*base.position, base.angle), self.pose, 1, on)
        self._along = any(task.middles)
        branch = scanned(task) if self._along else scanned_arcs(task)
        self.places = touching.PLACES * len(task.shapes) if self._along else len(branch)
        self.postures = 0
        self._branch, self._candidates, _ = self._clear(branch)
        self._load(scene)

    def _load(self, scene: GraspScene) -> None:
        """Take the forces of a scene."""
        self.scene, self.loads = scene, loads_of(scene)
        self._supports = support_block(scene, self.loads, support_contacts(scene, self.pose, self.on), self.pose)

    def with_forces(self, scene: GraspScene) -> Basins:
        """Postures of the same scan in a scene that differs in mass or in limits of forces alone."""
        other = copy(self)
        other._load(scene)
        return other

    def _clear(self, branch: Branch) -> tuple[Branch, Candidates, Array]:
        """Postures that are clear of everything, and which of the postures these are."""
        task, family = self.task, branch.postures(self.task)
        family = replace(family, joints=all_joints(task, family.joints))
        family = replace(family, violation=obstruction(task, family.knots, family.curvatures, family.joints))
        clear = family.violation <= STRICT
        self.postures += int(clear.sum())
        # The task has the finger's own side, and curves to either.
        candidates = replace(as_candidates(task, family.take(clear)), sides=branch.side[clear])
        return branch.take(clear), candidates, clear

    def lowest(self) -> Scored:
        """The minima along the curves, the best first."""
        weighed = self._weighed(self._branch, self._candidates)
        linked = along_outline(self._branch) if self._along else in_bends(self._branch, arc_spacing(self.task))
        return weighed.take(minima(weighed.score, linked))

    def refined(self) -> Scored:
        """The minima moved along their curves to where they are best, in the order then."""
        best = self.lowest()
        # Arcs to a middle contact have no free parameter; models with more elements bend away from there, farther than
        # refinement moves a posture.
        isolated = self._along and self.task.one_arc_to_joint
        if isolated or self.scene.setups[0].elements > 2:
            return best
        near, spacing = (beside, 1.0) if self._along else (beside_arcs, arc_spacing(self.task))
        count = len(best.score)
        for window in _WINDOWS:
            neighbors, rows = near(self.task, best.branch, np.tile(spacing * window * _WINDOW, (count, 1)))
            branch, candidates, clear = self._clear(neighbors)
            if not len(branch):
                continue
            new = self._weighed(branch, candidates)
            moved = best_of(new.score, rows[clear], count)
            better = np.append(new.score, np.inf)[moved] < best.score
            best = best.followed_by([new]).take(np.where(better, count + moved, np.arange(count)))
        return best.take(np.argsort(best.score, kind="stable"))

    def _weighed(self, branch: Branch, candidates: Candidates) -> Scored:
        block = finger_block(self.scene, self.loads, self.scene.setups[0], candidates, self.pose)
        count = len(block.needed)
        left, cost, forces = imbalance(self.loads, [block, self._supports], [np.arange(count), np.zeros(count, int)])
        greatest_cost = float((block.cost * block.high).sum())
        above = np.abs(branch.ends).max(axis=1) / np.max(self.task.limits) - 1.0
        score = cost + _PENALTY * np.maximum(left - STRICT, 0.0)
        # 10.0: score of a curvature above its limit, as a part of it
        score += _PENALTY * np.maximum(candidates.violation, 0.0) + 10.0 * np.maximum(above, 0.0)
        return Scored(branch, candidates, forces, left, score, greatest_cost * score)


def along_outline(branch: Branch) -> Array:
    """Mask (P, P) of neighbors among postures on a ring."""
    count = touching.PLACES
    apart = np.remainder(branch.place[:, None] - branch.place + 0.5 * count, count) - 0.5 * count
    first, second = np.nonzero(np.abs(apart) <= _NEIGHBORS)

    def differ(values: Array) -> Array:
        return np.asarray(np.abs(values[first] - values[second]))

    alike = (branch.side[first] == branch.side[second]) & (branch.part[first] == branch.part[second])
    alike &= (differ(branch.joint) < _JOINT) & _alike_normals(branch, first, second)
    for end in (0, 1, 3):
        alike &= differ(branch.ends[:, end]) < _CURVATURE
    return _pairs(len(branch), first[alike], second[alike])


def _pairs(count: int, rows: Array, columns: Array) -> Array:
    """A table (P, P) of pairs."""
    out = np.zeros((count, count), bool)
    out[rows, columns] = True
    return out


def in_bends(branch: Branch, spacing: float) -> Array:
    """Mask (P, P) of neighbors among postures of two arcs, of a scan with a spacing [rad]."""
    base_bends = branch.ends[:, 0] * branch.joint
    tip_bends = branch.ends[:, 2] * (1.0 - branch.joint)
    first, second = np.nonzero(
        np.abs(base_bends[:, None] - base_bends) + np.abs(tip_bends[:, None] - tip_bends) <= _NEIGHBORS * spacing
    )
    alike = (branch.tip[first] == branch.tip[second]) & _alike_normals(branch, first, second)
    return _pairs(len(branch), first[alike], second[alike])


def _alike_normals(branch: Branch, first: Array, second: Array) -> Array:
    return np.asarray(np.abs(wrapped(branch.tip_normal[first] - branch.tip_normal[second])) < _NORMAL)


def minima(score: Array, linked: Array) -> Array:
    """Indices of the least (P,) of each neighborhood (P, P), the best first."""
    # Of equal ones the first.
    order = np.argsort(score, kind="stable")
    rank = np.empty(len(order), int)
    rank[order] = np.arange(len(order))
    least = np.where(linked, rank[None, :], len(order)).min(axis=1)
    return np.asarray(order[least[order] >= rank[order]])


def best_of(score: Array, rows: Array, count: int) -> Array:
    """Index of the least score of each of so many rows; -1 where there is none."""
    out = np.full(count, -1)
    order = np.lexsort((-score, rows))
    out[rows[order]] = order
    return out
