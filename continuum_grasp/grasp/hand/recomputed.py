"""Everything about a hand's grasp that follows from its stored numbers, computed anew by numpy alone.

A finger lies in a plane with axes x, y and normal z, along which it is displaced by w. Its sections turn by a small
vector psi in the plane. With the tangent t, across = z x t, contact forces f beyond s and their couples c,

    M = sum c + (p_c - p + (w_c - w) z) x f,  m = M + M_z z x psi,
    psi' = (m . t / G J) t + (m . across / E I_l) across,  w' = -psi . across

to first order in psi and w: a linear system by collocation. The couple of a force at the skin is c = -h n x f.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.grasp.certificate.check import EXACT
from continuum_grasp.grasp.certificate.recomputed import TRACE, RecomputedFinger
from continuum_grasp.grasp.hand.frames import PlaneFrame
from continuum_grasp.grasp.hand.surfaces import PlacedSolid
from continuum_grasp.rod import DenseRod
from continuum_grasp.scene import HandScene

PANEL = 1 / 16
"""Length of the panels for displacements to the side, per length of the finger, with five Gauss points each: in
shipped hands the displacements are then 2e-13 of the length off at most."""
IDLE = 1e-3
"""Greatest friction force, per greatest force, up to which palm or table hold nothing [1]: optima leave 3e-4 of the
weight at contacts that carry nothing."""
OF_CONTACTS = {"positions": (3,), "normals": (3,), "forces": (3,), "stations": (), "deflections": ()}
"""Shapes per contact of the arrays ``contact_...`` beside the names; where contacts bear moments about their normals,
those too."""


@dataclass
class ObjectTouch:
    """A contact of the object, as the hand sees it."""

    name: str
    stored_position: Array
    stored_normal: Array
    stored_station: float
    stored_deflection: float
    load: Array  # force on what the object touches (3,) [N]
    moment: float  # about the normal on it [N m], and its arm: by which a cone bears it beside friction [m]
    arm: float
    friction: float  # coefficient, that less the reserve [1], and greatest normal force [N] in the scene
    held_friction: float
    normal_force_max: float
    point: Array = field(init=False)  # where the object's surface is touched (3,) [m]
    normal: Array = field(init=False)  # outward normal of the object there (3,)

    @property
    def normal_force(self) -> float:
        """Force along the normal [N]; negative where it pulls."""
        return float(self.load @ self.normal)

    @property
    def friction_force(self) -> float:
        """Force across the normal [N]."""
        return float(np.linalg.norm(self.load - self.normal_force * self.normal))

    @property
    def across(self) -> float:
        """Force across the normal with the moment about it, as the friction cone bears them [N]."""
        if not self.moment:
            return self.friction_force
        return math.hypot(self.friction_force, self.moment / self.arm) if self.arm else math.inf

    @property
    def friction_margin(self) -> float:
        """1 - |force across and moment| / (friction coefficient * normal force); 0 where nothing presses."""
        if not self.normal_force > 0.0:
            return 0.0
        return 1.0 - self.across / (self.friction * self.normal_force)


@dataclass
class SupportTouch(ObjectTouch):
    """A contact with palm or table, at the point of the surface nearest to the stored one."""

    support: Any  # palm or table of the scene

    @property
    def height(self) -> float:
        """Distance of the point from the plane [m]."""
        return float((self.point - np.array(self.support.point)) @ np.array(self.support.normal))

    @property
    def beyond(self) -> float:
        """Distance of the point from the disc, along its plane [m]."""
        away = self.point - np.array(self.support.point)
        across = math.sqrt(max(float(away @ away) - self.height**2, 0.0))
        return max(across - float(self.support.radius), 0.0)


@dataclass
class HandTouch(ObjectTouch):
    """A contact of a finger with recomputed geometry, as the hand sees it, without the part in the plane."""

    kind: str  # middle or tip
    joint: int  # number of elements between the finger's base and it
    station: float  # position along the finger [m]
    radius: float  # half the finger's thickness [m]
    force: Array = field(init=False)  # in the finger's plane (2,) [N]
    couple: float = field(init=False)  # about the normal of the plane [N m]
    side: float = field(init=False)  # force along the normal of the plane [N]
    twisting: Array = field(init=False)  # couple in the plane (2,) [N m]
    deflection: float = field(init=False)  # of the backbone along the normal of the plane [m]
    center: Array = field(init=False)  # of the finger's section (3,) [m]
    tangent: Array = field(init=False)  # of the backbone (3,), of length one within its plane
    distance: float = field(init=False)  # of the section's center from the surface [m]


class SpatialFinger:
    """A finger of a hand: what it is in its plane, and how loads to the side displace it."""

    def __init__(
        self, plane: RecomputedFinger, frame: PlaneFrame, gravity: Array, stiffness: tuple[float, float]
    ) -> None:
        self.plane = plane
        self.frame = frame
        self.name = plane.name
        self.length = plane.length
        self.lateral, self.torsion = stiffness  # E I_l and G J [N m2], with E I of the uniform finger
        self.radius = float(plane.thickness[0])  # half the thickness of its base [m]
        self.gravity = gravity  # along the axes of the plane and its normal (3,) [m/s2]
        self.contacts: list[HandTouch] = []

    def respond(self) -> None:
        """Compute the displacement to the side, from the contacts."""
        plane = self.plane
        edges = self.plane.rod.edges
        rod = DenseRod(plane.finger, plane.rod.joints, PANEL, plane.base)
        angle = rod.angle(plane.shape.curvature(rod.nodes))
        along = np.stack([-np.sin(angle), np.cos(angle)])
        across = -np.stack([np.cos(angle), np.sin(angle)])
        gives = plane.stiffness / plane.profile.bending_stiffness(rod.nodes)
        soft = gives * (_squares(along) / self.torsion + _squares(across) / self.lateral)
        # Of turns (2 N,), x before y, the displacements at nodes.
        shifting = -np.hstack([rod.mesh.forward * part for part in across])
        moment, added = self._moments(rod, along, across, shifting)
        turning = np.block([[rod.mesh.forward * part for part in row] for row in soft])
        turns = np.linalg.solve(np.eye(len(turning)) - turning @ added, turning @ moment)
        bent = np.einsum("ijn,jn->in", soft, (moment + added @ turns).reshape(2, -1))
        slopes = -(turns.reshape(2, -1) * across).sum(axis=0)
        edge_across = -np.stack([np.cos(plane.angles), np.sin(plane.angles)])
        # psi (P + 1, 2), w and w' (P + 1,) at the ends of panels.
        self.turns = np.stack([rod.mesh.integrate(part, edges) for part in bent], axis=1)
        self.deflections = rod.mesh.integrate(slopes, edges)
        self.slopes = -(self.turns.T * edge_across).sum(axis=0)
        # The displaced backbone (P + 1, 3), as the hand sees it.
        self.points = self.frame.world(np.column_stack([plane.points, self.deflections]))

    def _moments(self, rod: DenseRod, along: Array, across: Array, shifting: Array) -> tuple[Array, Array]:
        """Moments in the plane (2 N,) of all loads beyond each node, in the axes of its section where it did not turn,
        and the matrix (2 N, 2 N) of what turns of the sections add to them [N m].
        """
        plane, mesh, s = self.plane, rod.mesh, rod.nodes
        points = rod.start[:, None] + mesh.to_nodes(along)
        sideways = np.zeros((2, s.size))
        about = np.zeros(s.size)
        added = np.zeros((2, s.size, 2 * s.size))

        def add(force: Array, away: Array, shifts: Array) -> None:
            """Loads (3,) at places away (2, N), displaced by turns times shifts (N, 2 N) more than the nodes."""
            sideways[:] += force[2] * np.stack([away[1], -away[0]])  # D x z
            about[:] += away[0] * force[1] - away[1] * force[0]
            added[:] += np.stack([-force[1] * shifts, force[0] * shifts])  # z x F

        loads = [(c.station, np.append(c.force, c.side), np.append(c.twisting, c.couple)) for c in self.contacts]
        loads += [(body.at, body.mass * self.gravity, np.zeros(3)) for body in plane.finger.masses]
        for station, force, couple in loads:
            there = s < station
            place = plane.points[plane.rod.edge_index(station)]
            shift = -(np.where(there, rod.weights, 0.0) * across).ravel()
            add(force, (place[:, None] - points) * there, (shift - shifting) * there[:, None])
            sideways += couple[:2, None] * there
            about += couple[2] * there
        if self.gravity.any():
            density = plane.profile.linear_density(s)
            beyond = mesh.backward * density
            mass = beyond.sum(axis=1)
            add(self.gravity, points @ beyond.T - mass * points, beyond @ shifting - mass[:, None] * shifting)
        # Sections that turned see the moment about the normal from the side: M z x psi.
        nodes = np.arange(s.size)
        added[0, nodes, s.size + nodes] -= about
        added[1, nodes, nodes] += about
        return sideways.ravel(), added.reshape(2 * s.size, 2 * s.size)

    def place(self, contact: HandTouch) -> None:
        """Find where a contact is in the hand, from the displacement."""
        edge = int(self.plane.joint_edges[contact.joint])
        angle = self.plane.angles[edge]
        contact.deflection = float(self.deflections[edge])
        contact.center = self.points[edge]
        contact.tangent = self.frame.axes @ np.array([-np.sin(angle), np.cos(angle), self.slopes[edge]])


def _squares(vectors: Array) -> Array:
    """Matrices v v^T (2, 2, N) of vectors (2, N)."""
    return np.asarray(vectors[:, None] * vectors)


class RecomputedHand:
    """Shapes, normals and forces of a hand's grasp from its stored numbers, complete and of the right shapes."""

    def __init__(self, scene: HandScene, arrays: Mapping[str, Any]) -> None:
        self.scene = scene
        self.surface = PlacedSolid(scene)
        self.size, self.com = scene.object.size, scene.object.com
        self.gravity = np.array(scene.acceleration, dtype=float)
        self.frames = PlaneFrame.each(scene)
        self.fingers = tuple(self._finger(k, arrays) for k in range(len(scene.setups)))
        self.names = [str(name) for name in np.asarray(arrays["contact_names"]).ravel()]
        self.carried = list[SupportTouch]()  # contacts with palm and table
        self.contacts = self._contacts(arrays)  # with fingers
        for finger in self.fingers:
            finger.respond()
            for contact in finger.contacts:
                finger.place(contact)
        if self.contacts:
            near = self.surface.nearest(np.stack([contact.center for contact in self.contacts]))
            for k, contact in enumerate(self.contacts):
                contact.point = near.point[k]
                contact.normal = near.normal[k]
                contact.distance = float(near.distance[k])
        if self.carried:
            near = self.surface.nearest(np.stack([contact.stored_position for contact in self.carried]))
            for k, carried in enumerate(self.carried):
                carried.point = near.point[k]
                carried.normal = -np.array(carried.support.normal)
        forces = [float(np.linalg.norm(contact.load)) for contact in self.touches]
        # What a residual force is compared with [N]: the forces on the object, and a trace of what bends a finger.
        least = TRACE * min(f.plane.stiffness / f.length**2 for f in self.fingers)
        self.force_scale = float(np.max([*forces, scene.weight, least]))

    @property
    def touches(self) -> list[ObjectTouch]:
        """All contacts of the object, in the order in which they are stored."""
        return sorted([*self.contacts, *self.carried], key=lambda contact: self.names.index(contact.name))

    @property
    def pressing(self) -> list[ObjectTouch]:
        """Contacts that hold something: beyond the tolerance of balance, of supports beyond a cone's apex."""
        least = {c.name: IDLE / max(c.friction, math.sqrt(IDLE)) for c in self.carried}
        return [c for c in self.touches if c.normal_force > least.get(c.name, EXACT) * self.force_scale]

    def _finger(self, k: int, arrays: Mapping[str, Any]) -> SpatialFinger:
        setup = self.scene.setups[k]
        frame = self.frames[k]
        gravity = frame.axes.T @ self.gravity
        plane = RecomputedFinger(setup, (float(gravity[0]), float(gravity[1])), arrays)
        section = (self.scene.hand.named_bases[setup.name].finger or self.scene.hand.finger).cross_section
        stiffness = setup.stiffness * section.lateral, setup.stiffness * section.torsion
        return SpatialFinger(plane, frame, gravity, stiffness)

    def _contacts(self, arrays: Mapping[str, Any]) -> list[HandTouch]:
        stored = {key: np.asarray(arrays[f"contact_{key}"], dtype=float) for key in of_contacts(self.scene)}
        moments = stored.get("moments", np.zeros(len(self.names)))
        known = known_touches(self.scene)
        contacts = []
        supports = {support.name: support for support in self.scene.supports}
        for k, name in enumerate(self.names):
            common: dict[str, Any] = {
                "name": name,
                "stored_position": stored["positions"][k],
                "stored_normal": stored["normals"][k],
                "stored_station": float(stored["stations"][k]),
                "stored_deflection": float(stored["deflections"][k]),
                "load": stored["forces"][k],
                "moment": float(moments[k]),
            }
            support = supports.get(support_of(name))
            if support is not None:
                limits = self.scene.contacts
                held = support.friction * (1.0 - limits.reserve)
                most = limits.normal_force_max
                self.carried.append(SupportTouch(**common, arm=0.0, friction=support.friction, held_friction=held,
                                                 normal_force_max=most, support=support))  # fmt: skip
                continue
            if name not in known:  # which `touches_check` counts
                continue
            owner, kind, joint = known[name]
            finger = self.fingers[owner]
            setup = self.scene.setups[owner]
            contact = HandTouch(
                **common,
                arm=self.scene.contacts.torsional_friction / setup.friction if setup.friction else 0.0,
                friction=setup.friction,
                held_friction=setup.held_friction,
                normal_force_max=setup.normal_force_max,
                kind=kind,
                joint=joint,
                station=finger.plane.joint_position(joint),
                radius=float(finger.plane.skin(finger.plane.joint_position(joint))),
            )
            load, normal = (finger.frame.axes.T @ vector for vector in (contact.load, contact.stored_normal))
            couple = contact.moment * normal - contact.radius * np.cross(normal, load)
            contact.force = load[:2]
            contact.side = float(load[2])
            contact.twisting = couple[:2]
            contact.couple = float(couple[2])
            finger.contacts.append(contact)
            in_plane: list[Any] = finger.plane.contacts  # which take joint, force and couple alone
            in_plane.append(contact)
            contacts.append(contact)
        return contacts


def of_contacts(scene: HandScene) -> dict[str, tuple[int, ...]]:
    """Shapes per contact of the arrays ``contact_...`` of a scene beside the names."""
    more: dict[str, tuple[int, ...]] = {"moments": ()} if scene.contacts.torsional_friction else {}
    return OF_CONTACTS | more


def known_touches(scene: HandScene) -> dict[str, tuple[int, str, int]]:
    """Contacts that a scene can have by name: index of the finger, kind, joint."""
    known: dict[str, tuple[int, str, int]] = {}
    for k, setup in enumerate(scene.setups):
        known |= {name: (k, "middle", joint) for name, joint in zip(setup.middle_names, setup.before, strict=True)}
        known[setup.tip_name] = k, "tip", setup.elements
    return known


def support_of(name: str) -> str:
    """Name of the support of a contact such as ``palm_1``; empty of other contacts."""
    support, _, number = name.rpartition("_")
    return support if number.isdecimal() else ""
