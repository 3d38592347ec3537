"""A grasp as one nonlinear problem: rods by multiple shooting, contacts, and six rows of balance of the object.

Unknowns: the pose of the object; per finger the moments of two tendons, the ends of its segments between base, middle
contacts and tip, the force that acts beyond the begin of each segment, the moment there where a contact changes it, and
the states at all nodes; per contact its force (N, f, g) and moment; the friction margin; and the parts of the balance
that nothing bears, at a price, so that every start has a feasible point nearby. A `Geometry` says what a state is.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from continuum_grasp.base import Array, Indices
from continuum_grasp.grasp.rods import kinds
from continuum_grasp.grasp.rods.numbers import UNIFORM, FingerNumbers, SceneNumbers
from continuum_grasp.nlp import BlockProblem

STAGES = 24
"""Stages of a finger; 96 % of 55 hard grasps were within 0.3 % of those with 96 stages."""
FEWEST = 6
"""Least stages of a segment."""
APEX = 1e-4
"""Rounding of the apex of a friction cone in space, per unit of force."""
UNBORNE = 100.0
"""Price of a force or moment that nothing bears; 10 and 1000 did alike."""
SHORTEST = 0.02
"""Least length of a segment, per finger."""
ALONG = 1e-3
"""Slope at which a tip may point into the object."""
_BALANCE = ("force x", "force y", "force z", "moment x", "moment y", "moment z")


@dataclass(frozen=True)
class StagePlace:
    """A place of a finger between two nodes, as a share of the stage before a node."""

    finger: int
    node: int
    share: float


@dataclass(frozen=True)
class NearPair:
    """A node of a finger, and the chord after a node of another that is near to it."""

    finger: int
    node: int
    other: int
    chord: int


@dataclass(frozen=True)
class FingerPlaces:
    """Places of a finger's unknowns."""

    nodes: list[Indices]
    segments: list[Indices]  # places of the ends of each
    forces: list[Indices]
    turns: list[Indices]  # moments at the begin of each segment but the first
    pulls: Indices
    first: list[int]  # node at which each segment begins, then the last node
    stages: int  # of each segment

    def segment_of(self, node: int) -> int:
        """Segment of the stage before a node."""
        return (node - 1) // self.stages


class GraspRods(BlockProblem):
    """The problem of a scene's numbers.

    Parameters
    ----------
    numbers : SceneNumbers
    joints : sequence of sequences of float, optional
        About where the middle contacts of each finger are along it [L]: walls begin by that.
    stages : int
        Stages of a finger.
    places : sequence of StagePlace
        Places that keep clear of the object, apart from nodes and half way between them.
    near : sequence of NearPair
        Nodes and chords of fingers that keep apart.
    fine : bool
        Whether there are as many stages as in a grasp that the search returns.
    """

    def __init__(
        self,
        numbers: SceneNumbers,
        *,
        joints: Sequence[Sequence[float]] = (),
        stages: int = STAGES,
        places: Sequence[StagePlace] = (),
        near: Sequence[NearPair] = (),
        fine: bool = False,
    ) -> None:
        super().__init__("grasp", numbers.table.coefficients)
        self.numbers, self.geometry = numbers, numbers.geometry
        self.places, self.near, self._joints = tuple(places), tuple(near), joints
        self.fine = fine
        stages *= self.geometry.finer if fine else 1
        self.pose = self.unknown("pose", *numbers.pose_bounds)
        aims = numbers.aims
        self.margin = self.unknown("margin", 0.0, 1.0 if aims.margin else 0.0)
        self.price(self.margin, -aims.margin)
        self.balance = np.concatenate([self._balanced(k, name) for k, name in enumerate(_BALANCE)])
        self.contacts: dict[str, Indices] = {}
        self.parts = [self._finger(k, finger, stages) for k, finger in enumerate(numbers.fingers)]
        for support in numbers.supports:
            held = self._held(support.name, support.friction, support.most, 1.0, bears_moment=False)
            self.add(kinds.support_kind(), held, self.balance, [*support.arm, *support.normal, *support.across])
        halves = [StagePlace(k, n, 0.5) for k, part in enumerate(self.parts) for n in range(1, part.first[-1] + 1)]
        for place in [*halves, *places]:
            self._clear(place, self.parts[place.finger])
        for pair in near:
            self._apart(pair)
        # 1e-5: least price of tensions where another objective does not have one
        total = sum(finger.setup.max_tension for finger in numbers.fingers)
        for part, finger in zip(self.parts, numbers.fingers, strict=True):
            price = max(aims.tension, 1e-5) * finger.moment / finger.offset / total
            self.price(part.pulls, price)
        for held in self.contacts.values():
            self.price(held, 0.0, 2e-8)

    # -- parts -------------------------------------------------------------------------------------------------

    def _balanced(self, k: int, name: str) -> Indices:
        """A row of the balance of the object, and what nothing bears of it."""
        weight = -self.numbers.weight[k]
        binds = k in self.numbers.balances
        bounds = (weight, weight) if binds else (-np.inf, np.inf)
        row = self.rows(f"balance, {name}", "object", "F0", 1, 1.0, *bounds).ravel()
        if binds:
            unborne = self.unknown(f"unborne, {name}", [0.0, 0.0], np.inf)
            self.add(kinds.difference_kind(), unborne, row, [])
            self.price(unborne, UNBORNE)
        return row

    def _held(self, name: str, friction: float, most: float, unit: float, *, bears_moment: bool) -> Indices:
        """Force and moment of a contact within its cone."""
        spatial = self.numbers.spatial
        out = np.inf if spatial else 0.0
        twist = np.inf if bears_moment else 0.0
        least = self.numbers.least_normal / unit if name not in self._supported else 0.0
        held = self.unknown(f"force, {name}", [least, -np.inf, -out, -twist], [most, np.inf, out, twist])
        cone = self.rows(f"friction, {name}", "contacts.friction", "F0", 1 if spatial else 2, 1.0, 0.0, np.inf)
        self.add(kinds.cone_kind(spatial=spatial), [*held, *self.margin], cone, [friction, APEX / unit])
        self.contacts[name] = held
        return held

    @property
    def _supported(self) -> set[str]:
        return {support.name for support in self.numbers.supports}

    def _finger(self, index: int, finger: FingerNumbers, stages: int) -> FingerPlaces:
        numbers, key, geometry = self.numbers, finger.setup.where, self.geometry
        count, d = finger.coefficients, geometry.dimensions
        course = finger.course.numbers
        segments = len(finger.middles) + 1
        each = max(FEWEST, stages // segments)
        part = self._places(finger, segments, each)
        unit = finger.force / numbers.force
        friction, most = finger.setup.held_friction, finger.setup.normal_force_max / finger.force
        for k in range(segments):
            ends = part.segments[k]
            if segments > 1:
                row = self.rows(f"segment, {finger.name}", key, "L", 1, 1.0, SHORTEST, np.inf)
                self.add(kinds.difference_kind(), ends, row, [])
            for j in range(each):
                begin, end = part.nodes[k * each + j].copy(), part.nodes[k * each + j + 1]
                if k and not j:
                    begin[geometry.moments] = part.turns[k - 1]
                unknowns = [*begin, *end, *part.forces[k], *part.pulls, *ends]
                data = [j / each, (j + 1) / each, *finger.gravity, *finger.sides, *course]
                row = self.rows(f"rod, {finger.name}", key, "L", geometry.state)
                self.add(kinds.stage_kind(geometry, count), unknowns, row, data)
            name = finger.contacts[k] if k < len(finger.contacts) else None
            at = part.nodes[(k + 1) * each]
            if name is None:
                end = self.rows(f"tip, {finger.name}", key, "E I / L2", d + len(geometry.moments))
                unknowns = [*at[geometry.moments], *part.forces[k], *ends]
                data = [*finger.gravity, *finger.load, *course]
                self.add(kinds.free_tip_kind(geometry, count), unknowns, end, data)
                continue
            is_tip = k == segments - 1
            held = self._held(name, friction, most, unit, bears_moment=finger.arm > 0.0)
            gap = self.rows(f"contact, {name}", key, "L", 1).ravel()
            direction = self.rows(f"direction, {name}", key, "1", 1, 1.0, -np.inf if is_tip else 0.0, ALONG * is_tip)
            own = self.rows(f"force, {name}", key, "E I / L2", d + len(geometry.moments)).ravel()
            after = [] if is_tip else [*part.forces[k + 1], *part.turns[k]]
            unknowns = [*at, *part.forces[k], *after, *ends, *held, *self.pose]
            ratio = finger.length / numbers.size
            data = [ratio, unit, finger.arm, *finger.gravity, *finger.load, *numbers.center, *finger.across, *course]
            data += [*numbers.axes, *numbers.table.data_at(name)]
            rows = [*gap, *direction.ravel(), *own, *self.balance]
            self.add(kinds.contact_kind(geometry, count, tip=is_tip), unknowns, rows, data)
        self._limits(index, finger, part)
        return part

    def _places(self, finger: FingerNumbers, segments: int, each: int) -> FingerPlaces:
        """Unknowns of a finger."""
        name, geometry = finger.name, self.geometry
        pulls = self.unknown(f"pulls, {name}", np.zeros(2), finger.pulls)
        ends = [self.unknown(f"base place, {name}", 0.0, 0.0)]
        ends += [self.unknown(f"place, {middle}", *finger.places) for middle in finger.middles]
        ends.append(self.unknown(f"tip place, {name}", 1.0, 1.0))
        anything = np.full(geometry.dimensions, np.inf)
        forces = [self.unknown(f"force {k}, {name}", -anything, anything) for k in range(segments)]
        moment = np.full(len(geometry.moments), np.inf)
        turns = [self.unknown(f"moment {k}, {name}", -moment, moment) for k in range(1, segments)]
        everywhere = np.full(geometry.state, np.inf)
        nodes = [self.unknown(f"node 0, {name}", [*finger.base, *-moment], [*finger.base, *moment])]
        nodes += [self.unknown(f"node {k}, {name}", -everywhere, everywhere) for k in range(1, segments * each + 1)]
        pairs = [np.concatenate(pair) for pair in itertools.pairwise(ends)]
        return FingerPlaces(nodes, pairs, forces, turns, pulls, [k * each for k in range(segments + 1)], each)

    def _limits(self, index: int, finger: FingerNumbers, part: FingerPlaces) -> None:
        """Rows at nodes: clear of the object where they do not touch it, clear of walls, and strain."""
        geometry, count, course = self.geometry, finger.coefficients, finger.course.numbers
        key, depth = finger.setup.where, self.numbers.penetration
        contacts = set(part.first[1 : 1 + len(finger.contacts)])
        marks = [0.0, *self._middles(index, finger), 1.0]
        for node in range(1, part.first[-1] + 1):
            segment = part.segment_of(node)
            ends = part.segments[segment]
            u = ((node - 1) % part.stages + 1) / part.stages
            if node not in contacts:
                self._clear(StagePlace(index, node, 1.0), part)
            for wall in finger.walls:
                if marks[segment] + u * (marks[segment + 1] - marks[segment]) < wall.first:
                    continue
                emerges = segment == 0 and wall.emerging is not None
                level = wall.emerging if emerges else wall.level
                row = self.rows(f"wall, {finger.name}", key, "L", 1, 1.0, -depth, np.inf)
                data = [u, level, float(emerges), *wall.normal, *course]
                place = part.nodes[node][: geometry.dimensions]
                self.add(kinds.wall_kind(geometry, count), [*place, *ends], row, data)
        if finger.curvature_limit >= UNIFORM:
            return
        limit = finger.curvature_limit
        for node in range(part.first[-1] + 1):
            segment = part.segment_of(max(node, 1))
            u = (node - segment * part.stages) / part.stages
            row = self.rows(f"strain, {finger.name}", key, "1 / L", 1, 1.0, -limit, limit)
            unknowns = [*part.nodes[node], *part.pulls, *part.segments[segment]]
            self.add(kinds.bend_kind(geometry, count), unknowns, row, [u, *course])

    def _middles(self, index: int, finger: FingerNumbers) -> list[float]:
        """About where a finger's middle contacts are."""
        if self._joints:
            return list(self._joints[index])
        first, last = finger.places
        count = len(finger.middles)
        return [first + (last - first) * (k + 1) / (count + 1) for k in range(count)]

    def _clear(self, place: StagePlace, part: FingerPlaces) -> None:
        """A place between nodes is clear of the object."""
        finger, geometry, numbers = self.numbers.fingers[place.finger], self.geometry, self.numbers
        j = (place.node - 1) % part.stages
        segment = part.segments[part.segment_of(place.node)]
        ends = (part.nodes[node][: geometry.oriented] for node in (place.node - 1, place.node))
        unknowns = [*itertools.chain(*ends), *segment, *self.pose]
        data = [j / part.stages, (j + 1) / part.stages, place.share, finger.length / numbers.size]
        depth = numbers.penetration + numbers.deviation / finger.length
        row = self.rows(f"clear, {finger.name}", finger.setup.where, "L", 1, 1.0, -depth, np.inf)
        data += [*finger.course.numbers, *numbers.axes, *numbers.table.data]
        self.add(kinds.clear_kind(geometry, finger.coefficients), unknowns, row, data)

    def _apart(self, pair: NearPair) -> None:
        """A node of a finger is apart from a chord of another, or of itself."""
        one, other = self.numbers.fingers[pair.finger], self.numbers.fingers[pair.other]
        ratio = other.length / one.length
        reach = one.course.half[0] + ratio * other.course.half[0]
        nodes = (self.parts[pair.finger].nodes[pair.node], *self.parts[pair.other].nodes[pair.chord : pair.chord + 2])
        unknowns = np.concatenate([node[: self.geometry.dimensions] for node in nodes])
        depth = self.numbers.penetration
        row = self.rows(f"apart, {one.name}, {other.name}", "overlap", "L", 1, 1.0, -depth, np.inf)
        self.add(kinds.chord_kind(self.geometry), unknowns, row, [ratio, reach])

    # -- values ------------------------------------------------------------------------------------------------

    def bear(self, x: Array) -> None:
        """Set what nothing bears to what the other unknowns leave of the balance."""
        off = self.row_values(x, self.balance) + self.numbers.weight
        for k, name in enumerate(_BALANCE):
            if f"unborne, {name}" in self.at:
                # The row is last less first.
                x[self.at[f"unborne, {name}"]] = max(off[k], 0.0), max(-off[k], 0.0)

    def tension(self, x: Array) -> float:
        """Sum of all tensions [N]."""
        total = 0.0
        for part, finger in zip(self.parts, self.numbers.fingers, strict=True):
            least = finger.setup.tendons.min_tension
            total += float(x[part.pulls].sum()) * finger.moment / finger.offset + 2.0 * least
        return total

    def unborne(self, x: Array) -> float:
        """Sum of the forces and moments that nothing bears [F0, F0 size]."""
        return float(sum(x[at].sum() for name, at in self.at.items() if name.startswith("unborne")))
