"""Everything about a grasp that follows from its stored numbers, computed anew by numpy alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.grasp.certificate.drives import StoredFinger
from continuum_grasp.grasp.certificate.surfaces import PlacedObject
from continuum_grasp.grasp.shape import skin
from continuum_grasp.rod import DenseRod
from continuum_grasp.scene import FingerSetup, GraspScene, Peg, Wall

TRACE = 1e-4
"""Part of E I / L^2 that a contact force counts as at least: of it residuals may be 1e-6, and solvers, which leave
1e-11 as a rule, may leave 1e-10 of forces that are zero."""
SHARE = 1e-3
"""Part of the greatest moment in a finger that a load's moment counts as at least: an elastic moment and the moment of
tendons which balance each other to 1e-9 leave as much."""
OF_FINGER = "q", "lengths", "curvature_shapes", "tip_curvature", "tensions", "base", "backbone"
OF_CONTACTS = tuple(f"contact_{key}" for key in ("names", "positions", "normals", "forces", "stations", "parts"))
"""Names of the arrays stored of each finger, after its name and a dot, and of the contacts."""


class RecomputedFinger(StoredFinger):
    """Shape, loads and potential of one finger of a grasp."""

    def __init__(self, setup: FingerSetup, gravity: tuple[float, float], arrays: Mapping[str, Any]) -> None:
        super().__init__(setup, arrays)
        self.q = self.shape.q
        self.lengths = self.shape.lengths
        self.matches_tip = self.shape.matches_tip
        self.stored_tip_curvature = float(self.shape.tip)
        self.stored_backbone = np.asarray(arrays[f"{self.name}.backbone"], dtype=float)
        self.length = self.profile.length
        self.stiffness = setup.stiffness
        self.gravity = np.asarray(gravity)
        self.rod = DenseRod(self.finger, self.shape.joints, base=self.base)  # 400 panels at least
        self.curvature = self.shape.curvature(self.rod.nodes)  # at the Gauss points
        self.angles = self.rod.edge_angle(self.curvature)  # (P + 1,) [rad] and (P + 1, 2) [m] at the ends of panels
        self.points = self.rod.edge_points(self.curvature)
        self.skin = skin(self.profile.half_thickness)
        # Half the thickness (P + 1,) at the ends of panels [m].
        self.thickness = self.skin(self.rod.edges)
        self.joint_edges = np.searchsorted(self.rod.edges, self.rod.joints)
        self.contacts: list[RecomputedContact] = []

    def joint_position(self, joint: int) -> float:
        """Position of a joint along the finger [m]."""
        return float(self.rod.joints[joint])

    @property
    def moment_scale(self) -> float:
        """Greatest moment in play [N m], with a floor for straight fingers."""
        # 1 %: a straight finger under a force along it has no moment at all, and rounding would count.
        bent = float(np.abs(self.shape.moment(self.rod.nodes)).max())
        drive = float(np.abs(self.shape.actuation(self.rod.nodes)).max())
        return float(np.max([drive, bent, 0.01 * (self.stiffness / self.length)]))

    @property
    def load_moment(self) -> float:
        """Moment that residual moments are compared with [N m]: the greatest moment of contact forces and weight, to
        which what bends the finger adds little, however stiff it is.
        """
        s = self.rod.edges
        moment = np.zeros(self.rod.edges.size)
        greatest = 0.0
        for contact in self.contacts:
            edge = self.joint_edges[contact.joint]
            force = contact.force
            arm = self.points[edge] - self.points
            moment += np.where(s <= s[edge], arm[:, 0] * force[1] - arm[:, 1] * force[0] + contact.couple, 0.0)
            greatest = max(greatest, float(np.hypot(*force)))
        # A force along a straight finger has no moment, but counts by 1 % of what it had across.
        least = 0.01 * greatest * self.length, 0.1 * self.weight * self.length, SHARE * self.moment_scale
        return float(np.max([np.abs(moment).max(), *least]))

    @property
    def weight(self) -> float:
        """Weight of the finger and the masses on it [N]."""
        rod_mass = float(self.profile.linear_density(self.rod.nodes) @ self.rod.weights)
        return float(np.hypot(*self.gravity)) * (rod_mass + sum(mass.mass for mass in self.finger.masses))

    def virtual_work(self) -> Array:
        """Virtual work of all moments and forces in each bending coordinate, per greatest turn of a section (n,) [N m]:
        in equilibrium the potential of bending, weight, tendons and contact forces is stationary.
        """
        # The tension falls at another rate in each friction cell, and dry friction has another moment in each.
        cells = [friction.edges[1:-1].tolist() for friction in (self.friction, self.dry) if friction is not None]
        marks = [*(mass.at for mass in self.finger.masses), *(edge for edges in cells for edge in edges)]
        # 1 / 64: panels for the equilibrium: with five Gauss points each, exact to rounding; the fine ones are for
        # clearances
        rod = DenseRod(self.finger, self.shape.joints, (1 / 64), self.base, marks=marks)
        # A complex step subtracts nothing, so the derivative is exact to rounding (Squire and Trapp 1998).
        elastic = self.shape.elastic(rod.nodes, self.q + 1e-30j * np.eye(self.q.size))
        curvature = self.profile.rest_curvature(rod.nodes) + elastic
        angle, turns = rod.angle(curvature), rod.edge_angle(curvature)
        points = rod.edge_points(curvature, angle)
        work = self._potential(rod, elastic, angle, points)
        for contact in self.contacts:
            edge = rod.edge_index(rod.joints[contact.joint])
            work = work - points[..., edge, :] @ contact.force - contact.couple * turns[..., edge]
        return np.asarray(work.imag / np.abs(turns.imag).max(axis=-1))

    def _potential(self, rod: DenseRod, elastic: Array, angle: Array, points: Array) -> Array:
        """Energy of bending and of all loads but contacts (...,) [J]."""
        s = rod.nodes
        energy = 0.5 * (elastic**2 @ (rod.weights * self.profile.bending_stiffness(s)))
        # What bends the finger at rest does no work here.
        pulled = self.shape.actuation(s) if self.friction is None else self.friction.moment(s, self.tensions)
        energy = energy - elastic @ (rod.weights * pulled)
        if self.dry is not None:
            energy = energy + elastic @ (rod.weights * self.dry.moment(s))
        if self.gravity.any():
            energy = energy - rod.first_moment(self.profile.linear_density(s), angle) @ self.gravity
            for mass in self.finger.masses:
                energy = energy - mass.mass * (points[..., rod.edge_index(mass.at), :] @ self.gravity)
        return np.asarray(energy)


@dataclass
class RecomputedContact:
    """A contact, its geometry found anew; world frame."""

    name: str
    kind: str  # middle, station, tip, wall or peg
    finger: RecomputedFinger | None
    joint: int  # number of elements between the finger's base and it; -1 for supports
    support: Wall | Peg | None
    part: int  # of the object that it touches
    # Of the round body that touches the object: half the finger's thickness, the peg's; infinite for a wall [m].
    radius: float
    length: float  # what gaps are compared with [m]
    stored_position: Array
    stored_normal: Array
    stored_station: float
    normal_force: float  # these three [N]
    friction_force: float
    lift: float
    friction: float  # coefficient, that less the reserve [1], and greatest normal force [N] in the scene
    held_friction: float
    normal_force_max: float
    normal: Array = field(init=False)  # outward normal of the object (2,)
    point: Array = field(init=False)  # where its surface is touched (2,) [m]
    surface_radius: float = field(init=False)  # radius of curvature of the object's surface there [m]
    gap: float = field(init=False)  # how far apart the bodies are, or how deep in each other [m]
    # How far the point lies from where a body with this normal would touch, seen from ``length`` away [m].
    tilt: float = field(init=False)
    buried: float = field(init=False)  # how deep the point lies inside another part of the object [m]

    @property
    def force(self) -> Array:
        """World force on what touches the object [N]."""
        return self.normal_force * self.normal + self.friction_force * across(self.normal)

    @property
    def couple(self) -> float:
        """Moment of the friction force, which acts at the surface, about a finger's backbone [N m]."""
        return -self.radius * self.friction_force

    @property
    def friction_margin(self) -> float:
        """1 - |friction force| / (friction coefficient * normal force); 0 where nothing presses."""
        if not self.normal_force > 0.0:
            return 0.0
        return 1.0 - float(np.hypot(self.friction_force, self.lift)) / (self.friction * self.normal_force)


class RecomputedGrasp:
    """Shapes, normals and forces of a grasp from its stored numbers, complete and of the right shapes."""

    def __init__(self, scene: GraspScene, arrays: Mapping[str, Any]) -> None:
        self.scene, self.arrays = scene, arrays
        self.setups = scene.setups
        self.fingers = tuple(RecomputedFinger(setup, scene.gravity[:2], arrays) for setup in self.setups)
        self.pose = np.asarray(arrays["object.pose"], dtype=float)
        self.object = PlacedObject(scene.object, self.pose)
        self.size = scene.object.size
        self.names = [str(name) for name in np.asarray(arrays["contact_names"]).ravel()]
        self.forces = np.asarray(arrays["contact_forces"], dtype=float).reshape(-1, 3)
        # What a residual force is compared with [N]: the forces on the object, whatever bends the fingers. Where there
        # are none, as of a touch without weight, a trace of what bends a finger.
        least = TRACE * min(f.stiffness / f.length**2 for f in self.fingers)
        self.force_scale = float(np.max([np.abs(self.forces).max(initial=0.0), scene.weight, least]))
        self.contacts = self._contacts(arrays)
        for contact in self.contacts:
            if contact.finger is not None:
                contact.finger.contacts.append(contact)

    def _contacts(self, arrays: Mapping[str, Any]) -> list[RecomputedContact]:
        positions, normals, stations, parts = (
            np.asarray(arrays[f"contact_{key}"], dtype=float) for key in ("positions", "normals", "stations", "parts")
        )
        known = known_contacts(self.scene)
        contacts = []
        for k, name in enumerate(self.names):
            if name not in known:  # which `mode_check` counts
                continue
            kind, owner, joint, support = known[name]
            finger = None if owner is None else self.fingers[owner]
            if finger is not None:
                radius = float(finger.skin(finger.joint_position(joint)))
                length = finger.length
            else:
                radius = support.radius if isinstance(support, Peg) else np.inf
                length = max(self.size, *(recomputed.length for recomputed in self.fingers))
            place = name, kind, finger, joint, support, int(parts[k]), radius, length
            stored = positions[k], normals[k], float(stations[k])
            n, f, lift = (float(value) for value in self.forces[k])
            limits = self.scene.friction(name), self.scene.held_friction(name), self.scene.normal_force_max(name)
            contacts.append(RecomputedContact(*place, *stored, n, f, lift, *limits))
        self._touch(contacts)
        return contacts

    def _touch(self, contacts: list[RecomputedContact]) -> None:
        """Normals and points of contact from the geometry, and what does not fit."""
        if not contacts:
            return
        parts = [c.part for c in contacts]
        centers = np.stack([_center(c) for c in contacts])
        deep = 2.0 * self.scene.solver.penetration_tolerance  # of both faces in a notch
        surfaces = [
            self.object.touched(c.part, at, c.stored_normal, deep * c.length)
            for c, at in zip(contacts, centers, strict=True)
        ]
        near = self.object.nearest_of(centers, surfaces)
        for k, c in enumerate(contacts):
            unit = c.stored_normal / max(float(np.hypot(*c.stored_normal)), 1e-300)
            if isinstance(c.support, Wall):  # a face may touch anywhere along it: the place is the stored one
                c.normal = -np.asarray(c.support.normal)
                c.point = centers[k]
                c.gap = float(np.max(np.abs([near.distance[k], c.support.height((centers[k][0], centers[k][1]))])))
                continue
            if c.kind == "middle" and c.finger is not None:  # tangent: the finger's own normal
                angle = c.finger.angles[c.finger.joint_edges[c.joint]]
                normal = np.array([np.cos(angle), np.sin(angle)])
                normal = normal if normal @ unit >= 0.0 else -normal
                # The finger is as thick as discs along it: where these grow, the skin leans by the slope of the radius.
                lean = c.finger.skin.slope(c.finger.joint_position(c.joint))
                c.normal = np.sqrt(1.0 - lean**2) * normal + lean * np.array([-np.sin(angle), np.cos(angle)])
            else:
                # 1e-3: least radius of a tip, as a part of the length, from whose center the normal follows precisely
                c.normal = unit if c.radius < 1e-3 * c.length else near.normal[k]
            c.point = centers[k] - c.radius * c.normal
            c.gap = abs(float(near.distance[k]) - c.radius)
        # From afar along the normal, the object's nearest point is the point of contact if the normal is right.
        points = np.stack([c.point for c in contacts])
        away = np.array([c.length for c in contacts])
        seen = self.object.nearest_of(points + away[:, None] * np.stack([c.normal for c in contacts]), surfaces)
        off = np.hypot(*(seen.point - points).T)
        depths = -self.object.distances(points) if len(self.object.parts) > 1 else np.zeros((1, len(contacts)))
        depths[parts, range(len(contacts))] = 0.0
        for k, c in enumerate(contacts):
            c.surface_radius = float(seen.radius[k])
            c.tilt = float(off[k])
            c.buried = float(np.max(depths[:, k]))


def known_contacts(scene: GraspScene) -> dict[str, tuple[str, int | None, int, Wall | Peg | None]]:
    """Contacts that a scene can have by name: kind, index of the finger, joint, support."""
    known: dict[str, tuple[str, int | None, int, Wall | Peg | None]] = {}
    for k, setup in enumerate(scene.setups):
        for name, joint in zip(setup.middle_names, setup.before, strict=True):
            known[name] = "station" if setup.stations else "middle", k, joint, None
        known[setup.tip_name] = "tip", k, setup.elements, None
    for wall in scene.walls:  # a flat face lies on a wall with both of its ends
        known |= dict.fromkeys((wall.name, f"{wall.name}.1", f"{wall.name}.2"), ("wall", None, -1, wall))
    return known | {peg.name: ("peg", None, -1, peg) for peg in scene.pegs}


def across(normal: Array | tuple[float, float]) -> Array:
    """The normal turned by +90 degrees."""
    return np.array([-normal[1], normal[0]])


def _center(contact: RecomputedContact) -> Array:
    """World position of the round body that touches the object; of a wall, the stored contact."""
    if contact.finger is not None:
        return np.asarray(contact.finger.points[contact.finger.joint_edges[contact.joint]])
    return np.asarray(contact.support.position if isinstance(contact.support, Peg) else contact.stored_position)
