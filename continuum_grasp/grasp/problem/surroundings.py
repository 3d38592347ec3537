"""Surroundings of the fingers at a point of the search: obstacles for the guarded places, and the depth."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from continuum_grasp.base import Numbers as Array
from continuum_grasp.grasp.certificate.check import EXACT
from continuum_grasp.grasp.problem.points import bending_arrays
from continuum_grasp.grasp.problem.problem import GraspProblem
from continuum_grasp.grasp.problem.unit_finger import UnitFinger
from continuum_grasp.grasp.problem.values import FINE, Units, Values
from continuum_grasp.grasp.shape import ROUNDING, FingerShape, skin
from continuum_grasp.grasp.starts.curves import rough_distance, sample
from continuum_grasp.model import TouchingCircle, surface_of
from continuum_grasp.rod import DenseRod
from continuum_grasp.scene import Finger, FingerSetup, GraspScene, Part, Wall

_FAR = 10.0
"""Distance from which on nothing is in the way, in units of the problem."""
_EVEN = np.arange(2 * FINE + 1) / (2 * FINE)
"""Places along a finger between which its shape is integrated: half as far apart as those where the depth of one with a
single element is looked at.
"""


@dataclass(frozen=True)
class _Obstacle:
    """Obstacle that a finger must stay clear of, in units of the problem: a convex part of the world, or the half plane
    behind a wall, with which the base is within it if there is a ``floor``, the height of that.
    """

    body: Part | Wall
    floor: float | None = None
    emerging: int = 0  # elements that may come out of it

    def gaps(self, at: Array, owner: Array, half: Array, units: Units) -> tuple[Array, Array]:
        """Distances (K,) of places (K, 2) on the elements ``owner`` (K,), half as thick as ``half`` (K,), and the gaps
        that they need.
        """
        if not isinstance(self.body, Wall):
            return surface_of(self.body).outline(self.body).distance(_complex(at, units)) / units.length, half
        needed = half if self.floor is None else np.where(owner < self.emerging, self.floor, half)
        return (at - np.asarray(self.body.point) / units.length) @ np.asarray(self.body.normal), needed


def _obstacles(scene: GraspScene, setup: FingerSetup, emerging: int, base: Array, units: Units) -> list[_Obstacle]:
    """The obstacles of a finger: half planes, then what circles stand for."""
    obstacles = []
    clear = (1.0 - ROUNDING) * float(setup.finger.profile.half_thickness(0.0)) / units.length
    for wall in (wall for wall in scene.walls if wall.part is None):
        height = float((base[:2] - np.asarray(wall.point) / units.length) @ np.asarray(wall.normal))
        # A base within a support is no penetration: the finger comes out of it, up to its first contact.
        obstacles.append(_Obstacle(wall, min(0.0, height) if height < clear else None, emerging))
    return [*obstacles, *(_Obstacle(body.part) for body in scene.places if body.part is not None)]


class NearbySearch:
    """Looks for bodies near the fingers of one problem."""

    def __init__(self, problem: GraspProblem) -> None:
        self._problem = problem

    def look(
        self, scene: GraspScene, x: Array, numbers: Array, probes: Mapping[str, Array] | None = None
    ) -> tuple[float, Values]:
        """Look at a point of the search, given by unknowns and run-time numbers; what a look finds does not matter in
        these. ``probes`` by finger, where given, are the guarded fractions of the elements in place of the deepest.

        Gives the greatest penetration beyond the relaxation, in units of the problem, and the numbers that were found:
        probes, circles of obstacles, needed gaps.
        """
        units = Units.of(scene)
        seen = Values()
        pose = self._problem.pose(x, numbers)
        at = self._problem.x.at
        allowed = [float(x[at[f"relaxed clearance at the {name}"]][0]) for name in ("supports", "object")]
        traced = [
            self._along(scene, setup, k, x, numbers, pose, allowed, seen, probes)
            for k, setup in enumerate(scene.setups)
        ]
        depths = [-np.inf, *(finger.deepest for finger in traced)]
        for finger, other in self._problem.spec.pairs:
            allowed_overlap = float(x[at["relaxed overlap"]][0]) if other != finger else 0.0
            name = f"{traced[finger].name}, {traced[other].name}"
            before = [numbers[self._problem.numbers.at[f"{side} of {name}"]] for side in ("first", "second")]
            depths.append(_between(traced[finger], traced[other], before, seen) - allowed_overlap)
        for i, peg in enumerate(scene.pegs if self._problem.spec.free else ()):
            local = _local(np.asarray(peg.position)[None] / units.length, pose)
            for k, (circles, _) in enumerate(_beside(scene.object.pieces, self._problem.spec.obstacles, local, units)):
                seen[f"peg {i}.near_{k}"] = circles
        return max(depths), seen

    def _along(
        self,
        scene: GraspScene,
        setup: FingerSetup,
        index: int,
        x: Array,
        numbers: Array,
        pose: Array,
        allowed: list[float],
        seen: Values,
        earlier: Mapping[str, Array] | None,
    ) -> _Traced:
        """Look along one finger; supports and object may be ``allowed`` deep in it."""
        placed, name, units = self._problem.fingers[index], setup.name, Units.of(scene)
        finger = placed.part.finger
        clear = ~np.array(finger.touches)  # which guarded places do not touch the object
        touched = placed.values(placed.part.touched, x, numbers)[3][:, placed.part.along]
        points, half, curvatures, q, lengths, tip, pulls, base = placed.values(placed.part.places, x, numbers)
        half = half.ravel()
        lengths = lengths.ravel()
        base = base.ravel()
        size = setup.finger.rod.length
        line = _Line.of(setup, finger, curvatures, q.ravel(), lengths, float(tip.ravel()[0]), pulls.ravel())
        obstacles = _obstacles(scene, setup, finger.spec.emerging, base, units)
        pieces = scene.object.pieces
        count = self._problem.spec.obstacles

        def along(fractions: Array) -> tuple[Array, Array, Array]:
            at = line.points(fractions) * np.exp(1j * base[2]) * (size / units.length)
            owner = np.repeat(np.arange(len(fractions)), fractions.shape[1])
            thick = skin(setup.finger.profile.half_thickness)(size * line.places(fractions)) / units.length
            return np.stack([base[0] + at.real, base[1] + at.imag], axis=1), owner, thick

        def depth(places: tuple[Array, Array, Array], rough: bool) -> Array:
            at, _, thick = places
            local = _complex(_local(at, pose), units)
            deepest = thick - _from_object(pieces, local, rough) / units.length - allowed[1]
            for gap, needed in (obstacle.gaps(*places, units) for obstacle in obstacles):
                deepest = np.maximum(deepest, needed - gap - allowed[0])
            return deepest.reshape(finger.spec.elements, -1)

        even = np.tile(np.arange(FINE + 1) / FINE, (finger.spec.elements, 1))
        dense = along(even)
        if earlier is None:
            picks = _deepest(depth(dense, True), finger.spec.probes)
            before = numbers[self._problem.numbers.at[f"{name}.probes"]].reshape(picks.shape)
            probes = _refined(lambda fractions: depth(along(fractions), False), picks, before)
        else:
            probes = earlier[name].reshape(finger.spec.elements, finger.spec.probes)
        at, owner, thick = along(probes)
        at = np.concatenate([points.T, at])
        thick = np.concatenate([half, thick])
        owner = np.concatenate([finger.unprobed, owner]).astype(int)
        beside = _beside(pieces, count, _local(at, pose), units, (~clear, touched.T))
        sharp = np.any([TouchingCircle(circles[:, -probes.size :]).is_corner for circles, _ in beside], axis=0)
        # Next to an end a corner is what touches there.
        inside = (np.abs(probes - 0.5) < 0.5 - 1.5 / FINE).ravel()
        if (sharp & inside).any():
            around = probes[..., None] + np.array([-0.5, 0.0, 0.5]) / FINE
            traced = _local(along(around.reshape(len(probes), -1))[0], pose).reshape(-1, 3, 2)
            for circles, _ in beside:
                _bend_corners(circles[:, -probes.size :], traced, inside)
        if finger.spec.strained and line.shape is not None:
            seen[f"{name}.strain probes"] = _most_strained(setup, line, even)
        seen[f"{name}.probes"], depths = probes.ravel(), list[float]()
        for k, (circles, gap) in enumerate(beside):
            retained = clear if k == 0 and count == 1 else np.ones(len(owner), dtype=bool)
            depths.append(float((thick - gap)[retained].max()) - allowed[1])
            # One column after the other.
            seen[f"{name}.near_{k}"] = circles[:, retained].T
        for k, obstacle in enumerate(obstacles):
            gap, needed = obstacle.gaps(at, owner, thick, units)
            depths.append(float((needed - gap).max()) - allowed[0])
            if isinstance(obstacle.body, Wall):
                seen |= {f"{name}.needed_{k}_{j}": value for j, value in enumerate(needed)}
            else:
                number = k - self._problem.spec.planes
                seen[f"{name}.near_fixed_{number}"] = _nearest(obstacle.body, at, units)[0].T
        return _Traced(name, max(depths), *dense, at)


@dataclass(frozen=True)
class _Traced:
    """A finger as it was looked at, in units of the problem."""

    name: str
    deepest: float  # greatest penetration beyond what is allowed
    points: Array  # (M, 2) densely along it
    owner: Array  # (M,) their elements
    half: Array  # (M,) half the thickness there
    guarded: Array  # (K, 2) the guarded places

    @cached_property
    def _at(self) -> Array:
        """Indices (K,) of the points nearest to the guarded places."""
        off = self.points[:, None] - self.guarded
        return np.asarray((off**2).sum(axis=2).argmin(axis=0))

    def picks(self, weights: Array) -> Array:
        """Indices (m,) of points, about, that guarded places give with weights (m K,) column by column."""
        count = len(self.guarded)
        return np.asarray(np.rint(self._at @ weights.reshape(count, -1, order="F")).astype(int))

    def weights(self, picks: Array) -> Array:
        """Weights (K, m) of the guarded places that give the points of indices ``picks`` (m,), about."""
        at = self._at
        order = np.argsort(at, kind="stable")
        at = at[order]
        after = np.clip(np.searchsorted(at, picks), 1, at.size - 1)
        before = after - 1
        share = np.clip((picks - at[before]) / np.maximum(at[after] - at[before], 1), 0.0, 1.0)
        weights = np.zeros((at.size, picks.size))
        columns = np.arange(picks.size)
        weights[order[before], columns] += 1.0 - share
        weights[order[after], columns] += share
        return weights


def _between(finger: _Traced, other: _Traced, earlier: Sequence[Array], numbers: Values) -> float:
    """Depth of two fingers in each other, or of one in itself; the places where each element is nearest go into the
    numbers, and those where it was in ``earlier`` weights of either finger, which vanish at first.
    """
    away = np.hypot(*(finger.points[:, None] - other.points).transpose(2, 0, 1))
    gap = away - finger.half[:, None] - other.half
    rows = [np.flatnonzero(finger.owner == k)[:, None] for k in range(int(finger.owner[-1]) + 1)]
    columns = [np.flatnonzero(other.owner == k) for k in range(int(other.owner[-1]) + 1)]
    if finger is other:
        # Of each element the place nearest to what follows it beyond half a circle of the half thickness.
        s = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(finger.points, axis=0).T))])
        gap = np.where(s - s[:, None] > np.pi * np.maximum.outer(finger.half, finger.half), gap, _FAR)
        columns = []
    every = np.arange(len(finger.points))[:, None], np.arange(len(other.points))
    picks = []
    for i, j in (*((row, every[1]) for row in rows), *((every[0], column) for column in columns)):
        k = int(gap[i, j].argmin())
        picks.append((int(i.ravel()[k // j.size]), int(j[k % j.size])))
    first, second = np.array(picks).T
    before = [one.picks(weights)[: len(picks)] for one, weights in zip((finger, other), earlier, strict=True)]
    known = earlier[0].any()
    first, second = (np.append(at, was if known else at) for at, was in zip((first, second), before, strict=True))
    weights = finger.weights(first), other.weights(second)
    between = weights[0].T @ finger.guarded - weights[1].T @ other.guarded
    chords = np.maximum(np.hypot(*between.T), 1e-12)  # of places on each other any direction will do
    name = f"{finger.name}, {other.name}"
    # Column after column, as CasADi has it; between guarded places a finger bends away from the line through them.
    numbers |= {f"{side} of {name}": w.ravel(order="F") for side, w in zip(("first", "second"), weights, strict=True)}
    numbers[f"direction of {name}"] = (between / chords[:, None]).ravel()
    numbers[f"gap of {name}"] = chords - gap[first, second]
    return -float(gap.min())


@dataclass(frozen=True)
class _Line:
    """The backbone of a unit finger; ``ends`` (N + 1,) of its elements, and their curvature (K,) linear between knots,
    or of a graded finger its ``shape``.
    """

    ends: Array
    knots: Array
    curvatures: Array
    shape: FingerShape | None
    finger: Finger

    @classmethod
    def of(
        cls,
        setup: FingerSetup,
        finger: UnitFinger,
        curvatures: Array,
        q: Array,
        lengths: Array,
        tip: float,
        pulls: Array,
    ) -> _Line:
        """The line of stored numbers, in units of the problem."""
        ends = np.concatenate([[0.0], np.cumsum(lengths)])
        size = setup.finger.rod.length
        if setup.graded:
            tensions = pulls * setup.stiffness / size / setup.tendons.offset
            arrays = bending_arrays(setup, finger, q, lengths * size, tip, tensions)
            arrays |= {"lengths": lengths * size, "tensions": tensions}
            shape = FingerShape(setup, {f"{setup.name}.{key}": value for key, value in arrays.items()})
            return cls(ends, ends, ends, shape, setup.finger)
        family = finger.family
        places = family.places if family.degree else np.array([0.0, 1.0])
        knots = ends[:-1, None] + lengths[:, None] * places
        values = np.broadcast_to(curvatures.T, knots.shape)
        if family.continuous:
            knots, values = (np.append(v[:, :-1], v[-1, -1]) for v in (knots, values))
        return cls(ends, knots.ravel(), values.ravel(), None, setup.finger)

    def places(self, fractions: Array) -> Array:
        """Positions (N * M,) along the finger at fractions (N, M) of its elements."""
        return np.asarray((self.ends[:-1, None] + np.diff(self.ends)[:, None] * fractions).ravel())

    def points(self, fractions: Array) -> Array:
        """World points (N * M,) of a finger from 0 along i at increasing fractions (N, M) of its elements."""
        at = self.places(fractions)
        if self.shape is not None:
            rod = DenseRod(self.finger, self.shape.joints, _EVEN[1], (0.0, 0.0, 0.0))
            length = self.shape.joints[-1]
            points, _ = rod.at(self.shape.curvature(rod.nodes), length * at)
            return np.asarray((points[:, 0] + 1j * points[:, 1]) / length)
        every = np.concatenate([_EVEN, at])
        order = np.argsort(every, kind="stable")
        line = np.empty(len(every), complex)
        line[order] = sample(self.knots[None], self.curvatures[None], every[None, order])[0]
        return line[len(_EVEN) :]


_AROUND = np.arange(-8.0, 9.0)
"""Places around a pick at which the depth is looked at again, in steps."""


def _most_strained(setup: FingerSetup, line: _Line, fractions: Array) -> Array:
    """Per element, the fraction (N,) where the strain is greatest, by the parabola through it."""
    shape = line.shape
    depth = setup.finger.profile.half_depth
    if shape is None or depth is None:
        return np.zeros(len(fractions))
    at = shape.joints[-1] * line.places(fractions)
    strain = np.abs(shape.curvature(at) * depth(at)).reshape(fractions.shape)
    return _deepest(strain, 1)[:, 0]


def _deepest(depth: Array, count: int) -> Array:
    """Per element, the fractions (N, count) where it is deepest, apart from each other, by parabolas."""
    left = depth.copy()
    picks = []
    left[:, [0, -1]] = -np.inf  # ends are looked after on their own
    # Half of an even spacing between two picks, so that both do not fall into one dip.
    near = FINE // (2 * count)
    rows = np.arange(len(depth))
    for _ in range(count):
        pick = left.argmax(axis=1)
        picks.append((pick + _peak(depth, rows, pick)) / FINE)
        for k, j in enumerate(pick):
            left[k, max(j - near, 0) : j + near + 1] = -np.inf
    return np.sort(np.stack(picks, axis=1), axis=1)


def _refined(depth: Callable[[Array], Array], picks: Array, before: Array) -> Array:
    """Fractions (N, count) near picks where it is deepest, by parabolas through closer places; fractions of ``before``
    that are deeper: a finger that lies against an object at a guarded place sinks in there once the guard is gone, and
    two such places beside each other would take turns.

    Beside a contact the depth is far from a parabola over the first spacing, and the limit there has a multiplier of
    thousands: a place that is off by 0.005 changes the derivatives of tensions by 1e-4 (mug).
    """
    rows = np.arange(picks.size)
    step = 1.0 / FINE
    for _ in range(2):
        step /= 8.0
        around = np.clip(picks[..., None] + step * _AROUND, 1.0 / FINE, 1.0 - 1.0 / FINE)
        seen, places = (v.reshape(picks.size, -1) for v in (depth(around.reshape(len(picks), -1)), around))
        pick = np.clip(seen.argmax(axis=1), 1, _AROUND.size - 2)
        picks = (places[rows, pick] + step * _peak(seen, rows, pick)).reshape(picks.shape)
        picks = np.clip(picks, 1.0 / FINE, 1.0 - 1.0 / FINE)
    # The deepest of all, apart from each other; zero is a place that no look has put there.
    every = np.concatenate([picks, np.where(before > 0.0, before, picks)], axis=1)
    seen = depth(every)
    deepest = np.empty_like(picks)
    for k in range(picks.shape[1]):
        deepest[:, k] = every[np.arange(len(every)), seen.argmax(axis=1)]
        seen[np.abs(every - deepest[:, k : k + 1]) < 1.0 / FINE] = -np.inf
    return np.sort(deepest, axis=1)


def _peak(values: Array, rows: Array, pick: Array) -> Array:
    """Place of the maximum of the parabola through a pick and its neighbors, from the pick, in spacings."""
    a, b, c = (values[rows, pick + k] for k in (-1, 0, 1))
    bent = a - 2.0 * b + c
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.clip(np.where(bent < 0.0, 0.5 * (a - c) / bent, 0.0), -1.0, 1.0)


def _bend_corners(circles: Array, traced: Array, some: Array) -> None:
    """Bend circles (5, K) that stand for corners as the finger bends opposite to them, ``traced`` (K, 3, 2) before,
    at and behind ``some`` (K,) places.

    A corner may slide along the finger, away from a place that is fixed: the finger's distance from it is, to second
    order, the distance of the place from a circle through the corner with the curvature of the finger.
    """
    along = traced[:, 2] - traced[:, 0]
    bend = traced[:, 2] - 2.0 * traced[:, 1] + traced[:, 0]
    normal = circles[2:4].T
    length = np.linalg.norm(along, axis=1)
    # 0.1: angle between the finger's normal and a corner's direction [rad] up to which the corner is opposite to a
    # place
    opposite = np.abs((along * normal).sum(axis=1)) < 0.1 * length
    corner = some & opposite & TouchingCircle(circles).is_corner
    circles[4, corner] = (4.0 * (bend * normal).sum(axis=1) / length**2)[corner]


def _local(points: Array, pose: Array) -> Array:
    c, s = np.cos(pose[2]), np.sin(pose[2])
    return np.asarray((points - pose[:2]) @ np.array([[c, -s], [s, c]]))


def _complex(points: Array, units: Units) -> Array:
    """Points (K, 2) as complex numbers [m]."""
    return np.asarray((points[:, 0] + 1j * points[:, 1]) * units.length)


def _from_object(pieces: tuple[Part, ...], points: Array, rough: bool) -> Array:
    """Distances (K,) of complex points (K,) in the object's frame [m], to 1e-5 of its size where that is enough."""
    shapes = tuple(surface_of(piece).outline(piece) for piece in pieces)
    if rough:
        return rough_distance(shapes, points)
    return np.asarray(np.min([shape.distance(points) for shape in shapes], axis=0))


def _beside(
    pieces: tuple[Part, ...], count: int, points: Array, units: Units, touching: tuple[Array, Array] | None = None
) -> list[tuple[Array, Array]]:
    """Circles (5, K) and distances (K,) of the pieces nearest to points of the object's frame (K, 2), for each of
    ``count`` of them; of the points that are marked (K,) as ``touching`` at places (T, 2), without what they touch.
    """
    nearest = [_nearest(piece, points, units) for piece in pieces]
    circles, gaps = (np.stack(every) for every in zip(*nearest, strict=True))
    if touching is not None and count > 1:
        marked = np.flatnonzero(touching[0])
        places = touching[1]
        where, at = np.nonzero([_nearest(piece, places, units)[1] < EXACT for piece in pieces])
        # A face far behind takes the place of the touched one.
        circles[where, :2, marked[at]] -= _FAR * circles[where, 2:4, marked[at]]
        circles[where, 4, marked[at]] = 0.0
        gaps[where, marked[at]] += _FAR
    if len(pieces) > count:
        order = np.argsort(gaps, axis=0)[:count]
        gaps = np.take_along_axis(gaps, order, 0)
        circles = np.take_along_axis(circles, order[:, None], 0)
    return list(zip(circles, gaps, strict=True))


def _nearest(part: Part, points: Array, units: Units) -> tuple[Array, Array]:
    """Circles (5, K) that stand for a part near points of its frame (K, 2), and distances (K,), in units of the
    problem.
    """
    return surface_of(part).circles(part, points * units.length, units.length)
