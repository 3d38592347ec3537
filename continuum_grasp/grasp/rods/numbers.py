"""A scene with one set of contacts at one place, as plain numbers in units of its fingers and its object."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from continuum_grasp.base import Array, InputError
from continuum_grasp.grasp.body.bodies import body_of
from continuum_grasp.grasp.body.table import DistanceTable
from continuum_grasp.grasp.rods.rod import Course
from continuum_grasp.grasp.starts.supports import support_contacts
from continuum_grasp.grasp.starts.values import Pose
from continuum_grasp.scene import FingerSetup, GraspScene

DEGREE = 4
"""Degree of the polynomials of what varies along a finger: that of the stiffness of a linear taper."""
UNIFORM = 1e6
"""Curvature limit per length above which there is none."""


@dataclass(frozen=True, eq=False)
class FingerNumbers:
    """A finger at its base, in units of L, E I / L^2 and E I / L."""

    setup: FingerSetup
    course: Course
    base: Pose
    force: float  # [N]
    moment: float  # [N m]
    gravity: Array  # (2,), of a weight per length
    load: Array  # (2,) at the tip
    pulls: Array  # (2,) greatest moments of the tendons above their least tension
    offset: float  # [m]
    places: tuple[float, float]  # of middle contacts
    curvature_limit: float
    middles: tuple[str, ...]
    tip: str | None

    @property
    def length(self) -> float:
        """Length [m]."""
        return self.setup.finger.rod.length

    @property
    def name(self) -> str:
        """Name of the finger."""
        return self.setup.name

    @property
    def coefficients(self) -> int:
        """Coefficients of each polynomial of the course."""
        return len(self.course.half)

    @staticmethod
    def of(scene: GraspScene, setup: FingerSetup, base: Pose, on: frozenset[str]) -> FingerNumbers:
        """The numbers of a finger of a scene, with the contacts ``on`` by name."""
        finger, length = setup.finger, setup.finger.rod.length
        (channel,) = finger.channels
        moment = setup.stiffness / length
        force = moment / length
        gravity = np.array(scene.gravity[:2]) / force
        tip_mass = sum(mass.mass for mass in finger.masses if abs(mass.at - length) <= 1e-9 * length)
        offset = float(channel.arms[0])
        used = np.array([finger.tendons_used in ("both", side) for side in ("left", "right")], dtype=float)
        reach = (setup.max_tension - setup.tendons.min_tension) * offset / moment
        x, y, angle = base
        first, last = setup.middle_bounds
        return FingerNumbers(
            setup=setup,
            course=_course(setup),
            base=(x / length, y / length, angle),
            force=force,
            moment=moment,
            gravity=gravity,
            load=tip_mass * gravity,
            pulls=reach * used,
            offset=offset,
            places=(first / length, last / length),
            curvature_limit=min(finger.curvature_limit * length, UNIFORM),
            middles=tuple(name for name in setup.middle_names if name in on),
            tip=setup.tip_name if setup.tip_name in on else None,
        )


def _course(setup: FingerSetup) -> Course:
    """Polynomials of what varies along a finger."""
    finger, length = setup.finger, setup.finger.rod.length
    profile = finger.profile
    (channel,) = finger.channels
    at = length * (np.linspace(0.0, 1.0, 65) if setup.graded else np.zeros(1))
    columns = (
        profile.bending_stiffness(at) / setup.stiffness,
        profile.rest_curvature(at) * length,
        channel.shape(at),
        profile.linear_density(at) * length,
        profile.half_thickness(at) / length,
    )
    fits = list[list[float]]()
    for column in columns:
        values = np.broadcast_to(np.asarray(column, float), at.shape)
        degree = DEGREE if setup.graded else 0
        fit = np.polynomial.polynomial.polyfit(at / length, values, degree)
        off = np.abs(np.polynomial.polynomial.polyval(at / length, fit) - values).max()
        # 1e-6: share of the greatest value, far below what manufacturing leaves
        if off > 1e-6 * np.abs(values).max(initial=1e-300):
            raise InputError("a finger whose section jumps along it", key=setup.where)
        fits.append(fit.tolist())
    return Course(*fits)


@dataclass(frozen=True, eq=False)
class SupportNumbers:
    """Contact of a support with an object that does not move."""

    name: str
    arm: Array  # from the center of mass [object size]
    normal: Array
    friction: float
    most: float  # [F0]


@dataclass(frozen=True, eq=False)
class SceneNumbers:
    """A scene with one set of contacts at one place of the object and of the bases."""

    scene: GraspScene
    fingers: list[FingerNumbers]
    supports: list[SupportNumbers]
    walls: list[tuple[Array, float]]  # normal, height [m]
    table: DistanceTable  # [object size]
    size: float  # [m]
    force: float  # F0 [N]
    pose: Array  # x, y [object size], angle
    pose_bounds: tuple[Array, Array]
    center: Array  # of mass, in the object's frame [object size]
    weight: Array  # (6,) force and moment on the object [F0, F0 size]

    @staticmethod
    def of(
        scene: GraspScene,
        on: frozenset[str],
        place: tuple[Pose, tuple[Pose, ...]],
        force: float,
        table: DistanceTable,
    ) -> SceneNumbers:
        """The numbers of a scene with the contacts ``on`` by name, with a unit of force F0 [N]."""
        pose, bases = place
        size = scene.object.size
        turn = np.exp(1j * pose[2])
        center = complex(*pose[:2]) + turn * complex(*scene.object.com)
        touching = support_contacts(scene, pose, {name for name in on if scene.support_of(name) is not None})
        supports = []
        for name, start in touching.items():
            arm = (complex(*pose[:2]) + turn * complex(*start.point) - center) / size
            normal = turn * np.exp(1j * start.normal_angle)
            most = scene.normal_force_max(name) / force
            supports.append(SupportNumbers(name, _vector(arm), _vector(normal), scene.held_friction(name), most))
        own = np.array([pose[0] / size, pose[1] / size, pose[2]])
        bounds = np.array(scene.object.pose_bounds) / [[size], [size], [1.0]]
        free = scene.object.free is not None
        low, high = (np.minimum(bounds[:, 0], own), np.maximum(bounds[:, 1], own)) if free else (own, own)
        walls = [
            (np.array(wall.normal), float(np.dot(wall.normal, wall.point)))
            for wall in scene.walls
            if math.isinf(wall.half_length)
        ]
        return SceneNumbers(
            scene=scene,
            fingers=[FingerNumbers.of(scene, setup, base, on) for setup, base in zip(scene.setups, bases, strict=True)],
            supports=supports,
            walls=walls,
            table=table,
            size=size,
            force=force,
            pose=own,
            pose_bounds=(low, high),
            center=np.array(scene.object.com) / size,
            weight=np.array([*(scene.object.mass * np.array(scene.gravity) / force), 0.0, 0.0, 0.0]),
        )


def _vector(value: complex) -> Array:
    return np.array([value.real, value.imag])


def table_of(scene: GraspScene, counts: int = 181) -> DistanceTable:
    """The table of a scene's object, per its size."""
    body = body_of(scene.object)
    thickest = max(setup.finger.thickness_radius for setup in scene.setups)
    low, high = body.box
    # 2.5: half thicknesses around the object that are in the table
    reach = 2.5 * thickest
    step = (float((high - low).max()) + 2.0 * reach) / (counts - 1)
    return DistanceTable.around(body, reach, step).scaled(body.size)
