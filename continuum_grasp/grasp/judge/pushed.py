"""The push that a grasp bears in every direction, with Coulomb's limit at each contact; measured by differences.

Tensions stay. Each finger is integrated anew under small changes of the moment in its base, of the forces and places of
its contacts, and of the object's pose. To first order, what holds a pushed grasp is linear in these: no moment is left
at tips, gaps stay closed, fingers stay along the surface, material that touches stays together (contacts roll), and the
object is in balance. A push is borne if each contact then is within its cone of friction, with all of its friction, and
its greatest normal force.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from continuum_grasp.base import Numbers as Array
from continuum_grasp.grasp.judge.borne_push import bears
from continuum_grasp.grasp.judge.held import HeldContact, HeldFinger
from continuum_grasp.grasp.judge.obstacles import ExactObject
from continuum_grasp.grasp.judge.skin import skin_load
from continuum_grasp.grasp.judge.space_rod import TOLERANCE, SpaceRod
from continuum_grasp.grasp.judge.stage import GraspStage

CLAMPS = np.linspace(0.8, 0.0, 5)
"""Places along a finger, per length, from which on parts of it are tested [1]: one of them sees what buckles in up to
two waves."""
ROUGH = 1e-8
"""Relative tolerance of these tests [1]: their signs are asked for alone."""
STEP = 1e-5
"""Step of differences, per unit of each unknown: the root of the tolerance of integration."""
IDLE = 1e-6
"""Normal force, per greatest force of the grasp, up to which a contact bears nothing and parts."""
GIVE = 1e-8
"""Give of contacts, per L^3 / (E I) of the stiffest finger: it shares out forces that rigid contacts leave open."""
NOTHING = 1e-6
"""Stiffness of the object, per E I / L of the softest finger, that is none: rounding is a hundredth of it."""
FLAT = 1e-3
"""Least curvature of an object and a support that roll on each other, per size of the object."""
BESIDE = 1e-4
"""Distance from a contact at which the normals give the curvature of the object, per its size."""


@dataclass(frozen=True, eq=False)
class PressedContact:
    """A contact with the limits of its surfaces."""

    name: str
    force: Array  # (3,) on what touches the object [N]
    moment: float  # about the normal [N m]
    point: Array  # (3,) [m]
    normal: Array  # (3,)
    across: Array  # (3,) from which the directions along the surface are taken
    friction: float  # coefficient, all of it [1]
    torsional: float  # greatest moment per normal force [m]
    most: float  # greatest normal force [N]

    def frame(self, normal: Array) -> Array:
        """Rows (3, 3): a normal, the direction along the surface that is across, and the third one."""
        along = np.cross(self.across, normal)
        # 1e-300: no division by zero where both are the same
        along = along / max(float(np.linalg.norm(along)), 1e-300)
        return np.array([normal, along, np.cross(normal, along)])

    def load(self, normal: Array, force: Array, moment: float) -> Array:
        """Numbers (4,) that the cone of friction bounds [N]: force in the frame of a normal, and moment per arm."""
        arm = self.torsional / self.friction if self.torsional else np.inf
        return np.array([*self.frame(normal) @ force, moment / arm])

    def borne(self, slope: Array) -> float:
        """Push in every direction that the contact bears [N], by the change (4, K) of its load per push."""
        load = self.load(self.normal, self.force, self.moment)
        return bears(load, slope, np.eye(4)[0], self.friction, self.most)


@dataclass(frozen=True, eq=False)
class Answers:
    """Answers of a part of the grasp to small changes: rows that must be zero, the wrench (6,) with which it acts
    on the object about the center of mass, the loads (C, 4) of its contacts, and the turn of a finger's tip [rad].
    """

    left: Array
    wrench: Array
    loads: Array
    turn: Array

    @property
    def numbers(self) -> Array:
        """All numbers, one after the other."""
        return np.concatenate([self.left, self.wrench, self.loads.ravel(), self.turn])


class PushedPart:
    """A finger or a support whose contacts press, under small changes of its own unknowns and the object's pose."""

    contacts: Sequence[PressedContact]
    units: Array
    """Sizes of its own unknowns."""
    count: int
    """Number of rows that must be zero."""
    step = STEP
    """Step of differences, per unit of each unknown."""

    def answers(self, change: Array, pose: Array) -> Answers:
        """Answer to changes of its unknowns and of the object's pose (6,)."""
        raise NotImplementedError

    def slopes(self, units: Array) -> Array:
        """Derivatives (numbers, unknowns + 6) of the answers, by the unknowns and the pose, whose sizes are given."""
        return self._differences(np.concatenate([self.units, units]))

    @property
    def own_slopes(self) -> Array:
        """Derivatives (numbers, unknowns) of the answers by the unknowns."""
        return self._differences(self.units)

    def _differences(self, sizes: Array) -> Array:
        """Derivatives (numbers, m) by the first unknowns and numbers of the pose (m,), whose sizes are given."""
        own, columns = len(self.units), []
        for k, size in enumerate(sizes):
            change = np.zeros(own + 6)
            change[k] = self.step * size
            # Central: a straight finger yields along its axis by the square of a change alone.
            ends = [self.answers(side * change[:own], side * change[own:]).numbers for side in (1.0, -1.0)]
            columns.append((ends[0] - ends[1]) / (2.0 * self.step * size))
        return np.array(columns).T

    @property
    def buckles(self) -> bool:
        """Whether it moves away while the object stays."""
        return False


class PushedSupport(PushedPart):
    """A support on which the object rolls; its answers are linear in each number."""

    step = 1.0

    def __init__(self, contact: PressedContact, center: Array, rolls: Array, axes: Sequence[int], give: float) -> None:
        self.contacts, self._center, self._rolls, self._give = (contact,), center, rolls, give
        self._axes = list(axes)
        self.count = len(self._axes)
        self.units = np.full(self.count, max(float(np.linalg.norm(contact.force)), 1e-3))

    def answers(self, change: Array, pose: Array) -> Answers:
        """Shift of the object at the contact, and what acts on it."""
        (contact,), shift, turn = self.contacts, pose[:3], pose[3:]
        frame = contact.frame(contact.normal)
        local = np.zeros(3)
        local[self._axes] = change
        moved = frame @ (shift + np.cross(turn, contact.point - self._center)) - self._give * local
        force = contact.force + frame.T @ local
        point = contact.point + self._rolls @ np.cross(contact.normal, turn)
        moment = np.cross(point - self._center - shift, force)
        load = contact.load(contact.normal, force, 0.0)
        return Answers(moved[self._axes], -np.concatenate([force, moment]), load[None], np.zeros(0))


class PushedFinger(PushedPart):
    """A finger that is integrated anew.

    Parameters
    ----------
    stage : GraspStage
    body : ExactObject
    held : HeldFinger
    rod : SpaceRod
        Its shape in the grasp.
    contacts : sequence of PressedContact
        Those that press, in the order of ``held``.
    center : ndarray, shape (3,)
        Of mass of the object [m].
    axes : sequence of int
        Directions of a contact's frame along which its force changes.
    give : float
        Of contacts [m/N].
    clamp : float
        Position up to which it stays as it is [m].
    tolerance : float
        Relative tolerance of integrations [1].
    """

    def __init__(
        self,
        stage: GraspStage,
        body: ExactObject,
        held: HeldFinger,
        rod: SpaceRod,
        contacts: Sequence[PressedContact],
        center: Array,
        axes: Sequence[int],
        give: float,
        clamp: float = 0.0,
        tolerance: float = TOLERANCE,
    ) -> None:
        self._stage, self._body, self._held, self._rod = stage, body, held, rod
        self.contacts, self._center, self._axes, self._give = contacts, center, list(axes), give
        self._middle = [contact.name in rod.setup.middle_names for contact in contacts]
        self._soft = [0, 1, 2] if np.isfinite(stage.section(rod.setup).torsion) else [2]
        self._tolerance = tolerance
        self._clamp, ends = rod.clamped(clamp), rod.at(np.array([clamp, rod.length]))
        self._start, self._end = ends.moment[0], ends.axes[1]
        self._placed = {contact.name: contact.place for contact in held.contacts}
        self._before = {name: rod.at(np.array([place])) for name, place in self._placed.items()}
        unit, kinds = rod.setup.stiffness / rod.length, list[str]()
        for contact, middle in zip(contacts, self._middle, strict=True):
            kinds += ["force"] * len(axes) + ["place"] * middle + ["moment"] * bool(contact.torsional)
        sizes = {"force": unit / rod.length, "place": rod.length, "moment": unit}
        self._kinds = kinds
        self.units = np.array([*[unit] * len(self._soft), *(sizes[kind] for kind in kinds)])
        self.count = len(self.units)

    def answers(self, change: Array, pose: Array) -> Answers:
        """Shape under changed loads, and what its contacts leave."""
        turn = Rotation.from_rotvec(pose[3:]).as_matrix()

        def near(point: Array) -> tuple[float, Array]:
            distance, normal = self._body.near(((point - self._center - pose[:3]) @ turn + self._center)[None])
            return float(distance[0]), turn @ normal[0]

        base = np.zeros(3)
        base[self._soft] = change[: len(self._soft)]
        moved = self._moved(change[len(self._soft) :])
        others = [contact for contact in self._held.contacts if contact.name not in {each.name for each in moved}]
        loads = [skin_load(self._rod.setup, each, lambda r: near(r)[1]) for each in [*moved, *others]]
        rod = SpaceRod(
            self._rod.setup,
            (self._held.position, self._held.axes),
            self._held.tensions,
            loads,
            self._stage.finger_gravity,
            self._stage.section(self._rod.setup),
            tolerance=self._tolerance,
            clamp=self._clamp,
        )
        rod.integrate(self._start + self._held.axes @ base)
        left, wrench, seen = [(self._held.axes.T @ rod.missing)[self._soft]], np.zeros(6), []
        for contact, own, middle in zip(self.contacts, moved, self._middle, strict=True):
            there = rod.at(np.array([own.place]))
            half = self._rod.setup.finger.profile.half_thickness
            distance, normal = near(there.points[0])
            load = contact.load(normal, own.force, own.moment)
            shifted = load - contact.load(contact.normal, contact.force, contact.moment)
            past = self._past(rod, contact, pose) + self._give * shifted
            direction = float(normal @ there.axes[0, :, 1]) - half.slope(own.place)
            gap = distance - float(half(own.place)) + self._give * shifted[0]
            turned = [past[3]] * bool(contact.torsional)
            left.append([gap, *past[[k for k in self._axes if k > 0]], *[direction] * middle, *turned])
            point = there.points[0] - float(half(own.place)) * normal - self._center - pose[:3]
            wrench -= np.concatenate([own.force, np.cross(point, own.force) + own.moment * normal])
            seen.append(load)
        turned = rod.at(np.array([rod.length])).axes[0] @ self._end.T
        tip = self._held.axes.T @ Rotation.from_matrix(turned).as_rotvec()
        return Answers(np.concatenate(left), wrench, np.array(seen), tip[self._soft])

    @property
    def buckles(self) -> bool:
        """Whether a motion lowers its energy while the object stays.

        A part that is clamped nearer and nearer to the base yields more and more to a couple at its tip, until, from a
        conjugate point on, it yields against the couple.
        """
        return any(self._yields_back(share * self._rod.length) for share in CLAMPS)

    def _yields_back(self, clamp: float) -> bool:
        """Whether the part beyond a clamp [m] turns against a couple at its tip."""
        beyond = [contact for contact in self.contacts if self._placed[contact.name] > clamp]
        held = self._stage, self._body, self._held, self._rod
        part = PushedFinger(*held, beyond, self._center, self._axes, self._give, clamp, ROUGH)
        count, soft = part.count, len(self._soft)
        slopes = part.own_slopes * part.units
        turns = slopes[-soft:] @ np.linalg.solve(slopes[:count], np.eye(count)[:, :soft])
        return bool(np.linalg.eigvalsh(turns + turns.T)[0] < 0.0)

    def _moved(self, change: Array) -> list[HeldContact]:
        """Contacts that press, with changed forces, places and moments."""
        numbers, found = iter(change.tolist()), []
        for contact, middle in zip(self.contacts, self._middle, strict=True):
            local = np.zeros(3)
            local[self._axes] = [next(numbers) for _ in self._axes]
            force = contact.force + contact.frame(contact.normal).T @ local
            place = self._placed[contact.name] + (next(numbers) if middle else 0.0)
            moment = contact.moment + (next(numbers) if contact.torsional else 0.0)
            found.append(HeldContact(contact.name, force, place, moment))
        return found

    def _past(self, rod: SpaceRod, contact: PressedContact, pose: Array) -> Array:
        """Shift along the contact's frame [m], and turn about the normal [rad], of the materials that touched."""
        now, before = rod.at(np.array([self._placed[contact.name]])), self._before[contact.name]
        turned = now.axes[0] @ before.axes[0].T
        arm = contact.point - before.points[0]
        shift = now.points[0] - before.points[0] + turned @ arm - arm
        shift -= pose[:3] + np.cross(pose[3:], contact.point - self._center)
        spin = Rotation.from_matrix(turned).as_rotvec() - pose[3:]
        return np.array([*contact.frame(contact.normal) @ shift, float(contact.normal @ spin)])


class PushedGrasp:
    """A grasp with an object that is pushed.

    Parameters
    ----------
    parts : sequence of PushedPart
        Fingers and supports.
    units : ndarray, shape (6,)
        Sizes of the shift and the turn of the object.
    moves : sequence of int
        Components of the object's pose, and of the balance, that can change; the first ones are directions of a push.
    directions : int
        Number of these.
    bending : float
        E I / L of the softest finger [N m].
    """

    def __init__(
        self, parts: Sequence[PushedPart], units: Array, moves: Sequence[int], directions: int, bending: float
    ) -> None:
        self._parts, self._units, self._moves, self._directions = parts, units, list(moves), directions
        self._bending = bending

    @cached_property
    def _slopes(self) -> list[Array]:
        return [part.slopes(self._units) for part in self._parts]

    @cached_property
    def _resisted(self) -> tuple[Array, list[Array]]:
        """Wrench on the object by its pose (m, m), and loads of each part by the pose (4 C, m)."""
        m, loads = len(self._moves), []
        wrench: Array = np.zeros((m, m))
        for part, slopes in zip(self._parts, self._slopes, strict=True):
            own, n = len(part.units), part.count
            poses = slopes[:, [own + k for k in self._moves]]
            scale = part.units
            answer = -np.linalg.solve(slopes[:n, :own] * scale, poses[:n])
            total = poses + (slopes[:, :own] * scale) @ answer
            wrench = wrench + total[[n + k for k in self._moves]]
            loads.append(total[n + 6 : n + 6 + 4 * len(part.contacts)])
        return wrench, loads

    @property
    def stiffness(self) -> Array:
        """Wrench that a small motion of the object needs (m, m), symmetric [N/m, N, N m]."""
        wrench, _ = self._resisted
        return np.asarray(-0.5 * (wrench + wrench.T))

    @cached_property
    def stable(self) -> bool:
        """Whether every motion needs work: of the object, which fingers follow at rest, and of fingers alone."""
        scale = self._units[self._moves]
        least = float(np.linalg.eigvalsh(self.stiffness * np.outer(scale, scale))[0])
        return least > NOTHING * self._bending and not any(part.buckles for part in self._parts)

    @property
    def pushes(self) -> dict[str, float]:
        """Push that each contact bears in every direction [N]; zeros where the object moves away."""
        names = [contact.name for part in self._parts for contact in part.contacts]
        if not names or not self.stable:
            return dict.fromkeys(names, 0.0)
        wrench, loads = self._resisted
        motion = -np.linalg.solve(wrench, np.eye(len(self._moves))[:, : self._directions])
        found = dict[str, float]()
        for part, slopes in zip(self._parts, loads, strict=True):
            each = (slopes @ motion).reshape(len(part.contacts), 4, -1)
            found |= {c.name: c.borne(slope) for c, slope in zip(part.contacts, each, strict=True)}
        return found


def rolls(body: ExactObject, contact: PressedContact, size: float, curvature: float, *, planar: bool) -> Array:
    """Way of a contact per turn of the object (3, 3) [m], on a support with a curvature [1/m]."""
    away, ways = BESIDE * size, contact.frame(contact.normal)[1 : 2 if planar else 3]
    # Beside the surface, the normal changes by the step over the radius and the distance.
    at = contact.point + away * contact.normal
    turned = np.array([ways @ (body.near((at + away * s * way)[None])[1][0]) for way in ways for s in (1.0, -1.0)])
    slope = (turned[::2] - turned[1::2]) / (2.0 * away)
    values, vectors = np.linalg.eigh(0.5 * (slope + slope.T))
    curved = values / np.maximum(1.0 - away * values, FLAT)
    radii = 1.0 / np.maximum(curved + curvature, FLAT / size)
    along = vectors.T @ ways
    return np.asarray(along.T @ np.diag(radii) @ along)
