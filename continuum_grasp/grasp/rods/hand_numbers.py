"""The plain numbers of a hand's scene."""

from __future__ import annotations

from typing import Any

import numpy as np

from continuum_grasp.grasp.body.bodies import body_of
from continuum_grasp.grasp.body.table import DistanceTable
from continuum_grasp.grasp.hand.frames import PlaneFrame
from continuum_grasp.grasp.rods.numbers import (
    REACH,
    FingerNumbers,
    GraspAims,
    SceneNumbers,
    unit,
)
from continuum_grasp.grasp.rods.obstacles import PlaneObstacle
from continuum_grasp.grasp.rods.spatial import SPACE, quaternion_of
from continuum_grasp.grasp.rods.supports import FlatSupport, SupportNumbers
from continuum_grasp.scene import FingerSetup, HandScene

STEP = 0.42
"""Step of the table, per half thickness of the thinnest finger: contacts have finer ones."""
PRESSED = 1e-2
"""Least normal force of a finger's contact, per weight, where palm or table carry too."""


def hand_numbers(scene: HandScene, on: frozenset[str], table: DistanceTable) -> SceneNumbers:
    """The numbers of a scene with the contacts ``on`` by name."""
    solid: Any = scene.object
    size, axes = solid.size, np.asarray(solid.axes)
    frames = PlaneFrame.each(scene)
    fingers = [_finger(scene, setup, frame, on) for setup, frame in zip(scene.setups, frames, strict=True)]
    force = max(scene.weight, *(finger.force for finger in fingers))
    supports = list[SupportNumbers]()
    for contact in scene.support_contacts:
        if contact.name not in on:
            continue
        normal = -np.array(contact.support.normal)
        # The axis that is farthest from the normal.
        across = unit(np.cross(normal, np.eye(3)[np.abs(normal).argmin()]))
        point = (np.array(contact.position) - np.array(solid.position)) @ axes / size
        friction = contact.support.friction * (1.0 - scene.contacts.reserve)
        limits = contact.name, across, friction, scene.contacts.normal_force_max / force, True
        level = float(normal @ np.array(contact.support.point)) / size
        supports.append(FlatSupport(*limits, normal, level, point, 0.0))
    pose = np.array([*(np.array(solid.position) / size), 0.0, 0.0, 0.0])
    count = len(fingers)
    return SceneNumbers(
        geometry=SPACE,
        fingers=fingers,
        supports=supports,
        table=table,
        size=size,
        force=force,
        pose=pose,
        axes=axes.ravel(),
        pose_bounds=(pose, pose),
        center=np.array(solid.local_com) / size,
        weight=np.array([*(solid.weighed * np.array(scene.acceleration) / force), 0.0, 0.0, 0.0]),
        balances=tuple(range(6)),
        spatial=True,
        aims=GraspAims(),
        pairs=tuple((k, m) for k in range(count) for m in range(k + 1, count)),
        penetration=scene.solver.penetration_tolerance,
        deviation=scene.object.deviation,
        least_normal=PRESSED * scene.weight / force if supports else 0.0,
        reserve=scene.contacts.reserve,
    )


def _finger(scene: HandScene, setup: FingerSetup, frame: PlaneFrame, on: frozenset[str]) -> FingerNumbers:
    """The numbers of a finger in its plane."""
    section: Any = setup.finger
    length, half = section.rod.length, section.thickness_radius
    base, along = (tuple(part.tolist()) for part in (frame.base, frame.axes[:, 1]))
    obstacles = []
    for support in scene.supports:
        normal = np.array(support.normal)
        level = float(normal @ np.array(support.point)) / length
        first = support.clear_from(base, along, half) / length
        obstacles.append(PlaneObstacle(first, None, support.name, normal, level))
    placed = np.concatenate([frame.base / length, quaternion_of(frame.axes)])
    return FingerNumbers.of(
        setup,
        on,
        np.array(scene.acceleration),
        sides=(section.cross_section.lateral, section.cross_section.torsion),
        base=placed,
        base_bounds=(placed, placed),
        across=frame.axes[:, 2],
        arm=scene.contacts.torsional_friction / setup.friction / length,
        obstacles=tuple(obstacles),
    )


def hand_table(scene: HandScene) -> DistanceTable:
    """The table of a scene's object, per its size."""
    thick = [setup.finger.thickness_radius for setup in scene.setups]
    table = DistanceTable.around(body_of(scene.object), REACH * max(thick), STEP * min(thick))
    return table.scaled(scene.object.size)
