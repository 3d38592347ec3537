"""Everything about a grasp that follows from its stored numbers, computed anew by numpy alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.certificate.recomputed_finger import FingerLoad, RecomputedFinger
from continuum_grasp.grasp.certificate.surfaces import PlacedObject
from continuum_grasp.scene.grasp import GraspScene
from continuum_grasp.scene.supports import Peg, Wall

Array = NDArray[Any]

_BLUNT = 1e-3
"""Least radius of a tip, as a part of the length, from whose center the normal follows precisely."""


@dataclass
class RecomputedContact:
    """One contact, its geometry found anew.

    Attributes
    ----------
    name, kind : str
        ``middle``, ``tip``, ``wall`` or ``peg``.
    index : int
        Its row in the stored arrays.
    finger : RecomputedFinger or None
    joint : int
        Number of elements between the finger's base and it; -1 for supports.
    support : Wall, Peg or None
    part : int
        Part of the object that it touches.
    radius : float
        Of the round body that touches the object: half the finger's thickness, the peg's; infinite for a wall [m].
    length : float
        What gaps are compared with [m].
    stored_position, stored_normal : ndarray, shape (2,)
    normal_force, friction_force, lift : float
        [N]
    friction, normal_force_max : float
        Friction coefficient [1] and limit [N] in the scene.
    normal, point : ndarray, shape (2,)
        Outward normal of the object, and where its surface is touched [m], in the world.
    surface_radius : float
        Radius of curvature of the object's surface there [m].
    gap : float
        How far apart the bodies are, or how deep in each other [m].
    tilt : float
        How far the point lies from where a body with this normal would touch, seen from ``length`` away [m].
    buried : float
        How deep the point lies inside another part of the object [m].
    """

    name: str
    kind: str
    index: int
    finger: RecomputedFinger | None
    joint: int
    support: Wall | Peg | None
    part: int
    radius: float
    length: float
    stored_position: Array
    stored_normal: Array
    stored_station: float
    normal_force: float
    friction_force: float
    lift: float
    friction: float
    normal_force_max: float
    normal: Array = field(init=False)
    point: Array = field(init=False)
    surface_radius: float = field(init=False)
    gap: float = field(init=False)
    tilt: float = field(init=False)
    buried: float = field(init=False)

    @property
    def force(self) -> Array:
        """World force on what touches the object [N]."""
        return self.normal_force * self.normal + self.friction_force * across(self.normal)

    @property
    def friction_margin(self) -> float:
        """1 - |friction force| / (friction coefficient * normal force); 0 where nothing presses."""
        if not self.normal_force > 0.0:
            return 0.0
        return 1.0 - float(np.hypot(self.friction_force, self.lift)) / (self.friction * self.normal_force)


class RecomputedGrasp:
    """Shapes, normals and forces of a grasp from its stored numbers.

    Parameters
    ----------
    scene : GraspScene
    arrays : mapping
        See `continuum_grasp.grasp.certify`; complete and of the right shapes.
    """

    def __init__(self, scene: GraspScene, arrays: Mapping[str, Any]) -> None:
        self.scene, self.setups = scene, scene.setups
        self.walls, self.pegs = scene.walls, scene.pegs
        self.fingers = tuple(RecomputedFinger(setup, scene.gravity, arrays) for setup in self.setups)
        self.pose = np.asarray(arrays["object.pose"], dtype=float)
        self.object = PlacedObject(scene.object, self.pose)
        self.size = scene.object.size
        self.names = [str(name) for name in np.asarray(arrays["contact_names"]).ravel()]
        self.forces = np.asarray(arrays["contact_forces"], dtype=float).reshape(-1, 3)
        least = 0.01 * min(f.stiffness / f.length**2 for f in self.fingers)
        self.force_scale = float(np.max([np.abs(self.forces).max(initial=0.0), scene.weight, least]))
        """What a residual force is compared with [N]."""
        self.contacts = self._contacts(arrays)
        for contact in self.contacts:
            if contact.finger is not None:
                couple = -contact.finger.thickness * contact.friction_force
                contact.finger.loads.append(FingerLoad(contact.name, contact.joint, contact.force, couple))

    def of(self, finger: RecomputedFinger) -> list[RecomputedContact]:
        """Contacts of a finger."""
        return [contact for contact in self.contacts if contact.finger is finger]

    def _contacts(self, arrays: Mapping[str, Any]) -> list[RecomputedContact]:
        known = known_contacts(self.scene)
        positions = np.asarray(arrays["contact_positions"], dtype=float)
        normals = np.asarray(arrays["contact_normals"], dtype=float)
        stations = np.asarray(arrays["contact_stations"], dtype=float)
        parts = np.asarray(arrays["contact_parts"], dtype=float).astype(int)
        reach = float(max(finger.length for finger in self.fingers))
        found = []
        for k, name in enumerate(self.names):
            if name not in known:
                continue
            kind, owner, joint = known[name]
            finger = self.fingers[owner] if kind in ("middle", "tip") else None
            support = self.walls[owner] if kind == "wall" else self.pegs[owner] if kind == "peg" else None
            rounded = np.inf if finger is None else finger.thickness
            n, f, lift = (float(value) for value in self.forces[k])
            found.append(
                RecomputedContact(
                    name,
                    kind,
                    k,
                    finger,
                    joint,
                    support,
                    int(parts[k]),
                    support.radius if isinstance(support, Peg) else rounded,
                    max(reach, self.size) if finger is None else finger.length,
                    positions[k],
                    normals[k],
                    float(stations[k]),
                    n,
                    f,
                    lift,
                    self.scene.friction(name),
                    self.scene.normal_force_max(name),
                )
            )
        self._touch(found)
        return found

    def _touch(self, contacts: list[RecomputedContact]) -> None:
        """Normals and points of contact from the geometry, and what does not fit."""
        if not contacts:
            return
        parts = [c.part for c in contacts]
        centers = np.stack([_center(c) for c in contacts])
        near = self.object.nearest_of(centers, parts)
        for k, c in enumerate(contacts):
            unit = c.stored_normal / max(float(np.hypot(*c.stored_normal)), 1e-300)
            if isinstance(c.support, Wall):
                c.normal, c.point = -np.asarray(c.support.normal), centers[k]
                c.gap = float(np.max(np.abs([near.distance[k], c.support.height((centers[k][0], centers[k][1]))])))
                continue
            if c.kind == "middle" and c.finger is not None:  # tangent: the finger's own normal
                angle = c.finger.angles[c.finger.joint_edges[c.joint]]
                own = np.array([np.cos(angle), np.sin(angle)])
                c.normal = own if own @ unit >= 0.0 else -own
            else:
                c.normal = unit if c.radius < _BLUNT * c.length else near.normal[k]
            c.point = centers[k] - c.radius * c.normal
            c.gap = abs(float(near.distance[k]) - c.radius)
        points = np.stack([c.point for c in contacts])
        away = np.array([c.length for c in contacts])
        seen = self.object.nearest_of(points + away[:, None] * np.stack([c.normal for c in contacts]), parts)
        off = np.hypot(*(seen.point - points).T)
        depths = -self.object.distances(points) if len(self.object.parts) > 1 else np.zeros((1, len(contacts)))
        depths[parts, range(len(contacts))] = 0.0
        for k, c in enumerate(contacts):
            c.surface_radius, c.tilt = float(seen.radius[k]), float(off[k])
            c.buried = float(np.max(depths[:, k]))


def known_contacts(scene: GraspScene) -> dict[str, tuple[str, int, int]]:
    """Contacts that a scene can have by name: kind, index of finger, wall or peg, joint."""
    known: dict[str, tuple[str, int, int]] = {}
    for k, setup in enumerate(scene.setups):
        for name, joint in zip(setup.middle_names, setup.before, strict=True):
            known[name] = "middle", k, joint
        known[setup.tip_name] = "tip", k, setup.elements
    for k, wall in enumerate(scene.walls):
        known |= dict.fromkeys((wall.name, f"{wall.name}.1", f"{wall.name}.2"), ("wall", k, -1))
    for k, peg in enumerate(scene.pegs):
        known[peg.name] = "peg", k, -1
    return known


def across(normal: Array) -> Array:
    """The normal turned by +90 degrees."""
    return np.array([-normal[1], normal[0]])


def _center(contact: RecomputedContact) -> Array:
    """World position of the round body that touches the object; of a wall, the stored contact."""
    if contact.finger is not None:
        return np.asarray(contact.finger.points[contact.finger.joint_edges[contact.joint]])
    return np.asarray(contact.support.position if isinstance(contact.support, Peg) else contact.stored_position)
