"""The scene as the certificate sees it: one interface for the plane and for space."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator

import numpy as np

from continuum_grasp.base import Numbers as Array
from continuum_grasp.grasp.judge.check import EXACT, Check, Requirement, greatest
from continuum_grasp.grasp.judge.held import HeldFinger, HeldRods, in_plane
from continuum_grasp.grasp.judge.obstacles import ExactObject, Obstacle
from continuum_grasp.grasp.judge.space_rod import SideStiffness
from continuum_grasp.scene import FingerSetup, GraspScene, HandScene

TRACE = 1e-2
"""Share of E I / L^2 that the forces in play count as at least: solvers leave 1e-9 of it."""


class GraspStage(ABC):
    """A scene as the certificate sees it."""

    gravity: Array
    """Gravity (3,) [m/s2]."""
    mass: float
    """Mass of the object [kg]."""
    upright: bool = False
    """Whether something other than the contacts bears moments about x and y."""

    def __init__(self, scene: GraspScene | HandScene) -> None:
        self.scene = scene
        self.setups = {setup.name: setup for setup in scene.setups}
        self.obstacles = Obstacle.each(scene)

    @staticmethod
    def of(scene: GraspScene | HandScene) -> GraspStage:
        """The stage of a scene."""
        return _PlaneStage(scene) if isinstance(scene, GraspScene) else _HandStage(scene)

    @property
    def size(self) -> float:
        """Size of the object [m]."""
        return self.scene.object.size

    @property
    def deviation(self) -> float:
        """Greatest distance of the object's surface from the curve or mesh that it stands for [m]."""
        return self.scene.object.deviation

    @property
    def finger_gravity(self) -> Array:
        """Gravity (3,) that bends fingers [m/s2]."""
        return self.gravity

    @property
    def torsional(self) -> float:
        """Greatest moment of a contact about its normal, per normal force [m]."""
        return 0.0

    @property
    def moves(self) -> list[int]:
        """Components of the object's small motions, of three shifts and three turns."""
        return [0, 1, 2, 3, 4, 5]

    @property
    def axes(self) -> list[int]:
        """Directions, of a contact's normal, along the surface, and to the side, in which forces answer a push."""
        return [0, 1, 2]

    @abstractmethod
    def section(self, setup: FingerSetup) -> SideStiffness:
        """Section of a finger."""

    @abstractmethod
    def center(self, held: HeldRods) -> Array:
        """Center of mass (3,) of the object [m]."""

    @abstractmethod
    def poses(self, held: HeldRods) -> Iterator[Check]:
        """Checks of the poses of object and bases."""

    @abstractmethod
    def clear_from(self, obstacle: Obstacle, finger: HeldFinger) -> tuple[float, float]:
        """Position from which a finger is clear of an obstacle by half its thickness [m], and by what before."""

    @abstractmethod
    def pairs(self) -> Iterator[tuple[str, str]]:
        """Names of fingers that keep clear of each other."""

    def scale(self, held: HeldRods) -> float:
        """Force that residual forces are compared with [N]: the greatest on the object."""
        forces = (float(np.linalg.norm(contact.force)) for contact in held.contacts)
        traces = (TRACE * s.stiffness / s.finger.rod.length**2 for s in self.scene.setups)
        return max(*forces, self.scene.weight, min(traces)) if held.fingers else self.scene.weight

    def body(self, held: HeldRods) -> ExactObject:
        """The object where a grasp has it."""
        return ExactObject.of(self.scene, held)


class _PlaneStage(GraspStage):
    """Fingers of a planar scene bend in the plane alone."""

    scene: GraspScene

    def __init__(self, scene: GraspScene) -> None:
        super().__init__(scene)
        self.gravity, self.mass, self.upright = np.array(scene.gravity), scene.object.mass, scene.upright

    @property
    def finger_gravity(self) -> Array:
        return self.gravity * [1.0, 1.0, 0.0]

    @property
    def moves(self) -> list[int]:
        return [0, 1, 5]

    @property
    def axes(self) -> list[int]:
        return [0, 1]

    def section(self, setup: FingerSetup) -> SideStiffness:
        return SideStiffness()

    def center(self, held: HeldRods) -> Array:
        return np.asarray(held.position + held.axes @ np.array([*self.scene.object.com, 0.0]))

    def poses(self, held: HeldRods) -> Iterator[Check]:
        off = _beyond(self.scene.object.pose_bounds, (held.position, held.axes), self.size)
        yield Check(Requirement.POSE, "", off, EXACT)
        for finger in held.fingers:
            setup = self.setups[finger.name]
            off = _beyond(setup.finger.base_bounds, (finger.position, finger.axes), setup.finger.rod.length)
            yield Check(Requirement.BASE, finger.name, off, EXACT)

    def clear_from(self, obstacle: Obstacle, finger: HeldFinger) -> tuple[float, float]:
        half = float(self.setups[finger.name].finger.profile.half_thickness(0.0))
        height = float(obstacle.distance(finger.position[None])[0])
        # A base that stands exactly off the wall is clear, whatever rounding says.
        if height >= half * (1.0 - 1e-9):
            return 0.0, half
        # A finger that comes out of a wall is clear of it from its first contact on.
        length = self.setups[finger.name].finger.rod.length
        return min((contact.place for contact in finger.contacts), default=length), min(height, 0.0)

    def pairs(self) -> Iterator[tuple[str, str]]:
        for k, m in self.scene.pairs:
            yield self.scene.setups[k].name, self.scene.setups[m].name


class _HandStage(GraspStage):
    """Fingers of a hand bend in their planes and out of them."""

    scene: HandScene

    def __init__(self, scene: HandScene) -> None:
        super().__init__(scene)
        self.gravity, self.mass = np.array(scene.acceleration), scene.object.weighed
        self._bases = scene.hand.named_bases

    @property
    def torsional(self) -> float:
        return self.scene.contacts.torsional_friction

    def section(self, setup: FingerSetup) -> SideStiffness:
        section = (self._bases[setup.name].finger or self.scene.hand.finger).cross_section
        return SideStiffness(section.lateral, section.torsion)

    def center(self, held: HeldRods) -> Array:
        return np.asarray(held.position + held.axes @ np.array(self.scene.object.local_com))

    def poses(self, held: HeldRods) -> Iterator[Check]:
        body = self.scene.object
        off = _differs((held.position, held.axes), (np.array(body.position), body.axes), self.size)
        yield Check(Requirement.POSE, "", off, EXACT)
        for finger in held.fingers:
            base, length = self._bases[finger.name], self.setups[finger.name].finger.rod.length
            along = np.array(base.direction) / np.linalg.norm(base.direction)
            # It bends toward -X.
            normal = np.cross(along, base.bends_toward)
            normal /= np.linalg.norm(normal)
            axes = np.column_stack([np.cross(along, normal), along, normal])
            off = _differs((finger.position, finger.axes), (np.array(base.position), axes), length)
            yield Check(Requirement.BASE, finger.name, off, EXACT)

    def clear_from(self, obstacle: Obstacle, finger: HeldFinger) -> tuple[float, float]:
        base, half = self._bases[finger.name], self.setups[finger.name].finger.thickness_radius
        support = next(each for each in self.scene.supports if each.name == obstacle.name)
        return support.clear_from(base.position, base.direction, half), -np.inf

    def pairs(self) -> Iterator[tuple[str, str]]:
        names = list(self._bases)
        for k, name in enumerate(names):
            yield from ((name, other) for other in names[k + 1 :])


def _beyond(bounds: list[tuple[float, float]], place: tuple[Array, Array], length: float) -> float:
    """Distance of a place outside the bounds of a planar pose, per a length and in radians; out of the plane, too."""
    position, axes = place
    middle = 0.5 * (bounds[2][0] + bounds[2][1])
    angle = middle + np.remainder(np.arctan2(axes[1, 0], axes[0, 0]) - middle + np.pi, 2.0 * np.pi) - np.pi
    pose = np.array([*position[:2], angle])
    over = [max(low - value, value - high) for value, (low, high) in zip(pose, bounds, strict=True)]
    return greatest([*(np.array(over) / [length, length, 1.0]), _differs(place, in_plane(pose), length)])


def _differs(place: tuple[Array, Array], other: tuple[Array, Array], length: float) -> float:
    """By how much two places differ, per a length and in radians."""
    (position, axes), (wanted, turned) = place, other
    return greatest([np.abs(position - wanted).max() / length, np.abs(axes - turned).max()])
