"""Fingers and supports of a grasp in other postures: unknowns of each, and what these leave.

A part takes n postures at once: rows that must be zero, rows that must be zero or more, what friction bears, and the
wrench on the object.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from continuum_grasp.base import Numbers as Array
from continuum_grasp.grasp.judge.bent_rods import BentLoads, BentRods, BentShapes
from continuum_grasp.grasp.judge.drives import WoundCables
from continuum_grasp.grasp.judge.findings import FOLLOWED
from continuum_grasp.grasp.judge.held import HeldFinger, HeldRods, HeldSupport
from continuum_grasp.grasp.judge.space_rod import SpaceRod
from continuum_grasp.grasp.judge.stage import GraspStage, support_of

DEEP = 3e-6
"""Depth to which a finger may be in the object [L]. Friction that bends it sharper beside a contact than the object is
presses it in by that much: of `mug_motor`, 1e-5 L more spare 0.01 of the greatest force."""
CELLS = 24
"""Cells of a finger in which friction has one direction each, the same number between base, contacts and tip."""
_ALONG = 1e-3
"""Slope at which a tip may point into the object."""
_AROUND = np.radians([-180, *(way * angle for angle in (0.1, 0.3, 1, 3, 10, 30, 90) for way in (1, -1))])
"""Directions of planes that touch a cone of friction, from that of the force [rad]: between them steps that turn the
force cost no reserve to first order."""


@dataclass(frozen=True, eq=False)
class PostureRows:
    """Rows of n postures: zero, zero or more, and what friction bears.

    Friction has three numbers per contact: the coefficient times the normal force, and two components along the
    surface. The wrench (n, 6) acts on the object.
    """

    zero: Array
    positive: Array
    friction: Array
    wrench: Array

    @property
    def all(self) -> Array:
        """Rows that are zero, zero or more, and of friction, one after the other."""
        return np.concatenate([self.zero, self.positive, self.friction], axis=1)

    @property
    def reserves(self) -> Array:
        """Least spare friction of each posture (n,)."""
        most, first, second = np.moveaxis(self.friction.reshape(len(self.zero), -1, 3), 2, 0)
        return np.asarray((most - np.hypot(first, second)).min(axis=1, initial=np.inf))

    @property
    def violated(self) -> Array:
        """Sum of all violations of each posture (n,)."""
        return np.asarray(np.abs(self.zero).sum(axis=1) - np.minimum(self.positive, 0.0).sum(axis=1))

    def merits(self, penalty: float) -> Array:
        """Reserve of each posture less the cost of violations (n,)."""
        merits = self.reserves - penalty * self.violated
        return np.where(np.isfinite(merits), merits, -np.inf)

    @property
    def _parts(self) -> tuple[Array, ...]:
        return self.zero, self.positive, self.friction, self.wrench

    @property
    def first(self) -> PostureRows:
        """Rows of the first posture."""
        return PostureRows(*(part[:1] for part in self._parts))

    def changes(self, step: float) -> PostureRows:
        """Changes from the first posture to each of the others, per step."""
        return PostureRows(*((part[1:] - part[0]) / step for part in self._parts))

    def spread(self, sums: Array) -> PostureRows:
        """Rows of m sums (m, n) of the postures."""
        return PostureRows(*(sums @ part for part in self._parts))

    def where(self, taken: Array, other: PostureRows) -> PostureRows:
        """These rows where taken (n,), else other ones."""
        pairs = zip(self._parts, other._parts, strict=True)
        return PostureRows(*(np.where(taken[:, None], one, instead) for one, instead in pairs))

    def cut(self, cuts: Array) -> Array:
        """Rows that are zero, zero or more, and cuts of friction cones (cuts, numbers of friction)."""
        return np.concatenate([self.zero, self.positive, self.friction @ cuts.T], axis=1)

    @property
    def cuts(self) -> Array:
        """Planes that touch each cone of friction (cuts, numbers of friction) about the forces of the first posture."""
        contacts = self.friction[0].reshape(-1, 3)
        angles = [np.arctan2(second, first) + np.array([0.0, *_AROUND]) for _, first, second in contacts]
        found = np.zeros((sum(map(len, angles)), self.friction.shape[1]))
        for k, around in enumerate(angles):
            own = slice(k * len(around), (k + 1) * len(around))
            found[own, 3 * k : 3 * k + 3] = np.column_stack([np.ones_like(around), -np.cos(around), -np.sin(around)])
        return found


@dataclass(frozen=True, eq=False)
class _Touching:
    """Contacts of n postures: forces, points and normals (n, contacts, 3) of the object, and moments (n, contacts)."""

    forces: Array
    points: Array
    normals: Array
    twists: Array
    friction: float
    most: float
    across: Array  # (3,) from which directions along the surface are taken

    def rows(self, center: Array, scale: float, size: float) -> tuple[Array, Array, Array]:
        """Numbers of friction, limits of the normal force, and the wrench about the center of the object."""
        pressing = (self.forces * self.normals).sum(axis=2)
        along = np.cross(self.across, self.normals)
        along = along / np.linalg.norm(along, axis=2, keepdims=True)
        other = np.cross(self.normals, along)
        used = [(self.forces * way).sum(axis=2) for way in (along, other)]
        friction = np.stack([self.friction * pressing, *used], axis=2).reshape(len(pressing), -1)
        within = [pressing, self.most - pressing] if np.isfinite(self.most) else [pressing]
        moments = np.cross(self.points - center[:, None], self.forces) + self.twists[:, :, None] * self.normals
        wrench = np.concatenate([self.forces.sum(axis=1) / scale, moments.sum(axis=1) / (scale * size)], axis=1)
        return friction / scale, np.concatenate(within, axis=1) / scale, -wrench


class PosturePart(ABC):
    """A finger or a support, with unknowns of its own."""

    start: Array
    """Its unknowns in the grasp."""
    low: Array
    high: Array
    history: tuple[int, int]
    """Number of cells along it in which friction has one direction, and of its frictions."""

    @abstractmethod
    def rows(self, x: Array, poses: ObjectPoses, history: Array) -> PostureRows:
        """Rows of n unknowns (n, own), poses of the object, and histories (n, cells, frictions)."""


class ObjectPoses:
    """Poses of the object in n postures: shifts (n, 3) [m] and turns (n, 3) [rad] about where the grasp has it."""

    def __init__(self, stage: GraspStage, held: HeldRods, moves: Array) -> None:
        self.shifts, self._held = moves[:, :3], held
        self.turns = Rotation.from_rotvec(moves[:, 3:]).as_matrix()
        self._body, center = stage.body(held), stage.center(held)
        self.centers = held.position + self.shifts + np.einsum("nij,j->ni", self.turns, center - held.position)

    def inside(self, points: Array) -> Array:
        """Places (n, 3) where the object of the grasp has them."""
        moved = np.einsum("nji,nj->ni", self.turns, points - self._held.position - self.shifts)
        return np.asarray(moved + self._held.position)

    def near(self, points: Array) -> tuple[Array, Array]:
        """Distances (n,) and normals (n, 3) at places (n, 3) of n postures."""
        distances, normals = self._body.near(self.inside(points))
        return distances, np.einsum("nij,nj->ni", self.turns, normals)

    def distances(self, points: Array) -> Array:
        """Distances (k, n) of places (k, n, 3) of n postures."""
        count = len(points)
        moved = np.einsum("nji,knj->kni", self.turns, points - self._held.position - self.shifts) + self._held.position
        return np.asarray(self._body.distance(moved.reshape(-1, 3)).reshape(count, -1))


class FingerPart(PosturePart):
    """A finger.

    Parameters
    ----------
    stage : GraspStage
    held : HeldRods
        The grasp.
    finger : HeldFinger
    rod : SpaceRod
        Its shape in the grasp as it is reached.
    scale : float
        Force that others are compared with [N].
    """

    def __init__(self, stage: GraspStage, held: HeldRods, finger: HeldFinger, rod: SpaceRod, scale: float) -> None:
        self._stage, self._finger, self._scale = stage, finger, scale
        self._moment = rod.at(np.zeros(1)).moment[0]
        self._setup = setup = stage.setups[finger.name]
        self._length, section = setup.finger.rod.length, stage.section(setup)
        self._soft = [0, 1, 2] if np.isfinite(section.torsion) else [2]
        self._parts = 1 + sum(contact.place < self._length for contact in finger.contacts)
        frictions = (setup.tendons.friction > 0.0) + len(setup.finger.damping.dry_friction)
        self.history = self._parts * (CELLS // self._parts), frictions
        base = finger.position, finger.axes
        self._rods = BentRods(setup, base, stage.finger_gravity, section, CELLS // self._parts)
        self._middle = [contact.name in setup.middle_names for contact in finger.contacts]
        self._follows = setup.drive is not None and (setup.drive.locks or setup.drive.pulley)
        self._command = self._cables(rod.cables(), finger.tensions).held if self._follows else np.zeros(0)
        self._landed = self._landing(rod, stage, held)
        self._unknowns()

    def _landing(self, rod: SpaceRod, stage: GraspStage, held: HeldRods) -> Array | None:
        """Place on the object where a tip that alone touches it has landed; None: it may move there."""
        contacts = self._finger.contacts
        if held.supports or len(contacts) != 1 or any(self._middle):
            return None
        center = rod.at(np.array([contacts[0].place])).points
        normal = stage.body(held).near(center)[1][0]
        return np.asarray(center[0] - rod.half(np.array([contacts[0].place]))[0] * normal)

    def _cables(self, cables: tuple[float, Array], tensions: Array) -> WoundCables:
        law = self._setup.drive
        if law is None:
            raise ValueError("no drive winds up cables")
        return WoundCables(self._setup, law, cables, tensions)

    def _unknowns(self) -> None:
        """Set unknowns of the grasp, their units and bounds."""
        finger, setup, dimensions = self._finger, self._setup, dimensions_of(self._stage)
        unit = self._scale * self._length
        parts = [((finger.axes.T @ self._moment)[self._soft], unit, -np.inf, np.inf)]
        if self._follows:
            parts.append((finger.tensions, unit / setup.tendons.offset, -np.inf, setup.max_tension))
        bounds = dict(zip(setup.middle_names, setup.contact_bounds, strict=True))
        for contact in finger.contacts:
            parts.append((contact.force[:dimensions], self._scale, -np.inf, np.inf))
        for contact in finger.contacts:
            if contact.name in bounds:
                parts.append((np.array([contact.place]), self._length, *bounds[contact.name]))
        self.start, self._units, self.low, self.high = (
            np.concatenate([np.broadcast_to(part[k], part[0].shape) for part in parts]) for k in range(4)
        )
        self.start, self.low, self.high = (each / self._units for each in (self.start, self.low, self.high))

    def _loads(self, x: Array, history: Array) -> BentLoads:
        """Loads of n unknowns."""
        n, finger, dimensions = len(x), self._finger, dimensions_of(self._stage)
        values = iter((x * self._units).T)
        loads = BentLoads.of(finger, self._moment, history[0]).repeated(n)
        moment = np.array([next(values) for _ in self._soft])
        tensions = np.array([next(values) for _ in finger.tensions]).T if self._follows else loads.tensions
        forces, places = loads.forces.copy(), loads.places.copy()
        for k in range(len(finger.contacts)):
            forces[:, k, :dimensions] = np.array([next(values) for _ in range(dimensions)]).T
        for k, middle in enumerate(self._middle):
            places[:, k] = next(values) if middle else places[:, k]
        return replace(
            loads,
            moment=moment.T @ finger.axes[:, self._soft].T,
            tensions=tensions,
            forces=forces,
            places=places,
            directions=history,
        )

    def rows(self, x: Array, poses: ObjectPoses, history: Array) -> PostureRows:
        setup, finger, length = self._setup, self._finger, self._length
        loads = self._loads(x, history)
        shapes = self._rods.shapes(loads, poses.near)
        half = np.asarray(setup.finger.profile.half_thickness(loads.places))
        slopes = np.array([setup.finger.profile.half_thickness.slope(contact.place) for contact in finger.contacts])
        leaning = (shapes.normals * shapes.along).sum(axis=2) - slopes
        middle = np.array(self._middle, dtype=bool)
        zero = [shapes.missing[:, self._soft] / (self._scale * length), (shapes.distances - half) / length]
        zero.append(leaning[:, middle])
        points = shapes.centers - half[:, :, None] * shapes.normals
        zero += [*self._drives(shapes, loads.tensions), *self._stays(points, shapes.normals, poses)]
        limits = setup.held_friction, setup.normal_force_max
        touching = _Touching(loads.forces, points, shapes.normals, loads.twists, *limits, finger.axes[:, 2])
        friction, within, wrench = touching.rows(poses.centers, self._scale, self._stage.size)
        positive = [_ALONG - leaning[:, ~middle], *self._clear(shapes, poses), within]
        return PostureRows(np.concatenate(zero, axis=1), np.concatenate(positive, axis=1), friction, wrench)

    def _clear(self, shapes: BentShapes, poses: ObjectPoses) -> Iterator[Array]:
        """Rows of a finger that is clear of the object and of obstacles."""
        half = np.asarray(self._setup.finger.profile.half_thickness(shapes.s))
        yield (poses.distances(shapes.points) - half + self._stage.deviation).T / self._length + DEEP
        for obstacle in self._stage.obstacles:
            start, before = self._stage.clear_from(obstacle, self._finger)
            away = obstacle.distance(shapes.points.reshape(-1, 3)).reshape(half.shape)
            yield (away - np.where(shapes.s < start, before, half)).T / self._length + FOLLOWED

    def _drives(self, shapes: BentShapes, tensions: Array) -> Iterator[Array]:
        """Rows of what drives hold."""
        law = self._setup.drive
        if not self._follows or law is None:
            return
        # As tensions, of which a moment is the unit: cables are stiff.
        unit = (law.series + law.axial) * self._scale * self._length / self._setup.tendons.offset
        states = zip(shapes.drawn, shapes.shares, tensions, strict=True)
        yield np.array([self._cables((drawn, means), own).misfit(self._command) for drawn, means, own in states]) / unit

    def _stays(self, points: Array, normals: Array, poses: ObjectPoses) -> Iterator[Array]:
        """Rows of a tip that alone touches an object that yields: it stays where it landed."""
        if self._landed is None:
            return
        off = poses.inside(points[:, 0]) - self._landed
        own = np.einsum("nji,nj->ni", poses.turns, normals[:, 0])
        across = self._finger.axes[:, 2]
        ways = [np.cross(own, across)] + [np.broadcast_to(across, own.shape)] * (len(self._stage.axes) == 3)
        yield np.array([(way * off).sum(axis=1) for way in ways]).T / self._length


class SupportPart(PosturePart):
    """A contact of the object with a support."""

    history = 0, 0

    def __init__(self, stage: GraspStage, held: HeldRods, contact: HeldSupport, scale: float) -> None:
        self._stage, self._contact, self._scale = stage, contact, scale
        obstacle = next(each for each in stage.obstacles if each.name == support_of(stage, contact.name))
        self._friction, self._normal = obstacle.friction, obstacle.touched(contact, stage.body(held))[0]
        # Any fixed direction will do that is not along the normal; in a plane, the one out of it.
        self._across = np.eye(3)[2 if len(stage.axes) == 2 else np.abs(self._normal).argmin()]
        self.start = contact.force[: dimensions_of(stage)] / scale
        self.low, self.high = np.full(self.start.shape, -np.inf), np.full(self.start.shape, np.inf)

    def rows(self, x: Array, poses: ObjectPoses, history: Array) -> PostureRows:
        n, none = len(x), np.zeros((len(x), 0))
        forces = np.zeros((n, 1, 3))
        forces[:, 0, : x.shape[1]] = self._scale * x
        points, normals = (np.broadcast_to(each, (n, 1, 3)) for each in (self._contact.position, self._normal))
        most = self._stage.scene.contacts.normal_force_max
        touching = _Touching(forces, points, normals, np.zeros((n, 1)), self._friction, most, self._across)
        friction, within, wrench = touching.rows(poses.centers, self._scale, self._stage.size)
        return PostureRows(none, within, friction, wrench)


def dimensions_of(stage: GraspStage) -> int:
    """Components of the force of a contact: in a plane two, unless a weight acts across it."""
    return 3 if len(stage.axes) == 3 or np.any(stage.mass * stage.gravity[2]) else 2
