"""The plain numbers of a planar scene."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.grasp.body.bodies import body_of
from continuum_grasp.grasp.body.body import Body
from continuum_grasp.grasp.body.table import DistanceTable
from continuum_grasp.grasp.object_supports import Pose, support_contacts
from continuum_grasp.grasp.rods.numbers import (
    REACH,
    FingerNumbers,
    GraspAims,
    SceneNumbers,
)
from continuum_grasp.grasp.rods.obstacles import FingerObstacle, PlaneObstacle, PostObstacle
from continuum_grasp.grasp.rods.planar import PLANE
from continuum_grasp.grasp.rods.supports import FlatSupport, PegSupport, SupportNumbers
from continuum_grasp.scene import FingerSetup, GraspScene, Peg, Wall

FLAT = 100.0
"""Radius of an osculating circle, per size of the object, that is as good as a face [1]: off by 5e-3 of the square of a
way along it, before it is taken anew."""
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
    own = np.array([pose[0] / size, pose[1] / size, pose[2]])
    bounds = np.array(scene.object.pose_bounds) / [[size], [size], [1.0]]
    free = scene.object.free is not None
    low, high = (np.minimum(bounds[:, 0], own), np.maximum(bounds[:, 1], own)) if free else (own, own)
    aims = scene.weights
    return SceneNumbers(
        geometry=PLANE,
        fingers=[_finger(scene, setup, base, on) for setup, base in zip(scene.setups, bases, strict=True)],
        supports=planar_supports(scene, on, pose, force),
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


def planar_supports(scene: GraspScene, on: frozenset[str], pose: Pose, force: float) -> list[SupportNumbers]:
    """The supports of a scene as the object meets them at a pose [m, rad]: those that are ``on`` touch."""
    size, turn = scene.object.size, np.exp(1j * pose[2])
    body = body_of(scene.object)
    wanted = {support.name for support in scene.places}
    supports = list[SupportNumbers]()
    for name, start in support_contacts(scene, pose, wanted).items():
        support: Any = scene.support_of(name)
        touches = support.name in on
        limits = name, _UP, scene.held_friction(name), scene.normal_force_max(name) / force, touches
        spot, angle = complex(*start.point), start.normal_angle
        if isinstance(support, Peg):
            position = np.array([*support.position, 0.0]) / size
            supports.append(PegSupport(*limits, position, support.radius / size))
            continue
        if not touches and math.isfinite(support.half_length):
            continue
        # Two ends of a face stay where they are.
        radius = 0.0 if name != support.name else min(1.0 / _curvature(body, spot), FLAT * size)
        center = spot - radius * np.exp(1j * angle)
        normal = _vector(turn * np.exp(1j * angle))
        level = -float(np.dot(support.normal, support.point)) / size
        supports.append(FlatSupport(*limits, normal, level, _vector(center) / size, radius / size))
    return supports


def _curvature(body: Body, spot: complex) -> float:
    """Curvature of a surface at a place of it [1/m]; a face has a tiny one."""
    (curvature,) = body.near(np.array([[spot.real, spot.imag]])).curvature
    return max(float(curvature), 1e-9 / body.size)


def _finger(scene: GraspScene, setup: FingerSetup, base: Pose, on: frozenset[str]) -> FingerNumbers:
    """The numbers of a finger at its base."""
    length = setup.finger.rod.length
    half = float(setup.finger.profile.half_thickness(0.0)) / length
    unit = np.array([length, length, 1.0])
    own = np.array(base) / unit
    low, high = np.array(setup.finger.base_bounds).T / unit
    obstacles = [_obstacle(place, length, own[:2], half) for place in scene.places]
    return FingerNumbers.of(
        setup,
        on,
        np.array(scene.gravity[:2]),
        paths=bool(scene.weights.greatest_disturbance) and scene.disturbances.tendons == "locked",
        sides=(),
        base=own,
        base_bounds=(np.minimum(low, own), np.maximum(high, own)),
        across=_UP,
        arm=0.0,
        obstacles=tuple(obstacles),
    )


def _obstacle(place: Peg | Wall, length: float, base: Array, half: float) -> FingerObstacle:
    """A support in the way of a finger; one whose base is in it emerges from it before its first contact."""
    obstacle: FingerObstacle
    if isinstance(place, Wall) and math.isinf(place.half_length):
        normal = np.array(place.normal)
        obstacle = PlaneObstacle(0.0, None, place.name, normal, float(normal @ place.point) / length)
    elif isinstance(place, Wall):
        begin, end = np.array(place.ends) / length
        obstacle = PostObstacle(0.0, None, place.name, begin, end, 0.0)
    else:
        center = np.array(place.position) / length
        obstacle = PostObstacle(0.0, None, place.name, center, center, place.radius / length)
    height = float(obstacle.height(base[None])[0])
    return replace(obstacle, emerging=min(height, 0.0)) if height < half * (1.0 - 1e-9) else obstacle


def _vector(value: complex) -> Array:
    return np.array([value.real, value.imag, 0.0])


def planar_table(scene: GraspScene) -> DistanceTable:
    """The table of a scene's object, per its size."""
    body = body_of(scene.object)
    reach = REACH * max(setup.finger.thickness_radius for setup in scene.setups)
    low, high = body.box
    step = (float((high - low).max()) + 2.0 * reach) / _CELLS
    return DistanceTable.around(body, reach, step).scaled(scene.object.size)
