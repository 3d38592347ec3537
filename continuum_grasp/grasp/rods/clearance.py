"""Overlaps in a solution: of fingers and the object between nodes, and of fingers with each other."""

from __future__ import annotations

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.grasp.rods.guess import nodes_along
from continuum_grasp.grasp.rods.obstacles import FingerObstacle
from continuum_grasp.grasp.rods.places import NearPair, StagePlace
from continuum_grasp.grasp.rods.problem import GraspRods
from continuum_grasp.grasp.rods.rod import between
from continuum_grasp.grasp.rods.supports import PegSupport

DEEP = 3e-6
"""Depth between nodes at which a row is added there [L]."""
FINE = 8
"""Places of a stage at which the depth between nodes is looked for."""
CROSSED = 1e-4
"""Overlap that counts as crossing [L]."""
NEAR = 0.03
"""Gap of chords that get rows after a crossing [L]."""
MISSED, LEANS = 3e-7, 3e-7
"""Error of a table at a contact from which on a finer one is made: of the distance [L], and of the normal."""


def deep_places(problem: GraspRods, x: Array) -> list[StagePlace]:
    """The deepest place of each stage in which a finger is in the object, or in an obstacle, between its nodes."""
    found = list[StagePlace]()
    for k, finger in enumerate(problem.numbers.fingers):
        line = _SampledLine(problem, x, k)
        found += line.deepest(None, line.depth_in_object())
        for m, obstacle in enumerate(finger.obstacles):
            found += line.deepest(m, line.depth_in(obstacle, m))
    return found


class _SampledLine:
    """Places of a finger between its nodes: `FINE` - 1 in each stage, the share within the stage first (m, stages)."""

    def __init__(self, problem: GraspRods, x: Array, index: int) -> None:
        self._problem, self._x, self._index = problem, x, index
        self.finger = problem.numbers.fingers[index]
        states = x[np.array(problem.parts[index].nodes)][:, : problem.geometry.oriented]
        s = places_of_nodes(problem, x, index)
        self.shares = np.arange(1, FINE) / FINE
        share = self.shares[:, None]
        place = between(problem.geometry, states[:-1].T, states[1:].T, np.diff(s), share)
        self.points = np.stack([part.ravel() for part in place], axis=1)
        self.half = self.finger.half(s[:-1] + np.diff(s) * share)

    def depth_in_object(self) -> Array:
        """Depths in the object [L]."""
        numbers = self._problem.numbers
        gap, _ = numbers.seen(self.finger, self.points, self._x[self._problem.pose])
        return np.asarray(self.half - gap.reshape(self.half.shape) - numbers.deviation / self.finger.length)

    def depth_in(self, obstacle: FingerObstacle, index: int) -> Array:
        """Depths in an obstacle by index, where the finger keeps clear of it [L]."""
        heights = obstacle.height(self.points).reshape(self.half.shape)
        depth = np.empty(heights.shape)
        for j in range(len(heights.T)):
            at, emerges = self._problem.beside(StagePlace(self._index, j + 1, 0.5, index))
            clear = obstacle.emerging if emerges and obstacle.emerging is not None else self.half[:, j]
            depth[:, j] = clear - heights[:, j] if at >= obstacle.first else -np.inf
        return depth

    def deepest(self, obstacle: int | None, depth: Array) -> list[StagePlace]:
        """The deepest place of each stage that is deeper than `DEEP`."""
        rows = depth.argmax(axis=0)
        deep = np.flatnonzero(depth.max(axis=0) > DEEP).tolist()
        return [StagePlace(self._index, j + 1, float(self.shares[rows[j]]), obstacle) for j in deep]


def places_of_nodes(problem: GraspRods, x: Array, finger: int) -> Array:
    """Places of a finger's nodes along it [L]."""
    return nodes_along(problem.parts[finger], x)


class Crossing:
    """Fingers of a solution that are in each other, or in themselves."""

    def __init__(self, problem: GraspRods, x: Array) -> None:
        self._problem, self._x = problem, x
        count = len(problem.parts)
        self._pairs = [*problem.numbers.pairs, *((k, k) for k in range(count))]

    @property
    def depth(self) -> float:
        """Deepest overlap [L]."""
        deepest = -np.inf
        for k, m in self._pairs:
            gaps = [self._nearest(a, b)[1].min() for a, b in ((k, m), (m, k))]
            deepest = max(deepest, -min(gaps))
            if self._cut(k, m):
                deepest = max(deepest, float(self._problem.numbers.fingers[k].half(0.0)))
        return float(deepest)

    @property
    def near(self) -> list[NearPair]:
        """Nodes and chords that are nearer than `NEAR`."""
        found = list[NearPair]()
        for k, m in self._pairs:
            for a, b in {(k, m), (m, k)}:
                chords, gaps = self._nearest(a, b)
                found += [NearPair(a, int(i), b, int(chords[i])) for i in np.flatnonzero(gaps < NEAR) if i > 0]
        return found

    def _lines(self, k: int, m: int) -> tuple[Array, Array]:
        """Places of nodes (n, dimensions) of two fingers, in lengths of the first."""
        fingers, parts, d = self._problem.numbers.fingers, self._problem.parts, self._problem.geometry.dimensions
        ratio = fingers[m].length / fingers[k].length
        return self._x[np.array(parts[k].nodes)][:, :d], ratio * self._x[np.array(parts[m].nodes)][:, :d]

    def _nearest(self, k: int, m: int) -> tuple[Array, Array]:
        """Nearest chord of finger m to each node of finger k, and the gap between both [L of k]."""
        one, other = (self._problem.numbers.fingers[i] for i in (k, m))
        reach = float(one.half(0.0) + other.length / one.length * other.half(0.0))
        p, q = self._lines(k, m)
        chords = q[1:] - q[:-1]
        away = p[:, None] - q[None, :-1]
        # 1e-12: no division by zero where a chord has no length
        share = np.clip((away * chords).sum(-1) / ((chords * chords).sum(-1) + 1e-12), 0.0, 1.0)
        gap = np.linalg.norm(away - share[..., None] * chords, axis=-1)
        if k == m:
            s = places_of_nodes(self._problem, self._x, k)
            at = s[:-1] + share * np.diff(s)
            i, j = np.indices(gap.shape)
            # A half circle of its skin touches itself by bending alone.
            beside = np.abs(s[:, None] - at) < np.pi * one.half(0.0) + np.diff(s).max()
            gap[beside | (np.abs(i - j) <= 1) | (np.abs(i - j - 1) <= 1)] = np.inf
        else:
            gap[0, 0] = np.inf  # bases may be next to each other
        chord = gap.argmin(axis=1)
        return chord, gap[np.arange(len(p)), chord] - reach

    def _cut(self, k: int, m: int) -> bool:
        """Whether center lines cut each other."""
        hit = self._problem.geometry.cuts(*self._lines(k, m))
        if k == m:
            i, j = np.indices(hit.shape)
            hit = hit & (np.abs(i - j) > 1)
        return bool(hit.any())


def touched_places(problem: GraspRods, x: Array) -> dict[str, Array]:
    """Places in the object's frame (dimensions,) [object size] at which the problem reads its table at contacts, by
    name: of fingers those of their center lines, of pegs their centers.
    """
    d, numbers, found = problem.geometry.dimensions, problem.numbers, dict[str, Array]()
    pose = x[problem.pose]
    for finger, part in zip(numbers.fingers, problem.parts, strict=True):
        for name, node in zip(finger.contacts, part.touching, strict=True):
            place = x[part.nodes[node]][None, :d]
            found[name] = numbers.local(finger, place, pose)[0]
    for support in numbers.supports:
        if isinstance(support, PegSupport) and support.touches:
            found[support.name] = numbers.in_object(support.position, pose)
    return found


def table_misses(problem: GraspRods, x: Array) -> bool:
    """Whether the tables at contacts are less exact than they can be: in the distance or the normal."""
    table = problem.numbers.table
    if table.body.least_step:
        # Facets are less exact than the table of them.
        return False
    least = min(finger.length for finger in problem.numbers.fingers)
    for name, place in touched_places(problem, x).items():
        distance, slope = table.values(place[None], name)
        near = table.body.near(place[None] * table.unit)
        off = abs(distance[0] * table.unit - near.distance[0]) / least
        leans = np.linalg.norm(slope[0] - near.normal[0])
        if off > MISSED or leans > LEANS:
            return True
    return False
