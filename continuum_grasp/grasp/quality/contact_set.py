"""The contacts of a stored grasp as arrays (where, which way, how rough, how strong), and their wrench space."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.quality.lp import solve_lp
from continuum_grasp.scene.grasp import GraspScene
from continuum_grasp.scene.grasp_options import PlanarGravity

Array = NDArray[Any]

_FLAT = 1e-12
"""Below this part of the greatest, a length is rounding."""


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


@dataclass(frozen=True)
class WrenchSpace:
    """Wrenches of the contacts' friction cones at unit normal force.

    Attributes
    ----------
    edges : ndarray, shape (E, 3)
        Force x, y [1] and moment about the center of mass over ``torque_scale`` [1] on the object, of both edges of
        each cone; one where there is no friction.
    owner : ndarray of int, shape (E,)
        Contact that an edge belongs to.
    torque_scale : float
        [m]
    """

    edges: Array
    owner: Array
    torque_scale: float

    @cached_property
    def epsilon_l1(self) -> float:
        """Signed distance of the origin from the boundary of the convex hull of all edges [1].

        The greatest disturbance, in any direction, that the contacts resist with normal forces that add up to one;
        negative, with the distance from the hull, where the origin is outside.
        """
        points = self.edges
        if points.shape[0] == 0:
            return 0.0
        directions = [-points, _null_space(points)]
        if points.shape[0] > 1:
            a, b = (points[list(k)] for k in zip(*combinations(range(len(points)), 2), strict=True))
            along = b - a
            share = -np.einsum("ij,ij->i", a, along) / np.maximum(np.einsum("ij,ij->i", along, along), 1e-300)
            directions.append(-(a + np.clip(share, 0.0, 1.0)[:, None] * along))
        if points.shape[0] > 2:
            a, b, c = (points[list(k)] for k in zip(*combinations(range(len(points)), 3), strict=True))
            normals = np.cross(b - a, c - a)
            directions += [normals, -normals]
        units = _units(np.concatenate(directions))
        return float((units @ points.T).max(axis=1).min())

    @cached_property
    def epsilon_linf(self) -> float:
        """The same with normal forces of up to one at each contact: depth of the origin in the Minkowski sum [1].

        The sum holds the origin always; 0 where there is no force closure (`epsilon_l1` has the sign).
        """
        sides = [np.zeros((0, 3))]
        groups = [np.concatenate([np.zeros((1, 3)), self.edges[self.owner == k]]) for k in np.unique(self.owner)]
        for corners in groups:
            first, second = (list(k) for k in zip(*combinations(range(len(corners)), 2), strict=True))
            sides.append(corners[second] - corners[first])
        steps = np.concatenate(sides)
        if len(steps) < 2:
            return 0.0
        a, b = (steps[list(k)] for k in zip(*combinations(range(len(steps)), 2), strict=True))
        normals = np.cross(a, b)
        units = _units(np.concatenate([normals, -normals, _null_space(self.edges)]))
        if len(units) == 0:
            return 0.0
        reach = sum((units @ corners.T).max(axis=1) for corners in groups)
        return max(0.0, float(np.min(reach)))

    @cached_property
    def min_weight(self) -> float:
        """Greatest l such that the origin is a convex combination of the edges with no weight below l [1].

        Positive for force closure, at most one over the number of edges; 0 where the origin is no such combination,
        or where the edges do not span forces and moments.
        """
        count = len(self.edges)
        if count == 0 or len(_null_space(self.edges)) > 0:
            return 0.0
        rows = np.zeros((4, count + 1))  # weights are l + v, v >= 0
        rows[:3, :count], rows[3, :count] = self.edges.T, 1.0
        rows[:, count] = rows[:, :count].sum(axis=1)
        right = np.array([0.0, 0.0, 0.0, 1.0])
        found = solve_lp(np.append(np.zeros(count), -1.0), rows, right, right, 0.0, 1.0)
        return float(found.x[-1]) if found.optimal else 0.0


def wrench_space(scene: GraspScene, arrays: Mapping[str, Any]) -> WrenchSpace:
    """Cone edges of all contacts of a grasp: which wrenches they can put on the object.

    Contacts alone: every one of them, supports included, may push with any normal force up to one; that fingers bend
    and tendons have limits is the business of `continuum_grasp.grasp.quality.quality.resistance`.
    In a scene with the weight out of the plane the whole planar cones count, as though nothing were lifted.

    Parameters
    ----------
    scene : GraspScene
    arrays : mapping
        Of the grasp.
    """
    contacts = ContactSet.of(scene, arrays)
    scale = np.array([1.0, 1.0, scene.torque_scale])
    normal, across = (contacts.wrench_map()[:, :, i].T / scale for i in (0, 1))
    edges, owner = [np.zeros((0, 3))], []
    for k, mu in enumerate(contacts.friction):
        slopes = (mu, -mu) if mu > 0.0 else (0.0,)
        edges.append(np.array([normal[k] + slope * across[k] for slope in slopes]))
        owner += [k] * len(slopes)
    return WrenchSpace(np.concatenate(edges), np.array(owner, dtype=int), float(scene.torque_scale))


def _units(directions: Array) -> Array:
    lengths = np.linalg.norm(directions, axis=1)
    retained = lengths > _FLAT * max(1e-300, lengths.max(initial=0.0))
    return np.asarray(directions[retained] / lengths[retained][:, None])


def _null_space(points: Array) -> Array:
    """Directions, both ways, that are perpendicular to all points."""
    if len(points) == 0:
        return np.concatenate([np.eye(3), -np.eye(3)])
    _, singular, directions = np.linalg.svd(points)
    rank = int((singular > 1e-10 * singular[0]).sum())
    return np.concatenate([directions[rank:], -directions[rank:]])
