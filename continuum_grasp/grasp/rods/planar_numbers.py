"""The plain numbers of a planar scene."""

from __future__ import annotations

import math

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.grasp.body.bodies import body_of
from continuum_grasp.grasp.body.table import DistanceTable
from continuum_grasp.grasp.rods.numbers import (
    REACH,
    FingerNumbers,
    GraspAims,
    SceneNumbers,
    SupportNumbers,
    WallNumbers,
)
from continuum_grasp.grasp.rods.planar import PLANE
from continuum_grasp.grasp.starts.supports import support_contacts
from continuum_grasp.grasp.starts.values import Pose
from continuum_grasp.scene import FingerSetup, GraspScene, Peg

_CELLS = 180
"""Cells of the table along its longer side."""
_UP = np.array([0.0, 0.0, 1.0])


def planar_numbers(
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
        friction, body = scene.held_friction(name), scene.support_of(name)
        # 1e-9: a peg without a radius is a point
        curvature = size / max(body.radius, 1e-9 * size) if isinstance(body, Peg) else 0.0
        supports.append(SupportNumbers(name, _vector(arm), _vector(normal), _UP, friction, most, curvature))
    own = np.array([pose[0] / size, pose[1] / size, pose[2]])
    bounds = np.array(scene.object.pose_bounds) / [[size], [size], [1.0]]
    free = scene.object.free is not None
    low, high = (np.minimum(bounds[:, 0], own), np.maximum(bounds[:, 1], own)) if free else (own, own)
    aims = scene.weights
    return SceneNumbers(
        geometry=PLANE,
        fingers=[_finger(scene, setup, base, on) for setup, base in zip(scene.setups, bases, strict=True)],
        supports=supports,
        table=table,
        size=size,
        force=force,
        pose=own,
        axes=np.zeros(0),
        pose_bounds=(low, high),
        center=np.array([*scene.object.com, 0.0]) / size,
        weight=np.array([*(scene.object.mass * np.array(scene.gravity) / force), 0.0, 0.0, 0.0]),
        balances=tuple(scene.balances),
        spatial=scene.spatial,
        aims=GraspAims(
            aims.least_tension,
            aims.greatest_friction_margin,
            aims.least_normal_force * force / scene.contacts.normal_force_max,
        ),
        pairs=scene.pairs,
        penetration=scene.solver.penetration_tolerance,
        reserve=scene.contacts.reserve,
    )


def _finger(scene: GraspScene, setup: FingerSetup, base: Pose, on: frozenset[str]) -> FingerNumbers:
    """The numbers of a finger at its base."""
    length = setup.finger.rod.length
    x, y, angle = base
    half = float(setup.finger.profile.half_thickness(0.0)) / length
    walls = [
        _wall(np.array(wall.normal), np.array(wall.point) / length, np.array([x, y]) / length, half)
        for wall in scene.walls
        if math.isinf(wall.half_length)
    ]
    return FingerNumbers.of(
        setup,
        on,
        np.array(scene.gravity[:2]),
        paths=bool(scene.weights.greatest_disturbance) and scene.disturbances.tendons == "locked",
        sides=(),
        base=np.array([x / length, y / length, angle]),
        across=_UP,
        arm=0.0,
        walls=tuple(walls),
    )


def _wall(normal: Array, point: Array, base: Array, half: float) -> WallNumbers:
    """A wall, in units of the finger; a finger whose base is in it emerges from it before its first contact."""
    level, height = float(normal @ point), float(normal @ (base - point))
    inside = height < half * (1.0 - 1e-9)
    return WallNumbers(normal, level, emerging=level + min(height, 0.0) if inside else None)


def _vector(value: complex) -> Array:
    return np.array([value.real, value.imag, 0.0])


def planar_table(scene: GraspScene) -> DistanceTable:
    """The table of a scene's object, per its size."""
    body = body_of(scene.object)
    reach = REACH * max(setup.finger.thickness_radius for setup in scene.setups)
    low, high = body.box
    step = (float((high - low).max()) + 2.0 * reach) / _CELLS
    return DistanceTable.around(body, reach, step).scaled(scene.object.size)
