"""Small motions of a grasp as part of its problem: what it answers to loads bounds the grasp itself.

A variant adds unknowns and rows to a problem: changes of its unknowns under a load, to first order, by tangents of the
same blocks, and what must hold for them.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field, replace

import numpy as np

from continuum_grasp.base import Array, Indices
from continuum_grasp.grasp.rods import kinds
from continuum_grasp.grasp.rods.motion import GraspMotion, TendonBehavior
from continuum_grasp.grasp.rods.problem import APEX, GraspRods
from continuum_grasp.grasp.rods.tangent import SHIFT, GraspTangent
from continuum_grasp.scene import GraspScene, HandScene

ALIKE = 1e-6
"""Cost of the square of a change of tension, per (E I / L)^2: a thousandth of what it changes in the aim matters."""
STEADY = 0.1
"""Acceleration whose inertial force a grasp bears in every direction where ``stability`` is ``require`` [m/s2]: weight
turns away by as much where a hand tilts by 0.6 degrees. It takes 0.8 % more tension of `pinch`, 0.05 % of `gear`; a
larger push is stated by ``contacts.push``."""
MISSED = 1e-3
"""Share of a push that a solution may miss: a tenth of what its certificate lets pass [1]."""
EASED = 1e-6
"""Push that is asked for beyond the required one [F0]: the solver eases bounds of squared forces by 1e-8."""
STIFF = 0.02
"""Least stiffness that a grasp gets where small motions lower the energy [E I / L of the first finger]."""
_SPARES = np.logspace(-10.0, 4.0, 141)
"""Multipliers that are tried for a start, per greatest change of a load."""


class GraspAnswers(ABC):
    """Answers of a grasp to K loads, as changes of its unknowns that are unknowns, too.

    Attributes
    ----------
    amount : ndarray of int, shape (1,)
        Unknown amount of all loads.
    """

    amount: Indices

    def __init__(self, problem: GraspRods, motion: GraspMotion, loads: Array) -> None:
        """Add the answers to loads (K, 6) on the object, per unit of the amount [F0, F0 size]."""
        self.problem, self.motion, self.loads = problem, motion, loads
        self._size, self._count = problem.size, problem.count
        self._still = problem.unknown(f"still, {self.key}", 0.0, 0.0)
        self.changes = [self._answer(k, load) for k, load in enumerate(loads)]
        problem.fillings.append(self.fill)

    @property
    @abstractmethod
    def key(self) -> str:
        """Key of the scene that asks for them."""

    def _answer(self, k: int, load: Array) -> Indices:
        """Add the answer to a load; places (size,) of the changes of all unknowns."""
        problem, motion = self.problem, self.motion
        changes = np.full(self._size, int(self._still[0]))
        free = np.full(len(motion.changing), np.inf)
        changes[motion.changing] = problem.unknown(f"answer {k}, {self.key}", -free, free)
        rows = np.full(self._count, -1)
        inner = motion.rows[: -len(motion.balance)]
        rows[inner] = problem.rows(f"answer {k}, {self.key}", self.key, "1", len(inner)).ravel()
        rows[motion.balance] = self._balance_rows(k)
        problem.add_tangents(changes, rows)
        give = kinds.share_kind()
        for row, force, compliance in motion.gaps:
            problem.add(give, changes[force], rows[row], [compliance])
        for contact in motion.of_contacts:
            own = np.full(contact.kind.count, problem.free_row)
            own[contact.rows] = problem.rows(f"stick {k}, {self.key}", self.key, "1", len(contact.rows)).ravel()
            own[contact.balance] = rows[problem.balance[contact.balance]]
            problem.add(contact.kind, [*contact.unknowns, *changes[contact.changes]], own, contact.data)
            for row, force in zip(own[contact.rows], contact.forces, strict=True):
                problem.add(give, changes[force], row, [contact.give])
        for terms in motion.locks:
            length = problem.rows(f"lock {k}, {self.key}", self.key, "1", 1).ravel()
            for place in terms:
                problem.add(give, changes[place], length, [1.0])
        for row, part in zip(problem.balance, load, strict=True):
            if part:
                problem.add(give, self.amount, rows[row], [part])
        return changes

    def _balance_rows(self, k: int) -> Indices:
        """Rows of the changes of the balance under a load."""
        return self.problem.rows(f"balance {k}, {self.key}", self.key, "1", len(self.motion.balance)).ravel()

    def fill(self, x: Array) -> None:
        """Set the answers to the linear ones of the grasp in the unknowns, and the amount to what the grasp bears."""
        tangent = tangent_of(self.problem, x)
        x[self.amount] = self.borne(x, tangent)
        if tangent is not None:
            answers = tangent.to_loads(self.loads)
            for changes, column in zip(self.changes, answers.T, strict=True):
                x[changes[tangent.motion.changing]] = float(x[self.amount][0]) * column
        x[self._still] = 0.0

    @abstractmethod
    def borne(self, x: Array, tangent: GraspTangent | None) -> float:
        """Amount of the loads with which the problem starts."""


def tangent_of(problem: GraspRods, x: Array) -> GraspTangent | None:
    """Tangent of a grasp; None where nothing presses, or where nothing holds some motion."""
    try:
        tangent = GraspTangent(problem, x)
        tangent.response  # noqa: B018
    except (ValueError, RuntimeError):
        return None
    return tangent


class BornePush(GraspAnswers):
    """A push on the object, in any direction, that the grasp bears.

    Parameters
    ----------
    problem : GraspRods
    least : float
        Least push [N].
    aim : float
        Weight in the objective of the push per newton; without one, the push is the least one.
    """

    key = "contacts.push"

    def __init__(self, problem: GraspRods, least: float, aim: float = 0.0) -> None:
        force, directions = problem.numbers.force, problem.geometry.dimensions
        self._least = least / force + EASED * (least > 0.0)
        motion = GraspMotion(problem)
        self.amount = problem.unknown("push", self._least, np.inf if aim else self._least)
        problem.cost(self.amount, -aim * force)
        super().__init__(problem, motion, np.eye(6)[:directions])
        self._spare: dict[str, Indices] = {}
        for name in problem.contacts:
            self._bound(name)

    def _bound(self, name: str) -> None:
        problem, held, count = self.problem, self.problem.contacts[name], len(self.changes)
        spare, size = problem.unknown(f"spare, {name}", 0.0, np.inf), count + 1
        rows, columns = np.tril_indices(size)
        free = np.full(len(rows) - 1, np.inf)
        factor = problem.unknown(f"factor, {name}", np.where(rows == columns, 0.0, -np.inf)[:-1], free)
        self._spare[name] = np.concatenate([spare, factor])
        most, same = problem.limits[1][held[0]], [0.0] * len(free)
        lower, upper = [0.0, -np.inf, 0.0, *same], [np.inf, most, np.inf, *same]
        bounds = problem.rows(f"pushed, {name}", self.key, "F0", 1, np.ones(3 + len(free)), lower, upper)
        changes = np.concatenate([changes[held] for changes in self.changes])
        unknowns = [*held, *changes, *self._spare[name]]
        problem.add(kinds.pushed_kind(count), unknowns, bounds, [problem.numbers.friction(name)])

    def fill(self, x: Array) -> None:
        """Set the push, the answers, and multipliers for them."""
        super().fill(x)
        for name, at in self._spare.items():
            held = self.problem.contacts[name]
            slope = np.array([x[changes[held]] for changes in self.changes]).T
            x[at] = _spare(x[held], slope, self.problem.numbers.friction(name))

    def borne(self, x: Array, tangent: GraspTangent | None) -> float:
        """Half of what the grasp bears, or the least push."""
        push = 0.0 if tangent is None else 0.5 * tangent.push
        return max(self._least, push / self.problem.numbers.force)


def _spare(load: Array, slope: Array, friction: float) -> Array:
    """Multiplier of the S-lemma that leaves most of the last pivot, and the entries of the factor with it."""
    form = np.diag([friction**2, -1.0, -1.0, -1.0])
    w, axes = np.linalg.eigh(slope.T @ form @ slope)
    v = axes.T @ (slope.T @ form @ load)
    spares = max(0.0, -float(w[0])) + max(float(np.abs(w).max()), 1e-12) * _SPARES
    left = load @ form @ load - spares - (v[:, None] ** 2 / (w[:, None] + spares)).sum(axis=0)
    spare = float(spares[left.argmax()])
    whole = np.column_stack([slope, load])
    matrix = whole.T @ form @ whole + np.diag([*[spare] * len(w), -spare])
    # Where the push is not borne, the last entry does not count.
    matrix[-1, -1] += max(0.0, 1.0 - float(left.max()))
    factor = np.linalg.cholesky(matrix)
    return np.array([spare, *factor[np.tril_indices(len(factor))][:-1]])


class ResistedDisturbances(GraspAnswers):
    """Disturbances of the object that the grasp resists, all of them times one factor.

    Parameters
    ----------
    problem : GraspRods
    wrenches : ndarray, shape (K, 6)
        Forces and moments about the center of mass [N, N m].
    aim : float
        Weight of the factor in the objective.
    tendons : TendonBehavior
        What tendons do under each disturbance.
    """

    key = "disturbances"

    def __init__(self, problem: GraspRods, wrenches: Array, aim: float, tendons: TendonBehavior) -> None:
        numbers = problem.numbers
        units = numbers.force * np.array([1.0, 1.0, 1.0, numbers.size, numbers.size, numbers.size])
        self.amount = problem.unknown("factor", 0.0, np.inf)
        problem.cost(self.amount, -aim)
        super().__init__(problem, GraspMotion(problem, tendons=tendons), wrenches / units)
        limits = problem.limits[1]
        for k, changes in enumerate(self.changes):
            for name, held in problem.contacts.items():
                kind = kinds.moved_kind(spatial=numbers.spatial)
                high = [limits[held[0]], *[np.inf] * (kind.count - 1)]
                rows = problem.rows(f"disturbed {k}, {name}", self.key, "F0", 1, [1.0] * kind.count, 0.0, high)
                data = [numbers.friction(name), APEX]
                problem.add(kind, [*held, *changes[held]], rows, data)
            for part, finger in zip(problem.parts, numbers.fingers, strict=True):
                # Antagonists that change alike have no effect.
                problem.cost(changes[part.pulls], 0.0, ALIKE)
                for at, most in zip(part.pulls, finger.pulls, strict=True):
                    row = problem.rows(f"disturbed {k}, {finger.name}", self.key, "1", 1, 1.0, 0.0, most)
                    problem.add(kinds.sum_kind(), [at, changes[at]], row, [])

    def borne(self, x: Array, tangent: GraspTangent | None) -> float:
        """No disturbance: every grasp resists that."""
        return 0.0


class LeastStiffness(GraspAnswers):
    """Least stiffness of the object against small motions: the answers are to a unit shift or turn each.

    With K the wrench per motion of the object, fingers at rest, and M the norm of motions, K - least M is L L'.

    Parameters
    ----------
    problem : GraspRods
    least : float
        Least stiffness, in E I / L of the first finger, of a turn and of a shift by `SHIFT` of its length.
    """

    key = "stability"

    def __init__(self, problem: GraspRods, least: float) -> None:
        geometry, numbers = problem.geometry, problem.numbers
        motion = GraspMotion(problem)
        size = len(motion.balance)
        first = numbers.fingers[0]
        self._pairs = [(i, j) for i in range(size) for j in range(i + 1)]
        self._rows = problem.rows("stiffness", self.key, "F0 size", len(self._pairs)).ravel()
        self.amount = problem.unknown("unit motion", 1.0, 1.0)
        lengths = np.array(
            [*[SHIFT * first.length / numbers.size] * geometry.dimensions, *[1.0] * len(geometry.moments)]
        )
        self._least = least * first.moment / numbers.force / numbers.size / lengths**2
        super().__init__(problem, motion, np.zeros((size, 6)))
        turn, give = kinds.moved_object_kind(geometry), kinds.share_kind()
        for k, changes in enumerate(self.changes):
            rows = problem.rows(f"motion {k}", self.key, "1", size).ravel()
            data = [*numbers.center, *numbers.axes]
            problem.add(turn, [*problem.pose, *changes[problem.pose]], rows, data)
            problem.add(give, self.amount, rows[k], [-1.0])
        low = [0.0 if i == j else -np.inf for i, j in self._pairs]
        self._factor = problem.unknown("factor, stiffness", low, np.full(len(low), np.inf))
        more = [float(self._least[i]) if i == j else 0.0 for i, j in self._pairs]
        problem.add(kinds.square_kind(size), self._factor, self._rows, more)

    def _balance_rows(self, k: int) -> Indices:
        size = len(self.motion.balance)
        return self._rows[[self._pairs.index((max(i, k), min(i, k))) for i in range(size)]]

    def fill(self, x: Array) -> None:
        """Set the answers, and the factor to the nearest stiffness that is enough."""
        x[self.amount], x[self._still] = 1.0, 0.0
        tangent = tangent_of(self.problem, x)
        size = len(self.motion.balance)
        stiffness: Array = np.diag(self._least)
        if tangent is not None:
            answers, moved = tangent.by_wrenches()
            stiffness = np.asarray(np.linalg.inv(moved))
            for changes, column in zip(self.changes, (answers @ stiffness).T, strict=True):
                x[changes[tangent.motion.changing]] = column
        scale = np.sqrt(self._least)
        values, vectors = np.linalg.eigh(0.5 * (stiffness + stiffness.T) / np.outer(scale, scale) - np.eye(size))
        # 0.1: a start within the bounds of the factor
        enough = (vectors * np.maximum(values, 0.1)) @ vectors.T * np.outer(scale, scale)
        x[self._factor] = np.linalg.cholesky(enough)[np.tril_indices(size)]

    def borne(self, x: Array, tangent: GraspTangent | None) -> float:
        """One unit."""
        return 1.0


@dataclass(frozen=True, eq=False)
class AskedAnswers:
    """Answers to loads that are asked for: a variant of the problem of a grasp."""

    push: float = 0.0
    """Least push in every direction [N]."""
    push_aim: float = 0.0
    """Weight in the objective of the push per newton."""
    wrenches: Array = field(default_factory=lambda: np.zeros((0, 6)))
    """Disturbances (K, 6) whose factor is an aim [N, N m]."""
    wrench_aim: float = 0.0
    """Weight in the objective of their factor."""
    tendons: TendonBehavior = TendonBehavior.CONSTANT
    """Behavior of tendons under disturbances."""
    stiffness: float = 0.0
    """Least stiffness of the object [E I / L of the first finger]; 0: any."""
    tension: float = 1.0
    """Factor on the weight of tensions in the objective."""

    def __call__(self, problem: GraspRods) -> None:
        """Add the answers to a problem."""
        problem.scale_costs(np.concatenate([part.pulls for part in problem.parts]), self.tension)
        if self.push or self.push_aim:
            BornePush(problem, self.push, self.push_aim)
        if self.wrench_aim:
            ResistedDisturbances(problem, self.wrenches, self.wrench_aim, self.tendons)
        if self.stiffness:
            LeastStiffness(problem, self.stiffness)

    @property
    def required(self) -> bool:
        """Whether they are requirements, not aims alone."""
        return bool(self.push or self.stiffness)

    @property
    def aimed(self) -> bool:
        """Whether the objective has a part of them."""
        return bool(self.push_aim or self.wrench_aim)

    def joined(self, other: AskedAnswers | None) -> AskedAnswers:
        """Both, with the aims of the other ones."""
        if other is None:
            return self
        return replace(other, push=max(self.push, other.push), stiffness=max(self.stiffness, other.stiffness))

    def met(self, problem: GraspRods, x: Array) -> bool:
        """Whether a grasp has what is required."""
        tangent = tangent_of(problem, x)
        return tangent is not None and tangent.stable and tangent.push >= self.push * (1.0 - MISSED)


def asked_of(scene: GraspScene) -> AskedAnswers | None:
    """Answers that a planar scene asks for; None where it asks for none."""
    weights, most = scene.weights, scene.contacts.normal_force_max
    wrenches = np.array([[*wrench[:2], 0.0, 0.0, 0.0, wrench[2]] for wrench in scene.wrenches])
    asked = AskedAnswers(
        scene.contacts.push or 0.0,
        weights.greatest_push / most,
        wrenches,
        weights.greatest_disturbance,
        TendonBehavior(scene.disturbances.tendons),
    )
    return asked if asked.push or asked.push_aim or asked.wrench_aim else None


def steady_of(scene: GraspScene | HandScene) -> AskedAnswers | None:
    """Answers with which a grasp returns after a small push, where a scene requires that; None where it does not.

    A push that the scene states counts, else one of `STEADY` times the mass, as for an object whose hand moves.
    """
    if scene.stability == "ignore":
        return None
    mass = scene.object.mass if isinstance(scene, GraspScene) else scene.object.weighed
    push = scene.contacts.push
    return AskedAnswers(push=STEADY * mass if push is None else push, stiffness=STIFF)
