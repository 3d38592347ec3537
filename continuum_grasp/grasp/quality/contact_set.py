"""The contacts of a stored grasp as arrays: where, which way, how rough, how strong."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.scene.grasp import GraspScene
from continuum_grasp.scene.grasp_options import PlanarGravity

__all__ = ["ContactSet", "object_part"]

Array = NDArray[Any]


@dataclass(frozen=True)
class ContactSet:
    """All contacts that are on, with fingers and with supports; world frame, SI.

    Attributes
    ----------
    names : tuple of str
    positions : ndarray, shape (C, 2)
        On the object's surface [m].
    normals, across : ndarray, shape (C, 2)
        Outward normal of the object, and the same turned by +90 degrees.
    arms : ndarray, shape (C, 2)
        From the center of mass to the contacts [m].
    forces : ndarray, shape (C, 3)
        Normal force, friction in the plane (both on what touches the object), lift (on the object) [N].
    friction, normal_max : ndarray, shape (C,)
        Friction coefficient [1] and greatest normal force [N].
    stations : ndarray, shape (C,)
        Position along the finger [m]; NaN for supports.
    parts : ndarray of int, shape (C,)
        Index into the object's parts.
    com : ndarray, shape (2,)
        Center of mass [m].
    pose : ndarray, shape (3,)
        Of the object: x, y [m], angle [rad].
    load : ndarray, shape (3,)
        Weight on the object in the plane, about the center of mass: two forces [N], no moment.
    """

    names: tuple[str, ...]
    positions: Array
    normals: Array
    across: Array
    arms: Array
    forces: Array
    friction: Array
    normal_max: Array
    stations: Array
    parts: Array
    com: Array
    pose: Array
    load: Array

    @classmethod
    def of(cls, scene: GraspScene, arrays: Mapping[str, Any]) -> ContactSet:
        """The contacts of a grasp's stored arrays."""
        names = tuple(str(name) for name in np.atleast_1d(arrays["contact_names"]))
        count = len(names)
        positions = np.asarray(arrays["contact_positions"], dtype=float).reshape(count, 2)
        normals = np.asarray(arrays["contact_normals"], dtype=float).reshape(count, 2)
        pose = np.asarray(arrays["object.pose"], dtype=float)
        c, s = np.cos(pose[2]), np.sin(pose[2])
        com = pose[:2] + np.array([[c, -s], [s, c]]) @ np.asarray(scene.object.com)
        load = np.zeros(3)
        if isinstance(scene.gravity, PlanarGravity):
            load[:2] = scene.object.mass * np.asarray(scene.gravity.vector)
        return cls(
            names,
            positions,
            normals,
            np.stack([-normals[:, 1], normals[:, 0]], axis=1),
            positions - com,
            np.asarray(arrays["contact_forces"], dtype=float).reshape(count, 3),
            np.array([scene.friction(name) for name in names], dtype=float),
            np.array([scene.normal_force_max(name) for name in names], dtype=float),
            np.asarray(arrays["contact_stations"], dtype=float).reshape(count),
            np.asarray(arrays["contact_parts"], dtype=int).reshape(count),
            com,
            pose,
            load,
        )

    @property
    def count(self) -> int:
        """Number of contacts."""
        return len(self.names)

    def wrench_map(self) -> Array:
        """Wrench on the object about its center of mass per (N, f) of each contact, shape (3, C, 2) [1, 1, m]."""
        on_object = -np.stack([self.normals, self.across], axis=1)
        moment = self.arms[:, None, 0] * on_object[:, :, 1] - self.arms[:, None, 1] * on_object[:, :, 0]
        return np.stack([on_object[:, :, 0], on_object[:, :, 1], moment])

    def finger_of(self, contact: int) -> str | None:
        """Name of the finger at a contact, None at a support."""
        return None if np.isnan(self.stations[contact]) else self.names[contact].split(".")[0]


def object_part(scene: GraspScene, contacts: ContactSet, contact: int) -> tuple[Any, Array]:
    """The part of the object that a contact is on, and the contact's position in the object's frame [m]."""
    c, s = np.cos(contacts.pose[2]), np.sin(contacts.pose[2])
    local = np.array([[c, s], [-s, c]]) @ (contacts.positions[contact] - contacts.pose[:2])
    return scene.object.parts[int(contacts.parts[contact])], local
