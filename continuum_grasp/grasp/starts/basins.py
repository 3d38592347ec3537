"""Basins of one finger's grasps: minima of the estimated tension over all postures that touch as they should.

All postures of one finger with a fixed base before a fixed object are on curves with one parameter (see
`continuum_grasp.grasp.starts.scan.touching`). They are scanned, the forces of each are balanced, and the minima along
the curves are refined for models of two elements; those of more bend away from there.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace

import numpy as np

from continuum_grasp.arrays import Numbers as Array
from continuum_grasp.grasp.starts.candidates import Candidates, all_joints, as_candidates
from continuum_grasp.grasp.starts.force import Block, finger_block, imbalance, loads_of, support_block
from continuum_grasp.grasp.starts.scan.curves import wrapped
from continuum_grasp.grasp.starts.scan.task import Postures, Rows, make_task, obstruction
from continuum_grasp.grasp.starts.scan.touching import Branch, Ring, beside, scanned
from continuum_grasp.grasp.starts.scan.two_arcs import arc_spacing, beside_arcs, scanned_arcs
from continuum_grasp.grasp.starts.supports import support_contacts
from continuum_grasp.model.family import family_class
from continuum_grasp.scene.grasp import GraspScene

STRICT = 2e-4
"""Penetration that a posture may have, per length of the finger, where postures are judged."""
_WINDOW = 0.125 * np.array([*range(-8, 0), *range(1, 9)])
"""Neighbors that are tried where a basin is refined, in windows, of which the first is a spacing of the scan."""
_ROUNDS, _SHRINK = 2, 0.125
"""Rounds of that, and what each leaves of the window: the spacing of the neighbors."""
_PER_DEPTH, _PER_EXCESS = 100.0, 10.0
"""Score of penetration [1/L], and of a curvature above its limit, as a part of it."""
_BALANCED, _PER_IMBALANCE = 2e-4, 100.0
"""Relative imbalance that the weight of the tensions leaves, and score of what is left beyond: lower, and postures that
cannot hold would come first."""
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
    two_arcs = setup.elements == 2 and family_class(setup.family).degree == 0
    return middles == 1 or (middles == 0 and two_arcs and setup.tip_name in on)


@dataclass(frozen=True)
class Scored(Rows):
    """P postures, the forces that come closest to balance, and what that takes."""

    branch: Branch
    candidates: Candidates
    forces: Array  # (P, n) [N]
    left: Array  # (P,) relative imbalance
    wrong: Array  # (P,) penetration [L]
    score: Array  # (P,) tensions by their limits, with penalties
    estimate: Array  # (P,) the same in N


class Basins:
    """The basins of a scene of one finger with the contacts ``on`` by name."""

    def __init__(self, scene: GraspScene, on: frozenset[str]) -> None:
        self.on = on
        base = scene.setups[0].finger.base
        self.base = (*base.position, base.angle)
        self.pose = scene.object.pose
        self.task = make_task(scene, scene.setups[0], self.base, self.pose, 1, on)
        self._ring = Ring(self.task)
        self.places = self.postures = 0
        # Arcs to a middle contact have no free parameter.
        self._isolated = any(self.task.middles) and self.task.one_arc_to_joint
        self._postures: Scored | None = None
        self._load(scene)

    def _load(self, scene: GraspScene) -> None:
        """Take the forces of a scene."""
        self.scene, self.setup = scene, scene.setups[0]
        touched = support_contacts(scene, self.pose, self.on)
        self.loads = loads_of(scene)
        self.supports = support_block(scene, self.loads, touched, self.pose)

    def found(self) -> Scored | None:
        """The basins, those with the least score first; None where no posture touches."""
        along = any(self.task.middles)
        some = scanned(self.task, self._ring) if along else scanned_arcs(self.task)
        self.places = self._ring.count * len(self.task.shapes) if along else len(some)
        self._postures, _ = self._judged(some)
        if self._postures is None:
            return None
        lowest = self._lowest(self._postures)
        # Models with more elements bend away from there, farther than refinement moves a posture.
        return self._refined(lowest) if self.setup.elements <= 2 else _ordered(lowest)

    def with_forces(self, scene: GraspScene) -> tuple[Basins, Scored | None]:
        """The basins among the same postures in a scene that differs in mass or in limits of forces alone."""
        other, known = copy(self), self._postures
        other._load(scene)
        if known is None:
            return other, None
        block = finger_block(scene, other.loads, other.setup, known.candidates, self.pose)
        return other, _ordered(other._lowest(other._weighed(known.branch, known.candidates, block, known.wrong)))

    # -- postures ----------------------------------------------------------------------------------------------

    def _depth(self, branch: Branch) -> Array:
        """By how much something is in the way of postures (P,) [L]."""
        return obstruction(self.task, branch.knots, branch.ends, self._joints(branch))

    def _joints(self, branch: Branch) -> Array:
        """Positions of all middle contacts (P, J)."""
        return all_joints(self.task, branch.joint[:, None] if any(self.task.middles) else np.zeros((len(branch), 0)))

    # -- forces ------------------------------------------------------------------------------------------------

    def _judged(self, branch: Branch) -> tuple[Scored | None, Array]:
        """Postures that are clear of everything, with their forces, and which of the postures these are."""
        wrong = self._depth(branch)
        clear = wrong <= STRICT
        if not clear.any():
            return None, clear
        self.postures += int(clear.sum())
        branch, wrong = branch.take(clear), wrong[clear]
        candidates = self._candidates(branch, wrong)
        block = finger_block(self.scene, self.loads, self.setup, candidates, self.pose)
        return self._weighed(branch, candidates, block, wrong), clear

    def _weighed(self, branch: Branch, candidates: Candidates, block: Block, wrong: Array) -> Scored:
        count = len(block.needed)
        left, cost, forces = imbalance(self.loads, [block, self.supports], [np.arange(count), np.zeros(count, int)])
        greatest_cost = float((block.cost * block.high).sum())
        above = np.abs(branch.ends).max(axis=1) / np.max(self.task.limits) - 1.0
        score = cost + _PER_IMBALANCE * np.maximum(left - _BALANCED, 0.0)
        score += _PER_DEPTH * np.maximum(wrong, 0.0) + _PER_EXCESS * np.maximum(above, 0.0)
        return Scored(branch, candidates, forces, left, wrong, score, greatest_cost * score)

    def _candidates(self, branch: Branch, wrong: Array) -> Candidates:
        middle, tip = any(self.task.middles), self.task.tip
        postures = Postures(
            knots=branch.knots,
            curvatures=branch.ends,
            joints=self._joints(branch),
            parts=np.stack([branch.part] * middle + [branch.tip] * tip, axis=1),
            points=np.stack([branch.point] * middle + [branch.tip_point] * tip, axis=1),
            angles=np.stack([branch.normal] * middle + [branch.tip_normal] * tip, axis=1),
            violation=wrong,
        )
        # The task has the finger's own side, and curves to either.
        return replace(as_candidates(self.task, postures), sides=branch.side)

    # -- minima ------------------------------------------------------------------------------------------------

    def _lowest(self, some: Scored) -> Scored:
        """The minima along the curves."""
        if any(self.task.middles):
            linked = along_outline(some.branch, self._ring.count)
        else:
            linked = in_bends(some.branch, arc_spacing(self.task))
        return some.take(minima(some.score, linked))

    def _refined(self, best: Scored) -> Scored:
        """The basins, moved along their curves to where they are best, and the order then."""
        count = len(best.score)
        window = 1.0 if any(self.task.middles) else arc_spacing(self.task)
        for number in range(0 if self._isolated else _ROUNDS):
            neighbors, rows = self._near(best.branch, np.tile(window * _SHRINK**number * _WINDOW, (count, 1)))
            new, clear = self._judged(neighbors)
            if new is None:
                continue
            moved = best_of(new.score, rows[clear], count)
            better = np.append(new.score, np.inf)[moved] < best.score
            best = best.followed_by([new]).take(np.where(better, count + moved, np.arange(count)))
        return _ordered(best)

    def _near(self, branch: Branch, shifts: Array) -> tuple[Branch, Array]:
        """Postures next to some on their curves, and the row that each is from."""
        if any(self.task.middles):
            return beside(self.task, self._ring, branch, shifts)
        return beside_arcs(self.task, branch, shifts)


def _ordered(some: Scored) -> Scored:
    return some.take(np.argsort(some.score, kind="stable"))


def along_outline(branch: Branch, count: int) -> Array:
    """Mask (P, P) of neighbors among postures on a ring with so many places."""
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
