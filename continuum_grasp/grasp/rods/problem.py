"""A grasp as one nonlinear problem: rods by multiple shooting, contacts, and six rows of balance of the object.

Unknowns: the pose of the object; per finger the moments of two tendons, the ends of its segments between base, middle
contacts and tip, the force that acts beyond the begin of each segment, and the states (x, y, a, M) at all nodes; per
contact its forces (N, f, u); the friction margin; and the parts of the balance that nothing bears, at a price, so that
every start has a feasible point nearby.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from continuum_grasp.base import Array, Indices
from continuum_grasp.grasp.rods import kinds
from continuum_grasp.grasp.rods.numbers import UNIFORM, FingerNumbers, SceneNumbers
from continuum_grasp.grasp.rods.rod import integral, polynomial, stage
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
    pulls: Indices
    first: list[int]  # node at which each segment begins, then the last node
    stages: int  # of each segment

    def segment_of(self, node: int) -> int:
        """Segment of the stage before a node."""
        return (node - 1) // self.stages


class GraspRods(BlockProblem):
    """The problem of a scene's numbers."""

    def __init__(
        self,
        numbers: SceneNumbers,
        *,
        stages: int = STAGES,
        places: Sequence[StagePlace] = (),
        near: Sequence[NearPair] = (),
    ) -> None:
        super().__init__("grasp", numbers.table.coefficients)
        self.numbers = numbers
        scene = numbers.scene
        self.pose = self.unknown("pose", *numbers.pose_bounds)
        aims = scene.weights
        most = 1.0 if aims.greatest_friction_margin else 0.0
        self.margin = self.unknown("margin", 0.0, most)
        self.price(self.margin, -aims.greatest_friction_margin)
        self.balance = np.concatenate([self._balanced(k, name) for k, name in enumerate(_BALANCE)])
        self.contacts: dict[str, Indices] = {}
        self.parts = [self._finger(finger, stages) for finger in numbers.fingers]
        for support in numbers.supports:
            held = self._held(support.name, support.friction, support.most, 1.0)
            self.add(kinds.support_kind(), held, self.balance, [*support.arm, *support.normal])
        halves = [StagePlace(k, n, 0.5) for k, part in enumerate(self.parts) for n in range(1, part.first[-1] + 1)]
        for place in [*halves, *places]:
            self._clear(place)
        for pair in near:
            self._apart(pair)
        # 1e-5: least price of tensions where another objective does not have one
        total = sum(setup.max_tension for setup in scene.setups)
        for part, finger in zip(self.parts, numbers.fingers, strict=True):
            price = max(aims.least_tension, 1e-5) * finger.moment / finger.offset / total
            self.price(part.pulls, price)
        for held in self.contacts.values():
            self.price(held, 0.0, 2e-8)

    # -- parts -------------------------------------------------------------------------------------------------

    def _balanced(self, k: int, name: str) -> Indices:
        """A row of the balance of the object, and what nothing bears of it."""
        weight = -self.numbers.weight[k]
        binds = k in self.numbers.scene.balances
        bounds = (weight, weight) if binds else (-np.inf, np.inf)
        row = self.rows(f"balance, {name}", "object", "F0", 1, 1.0, *bounds).ravel()
        if binds:
            unborne = self.unknown(f"unborne, {name}", [0.0, 0.0], np.inf)
            self.add(kinds.difference_kind(), unborne, row, [])
            self.price(unborne, UNBORNE)
        return row

    def _held(self, name: str, friction: float, most: float, unit: float) -> Indices:
        """Forces of a contact within its cone."""
        spatial = self.numbers.scene.spatial
        out = np.inf if spatial else 0.0
        held = self.unknown(f"force, {name}", [0.0, -np.inf, -out], [most, np.inf, out])
        cone = self.rows(f"friction, {name}", "contacts.friction", "F0", 1 if spatial else 2, 1.0, 0.0, np.inf)
        self.add(kinds.cone_kind(spatial=spatial), [*held, *self.margin], cone, [friction, APEX / unit])
        self.contacts[name] = held
        return held

    def _finger(self, finger: FingerNumbers, stages: int) -> FingerPlaces:
        numbers, count, key = self.numbers, finger.coefficients, finger.setup.where
        course = finger.course.numbers
        segments = len(finger.middles) + 1
        each = max(FEWEST, stages // segments)
        part = self._places(finger, segments, each)
        unit = finger.force / numbers.force
        friction, most = finger.setup.held_friction, finger.setup.normal_force_max / finger.force
        touched = [self._held(name, friction, most, unit) for name in finger.middles]
        for k in range(segments):
            ends = part.segments[k]
            if segments > 1:
                row = self.rows(f"segment, {finger.name}", key, "L", 1, 1.0, SHORTEST, np.inf)
                self.add(kinds.difference_kind(), ends, row, [])
            for j in range(each):
                begin, end = part.nodes[k * each + j], part.nodes[k * each + j + 1]
                couple = j == 0 and k > 0
                along = touched[k - 1][1] if couple else part.pulls[0]
                unknowns = [*begin, *end, *part.forces[k], *part.pulls, *ends, along]
                data = [j / each, (j + 1) / each, float(couple), *finger.gravity, *course]
                self.add(kinds.stage_kind(count), unknowns, self.rows(f"rod, {finger.name}", key, "L", 4), data)
            common = [finger.length / numbers.size, unit, *finger.gravity, *finger.load, *numbers.center, *course]
            at = [*part.nodes[(k + 1) * each], *part.forces[k]]
            if k < segments - 1:
                name = finger.middles[k]
                own = self.rows(f"contact, {name}", key, "L", 4).ravel()
                unknowns = [*at, *part.forces[k + 1], *ends, *touched[k], *self.pose]
                data = [*common, *numbers.table.data]
                self.add(kinds.contact_kind(count, tip=False), unknowns, [*own, *self.balance], data)
            elif finger.tip:
                held = self._held(finger.tip, friction, most, unit)
                gap = self.rows(f"contact, {finger.tip}", key, "L", 1).ravel()
                direction = self.rows(f"direction, {finger.tip}", key, "1", 1, 1.0, -np.inf, ALONG).ravel()
                end = self.rows(f"tip, {finger.name}", key, "E I / L2", 3).ravel()
                unknowns = [*at, *ends, *held, *self.pose]
                data = [*common, *numbers.table.data]
                rows = [*gap, *direction, *end, *self.balance]
                self.add(kinds.contact_kind(count, tip=True), unknowns, rows, data)
            else:
                end = self.rows(f"tip, {finger.name}", key, "E I / L2", 3).ravel()
                unknowns = [part.nodes[-1][3], *part.forces[k], *ends]
                self.add(kinds.free_tip_kind(count), unknowns, end, [*finger.gravity, *finger.load, *course])
        self._limits(finger, part)
        return part

    def _places(self, finger: FingerNumbers, segments: int, each: int) -> FingerPlaces:
        """Unknowns of a finger."""
        name = finger.name
        x, y, angle = finger.base
        pulls = self.unknown(f"pulls, {name}", np.zeros(2), finger.pulls)
        ends = [self.unknown(f"base place, {name}", 0.0, 0.0)]
        ends += [self.unknown(f"place, {middle}", *finger.places) for middle in finger.middles]
        ends.append(self.unknown(f"tip place, {name}", 1.0, 1.0))
        forces = [self.unknown(f"force {k}, {name}", [-np.inf, -np.inf], np.inf) for k in range(segments)]
        base = np.array([x, y, angle, 0.0])
        free = np.array([0.0, 0.0, 0.0, np.inf])
        everywhere = np.full(kinds.STATE, np.inf)
        nodes = [self.unknown(f"node 0, {name}", base - free, base + free)]
        nodes += [self.unknown(f"node {k}, {name}", -everywhere, everywhere) for k in range(1, segments * each + 1)]
        pairs = [np.concatenate(pair) for pair in itertools.pairwise(ends)]
        return FingerPlaces(nodes, pairs, forces, pulls, [k * each for k in range(segments + 1)], each)

    def _limits(self, finger: FingerNumbers, part: FingerPlaces) -> None:
        """Rows at nodes: clear of the object where they do not touch it, clear of walls, and strain."""
        numbers, count, course = self.numbers, finger.coefficients, finger.course.numbers
        key = finger.setup.where
        contacts = {node for k, node in enumerate(part.first[1:]) if k < len(finger.middles) or finger.tip}
        x, y, _ = finger.base
        for node in range(1, part.first[-1] + 1):
            ends = part.segments[part.segment_of(node)]
            u = ((node - 1) % part.stages + 1) / part.stages
            if node not in contacts:
                self._clear(StagePlace(self._index(finger), node, 1.0), finger, part)
            for normal, level in numbers.walls:
                height = normal[0] * x + normal[1] * y - level / finger.length
                # A finger whose base is in a wall emerges from it before its first contact.
                inside = part.segment_of(node) == 0 and height < finger.course.half[0] * (1.0 - 1e-9)
                floor = level / finger.length + (min(height, 0.0) if inside else 0.0)
                row = self.rows(f"wall, {finger.name}", key, "L", 1, 1.0, -self._depth, np.inf)
                data = [u, floor, float(inside), *normal, *course]
                self.add(kinds.wall_kind(count), [*part.nodes[node][:2], *ends], row, data)
        if finger.curvature_limit >= UNIFORM:
            return
        limit = finger.curvature_limit
        for node in range(part.first[-1] + 1):
            segment = part.segment_of(max(node, 1))
            u = (node - segment * part.stages) / part.stages
            row = self.rows(f"strain, {finger.name}", key, "1 / L", 1, 1.0, -limit, limit)
            unknowns = [part.nodes[node][3], *part.pulls, *part.segments[segment]]
            self.add(kinds.bend_kind(count), unknowns, row, [u, *course])

    def _index(self, finger: FingerNumbers) -> int:
        return next(k for k, one in enumerate(self.numbers.fingers) if one is finger)

    @property
    def _depth(self) -> float:
        return self.numbers.scene.solver.penetration_tolerance

    def _clear(self, place: StagePlace, finger: FingerNumbers | None = None, part: FingerPlaces | None = None) -> None:
        """A place between nodes is clear of the object."""
        finger, part = finger or self.numbers.fingers[place.finger], part or self.parts[place.finger]
        j = (place.node - 1) % part.stages
        segment = part.segments[part.segment_of(place.node)]
        unknowns = [*part.nodes[place.node - 1][:3], *part.nodes[place.node][:3], *segment, *self.pose]
        data = [j / part.stages, (j + 1) / part.stages, place.share, finger.length / self.numbers.size]
        row = self.rows(f"clear, {finger.name}", finger.setup.where, "L", 1, 1.0, -self._depth, np.inf)
        table = self.numbers.table.data
        self.add(kinds.clear_kind(finger.coefficients), unknowns, row, [*data, *finger.course.numbers, *table])

    def _apart(self, pair: NearPair) -> None:
        """A node of a finger is apart from a chord of another, or of itself."""
        one, other = self.numbers.fingers[pair.finger], self.numbers.fingers[pair.other]
        ratio = other.length / one.length
        reach = one.course.half[0] + ratio * other.course.half[0]
        chord = self.parts[pair.other].nodes[pair.chord : pair.chord + 2]
        unknowns = [*self.parts[pair.finger].nodes[pair.node][:2], *chord[0][:2], *chord[1][:2]]
        row = self.rows(f"apart, {one.name}, {other.name}", "overlap", "L", 1, 1.0, -self._depth, np.inf)
        self.add(kinds.chord_kind(), unknowns, row, [ratio, reach])

    # -- starts and values -------------------------------------------------------------------------------------

    def x_of(self, shots: Sequence[Array], supports: Array) -> Array:
        """Unknowns from numbers of each finger and the forces N, f of supports [F0].

        The numbers of a finger are its curvature at the base, the force Fx, Fy beyond it, the moment of its tendons,
        then place, N and f of each middle contact; the tip's forces follow from these.
        """
        numbers, x = self.numbers, np.zeros(self.size)
        x[self.pose] = numbers.pose
        for finger, part, shot in zip(numbers.fingers, self.parts, shots, strict=True):
            self._shoot(x, finger, part, shot)
        for support, pair in zip(numbers.supports, np.reshape(supports, (-1, 2)), strict=True):
            x[self.contacts[support.name][:2]] = pair
        if numbers.scene.spatial:
            units = {name: f.force for f in numbers.fingers for name in (*f.middles, f.tip) if name}
            for name, held in self.contacts.items():
                unit = units.get(name, numbers.force) / numbers.force
                x[held[2]] = -numbers.weight[2] / len(self.contacts) / unit
        off = self.row_values(x, self.balance) + numbers.weight
        for k, name in enumerate(_BALANCE):
            if f"unborne, {name}" in self.at:
                # The row is last less first.
                x[self.at[f"unborne, {name}"]] = max(off[k], 0.0), max(-off[k], 0.0)
        return x

    def _shoot(self, x: Array, finger: FingerNumbers, part: FingerPlaces, shot: Array) -> None:
        """Unknowns of a finger by integration from its base."""
        course, gravity = finger.course, finger.gravity
        bent, fx, fy, m, *middles = shot.tolist()
        x[part.pulls] = max(m, 0.0), max(-m, 0.0)
        force = np.array([fx, fy])
        state = np.array([*finger.base, course.stiffness[0] * (bent - course.rest[0]) - course.tendon[0] * m])
        ends = [0.0, *middles[::3], 1.0]
        x[part.nodes[0]] = state
        couple = 0.0
        for k, (begin, end) in enumerate(itertools.pairwise(ends)):
            x[part.segments[k]] = begin, end
            x[part.forces[k]] = force
            for j in range(part.stages):
                s = begin + (end - begin) * j / part.stages
                beyond = force - gravity * integral(course.weight, begin, s)
                given = state + np.array([0.0, 0.0, 0.0, couple])
                state = np.array(stage(course, gravity, given, beyond, m, s, (end - begin) / part.stages))
                couple = 0.0
                x[part.nodes[k * part.stages + j + 1]] = state
            force = force - gravity * integral(course.weight, begin, end)
            normal = self.seen(finger, state[None, :2], x[self.pose])[1][0]
            across = np.array([-normal[1], normal[0]])
            if k < len(finger.middles):
                pressed, along = middles[3 * k + 1], middles[3 * k + 2]
                x[self.contacts[finger.middles[k]][:2]] = pressed, along
                force = force - (pressed * normal + along * across)
                couple = polynomial(course.half, end) * along
            elif finger.tip:
                left = force - finger.load
                x[self.contacts[finger.tip][:2]] = left @ normal, left @ across

    def seen(self, finger: FingerNumbers, points: Array, pose: Array) -> tuple[Array, Array]:
        """Gaps (n,) of the object at points (n, 2) of a finger [L], and world normals (n, 2)."""
        ratio = finger.length / self.numbers.size
        turn = np.array([[np.cos(pose[2]), -np.sin(pose[2])], [np.sin(pose[2]), np.cos(pose[2])]])
        gap, slope = self.numbers.table.values((ratio * points - pose[:2]) @ turn)
        # 1e-30: no division by zero where a table is flat
        normal = slope / (np.linalg.norm(slope, axis=1, keepdims=True) + 1e-30)
        return gap / ratio, normal @ turn.T

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
