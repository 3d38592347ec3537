"""A grasp as one nonlinear problem: rods by multiple shooting, contacts, and six rows of balance of the object.

Unknowns: the pose of the object; per finger the moments of its tendons, the ends of its segments between base, middle
contacts and tip, the force that acts beyond the begin of each segment, the moment there where a contact changes it, and
the states at all nodes; per contact its force (N, f, g) and moment; the friction margin; and the parts of the balance
that nothing bears, at a cost, so that every start has a feasible point nearby. A `Geometry` says what a state is.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from continuum_grasp.base import Array, Indices
from continuum_grasp.grasp.rods import kinds
from continuum_grasp.grasp.rods.numbers import UNIFORM, FingerNumbers, SceneNumbers
from continuum_grasp.grasp.rods.places import FingerPlaces, NearPair, StagePlace, StageSpan
from continuum_grasp.grasp.rods.supports import pinning
from continuum_grasp.grasp.rods.winding import WoundDrive
from continuum_grasp.nlp import BlockProblem

STAGES = 24
"""Stages of a finger; 96 % of 55 hard grasps were within 0.3 % of those with 96 stages."""
FEWEST = 6
"""Least stages of a segment."""
APEX = 1e-4
"""Rounding of the apex of a friction cone in space, per unit of force."""
UNBORNE = 100.0
"""Cost of a force or moment that nothing bears; 10 and 1000 did alike."""
SHORTEST = 0.02
"""Least length of a segment, per finger."""
ALONG = 1e-3
"""Slope at which a tip may point into the object."""
_BALANCE = ("force x", "force y", "force z", "moment x", "moment y", "moment z")


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
    reached : bool
        Whether drives reach the grasp; else they hold what they have, and tendons that are let out may pull.
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
        reached: bool = True,
    ) -> None:
        super().__init__("grasp", numbers.table.coefficients)
        self.numbers, self.geometry = numbers, numbers.geometry
        self.places, self.near, self._joints = tuple(places), tuple(near), joints
        self.fine, self.stages, self._reached = fine, stages, reached
        # A finer problem has a multiple of the stages of each span.
        self._times = self.geometry.finer if fine else 1
        self.pose = self.unknown("pose", *numbers.pose_bounds)
        aims = numbers.aims
        self.margin = self.unknown("margin", 0.0, 1.0 if aims.margin else 0.0)
        self.cost(self.margin, -aims.margin)
        self.balance = np.concatenate([self._balanced(k, name) for k, name in enumerate(_BALANCE)])
        self.contacts: dict[str, Indices] = {}
        self.parts = [self._finger(k, finger, stages) for k, finger in enumerate(numbers.fingers)]
        self.drives = [self._drives(*pair) for pair in zip(numbers.fingers, self.parts, strict=True)]
        self._supports()
        for place in [*self._first_places(), *places]:
            self._clear(place)
        for pair in near:
            self._apart(pair)
        # 1e-5: least cost of tensions where another objective does not have one
        total = sum(finger.setup.max_tension for finger in numbers.fingers)
        for part, finger in zip(self.parts, numbers.fingers, strict=True):
            for at, pull in zip(part.pulls, finger.section.pulls, strict=True):
                self.cost(at, max(aims.tension, 1e-5) * pull.unit / total)
        for held in self.contacts.values():
            self.cost(held, 0.0, 2e-8)
        if aims.normal:
            self._aim_at_normal_forces(aims.normal)
        self.fillings: list[Callable[[Array], None]] = []
        """Functions that set the unknowns of variants by all others."""

    # -- parts -------------------------------------------------------------------------------------------------

    def _aim_at_normal_forces(self, weight: float) -> None:
        """Add the greatest normal force of all contacts [F0] to the objective, by its weight per F0."""
        greatest = self.unknown("greatest normal force", 0.0, np.inf)
        self.cost(greatest, weight)
        for name, held in self.contacts.items():
            row = self.rows(f"normal force, {name}", "contacts.normal_force_max", "F0", 1, 1.0, 0.0, np.inf)
            self.add(kinds.share_kind(), greatest, row, [1.0])
            self.add(kinds.share_kind(), held[0], row, [-self.numbers.unit(name)])

    def _balanced(self, k: int, name: str) -> Indices:
        """A row of the balance of the object, and what nothing bears of it."""
        weight = -self.numbers.weight[k]
        binds = k in self.numbers.balances
        bounds = (weight, weight) if binds else (-np.inf, np.inf)
        row = self.rows(f"balance, {name}", "object", "F0", 1, 1.0, *bounds).ravel()
        if binds:
            unborne = self.unknown(f"unborne, {name}", [0.0, 0.0], np.inf)
            self.add(kinds.difference_kind(), unborne, row, [])
            self.cost(unborne, UNBORNE)
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

    def _supports(self) -> None:
        """Forces of supports that the object touches, and gaps where its pose is free."""
        low, high = self.numbers.pose_bounds
        pins = pinning(self.numbers, self.numbers.supports, self.numbers.pose, np.where(high > low, 1.0, 0.0))
        for support, pins_down in zip(self.numbers.supports, pins, strict=True):
            if support.touches:
                held = self._held(support.name, support.friction, support.most, 1.0, bears_moment=False)
                kind, data = support.force_block(self.numbers)
                self.add(kind, [*held, *self.pose], self.balance, data)
            if pins_down or (not support.touches and (high > low).any()):
                row = self.rows(
                    f"support, {support.name}", "object.free", "size", 1, 1.0, 0.0, 0.0 if pins_down else np.inf
                )
                kind, data = support.gap_block(self.numbers)
                self.add(kind, self.pose, row, data)

    def _finger(self, index: int, finger: FingerNumbers, stages: int) -> FingerPlaces:
        numbers, key, geometry = self.numbers, finger.setup.where, self.geometry
        form, d = finger.section.form, geometry.dimensions
        part = self._places(index, finger, stages)
        unit = finger.force / numbers.force
        friction, most = finger.friction, finger.setup.normal_force_max / finger.force
        middles = part.touching[: len(finger.middles)]
        stage = kinds.stage_kind(geometry, form)
        for span in part.spans:
            for node in range(span.first + 1, span.first + span.stages + 1):
                begin = part.nodes[node - 1].copy()
                if node - 1 in middles:
                    begin[geometry.moments] = part.turns[middles.index(node - 1)]
                unknowns = [*begin, *part.nodes[node], *span.force, *part.pulls, *span.ends]
                data = [*finger.acting(span.piece, part.along(node)), *span.shares(node)]
                self.add(stage, unknowns, self.rows(f"rod, {finger.name}", key, "L", len(begin)), data)
        losses = sum(name.startswith("loss") for name in form.sliding_names)
        if losses:
            row = self.rows(f"tendons, {finger.name}", key, "1", losses)
            self.add(kinds.enter_kind(form), part.sliding(0), row, [*finger.history[0], *finger.section.numbers(0)])
        for k, name in enumerate(finger.contacts):
            node = part.touching[k]
            span, is_tip = part.span_of(node), name == finger.tip
            held = self._held(name, friction, most, unit, bears_moment=finger.arm > 0.0)
            gap = self.rows(f"contact, {name}", key, "L", 1).ravel()
            direction = self.rows(f"direction, {name}", key, "1", 1, 1.0, -np.inf if is_tip else 0.0, ALONG * is_tip)
            own = self.rows(f"force, {name}", key, "E I / L2", d + len(geometry.moments)).ravel()
            after = [] if is_tip else [*part.span_of(node + 1).force, *part.turns[k]]
            at = part.nodes[node][: geometry.state]
            unknowns = [*at, *span.force, *after, span.ends[1], *held, *self.pose]
            data = [finger.length / numbers.size, unit, finger.arm, *finger.load, *numbers.center, *finger.across]
            data += [*finger.thickness(span.piece), *(finger.at_tip if is_tip else ())]
            data += [*numbers.axes, *numbers.table.data_at(name)]
            rows = [*gap, *direction.ravel(), *own, *self.balance]
            self.add(kinds.contact_kind(geometry, tip=is_tip), unknowns, rows, data)
        if finger.tip is None:
            end = self.rows(f"tip, {finger.name}", key, "E I / L2", d + len(geometry.moments))
            unknowns = [*part.nodes[-1][: geometry.state], *part.spans[-1].force]
            self.add(kinds.free_tip_kind(geometry), unknowns, end, [*finger.load, *finger.at_tip])
        self._limits(finger, part)
        return part

    def _drives(self, finger: FingerNumbers, part: FingerPlaces) -> list[WoundDrive]:
        """Drives of the tendons of a finger."""
        return [WoundDrive(self, finger, part, k, reached=self._reached) for k in range(len(finger.drives))]

    def _places(self, index: int, finger: FingerNumbers, stages: int) -> FingerPlaces:
        """Unknowns of a finger."""
        name, geometry, section = finger.name, self.geometry, finger.section
        form = section.form
        pulls = self.unknown(f"pulls, {name}", np.zeros(len(finger.pulls)), finger.pulls)
        anything, moment = np.full(geometry.dimensions, np.inf), np.full(len(geometry.moments), np.inf)
        joints = self._middles(index, finger)
        marks: list[tuple[float, str | None]] = [(at, None) for at in section.places[1:-1]]
        marks = sorted([*marks, *zip(joints, finger.middles, strict=True)], key=lambda mark: mark[0])
        marks.append((1.0, finger.tip))
        each = max(FEWEST, stages // (len(finger.middles) + 1))
        bounds = [0.0, *joints, 1.0]
        place = self.unknown(f"base place, {name}", 0.0, 0.0)
        previous, before, segment, node = place, 0.0, 0, 0
        force = self.unknown(f"force 0, {name}", -anything, anything)
        spans, touching, turns = list[StageSpan](), list[int](), list[Indices]()
        for at, contact in marks:
            piece = section.piece_at(0.5 * (before + at))
            if at == 1.0:
                end = self.unknown(f"tip place, {name}", 1.0, 1.0)
            elif contact is None:
                end = self.unknown(f"piece {piece}, {name}", at, at)
            else:
                bounds_there = finger.places[finger.middles.index(contact)]
                low, high = np.clip(bounds_there, section.places[piece], section.places[piece + 1])
                end = self.unknown(f"place, {contact}", low, high)
            share = (at - before) / max(bounds[segment + 1] - bounds[segment], 1e-12)
            count = self._times * max(1, round(each * share))
            spans.append(StageSpan(node, count, piece, np.concatenate([place, end]), force))
            node += count
            if contact is not None or at == 1.0:
                if len(finger.middles):
                    row = self.rows(f"segment, {name}", finger.setup.where, "L", 1, 1.0, SHORTEST, np.inf)
                    self.add(kinds.difference_kind(), [*previous, *end], row, [])
                previous = end
            if contact is not None:
                touching.append(node)
            if contact in finger.middles:
                segment += 1
                force = self.unknown(f"force {segment}, {name}", -anything, anything)
                turns.append(self.unknown(f"moment {segment}, {name}", -moment, moment))
            place, before = end, at
        sliding = form.sliding_names
        anywhere = np.full(len(sliding), np.inf)
        at_tip = np.array([0.0 if label.startswith("slide") else np.inf for label in sliding])
        everywhere = np.full(geometry.state, np.inf)
        free = np.concatenate([moment, anywhere])
        low, high = finger.base_bounds
        nodes = [self.unknown(f"node 0, {name}", [*low, *-free], [*high, *free])]
        for k in range(1, node + 1):
            limits = np.concatenate([everywhere, at_tip if k == node else anywhere])
            nodes.append(self.unknown(f"node {k}, {name}", -limits, limits))
        return FingerPlaces(nodes, spans, touching, turns, pulls, geometry.state)

    def _limits(self, finger: FingerNumbers, part: FingerPlaces) -> None:
        """Rows at nodes: strain."""
        geometry, form, key = self.geometry, finger.section.form, finger.setup.where
        if finger.curvature_limit >= UNIFORM:
            return
        limit = finger.curvature_limit
        for node in range(len(part.nodes)):
            span = part.span_of(node)
            row = self.rows(f"strain, {finger.name}", key, "1 / L", 1, 1.0, -limit, limit)
            unknowns = [*part.nodes[node], *span.force, *part.pulls, *span.ends]
            share = (node - span.first) / span.stages
            data = [*finger.acting(span.piece, part.along(node)), share, *finger.depth(span.piece)]
            self.add(kinds.bend_kind(geometry, form), unknowns, row, data)

    def _marks(self, index: int, finger: FingerNumbers, part: FingerPlaces) -> list[float]:
        """Approximate places of the nodes along a finger."""
        about = sorted([*finger.section.places, *self._middles(index, finger)])
        marks = [0.0]
        for span, (begin, end) in zip(part.spans, itertools.pairwise(about), strict=True):
            marks += [begin + (end - begin) * j / span.stages for j in range(1, span.stages + 1)]
        return marks

    def _middles(self, index: int, finger: FingerNumbers) -> list[float]:
        """Approximate places of a finger's middle contacts."""
        if self._joints:
            return list(self._joints[index])
        shares = np.arange(1, len(finger.places) + 1) / (len(finger.places) + 1)
        return [low + (high - low) * share for (low, high), share in zip(finger.places, shares.tolist(), strict=True)]

    def _first_places(self) -> Iterator[StagePlace]:
        """Places that keep clear from the beginning: of the object at nodes that do not touch it and half way between
        them; of obstacles where these ask for it; and the base, where it or the object may move.
        """
        low, high = self.numbers.pose_bounds
        for k, (finger, part) in enumerate(zip(self.numbers.fingers, self.parts, strict=True)):
            own_low, own_high = finger.base_bounds
            moves = bool((own_high > own_low).any())
            nodes = range(1, len(part.nodes))
            if moves or (high > low).any():
                yield StagePlace(k, 1, 0.0)
            for node in nodes:
                if node not in part.touching:
                    yield StagePlace(k, node, 1.0)
                yield StagePlace(k, node, 0.5)
            for m, obstacle in enumerate(finger.obstacles):
                yield from ([StagePlace(k, 1, 0.0, m)] if moves else [])
                yield from (StagePlace(k, node, share, m) for node in nodes for share in obstacle.shares)

    def _clear(self, place: StagePlace) -> None:
        """A place between nodes is clear of the object, or of an obstacle."""
        part, finger = self.parts[place.finger], self.numbers.fingers[place.finger]
        span = part.span_of(place.node)
        ends = (part.nodes[node][: self.geometry.oriented] for node in (place.node - 1, place.node))
        unknowns = [*itertools.chain(*ends), *span.ends]
        data = [*span.shares(place.node), place.share]
        if place.obstacle is None:
            self._clear_of_object(finger, unknowns, data, span)
        else:
            self._clear_of_obstacle(place, unknowns, data, span)

    def _clear_of_object(self, finger: FingerNumbers, unknowns: list[Any], data: list[Any], span: StageSpan) -> None:
        numbers = self.numbers
        depth = numbers.penetration + numbers.deviation / finger.length
        row = self.rows(f"clear, {finger.name}", finger.setup.where, "L", 1, 1.0, -depth, np.inf)
        data = [*data, finger.length / numbers.size, *finger.thickness(span.piece), *numbers.axes, *numbers.table.data]
        self.add(kinds.clear_kind(self.geometry), [*unknowns, *self.pose], row, data)

    def _clear_of_obstacle(self, place: StagePlace, unknowns: list[Any], data: list[Any], span: StageSpan) -> None:
        finger = self.numbers.fingers[place.finger]
        obstacle = finger.obstacles[place.obstacle or 0]
        at, emerges = self.beside(place)
        if at < obstacle.first:
            return
        emerging = obstacle.emerging if emerges and obstacle.emerging is not None else 0.0
        row = self.rows(f"obstacle, {finger.name}", finger.setup.where, "L", 1, 1.0, -self.numbers.penetration, np.inf)
        data = [*data, float(emerges), emerging, *finger.thickness(span.piece), *obstacle.data]
        self.add(obstacle.kind(self.geometry), unknowns, row, data)

    def beside(self, place: StagePlace) -> tuple[float, bool]:
        """Approximate place along the finger [L], and whether only its center line keeps clear of an obstacle."""
        finger, part = self.numbers.fingers[place.finger], self.parts[place.finger]
        before, after = self._marks(place.finger, finger, part)[place.node - 1 : place.node + 1]
        first = part.touching[0] if part.touching else len(part.nodes)
        obstacle = finger.obstacles[place.obstacle or 0]
        return before + place.share * (after - before), obstacle.emerges(place.node <= first)

    def _apart(self, pair: NearPair) -> None:
        """A node of a finger is apart from a chord of another, or of itself."""
        one, other = self.numbers.fingers[pair.finger], self.numbers.fingers[pair.other]
        ratio = other.length / one.length
        reach = float(one.half(0.0) + ratio * other.half(0.0))
        nodes = (self.parts[pair.finger].nodes[pair.node], *self.parts[pair.other].nodes[pair.chord : pair.chord + 2])
        unknowns = np.concatenate([node[: self.geometry.dimensions] for node in nodes])
        depth = self.numbers.penetration
        row = self.rows(f"apart, {one.name}, {other.name}", "overlap", "L", 1, 1.0, -depth, np.inf)
        self.add(kinds.chord_kind(self.geometry), unknowns, row, [ratio, reach])

    def add_load_share(self, less: Indices) -> None:
        """Take a share, an unknown, off the load of the object."""
        for row, weight in zip(self.balance, self.numbers.weight, strict=True):
            if weight:
                self.add(kinds.share_kind(), less, [row], [-weight])

    # -- values ------------------------------------------------------------------------------------------------

    def is_same(self, other: GraspRods) -> bool:
        """Whether another problem of the same scene has the same stages, and as many rows."""
        return self.numbers is other.numbers and (self.size, self.count) == (other.size, other.count)

    def fill(self, x: Array) -> None:
        """Set what follows from the other unknowns: what nothing bears, the greatest normal force, variants."""
        if "greatest normal force" in self.at:
            forces = [self.numbers.unit(name) * x[held[0]] for name, held in self.contacts.items()]
            x[self.at["greatest normal force"]] = max(forces, default=0.0)
        for filling in self.fillings:
            filling(x)

    def bear(self, x: Array) -> None:
        """Set what nothing bears to what the other unknowns leave of the balance."""
        off = self.row_values(x, self.balance) + self.numbers.weight
        for k, name in enumerate(_BALANCE):
            if f"unborne, {name}" in self.at:
                # The row is last less first.
                x[self.at[f"unborne, {name}"]] = max(off[k], 0.0), max(-off[k], 0.0)

    def wind(self, x: Array) -> None:
        """Set the states of all drives to what the other unknowns ask for."""
        for of_finger in self.drives:
            for drive in of_finger:
                drive.wind(x)

    @property
    def placed(self) -> Indices:
        """Places of the poses of object and bases."""
        bases = (part.nodes[0][: self.geometry.oriented] for part in self.parts)
        return np.concatenate([self.pose, *bases])

    @property
    def moves(self) -> bool:
        """Whether the pose of the object or of a base is free."""
        low, high = self.limits
        return bool((high > low)[self.placed].any())

    def stay(self, places: Array) -> None:
        """Leave object and bases at their poses in another problem, its `placed` unknowns."""
        self.bound(self.placed, low=places, high=places)

    def bear_all(self) -> None:
        """Ask for grasps alone: nothing may be left of the balance."""
        for name, at in self.at.items():
            if name.startswith("unborne"):
                self.bound(at, high=0.0)

    def tension(self, x: Array) -> float:
        """Sum of all tensions [N]."""
        pairs = zip(self.parts, self.numbers.fingers, strict=True)
        return float(sum(finger.tensions(x[part.pulls]).sum() for part, finger in pairs))

    def unborne(self, x: Array) -> float:
        """Sum of the forces and moments that nothing bears [F0, F0 size]."""
        return float(sum(x[at].sum() for name, at in self.at.items() if name.startswith("unborne")))
