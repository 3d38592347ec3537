"""Starting points of the search, also made from a grasp that was found: for other elements, or another aim."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import zip_longest

import numpy as np

from continuum_grasp.base import Numbers as Array
from continuum_grasp.grasp.shape import FingerShape
from continuum_grasp.scene import FingerSetup, GraspScene

Pose = tuple[float, float, float]
"""World x, y [m] and angle [rad]."""


@dataclass(frozen=True)
class FingerStart:
    """A finger of a start."""

    base: Pose  # world pose of the base [m, rad]
    joints: tuple[float, ...]  # positions along the finger of all middle contacts, on or off, increasing [m]
    sides: tuple[int, ...]
    """Per middle contact: the object's outward normal there is side * (cos, sin) of the section's angle; +1: the object
    is on the finger's left (-X)."""
    knots: tuple[float, ...]  # positions along the finger, from 0 to its length [m]
    curvatures: tuple[float, ...]  # at the knots, linear between them [1/m]


@dataclass(frozen=True)
class ContactStart:
    """A contact of a start, in the object's frame."""

    part: int  # index of the object's part that is touched
    point: tuple[float, float]  # on its surface [m]
    normal_angle: float  # of the outward normal [rad]

    @property
    def place(self) -> tuple[tuple[float, float], float]:
        """Point on the surface, and the angle of its normal."""
        return self.point, self.normal_angle


@dataclass(frozen=True)
class GraspStart:
    """A start."""

    label: str  # "map" (at its optimum), "spare" (before that), "rough" (nearly touches) ...
    object_pose: Pose  # in the world [m, rad]
    fingers: dict[str, FingerStart]
    contacts: dict[str, ContactStart]  # all that are on, those with supports included
    forces: dict[str, tuple[float, float, float]] = field(default_factory=dict)
    """Normal, friction and lift at the contacts that balance the object as nearly as they can [N]; signs as in a
    result's ``contact_forces``; may be empty."""
    tensions: dict[str, tuple[float, float]] = field(default_factory=dict)
    """Tensions of the fingers' tendons that go with the postures [N]; may be empty."""
    estimate: float = math.nan
    """Sum of the tensions [N] to be expected of the basin that it stands for; NaN: unknown."""
    imbalance: float = math.nan
    """Part of the loads that the best forces within their limits leave unbalanced there; NaN: unknown."""
    friction_states: dict[str, tuple[float, ...]] = field(default_factory=dict)
    """Friction states of the fingers whose tendons did not simply slide from the straight finger on."""

    @property
    def is_spare(self) -> bool:
        """Whether the start holds the object, but not at the least tension next to it."""
        return self.label == "spare"

    @property
    def is_rough(self) -> bool:
        """Whether fingers of the start only nearly touch the object."""
        return self.label == "rough"

    @classmethod
    def of(cls, scene: GraspScene, arrays: dict[str, Array]) -> GraspStart:
        """A grasp of a scene, by its numbers as `GraspResult` holds them, as a start for it with other elements."""
        names = [str(name) for name in arrays["contact_names"]]
        normals = dict(zip(names, arrays["contact_normals"], strict=True))
        x, y, turn = arrays["object.pose"].tolist()
        back = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
        fingers, tensions = {}, {}
        for setup in scene.setups:
            finger = setup.name
            shape = FingerShape(setup, arrays)
            ends = shape.joints
            joints = tuple(float(ends[count]) for count in setup.before)
            line = arrays[f"{finger}.backbone"]
            sides = []
            for name, joint in zip(setup.middle_names, joints, strict=True):
                angle = float(np.interp(joint, line[:, 0], line[:, 3]))
                across = np.array([np.cos(angle), np.sin(angle)])
                sides.append(1 if name not in normals or across @ normals[name] >= 0.0 else -1)
            base = tuple(arrays[f"{finger}.base"].tolist())
            fingers[finger] = FingerStart(base, joints, tuple(sides), *_knots(shape.curvatures, ends))
            left, right = arrays[f"{finger}.tensions"].tolist()
            tensions[finger] = left, right
        contacts, forces = {}, {}
        for k, name in enumerate(names):
            n, f, lift = arrays["contact_forces"][k].tolist()
            forces[name] = n, f, lift
            point = back @ (arrays["contact_positions"][k] - [x, y])
            normal = back @ normals[name]
            angle = float(np.arctan2(normal[1], normal[0]))
            contacts[name] = ContactStart(int(arrays["contact_parts"][k]), (float(point[0]), float(point[1])), angle)
        return cls("found", (x, y, turn), fingers, contacts, forces, tensions)


def with_contacts(scene: GraspScene, start: GraspStart, contacts: Mapping[str, ContactStart]) -> GraspStart:
    """The start with these contacts alone; middle contacts and stations that are clear are where the scene has them."""
    fingers = dict(start.fingers)
    for setup in scene.setups:
        finger_start = fingers[setup.name]
        places = zip(setup.middle_names, finger_start.joints, setup.middle_places, strict=True)
        joints = tuple(at if name in contacts else off for name, at, off in places)
        fingers[setup.name] = replace(finger_start, joints=joints)
    # In one order, so that equal sets share one solver.
    middles = (name for setup in scene.setups for name in setup.middle_names)
    order = dict.fromkeys((*middles, *start.contacts, *contacts))
    return replace(
        start,
        fingers=fingers,
        contacts={name: contacts[name] for name in order if name in contacts},
        forces={name: force for name, force in start.forces.items() if name in contacts},
    )


def interleaved(lists: list[list[GraspStart]]) -> list[GraspStart]:
    """The first of each list, then the second of each, and so on."""
    return [start for rank in zip_longest(*lists) for start in rank if start is not None]


def all_joints(setup: FingerSetup, on: dict[str, float]) -> tuple[float, ...]:
    """Positions of all middle contacts [m], given those that are ``on``, between which the others are spread evenly."""
    if not on:
        return setup.middle_places
    count = len(setup.middle_names)
    known = [-1, *(k for k, name in enumerate(setup.middle_names) if name in on), count]
    places = [0.0, *on.values(), setup.finger.rod.length]
    return tuple(np.interp(range(count), known, places).tolist())


def _knots(profile: Array, ends: Array) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Knots and curvatures of a continuous profile near a finger's, whose elements have D curvatures each."""
    first = ends[:-1, None]
    last = ends[1:, None]
    # Where curvatures of neighbors differ at their joint, their mean; of arcs, from middle to middle.
    if profile.shape[1] == 1:
        knots = np.concatenate([ends[:1], 0.5 * (ends[1:] + ends[:-1]), ends[-1:]])
        values = np.concatenate([profile[0], profile[:, 0], profile[-1]])
    else:
        inner = first + (last - first) * np.linspace(0.0, 1.0, profile.shape[1])[1:-1]
        joints = np.concatenate([profile[:1, 0], 0.5 * (profile[:-1, -1] + profile[1:, 0]), profile[-1:, -1]])
        knots = np.append(np.concatenate([first, inner], axis=1), ends[-1])
        values = np.append(np.concatenate([joints[:-1, None], profile[:, 1:-1]], axis=1), joints[-1])
    return tuple(knots.tolist()), tuple(values.tolist())
