"""Postures of one finger that touch an object at one pose, from both sides and all poses of its base: curves to one
middle contact after the other, and on to a tip that touches, or fingers whose tips alone touch.

Of two elements of linear curvature any shape whose tip touches is in balance under some force and tension, so all of
them are looked at, by the curvatures at base and joint; fingers of more elements begin with the same shapes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise

import numpy as np

from continuum_grasp.base import Numbers as Array
from continuum_grasp.grasp.starts.scan.curves import sample, segment_end, table_of, touch
from continuum_grasp.grasp.starts.scan.task import (
    ALLOWED,
    FRONT,
    TIP_REACH,
    TIPS,
    FingerTask,
    Postures,
    join,
    make_task,
    unique,
    violation,
)
from continuum_grasp.grasp.starts.scan.touching import onwards, scanned, started
from continuum_grasp.grasp.starts.scan.two_arcs import scanned_arcs
from continuum_grasp.grasp.starts.values import Pose
from continuum_grasp.scene import FingerSetup, GraspScene


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
        # Scaled so that one is a likeness: a quarter of the length, 3 1/L, 30 degrees of a normal.
        return 2.0 * np.concatenate(
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
    families = [(task, _postures(task, len(scene.setups) > 1)) for task in tasks]
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


def _postures(task: FingerTask, several: bool) -> Postures | None:
    """All postures found with the contacts of a task, from the base on: first contact, further ones, tip."""
    family: Postures | None
    if any(task.middles):
        family = first_joint(task)
        for _ in range(sum(task.middles) - 1):
            family = None if family is None else next_joint(task, family)
        if family is not None:
            family = with_tip(task, family) if task.tip else _free_end(family)
    elif task.tip:
        if task.arcs and task.counts == (1, 1):
            family = scanned_arcs(task).postures(task)
        else:
            family = bent_by_tip(task, several)
    else:  # it touches nothing: at rest
        none, bent = np.zeros((1, 0)), np.full((1, 2), task.rest)
        family = Postures(np.array([[0.0, 1.0]]), bent, none, none.astype(int), none + 0j, none, np.zeros(1))
    if family is None:
        return None
    joints = all_joints(task, family.joints)
    wrong = violation(task, family.knots, family.curvatures, joints)
    return replace(family, joints=joints, violation=wrong)


def _free_end(family: Postures) -> Postures:
    """The postures on to a free tip: constant curvature, which no force bends."""
    return replace(
        family,
        knots=np.concatenate([family.knots, np.ones((len(family), 1))], axis=1),
        curvatures=np.concatenate([family.curvatures, family.curvatures[:, -1:]], axis=1),
    )


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


_REACH, _TIP_REACH, _COUNT = 10.0, 15.0, 41
"""Greatest curvature at base and joint, and at the tip, which a short end bends [1/L]; number of each."""


def first_joint(task: FingerTask) -> Postures | None:
    """Curves from the base to the first contact, tangent there, with the object on their left."""
    some = scanned(replace(task, tip=False))
    some = some.take(some.side > 0)
    whole = some.postures(replace(task, tip=False))
    first = replace(whole, knots=whole.knots[:, :2], curvatures=whole.curvatures[:, :2])
    return _clear(task, first) if len(some) else None


def next_joint(task: FingerTask, family: Postures) -> Postures | None:
    """Curves on from the last contact to one more, with a knot half-way."""
    last = family.knots[:, -1]
    groups = []
    point, angle = ends_of(family)
    for share in (0.15, 0.3, 0.45, 0.6, 0.8):
        ell = share * (task.bounds[1] - last)
        # Shorter than 3 % of the length, no curve is worth a start.
        rows = np.flatnonzero(ell > 0.03)
        if not len(rows):
            continue
        ell, begin, start = ell[rows], family.curvatures[rows, -1], (point[rows], angle[rows])
        lengths = np.stack([0.5 * ell, 0.5 * ell], axis=1)
        for part, shape in enumerate(task.shapes):
            # On as before, straighter, or more bent.
            for factor in (1.0, 0.5, 2.0):
                curve = np.stack([begin, factor * begin, factor * begin], axis=1)
                end, _, _, _ = segment_end(lengths, curve)
                _, walk = shape.nearest(start[0] + np.exp(1j * start[1]) * end)
                bent, walk, good = touch(shape, start, lengths, curve, np.eye(3)[1:], walk)
                if not good.any():
                    continue
                retained = family.take(rows[good])
                there = last[rows][good] + ell[good]
                knots = np.stack([there - 0.5 * ell[good], there], axis=1)
                at = shape.walk(walk[good])
                parts = np.full(len(retained), part)
                longer = retained.on_to(knots, bent[good, 1:], parts, at.point, at.angle)
                groups.append(replace(longer, joints=np.concatenate([retained.joints, there[:, None]], axis=1)))
    postures = join(groups)
    return None if postures is None else _clear(task, unique(postures))


def ends_of(family: Postures) -> tuple[Array, Array]:
    """Ends of the curves so far: point and angle."""
    end, turn, _, _ = segment_end(np.diff(family.knots, axis=1), family.curvatures)
    return end, turn


def _clear(task: FingerTask, family: Postures) -> Postures:
    """Curves clear of the object so far, or the least deep ones where none is."""
    at = family.knots[:, -1:] * np.linspace(0.0, 1.0, 33)
    depth = task.half - task.distance(sample(family.knots, family.curvatures, at)).min(axis=1)
    good = depth <= ALLOWED
    return family.take(np.flatnonzero(good) if good.any() else np.argsort(depth, kind="stable")[:4])


def with_tip(task: FingerTask, family: Postures) -> Postures | None:
    point, angle = ends_of(family)
    none, bent = np.zeros(len(family)), np.repeat(family.curvatures[:, -1:], 2, axis=1)
    last = started(none.astype(int), none, none, point, none, angle, family.knots[:, -1], bent)
    branch, rows = onwards(task, last)
    if not len(rows):
        return None
    # The curvature may step at the last contact.
    on = branch.knots[:, 2:], branch.ends[:, 2:], branch.tip, branch.tip_point, branch.tip_normal
    return family.take(rows).on_to(*on)


@cache
def _halves() -> tuple[Array, Array, Array, Array, Array]:
    """Curvatures at base and joint (N,), and at the tip (N,); ends and angles (N, N) of the first half of a finger, and
    ends (N, N) of its second half.
    """
    line, ends = np.linspace(-_REACH, _REACH, _COUNT), np.linspace(-_TIP_REACH, _TIP_REACH, _COUNT)
    # A curve of half the length is half as long with twice the curvature.
    joints, bends = table_of(0.5 * line, 0.5 * line, None)
    return line, ends, 0.5 * joints, bends, 0.5 * table_of(0.5 * line, 0.5 * ends, None)[0]


def bent_by_tip(task: FingerTask, several: bool) -> Postures | None:
    """Fingers bent by a force at their tips, which touch: one or more for each pair of curvatures at base and joint.

    Of ``several`` fingers also those whose curvature is linear all along, by a grid of its ends both ways: without them
    2 of 12 scenes of three fingers lose their best grasp, and none of 160 of one finger and 20 of two.
    """
    line, ends, joints, bends, tips = _halves()
    grid = np.linspace(-TIP_REACH, TIP_REACH, TIPS // 2 + 1)
    knots, step = np.array(task.nodes), grid[1] - grid[0]
    groups: list[Postures] = []
    for part, shape in enumerate(task.shapes):
        if several:
            at, _ = table_of(grid, grid, None)
            for tip, way in ((0, 1.0 - knots), (1, knots)):
                rows, places, walk = _crossings(task, part, at if tip else at.T)
                sides = np.stack([grid[rows], grid[0] + places * step])[:: 1 if tip else -1]
                groups.append(_touching(task, part, sides.T @ [1.0 - knots, knots], way, walk))
        i, j = np.nonzero(np.abs(joints - shape.center) < shape.extent + task.half + 0.51)
        rows, places, walk = _crossings(task, part, joints[i, j][:, None] + np.exp(1j * bends[i, j])[:, None] * tips[j])
        bent = np.stack([line[i[rows]], line[j[rows]], ends[0] + places * (ends[1] - ends[0])], axis=1)
        hats = np.stack([np.interp(knots, (0.0, 0.5, 1.0), unit) for unit in np.eye(3)])
        groups.append(_touching(task, part, bent @ hats, knots > 0.5, walk))
    postures = join(groups)
    return None if postures is None else unique(postures)


def _crossings(task: FingerTask, part: int, at: Array) -> tuple[Array, Array, Array]:
    """Neighbors along the rows of a table of tips that are on either side of a grown part: rows, places along them, and
    the walks of the nearest places of the outline.
    """
    gap = task.gap(at, part)
    a, b = gap[:, :-1], gap[:, 1:]
    row, k = np.nonzero((a * b <= 0.0) & (a != b))
    share = a[row, k] / (a[row, k] - b[row, k])
    return row, k + share, task.shapes[part].nearest(at[row, k] + share * (at[row, k + 1] - at[row, k]))[1]


def _touching(task: FingerTask, part: int, bent: Array, way: Array, walk: Array) -> Postures:
    """Curves from the base whose tips touch a part with their fronts, from first guesses, by changes along a way."""
    shape, knots = task.shapes[part], np.broadcast_to(task.nodes, bent.shape)
    start, lengths = (0j * walk, 0.0 * walk), np.diff(knots, axis=1)
    bent, walk, good = touch(shape, start, lengths, bent, np.array([way], float), walk)
    at, facing = shape.walk(walk), segment_end(lengths, bent)[1]
    # The front half of the rounded tip touches.
    good &= np.cos(at.angle - facing - 0.5 * math.pi) <= FRONT
    touched = np.full((int(good.sum()), 1), part), at.point[good, None], at.angle[good, None]
    return Postures(knots[good], bent[good], np.zeros((len(touched[0]), 0)), *touched, np.zeros(len(touched[0])))


def spread_order(score: Array, features: Array, count: int) -> list[int]:
    """Indices of ``count`` of P, each the best by score (P,), less being better, under a penalty for being like one
    before by its features (P, F), which are up to a distance of one.
    """
    order: list[int] = []
    near = np.full(len(score), np.inf)
    taken = np.zeros(len(score), bool)
    for _ in range(min(count, len(score))):
        likeness = np.exp(-(near**2))
        pick = int(np.argmin(np.where(taken, np.inf, score + 0.5 * likeness)))
        order.append(pick)
        taken[pick] = True
        near = np.minimum(near, np.sqrt(((features - features[pick]) ** 2).sum(axis=1)))
    return order
