"""Sets of postures of several fingers that touch with their tips alone: which go together, by the object's balance.

1. Shapes fix the forces of such fingers: a table has what each posture does to the object, what it lacks alone, and
   what it costs; the best that differ stay.
2. All sets of them are added up; what supports add is the nearest point of their friction cones. The likeliest that
   differ stay.
3. What is missing for balance, and what it costs, are smooth functions of the curvatures along the curves whose tips
   touch, of the places of free bases, of the lifts, and of the forces at supports: Gauss-Newton steps bring it down for
   many sets at once, at first with a weight on what it costs.
"""

from __future__ import annotations

import cmath
from dataclasses import dataclass, replace

import numpy as np

from continuum_grasp.base import Numbers as Array
from continuum_grasp.grasp.shape import ROUNDING
from continuum_grasp.grasp.starts.candidates import Candidates, spread_order
from continuum_grasp.grasp.starts.force import ForceBlock, Loads, cone_edges, finger_block
from continuum_grasp.grasp.starts.scan.curves import segment_end, touch
from continuum_grasp.grasp.starts.scan.task import FingerTask, make_task, violation
from continuum_grasp.grasp.starts.values import ContactStart, Pose
from continuum_grasp.grasp.values import NEAR
from continuum_grasp.scene import FingerSetup, GraspScene

COUNTS = {2: (14, 400, 48), 3: (8, 36, 96), 4: (6, 14, 96)}
"""By number of fingers: postures per finger that are combined, to 200 to 1300 combinations; and, of those that touch
with their tips alone, that are matched, to 40,000 to 160,000 sets, and how many of these are chosen."""
_LIKELY = 600
"""Sets among which those that differ are chosen."""
_COST = 0.1
"""Weight of the tensions of a set, per those of likely sets, beside its relative imbalance."""


def matched_sets(
    scene: GraspScene,
    loads: Loads,
    postures: list[Candidates],
    features: list[Array],
    blocks: list[ForceBlock],
    supports: tuple[ForceBlock, dict[str, ContactStart]],
) -> list[Candidates]:
    """Postures of each finger, the k-th of which belong together, the most likely ones that differ first."""
    com = complex(*scene.object.com)
    _, row_limit, count = COUNTS[len(postures)]
    picks, tables = [], []
    for setup, candidates, unlike, block in zip(scene.setups, postures, features, blocks, strict=True):
        known, own = shape_forces(loads, setup, candidates, block, com)
        edges, pull = known[:, 3:5], known[:, 5]
        high = float(block.high[-2:].max()) / loads.force
        normal = edges.sum(axis=1)
        # What is outside of the cone or a limit, per the forces in play.
        outside = np.maximum(-edges, 0.0).sum(axis=1) + np.maximum(np.abs(pull) - high, 0.0)
        outside += np.maximum(normal - setup.normal_force_max / loads.force, 0.0)
        alone = outside / (1.0 + np.abs(edges).sum(axis=1)) + np.sqrt((own**2).sum(axis=1))
        alone += np.minimum(10.0 * candidates.violation, 1.0)
        lift = 2.0 * setup.held_friction * np.sqrt(np.maximum(edges[:, 0] * edges[:, 1], 0.0))
        cost = np.abs(pull) / high
        score = alone + _COST * cost / max(float(np.median(cost)), 1e-9)
        pick = np.array(spread_order(score, unlike, row_limit))
        picks.append(pick)
        tables.append(np.column_stack([known[:, :3], lift, alone, cost])[pick])
    sizes = [len(pick) for pick in picks]
    total = tables[0]
    size = 1.0 + np.sqrt((total[:, :3] ** 2).sum(axis=1))
    for table in tables[1:]:
        # Sets as rows, the last finger's postures counting fastest.
        total = (total[:, None, :] + table).reshape(-1, total.shape[1])
        size = (size[:, None] + np.sqrt((table[:, :3] ** 2).sum(axis=1))).ravel()
    off = total[:, :3] - loads.target[:3]
    off, lift = _supported(scene, loads, off, *supports)
    short = np.maximum(loads.lift / loads.force - total[:, 3] - lift, 0.0)
    wrong = np.sqrt((off**2).sum(axis=1) + short**2) / size + total[:, 4]
    cost = total[:, 5]
    likely = np.argpartition(wrong, min(_LIKELY, len(wrong) - 1))[:_LIKELY]
    score = wrong + _COST * cost / max(float(np.median(cost[likely])), 1e-9)
    likely = np.argpartition(score, min(_LIKELY, len(score) - 1))[:_LIKELY]
    index = [pick[i] for pick, i in zip(picks, np.unravel_index(likely, sizes), strict=True)]
    unlike = np.concatenate([each[i] for each, i in zip(features, index, strict=True)], axis=1)
    best = spread_order(score[likely], unlike, count)
    return [candidates.take(i[best]) for candidates, i in zip(postures, index, strict=True)]


def _supported(
    scene: GraspScene, loads: Loads, off: Array, block: ForceBlock, touched: dict[str, ContactStart]
) -> tuple[Array, Array]:
    """Remainder of imbalances (S, 3) under the best forces of supports, and how much these may lift (S,)."""
    if not touched:
        return off, np.zeros(len(off))
    friction = np.array([scene.held_friction(name) for name in touched])
    columns = [loads.edges * k + edge for k, mu in enumerate(friction) for edge in cone_edges(loads, mu)]
    effects = block.onto[0][:3, columns]
    force = pressed(effects, off)
    pairs = force.reshape(len(off), -1, 2)
    return off + force @ effects.T, (2.0 * friction * np.sqrt(pairs[..., 0] * pairs[..., 1])).sum(axis=1)


_COSTS = (0.0, 0.0, *(0.1,) * 6, 0.05, 0.05, 0.02, 0.0, 0.0, 0.0, 0.0)
"""Weight of the tensions, or of the normal forces, per those to begin with, in each step: they fall along what is
nearly in balance, and the last steps balance it."""
_STEP, _MOST, _DAMPING = 1e-4, 0.8, 1e-4
"""Difference for slopes, whose error is far below the imbalance sought; greatest change of a curvature in one
step [1/L]; damping of the normal equations, which may be singular."""
_IN_THE_WAY, _GAP = 5.0, 20.0
"""Weights of what is in the way and of the gap at the tip, in lengths of the finger, beside relative imbalances."""


def shape_forces(
    loads: Loads, setup: FingerSetup, candidates: Candidates, block: ForceBlock, com: complex
) -> tuple[Array, Array]:
    """Contact force and tension that come closest to bending P postures of a finger, which touches with its tip alone,
    as they are: what is known of them (P, 8), and what is missing for the balance of the finger (P, R).

    Known are their effect on the object (3), forces along two edges of the cone, tension left minus right, all per the
    unit of force, and the arm of the contact from ``com``, in the object's frame [m], per the object's size (2).
    """
    columns = [*cone_edges(loads, setup.held_friction), -2]
    moments, onto = block.moments[:, :, columns], block.onto[:, :3, columns]
    square = np.einsum("pri,prj->pij", moments, moments)
    # Normal equations scaled to a unit diagonal, 1e-9 on it where the forces are not unique.
    span = np.sqrt(np.maximum(np.einsum("pii->pi", square), 1e-300))
    square = square / (span[:, :, None] * span[:, None, :]) + 1e-9 * np.eye(3)
    right = np.einsum("pri,pr->pi", moments, block.needed) / span
    forces = np.linalg.solve(square, right[..., None])[..., 0] / span
    remainder = (moments @ forces[..., None])[..., 0] - block.needed
    arm = (candidates.points[:, 0] - com) / loads.length
    known = [(onto @ forces[..., None])[..., 0], forces, arm.real[:, None], arm.imag[:, None]]
    known[0], known[1] = known[0] / loads.force, known[1] / loads.force
    return np.concatenate(known, axis=1), remainder


def polished(
    scene: GraspScene,
    loads: Loads,
    some: list[Candidates],
    pose: Pose,
    supports: tuple[ForceBlock, dict[str, ContactStart]],
) -> list[Candidates]:
    """Sets of postures nearer to balance at a world pose of the object [m, rad]: of each finger K postures, the k-th of
    which belong together. All touch with their tips alone.
    """
    fingers = [_Finger(scene, loads, setup, pose, mine) for setup, mine in zip(scene.setups, some, strict=True)]
    balance = _Balance(scene, loads, *supports)
    looks = [finger.look(finger.unknowns) for finger in fingers]
    x = [*(finger.unknowns for finger in fingers), balance.start(looks)]
    ends = np.cumsum([part.shape[1] for part in x])[:-1]
    point = np.concatenate(x, axis=1)
    rest, slope = balance.missing(looks, x[-1])
    damping = np.full(len(point), _DAMPING)
    for cost in _COSTS:
        weight = np.ones(rest.shape[1])
        weight[: balance.costs] = cost
        size = ((weight * rest) ** 2).sum(axis=1)
        tall = weight[:, None] * slope
        square = np.einsum("kri,krj->kij", tall, tall) + damping[:, None, None] * np.eye(point.shape[1])
        change = -np.linalg.solve(square, np.einsum("kri,kr->ki", tall, weight * rest)[..., None])[..., 0]
        bent = np.abs(change[:, : ends[-1]]).max(axis=1)
        change *= np.minimum(1.0, _MOST / np.maximum(bent, 1e-300))[:, None]
        x = np.split(point + change, ends, axis=1)
        looks = [finger.look(mine) for finger, mine in zip(fingers, x, strict=False)]
        new, steep = balance.missing(looks, x[-1])
        # Steps that lead to more are not taken, and the next one is shorter.
        good = ((weight * new) ** 2).sum(axis=1) < size
        point[good], rest[good], slope[good] = (point + change)[good], new[good], steep[good]
        damping = np.where(good, np.maximum(0.2 * damping, _DAMPING), 20.0 * damping)
    return [finger.candidates(part) for finger, part in zip(fingers, np.split(point, ends, axis=1), strict=False)]


def pressed(onto: Array, off: Array) -> Array:
    """Forces (S, E) along the edges of the cones of supports, with effects ``onto`` (3, E), that leave the least of
    imbalances (S, 3), nearly: by Y. Nesterov's accelerated projected gradient, in which all edges count alike.
    """
    square, slope = onto.T @ onto, off @ onto
    stiff = np.linalg.eigvalsh(square).max(initial=1e-300)
    force = ahead = np.zeros_like(slope)
    # 24: steps to the nearest forces of supports, with which Gauss-Newton steps begin
    for k in range(24):
        new = np.maximum(ahead - (ahead @ square + slope) / stiff, 0.0)
        force, ahead = new, new + k / (k + 3.0) * (new - force)
    return force


@dataclass(frozen=True)
class _Look:
    """Tip of a finger at a set's posture and, behind it, with each of its n unknowns changed a little."""

    known: Array  # (K, 1 + n, 8), of `shape_forces`
    own: Array  # (K, 1 + n, R)
    steps: Array  # (K, n) these changes


class _Balance:
    """Imbalance, and its cost, from what the tips do, lifts and forces at supports."""

    def __init__(self, scene: GraspScene, loads: Loads, supports: ForceBlock, touched: dict[str, ContactStart]) -> None:
        self.loads = loads
        self._friction = np.array(
            [s.held_friction for s in scene.setups] + [scene.held_friction(name) for name in touched]
        )
        caps = [s.normal_force_max for s in scene.setups] + [scene.normal_force_max(name) for name in touched]
        self._caps = np.array(caps) / loads.force
        self._count, self._held = len(scene.setups), len(touched)
        com = complex(*scene.object.com)
        # Effects of the edges of the supports' cones in the plane, and their arms.
        edges = [
            [loads.edges * k + edge for edge in cone_edges(loads, scene.held_friction(name))]
            for k, name in enumerate(touched)
        ]
        self._onto = supports.onto[0][:3][:, np.array(edges, int).reshape(-1)]
        arms = [(complex(*contact.point) - com) / loads.length for contact in touched.values()]
        self._arms = np.array([[arm.real, arm.imag] for arm in arms]).reshape(-1, 2)
        self._lifts = bool(loads.lift)
        # Least tensions cancel in what bends a finger, and are left out of its range.
        limits = [(s.tendons.min_tension, s.tendons.max_tension, s.finger.tendons_used) for s in scene.setups]
        self._high = np.array([high - low if used != "right" else 0.0 for low, high, used in limits]) / loads.force
        self._low = -np.array([high - low if used != "left" else 0.0 for low, high, used in limits]) / loads.force
        self._aims_at_forces = scene.objective == "least_normal_force"
        self.costs = self._count + self._held if self._aims_at_forces else self._count

    def start(self, looks: list[_Look]) -> Array:
        """Forces along the edges of supports, and lifts as far as friction has them to spare (K, m). What is paid from
        here on is per the tensions, or forces, of these sets.
        """
        first = np.stack([look.known[:, 0] for look in looks], axis=1)
        cost = first[:, :, 3:5].sum(axis=2) if self._aims_at_forces else first[:, :, 5]
        self._usual = np.abs(cost).mean(axis=1) + 1e-3
        held = pressed(self._onto, first[:, :, :3].sum(axis=1) - self.loads.target[:3])
        if not self._lifts:
            return held
        edges = np.concatenate([first[:, :, 3:5], held.reshape(len(held), self._held, 2)], axis=1)
        spare = 2.0 * self._friction * np.sqrt(np.maximum(edges[:, :, 0] * edges[:, :, 1], 1e-6))
        share = self.loads.lift / self.loads.force / spare.sum(axis=1, keepdims=True)
        return np.concatenate([held, share * spare], axis=1)

    def missing(self, looks: list[_Look], free: Array) -> tuple[Array, Array]:
        """Residuals (K, R), of which the first ones are the cost, and their slopes (K, R, n)."""

        def residuals(free: Array, finger: int = 0, change: int = 0) -> Array:
            at = [change if k == finger else 0 for k in range(len(looks))]
            known, own = (
                [getattr(look, name)[:, j] for look, j in zip(looks, at, strict=True)] for name in ("known", "own")
            )
            return np.concatenate([self._common(known, free), *own], axis=1)

        here = residuals(free)
        slopes = [
            (residuals(free, k, 1 + j) - here) / look.steps[:, j, None]
            for k, look in enumerate(looks)
            for j in range(look.steps.shape[1])
        ]
        slopes += [(residuals(free + step) - here) / _STEP for step in _STEP * np.eye(free.shape[1])]
        return here, np.stack(slopes, axis=2)

    def _common(self, known: list[Array], free: Array) -> Array:
        """The cost, balances of the object, and what is outside of limits (K, R)."""
        pressed = free[:, : 2 * self._held]
        tips = np.stack(known, axis=1)
        edges = np.concatenate([tips[:, :, 3:5], pressed.reshape(len(free), self._held, 2)], axis=1)
        normal, across = edges.sum(axis=2), self._friction * (edges[:, :, 0] - edges[:, :, 1])
        pull = tips[:, :, 5]
        off = tips[:, :, :3].sum(axis=1) + pressed @ self._onto.T - self.loads.target[:3]
        cost = normal if self._aims_at_forces else np.sqrt(pull**2 + 1e-8)
        rows = [cost / self._usual[:, None], off]
        side = np.abs(across)
        if self._lifts:
            lifts = free[:, 2 * self._held :]
            rows.append(lifts.sum(axis=1, keepdims=True) - self.loads.lift / self.loads.force)
            if self.loads.balance:
                arms = np.concatenate(
                    [tips[:, :, 6:8], np.broadcast_to(self._arms, (len(free), self._held, 2))], axis=1
                )
                rows.append((lifts[..., None] * arms).sum(axis=1))
            side = np.hypot(across, lifts)
        # Beyond cones and limits, and never a pull at a contact.
        rows += [np.maximum(side - self._friction * normal, 0.0), np.minimum(normal, 0.0)]
        rows += [
            np.maximum(normal - self._caps, 0.0),
            np.maximum(pull - self._high, 0.0) + np.minimum(pull - self._low, 0.0),
        ]
        return np.concatenate(rows, axis=1)


class _Finger:
    """A finger of the sets, whose unknowns are the curvatures at its knots and what is free of its base."""

    def __init__(self, scene: GraspScene, loads: Loads, setup: FingerSetup, pose: Pose, start: Candidates) -> None:
        self.scene, self.loads, self.setup, self.pose, self.start = scene, loads, setup, pose, start
        base_pose = setup.finger.base.pose
        length = setup.finger.rod.length
        self.task: FingerTask = make_task(scene, setup, base_pose, pose, 1, (setup.tip_name,))
        self._length, self._own = length, np.array(base_pose)
        bounds = np.array(setup.finger.base_bounds)
        self._free = np.flatnonzero(bounds[:, 1] > bounds[:, 0])
        self._unit = np.array([length, length, 1.0])
        self._low, self._high = ((bounds[:, k] - base_pose) / self._unit for k in (0, 1))
        moved = (start.bases - base_pose) / self._unit
        self.unknowns = np.concatenate([start.curvatures, moved[:, self._free]], axis=1)
        self._size = start.curvatures.shape[1]

    def look(self, x: Array) -> _Look:
        """Tip at unknowns (K, n), and with small changes for its slopes."""
        count, size = x.shape
        # Away from zero: of a mirrored finger, which bends the other way, the slopes are the same.
        steps = np.copysign(_STEP, x)
        every = np.concatenate([x[:, None], x[:, None] + steps[:, :, None] * np.eye(size)], axis=1)
        every, rows = every.reshape(-1, size), np.repeat(np.arange(count), size + 1)
        postures, gap = self._postures(every, rows, touching=False)
        # Slopes of what is in the way are needed where something is, and cost the most.
        wrong = self._in_the_way(postures.take(slice(None, None, size + 1)))
        slopes = np.flatnonzero(np.repeat(wrong > 0.0, size + 1))
        wrong = np.repeat(wrong, size + 1)
        if len(slopes):
            wrong[slopes] = self._in_the_way(postures.take(slopes))
        block = finger_block(self.scene, self.loads, self.setup, postures, self.pose)
        known, own = shape_forces(self.loads, self.setup, postures, block, complex(*self.scene.object.com))
        own = np.column_stack([own, _IN_THE_WAY * wrong, _GAP * gap])
        known, own = (part.reshape(count, size + 1, -1) for part in (known, own))
        return _Look(known, own, steps)

    def candidates(self, x: Array) -> Candidates:
        """The postures at unknowns (K, n), changed so that their tips touch, with what is in their way."""
        postures, gap = self._postures(x, np.arange(len(x)), touching=True)
        # The weights leave the best posture beside an object a little too deep.
        wrong = np.maximum(self._in_the_way(postures) - NEAR, 0.0)
        return replace(postures, violation=wrong + np.where(np.abs(gap) < ROUNDING, 0.0, 1.0))

    def _in_the_way(self, postures: Candidates) -> Array:
        """By how much each posture penetrates, or breaks a limit, from where its base is."""
        move = postures.bases - self._own
        start = (move[:, 0] + 1j * move[:, 1]) / self._length * cmath.exp(-1j * float(self._own[2]))
        return violation(self.task, postures.knots, postures.curvatures, postures.joints, (start, move[:, 2]))

    def _postures(self, x: Array, rows: Array, touching: bool) -> tuple[Candidates, Array]:
        """Postures at unknowns (P, n), next to some of the first, and the gaps of their tips (P,), which are closed
        where they can be if they are to be ``touching``.
        """
        task, some = self.task, self.start.take(rows)
        bent, gap = x[:, : self._size].copy(), np.zeros(len(x))
        move = np.zeros((len(x), 3))
        move[:, self._free] = np.clip(x[:, self._size :], self._low[self._free], self._high[self._free])
        # The base that is moved in the world, seen from the one that is not.
        start = (move[:, 0] + 1j * move[:, 1]) * cmath.exp(-1j * float(self._own[2])), move[:, 2]
        lengths = np.diff(some.knots, axis=1)
        points, angles = np.zeros(len(rows), complex), np.zeros(len(rows))
        for part, shape in enumerate(task.shapes):
            mine = np.flatnonzero(some.parts[:, 0] == part)
            if not len(mine):
                continue
            begin = start[0][mine], start[1][mine]
            end, _, _, _ = segment_end(lengths[mine], bent[mine])
            away, walk = shape.nearest(begin[0] + np.exp(1j * begin[1]) * end)
            gap[mine] = away - task.half
            if touching:
                curves, there, good = touch(shape, begin, lengths[mine], bent[mine], np.ones((1, self._size)), walk)
                bent[mine[good]], walk[good], gap[mine[good]] = curves[good], there[good], 0.0
            at = shape.walk(walk)
            points[mine], angles[mine] = at.point, at.angle
        surface = task.frame.back(points - task.half * np.exp(1j * angles))
        normals = task.frame.angle_back(angles)[:, None]
        bases = self._own + move * self._unit
        return replace(some, curvatures=bent, bases=bases, points=surface[:, None], angles=normals), gap
