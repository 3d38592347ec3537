"""The contacts of a stored grasp as arrays (where, which way, how rough, how strong), and their wrench space."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import combinations
from typing import Any

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.grasp.judge.check import EXACT
from continuum_grasp.scene import GraspScene, Peg


class ContactSet:
    """All contacts of a grasp that are on, C of them, with fingers and with supports; world frame, SI.

    ``arrays`` are the grasp's stored numbers, as `continuum_grasp.grasp.certify` takes them.
    """

    def __init__(self, scene: GraspScene, arrays: Mapping[str, Any]) -> None:
        self.scene = scene
        self.names = tuple(str(name) for name in np.atleast_1d(arrays["contact_names"]))
        self.count = len(self.names)

        def stored(name: str, *columns: int) -> Array:
            return np.asarray(arrays[f"contact_{name}"], dtype=float).reshape(self.count, *columns)

        # Outward normal of the object, and the same turned by +90 degrees, along which friction counts.
        self.positions, self.normals = stored("positions", 2), stored("normals", 2)
        self.across = np.stack([-self.normals[:, 1], self.normals[:, 0]], axis=1)
        # Normal force, friction in the plane (both on what touches the object), lift (on the object) [N].
        self.forces = stored("forces", 3)
        self.stations = stored("stations")  # along the finger [m]; NaN for supports
        self._parts = stored("parts").astype(int)
        self.friction = np.array([scene.friction(name) for name in self.names], dtype=float)
        self.normal_max = np.array([scene.normal_force_max(name) for name in self.names], dtype=float)
        self._pose = np.asarray(arrays["object.pose"], dtype=float)
        c = np.cos(self._pose[2])
        s = np.sin(self._pose[2])
        self._to_object = np.array([[c, s], [-s, c]])
        com = self._pose[:2] + np.array([[c, -s], [s, c]]) @ np.asarray(scene.object.com)
        self.arms = self.positions - com  # from the center of mass (C, 2) [m]

    @property
    def pushes(self) -> Array:
        """World forces (C, 2) in the plane on what touches the object [N]."""
        return np.asarray(self.forces[:, :1] * self.normals + self.forces[:, 1:2] * self.across)

    def finger_of(self, contact: int) -> str | None:
        """Name of the finger at a contact, None at a support."""
        return None if np.isnan(self.stations[contact]) else self.names[contact].split(".")[0]

    def of(self, finger: str) -> list[int]:
        return [k for k in range(self.count) if self.finger_of(k) == finger]

    def curvature(self, contact: int) -> float:
        """Curvature of the object's surface at a contact [1/m], infinite at a sharp corner, on which it is within the
        tolerance of stored contacts.
        """
        x, y = self._to_object @ (self.positions[contact] - self._pose[:2])
        part = self.scene.object.parts[int(self._parts[contact])]
        return part.curvature((x, y), EXACT * self.scene.object.size)

    def support_curvature(self, contact: int) -> float | None:
        """Curvature of a wall or peg at its contact [1/m], infinite at the end of a line; None where a flat face lies
        on a wall, which it touches at two points.
        """
        support = self.scene.support_of(self.names[contact])
        if support is None or support.name != self.names[contact]:
            return None
        if isinstance(support, Peg):
            return 1.0 / support.radius if support.radius > 0.0 else math.inf
        offset = float(np.hypot(*(self.positions[contact] - np.asarray(support.point))))
        return math.inf if abs(offset - support.half_length) <= EXACT * self.scene.object.size else 0.0


def cone_edges(contacts: ContactSet) -> Array:
    """Wrenches of both edges of the contacts' friction cones at unit normal force (E, 3): force x, y and moment about
    the center of mass over the torque scale [1], on the object; one edge where there is no friction.

    Contacts alone: every one of them, supports included, may push with any normal force up to one; that fingers bend
    and tendons have limits is the business of `continuum_grasp.grasp.quality.resistance`. In a scene with the weight
    out of the plane the whole planar cones count, as though nothing were lifted.
    """
    arms = contacts.arms
    scale = np.array([1.0, 1.0, contacts.scene.torque_scale])
    normal, across = (
        np.column_stack([on_object, arms[:, 0] * on_object[:, 1] - arms[:, 1] * on_object[:, 0]]) / scale
        for on_object in (-contacts.normals, -contacts.across)
    )
    slopes = [(mu, -mu) if mu > 0.0 else (0.0,) for mu in contacts.friction]
    edges = [normal[k] + slope * across[k] for k, pair in enumerate(slopes) for slope in pair]
    return np.reshape(edges, (-1, 3))


def epsilon_l1(edges: Array) -> float:
    """Signed distance of the origin from the boundary of the convex hull of all edges [1].

    The greatest disturbance, in any direction, that the contacts resist with normal forces that add up to one;
    negative, with the distance from the hull, where the origin is outside.
    """
    # The distance is the least of the support function h(u) over unit vectors u. It is reached at the normal of a
    # facet, or outside at the direction away from the nearest corner or edge: all of these are tried.
    if len(edges) == 0:
        return 0.0
    directions = [-edges, _null_space(edges)]
    if len(edges) > 1:
        a, b = _chosen(edges, 2)
        along = b - a
        share = -np.einsum("ij,ij->i", a, along) / np.maximum(np.einsum("ij,ij->i", along, along), 1e-300)
        directions.append(-(a + np.clip(share, 0.0, 1.0)[:, None] * along))
    if len(edges) > 2:
        a, b, c = _chosen(edges, 3)
        normals = np.cross(b - a, c - a)
        directions += [normals, -normals]
    every = np.concatenate(directions)
    lengths = np.linalg.norm(every, axis=1)
    retained = lengths > 0.0  # the direction of rounding is one more that does no harm
    return float((every[retained] / lengths[retained, None] @ edges.T).max(axis=1).min())


def _chosen(points: Array, count: int) -> list[Array]:
    """All choices of ``count`` points: the first of each choice (K, 3), the second and so on."""
    return [points[list(k)] for k in zip(*combinations(range(len(points)), count), strict=True)]


def _null_space(points: Array) -> Array:
    """Directions, both ways, that are perpendicular to all points."""
    if len(points) == 0:
        return np.concatenate([np.eye(3), -np.eye(3)])
    _, singular, directions = np.linalg.svd(points)
    # Rounding leaves singular values of 1e-16; contacts are placed to 1e-6.
    rank = int((singular > 1e-10 * singular[0]).sum())
    return np.concatenate([directions[rank:], -directions[rank:]])
