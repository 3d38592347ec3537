"""Postures of a grasp in which friction has another history, at what its drives hold.

Unknown are moments in the bases, forces and places of contacts, tensions where drives hold cables, and the pose of an
object that fingers alone hold. Known histories make all of them follow but for forces that friction shares. Of these,

    maximize  s   subject to   mu N - |f| >= s of all contacts,  shapes touch the object,  forces balance,

by a sequence of linear problems in a region of trust (R. Fletcher, E. Sainz de la Maza, 1989,
doi:10.1007/BF01589355), whose slopes are differences of rods that are integrated anew.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.optimize import linprog
from scipy.spatial.transform import Rotation

from continuum_grasp.base import Numbers as Array
from continuum_grasp.grasp.judge.bending import FrictionCells
from continuum_grasp.grasp.judge.check import FOLLOWED, YIELDS
from continuum_grasp.grasp.judge.drives import WoundCables
from continuum_grasp.grasp.judge.held import HeldContact, HeldFinger, HeldRods
from continuum_grasp.grasp.judge.obstacles import ExactObject
from continuum_grasp.grasp.judge.space_rod import RodLoad, SpaceRod
from continuum_grasp.grasp.judge.stage import GraspStage
from continuum_grasp.scene import FingerSetup

_TOLERANCE = 1e-8
"""Relative tolerance with which shapes are integrated [1]; gaps of shipped grasps change by up to 1e-8 L."""
_STEP = 1e-5
"""Step of differences in units of the unknowns [1]: a tenth of the root of the tolerance, as rods err alike."""
_SAMPLES = np.linspace(0.0, 1.0, 33)[1:]
"""Places along a finger that keep clear of the object."""
_BESIDE = np.array([-0.04, -0.02, -0.01, 0.01, 0.02, 0.04])
"""Such places beside contacts [L]: there a finger that friction bends sharper than the object is in it."""
_PENALTIES = 50.0, 5e4
"""First and greatest cost of a violation, per cost of the reserve: tens of times as much where it stays."""
_TRUST, _LEAST_TRUST = 0.3, 1e-8
"""First and least region of trust, in units of the unknowns."""
_STEPS = 150
"""Most linear problems: 8 to 40 where the finger is clear beside its contacts; where it is not, 150 leave 2e-5
(`mug_sticking`)."""
_EXACT = 1e-7
"""Sum of violations, and gain of a step, that count as none [1]."""
_ALONG = 1e-3
"""Slope at which a tip may point into the object."""


@dataclass(frozen=True, eq=False)
class TouchingPlace:
    """A contact in a posture: force (3,) on the finger or support [N], point (3,) and outward normal of the object."""

    force: Array
    point: Array
    normal: Array
    friction: float
    most: float
    twist: float = 0.0

    @property
    def spare(self) -> float:
        """Force across the normal that friction still bears [N]."""
        pressing = float(self.force @ self.normal)
        return self.friction * pressing - float(np.linalg.norm(self.force - pressing * self.normal))


@dataclass(frozen=True, eq=False)
class JudgedPosture:
    """A posture: unknowns, the least spare friction per force scale, and what it leaves violated."""

    x: Array
    reserve: float
    violated: float
    slopes: Array  # of the reserve by all rows


@dataclass(frozen=True, eq=False)
class _PostureRows:
    """Rows of a posture: zero, zero or more, and at least the reserve."""

    zero: Array
    positive: Array
    spare: Array

    @property
    def violated(self) -> float:
        """Sum of all violations."""
        return float(np.abs(self.zero).sum() - np.minimum(self.positive, 0.0).sum())

    @property
    def all(self) -> Array:
        """All rows."""
        return np.concatenate([self.zero, self.positive, self.spare])

    def merit(self, penalty: float) -> float:
        """Reserve less the cost of violations."""
        merit = float(self.spare.min()) - penalty * self.violated
        return merit if np.isfinite(merit) else -np.inf


FingerRows = tuple[Array, Array, list[TouchingPlace]]
"""Rows of a finger that are zero, rows that are zero or more, and contacts."""


class HistoryPostures:
    """Finds postures of a grasp for histories of friction."""

    def __init__(self, stage: GraspStage, held: HeldRods, rods: list[SpaceRod]) -> None:
        self.stage, self.held = stage, held
        self.scale = stage.scale(held)
        self.yields = not held.supports
        self._setups = [stage.setups[finger.name] for finger in held.fingers]
        self._bases = [(finger.position, finger.axes) for finger in held.fingers]
        self._flat = not np.any(stage.mass * stage.gravity[2]) and not np.isfinite(
            stage.section(self._setups[0]).torsion
        )
        self._commands = [
            None if setup.drive is None else WoundCables(setup, setup.drive, rod, finger.tensions).held
            for setup, rod, finger in zip(self._setups, rods, held.fingers, strict=True)
        ]
        own = [
            replace(finger, moment=rod.at(np.zeros(1)).moment[0])
            for finger, rod in zip(held.fingers, rods, strict=True)
        ]
        self.held = replace(held, fingers=tuple(own))
        body = stage.body(held)
        self._landed = {
            contact.name: held.axes.T @ (self._touched(setup, rod, contact, body)[0] - held.position)
            for setup, rod, finger in zip(self._setups, rods, held.fingers, strict=True)
            for contact in finger.contacts
        }

    # -- unknowns ----------------------------------------------------------------------------------------------

    @cached_property
    def _parts(self) -> list[tuple[int, str, int, float]]:
        """Owner (finger, -1: supports, -2: object), name, count and unit of unknowns."""
        parts = list[tuple[int, str, int, float]]()
        for k, (setup, finger) in enumerate(zip(self._setups, self.held.fingers, strict=True)):
            length = setup.finger.rod.length
            parts.append((k, "moment", len(self._soft(k)), self.scale * length))
            if self._follows(k):
                parts.append((k, "tensions", 2, self.scale * length / setup.tendons.offset))
            for j, contact in enumerate(finger.contacts):
                parts.append((k, f"force {j}", 2 if self._flat else 3, self.scale))
                if contact.name in setup.middle_names:
                    parts.append((k, f"place {j}", 1, length))
        parts += [(-1, f"force {j}", 2 if self._flat else 3, self.scale) for j in range(len(self.held.supports))]
        if self.yields:
            flat = self._soft(0) == [2]
            parts += [(-2, "position", 2 if flat else 3, self.stage.size), (-2, "turn", 1 if flat else 3, 1.0)]
        return parts

    def _soft(self, index: int) -> list[int]:
        """Axes of the base about which moments are unknown."""
        return [0, 1, 2] if np.isfinite(self.stage.section(self._setups[index]).torsion) else [2]

    def _follows(self, index: int) -> bool:
        """Whether tensions follow from what drives hold."""
        law = self._setups[index].drive
        return law is not None and (law.locks or law.pulley)

    @cached_property
    def start(self) -> Array:
        """Unknowns of the grasp itself."""
        return np.concatenate([self._value(owner, name)[:count] / unit for owner, name, count, unit in self._parts])

    def _value(self, owner: int, name: str) -> Array:
        key, _, j = name.partition(" ")
        if owner == -2:
            return np.zeros(3)
        if owner == -1:
            return self.held.supports[int(j)].force
        finger = self.held.fingers[owner]
        if key == "moment":
            return np.asarray((finger.axes.T @ _moment(finger))[self._soft(owner)])
        if key == "tensions":
            return finger.tensions
        contact = finger.contacts[int(j)]
        return contact.force if key == "force" else np.array([contact.place])

    @cached_property
    def owners(self) -> Array:
        """Owner of each unknown."""
        return np.array([owner for owner, _, count, _ in self._parts for _ in range(count)])

    @cached_property
    def _bends(self) -> list[bool]:
        """Whether an unknown bends a finger: planar ones are stiff across their plane."""
        return [
            not (name.startswith("force") and i == 2 and self._soft(max(owner, 0)) == [2])
            for owner, name, count, _ in self._parts
            for i in range(count)
        ]

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """Least and greatest unknowns."""
        low, high = np.full(self.start.size, -np.inf), np.full(self.start.size, np.inf)
        i = 0
        for owner, name, count, unit in self._parts:
            if name.startswith("place"):
                setup, contact = self._setups[owner], self.held.fingers[owner].contacts[int(name.split()[1])]
                limits = dict(zip(setup.middle_names, setup.contact_bounds, strict=True))[contact.name]
                low[i], high[i] = np.array(limits) / unit
            elif name == "tensions":
                high[i : i + 2] = self._setups[owner].max_tension / unit
            elif owner == -2:
                low[i : i + count], high[i : i + count] = -YIELDS, YIELDS
            i += count
        return low, high

    def _record(self, x: Array) -> HeldRods:
        """The record with other unknowns."""
        fingers, supports = list(self.held.fingers), list(self.held.supports)
        position, axes, i = self.held.position.copy(), self.held.axes, 0
        for owner, name, count, unit in self._parts:
            value, (key, _, j) = unit * x[i : i + count], name.partition(" ")
            i += count
            if owner == -2:
                if key == "position":
                    position[:count] += value
                else:
                    axes = Rotation.from_rotvec([0.0] * (3 - count) + value.tolist()).as_matrix() @ axes
            elif owner == -1:
                supports[int(j)] = replace(supports[int(j)], force=_in_space(value))
            elif key == "moment":
                fingers[owner] = replace(fingers[owner], moment=fingers[owner].axes[:, self._soft(owner)] @ value)
            elif key == "tensions":
                fingers[owner] = replace(fingers[owner], tensions=value)
            else:
                change = {"force": _in_space(value)} if key == "force" else {"place": float(value[0])}
                contacts = list(fingers[owner].contacts)
                contacts[int(j)] = replace(contacts[int(j)], **change)
                fingers[owner] = replace(fingers[owner], contacts=tuple(contacts))
        return HeldRods(position, axes, tuple(fingers), tuple(supports))

    # -- rows --------------------------------------------------------------------------------------------------

    @staticmethod
    def _touched(
        setup: FingerSetup, rod: SpaceRod, contact: HeldContact, body: ExactObject
    ) -> tuple[Array, Array, float, Array]:
        """Point and normal of a contact, its gap [m], and the direction of the finger."""
        here = rod.at(np.array([contact.place]))
        (distance,), (normal,) = body.near(here.points)
        half = float(setup.finger.profile.half_thickness(contact.place))
        return here.points[0] - half * normal, normal, float(distance) - half, here.axes[0, :, 1]

    def finger_rows(self, index: int, held: HeldRods, history: Array) -> FingerRows:
        """Rows that are zero, rows that are zero or more, and contacts of a finger."""
        setup, finger, body = self._setups[index], held.fingers[index], self.stage.body(held)
        profile, length = setup.finger.profile, setup.finger.rod.length

        def load(contact: HeldContact) -> RodLoad:
            half = float(profile.half_thickness(contact.place))

            def couple(center: Array) -> Array:
                normal = body.near(center[None])[1][0]
                return np.asarray(contact.moment * normal - half * np.cross(normal, contact.force))

            return RodLoad(contact.place, contact.force, couple)

        rod = SpaceRod(
            setup,
            self._bases[index],
            finger.tensions,
            [load(contact) for contact in finger.contacts],
            self.stage.finger_gravity,
            self.stage.section(setup),
            tolerance=_TOLERANCE,
            history=_cells(finger, length, history),
        )
        rod.integrate(_moment(finger))
        zero = list((finger.axes.T @ rod.missing)[self._soft(index)] / (self.scale * length))
        positive, touching = list[float](), list[TouchingPlace]()
        for contact in finger.contacts:
            point, normal, gap, tangent = self._touched(setup, rod, contact, body)
            leaning = float(normal @ tangent) - profile.half_thickness.slope(contact.place)
            zero.append(gap / length)
            if contact.name in setup.middle_names:
                zero.append(leaning)
            else:
                positive.append(_ALONG - leaning)
            if self.yields and len(finger.contacts) == 1 and contact.name == setup.tip_name:
                off = held.axes.T @ (point - held.position) - self._landed[contact.name]
                across = held.axes.T @ normal
                zero += [float(row @ off) / length for row in _along(across, 2 if self._soft(index) == [2] else 3)]
            touching.append(
                TouchingPlace(contact.force, point, normal, setup.held_friction, setup.normal_force_max, contact.moment)
            )
        law, command = setup.drive, self._commands[index]
        if self._follows(index) and law is not None and command is not None:
            # As tensions, of which a moment is the unit: cables are stiff.
            unit = (law.series + law.axial) * self.scale * length / setup.tendons.offset
            zero += list(WoundCables(setup, law, rod, finger.tensions).misfit(command) / unit)
        beside = [contact.place / length + _BESIDE for contact in finger.contacts]
        s = np.clip(np.concatenate([_SAMPLES, *beside]), 0.0, 1.0) * length
        clear = body.distance(rod.at(s).points) - profile.half_thickness(s) + self.stage.deviation
        return np.array(zero), np.array([*positive, *(clear / length + FOLLOWED)]), touching

    def rows(self, held: HeldRods, of_fingers: list[FingerRows]) -> _PostureRows:
        """All rows, by the rows of each finger."""
        stage, body = self.stage, self.stage.body(held)
        touching = [touch for *_, each in of_fingers for touch in each]
        for support in held.supports:
            name = support.name if any(o.name == support.name for o in stage.obstacles) else support.name[:-2]
            obstacle = next(each for each in stage.obstacles if each.name == name)
            normal, _ = obstacle.touched(support, body)
            most = stage.scene.contacts.normal_force_max
            touching.append(TouchingPlace(support.force, support.position, normal, obstacle.friction, most))
        center, force = stage.center(held), stage.mass * stage.gravity
        moment = np.zeros(3)
        for touch in touching:
            force = force - touch.force
            moment -= np.cross(touch.point - center, touch.force) + touch.twist * touch.normal
        balance = [*(force / self.scale), *(moment / (self.scale * stage.size))]
        if self._flat:
            balance = [balance[0], balance[1], balance[5]]
        elif stage.upright:
            balance = [*balance[:3], balance[5]]
        pressing = [(t.most - t.force @ t.normal) / self.scale for t in touching if np.isfinite(t.most)]
        return _PostureRows(
            np.concatenate([*(zero for zero, *_ in of_fingers), balance]),
            np.concatenate([*(positive for _, positive, _ in of_fingers), pressing]),
            np.array([touch.spare for touch in touching]) / self.scale,
        )

    def _evaluated(self, x: Array, histories: list[Array]) -> tuple[_PostureRows, list[FingerRows]]:
        held = self._record(x)
        each = [self.finger_rows(k, held, history) for k, history in enumerate(histories)]
        return self.rows(held, each), each

    def _slopes(self, x: Array, rows: _PostureRows, each: list[FingerRows], histories: list[Array]) -> Array:
        """Slopes of all rows by all unknowns."""
        columns = []
        for i, owner in enumerate(self.owners.tolist()):
            moved = x.copy()
            moved[i] += _STEP
            held = self._record(moved)
            fingers = range(len(each)) if owner == -2 else [owner] if owner >= 0 and self._bends[i] else []
            other = [
                self.finger_rows(k, held, h) if k in fingers else self._with_forces(k, held, each[k])
                for k, h in enumerate(histories)
            ]
            columns.append((self.rows(held, other).all - rows.all) / _STEP)
        return np.column_stack(columns)

    @staticmethod
    def _with_forces(index: int, held: HeldRods, of_finger: FingerRows) -> FingerRows:
        """Rows of a finger under forces that do not bend it."""
        zero, positive, touching = of_finger
        pairs = zip(touching, held.fingers[index].contacts, strict=True)
        return zero, positive, [replace(touch, force=contact.force) for touch, contact in pairs]

    # -- postures ----------------------------------------------------------------------------------------------

    def found(self, histories: list[Array], start: Array, enough: float = np.inf) -> JudgedPosture:
        """The posture with the greatest reserve next to a start, for directions of friction of each finger.

        One that violates nothing and has ``enough`` of a reserve is as good. Slopes follow each step by Broyden's
        formula, and are taken anew where a step gains less than they promise.
        """
        low, high = self.bounds
        x, trust, penalty = np.clip(start, low, high), _TRUST, _PENALTIES[0]
        rows, each = self._evaluated(x, histories)
        slopes, fresh, forces = self._slopes(x, rows, each, histories), True, np.zeros(rows.all.size)
        for _ in range(_STEPS):
            if rows.violated < FOLLOWED and rows.spare.min() > enough:
                break
            within = np.maximum(low - x, -trust), np.minimum(high - x, trust)
            step, promised, forces = _linear(rows, slopes, within, penalty)
            if promised < _EXACT or trust < _LEAST_TRUST:
                if fresh and (rows.violated < FOLLOWED or penalty > _PENALTIES[1]):
                    break
                penalty *= 10.0 if fresh else 1.0
                slopes, fresh = self._slopes(x, rows, each, histories), True
                trust = max(trust, 1e-3)
                continue
            step, after, other = self._tried(x, step, slopes, histories, penalty)
            share = (after.merit(penalty) - rows.merit(penalty)) / promised
            if np.isfinite(share) and step.any():
                off = after.all - rows.all - slopes @ step
                slopes = slopes + np.outer(off, step) / (step @ step)
            if share > 0.1:
                x, rows, each, fresh = x + step, after, other, False
                trust = min(2.0 * trust, 1.0) if share > 0.7 else trust
            elif fresh:
                trust = 0.25 * min(trust, float(np.abs(step).max()))
            if share < 0.3 and not fresh:
                slopes, fresh = self._slopes(x, rows, each, histories), True
        return JudgedPosture(x, float(rows.spare.min()), rows.violated, forces)

    def _tried(
        self, x: Array, step: Array, slopes: Array, histories: list[Array], penalty: float
    ) -> tuple[Array, _PostureRows, list[FingerRows]]:
        """A step with what it leads to; with a second one that takes off what bends along it, where that is better.

        R. Fletcher, "Second order corrections for non-differentiable optimization", 1982.
        """
        low, high = self.bounds
        after, other = self._evaluated(x + step, histories)
        if not np.isfinite(after.violated):
            return step, after, other
        bent = np.linalg.lstsq(slopes[: after.zero.size], -after.zero, rcond=1e-9)[0]
        corrected = np.clip(x + step + bent, low, high) - x
        nearer, beside = self._evaluated(x + corrected, histories)
        if nearer.merit(penalty) > after.merit(penalty):
            return corrected, nearer, beside
        return step, after, other

    def slopes(self, posture: JudgedPosture, histories: list[Array]) -> Iterator[Array]:
        """Slope of the reserve by the directions of each finger (cells, frictions)."""
        rows, each = self._evaluated(posture.x, histories)
        held = self._record(posture.x)
        for k, history in enumerate(histories):
            slope = np.zeros(history.shape)
            for at in np.ndindex(history.shape):
                other = history.copy()
                inward = -1e-3 if history[at] > 0.0 else 1e-3
                other[at] += inward
                moved = [self.finger_rows(k, held, other) if j == k else own for j, own in enumerate(each)]
                slope[at] = posture.slopes @ (self.rows(held, moved).all - rows.all) / inward
            yield slope


def _cells(finger: HeldFinger, length: float, history: Array) -> FrictionCells:
    """Cells of a history (cells, frictions): as many in each part between base, contacts and tip.

    At a contact the moment jumps with its friction, so that directions on both sides matter apart.
    """
    inner = [contact.place for contact in finger.contacts if contact.place < length]
    marks = np.array([0.0, *sorted(inner), length])
    each = len(history) // (len(marks) - 1)
    shares = np.arange(1, each + 1) / each
    ends = (marks[:-1, None] + shares * np.diff(marks)[:, None]).ravel()
    return FrictionCells(ends, history)


def _in_space(force: Array) -> Array:
    return np.append(force, np.zeros(3 - len(force)))


def _along(normal: Array, dimensions: int) -> list[Array]:
    """Directions along a surface: one in the plane, two in space."""
    if dimensions == 2:
        return [np.array([-normal[1], normal[0], 0.0])]
    first = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    first = first / np.linalg.norm(first)
    return [first, np.cross(normal, first)]


def _linear(
    rows: _PostureRows, slopes: Array, within: tuple[Array, Array], penalty: float
) -> tuple[Array, float, Array]:
    """Step with the greatest merit to first order, what it gains, and slopes of the merit by all rows."""
    low, high = within
    a, b, c = rows.zero.size, rows.positive.size, rows.spare.size
    n = low.size
    # Unknowns: step, reserve, what is violated of zero rows to both sides and of positive ones.
    cost = np.concatenate([np.zeros(n), [-1.0], np.full(2 * a + b, penalty)])
    zero = np.hstack([slopes[:a], np.zeros((a, 1)), np.eye(a), -np.eye(a), np.zeros((a, b))])
    positive = np.hstack([-slopes[a : a + b], np.zeros((b, 1 + 2 * a)), -np.eye(b)])
    spare = np.hstack([-slopes[a + b :], np.ones((c, 1)), np.zeros((c, 2 * a + b))])
    bounds = [*zip(low, high, strict=True), (None, None), *[(0.0, None)] * (2 * a + b)]
    found = linprog(
        cost,
        A_ub=np.vstack([positive, spare]),
        b_ub=np.concatenate([rows.positive, rows.spare]),
        A_eq=zero,
        b_eq=-rows.zero,
        bounds=bounds,
        method="highs",
    )
    if found.x is None:
        return np.zeros(n), 0.0, np.zeros(a + b + c)
    # The merit is the negative cost; rows are on the right-hand side, zero ones with the other sign.
    forces = np.concatenate([found.eqlin.marginals, -found.ineqlin.marginals])
    return found.x[:n], float(-found.fun) - rows.merit(penalty), forces


def _moment(finger: HeldFinger) -> Array:
    """Moment (3,) at the base of a finger [N m]."""
    if finger.moment is None:
        raise ValueError(f"{finger.name}: a posture has a moment at its base")
    return finger.moment
