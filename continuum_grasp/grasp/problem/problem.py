"""The grasp as a nonlinear programme: unknowns, named constraints, objective.

Units of the problem: length of the longest finger, greatest E I / L^2 of the fingers as force, radians. Each finger's
mechanics are those of `continuum_grasp.model.FingerModel` in units of its own; element lengths are run-time parameters,
so that middle contacts, which are joints of two elements, can move along the finger. With surface point p, outward
normal n and half thickness h:

    middle    r(s) = p + h n,  n across the finger there (tangency)
    tip       r(L) = p + h n
    finger    inverse dynamics at rest = 0, contact forces N n + f t and couples -h f included
    object    weight - sum (N n + f t) = 0, moments about the centre of mass, lift out of the plane

All numbers of the scene are run-time arguments: two scenes of one make share one solver.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from continuum_grasp.grasp.problem.blocks import BlockList
from continuum_grasp.grasp.problem.limits import add_limits
from continuum_grasp.grasp.problem.numbers import Numbers
from continuum_grasp.grasp.problem.objective import add_objective
from continuum_grasp.grasp.problem.relaxations import RELAXATIONS
from continuum_grasp.grasp.problem.structure import ContactMake, ProblemMake
from continuum_grasp.grasp.problem.unit_finger import FingerMake, UnitFinger, rotation
from continuum_grasp.model.surfaces.surface import SurfacePoint

__all__ = ["FingerState", "GraspProblem", "TouchState"]


@dataclass(frozen=True)
class FingerState:
    """A finger's unknowns and what follows from them, as expressions.

    Attributes
    ----------
    make : FingerMake
    unit : UnitFinger
    q : casadi.SX
        Bending coordinates of the unit finger.
    joints : list of casadi.SX
        Positions of the middle contacts, as parts of the length.
    pulls : casadi.SX
        (2,) tensions times offset, in E I / L of the finger.
    base : casadi.SX
        (3,) x, y and angle in the world.
    u, p : casadi.SX
        Input and run-time argument of the unit finger's model.
    ends : casadi.SX
        (2, N) world positions of the elements' ends.
    angles : casadi.SX
        (N,) world angles there.
    """

    make: FingerMake
    unit: UnitFinger
    q: ca.SX
    joints: list[ca.SX]
    pulls: ca.SX
    base: ca.SX
    u: ca.SX
    p: ca.SX
    ends: ca.SX
    angles: ca.SX

    def world(self, points: ca.SX) -> ca.SX:
        """World positions (2, K) of points of the unit finger."""
        turned = self.unit.number("length") * rotation(self.base[2]) @ points
        return turned + ca.repmat(self.base[:2], 1, points.shape[1])

    def end_of(self, contact: ContactMake) -> int:
        """Index of the element at whose end a contact sits."""
        return self.make.elements - 1 if contact.joint < 0 else self.make.before[contact.joint] - 1


@dataclass(frozen=True)
class TouchState:
    """A contact's unknowns and what follows from them, as expressions in the world.

    Attributes
    ----------
    make : ContactMake
    point, normal : casadi.SX
        (2,) surface point and outward normal of the object.
    local : SurfacePoint
        The same in the object's frame.
    force : casadi.SX
        (3,) N, f, lift.
    """

    make: ContactMake
    point: ca.SX
    normal: ca.SX
    local: SurfacePoint
    force: ca.SX

    @property
    def across(self) -> ca.SX:
        """The normal turned by +90 degrees."""
        return ca.vertcat(-self.normal[1], self.normal[0])

    @property
    def world(self) -> ca.SX:
        """Force on what touches the object."""
        return self.force[0] * self.normal + self.force[1] * self.across


class GraspProblem:
    """Unknowns, constraint blocks and objective of a grasp.

    Parameters
    ----------
    make : ProblemMake

    Attributes
    ----------
    make : ProblemMake
    parts : BlockList
        Unknowns and constraints.
    numbers : Numbers
        Run-time numbers.
    fingers : list of FingerState
    contacts : list of TouchState
    pose : casadi.SX
        (3,) of the object.
    give : dict of str to casadi.SX
        By how much each limit that can be relaxed gives way.
    objective : casadi.SX
    """

    def __init__(self, make: ProblemMake) -> None:
        self.make = make
        self.parts, self.numbers = BlockList(), Numbers()
        self.give = {r.name: self.parts.unknown(f"relaxed {r.name}", r.size) for r in RELAXATIONS}
        self.pose = self.parts.unknown("object pose", 3) if make.free else self.numbers("object pose", 3)
        if "greatest_friction_margin" in make.aims:
            self.parts.unknown("friction margin")
        self._forces = {c.name: self._force(c) for c in make.contacts}
        self.fingers = [self._finger(finger) for finger in make.fingers]
        self.contacts = [self._touch(contact) for contact in make.contacts]
        for contact in self.contacts:
            self._close(contact)
        for k, finger in enumerate(self.fingers):
            missing = finger_balance(finger, [c for c in self.contacts if c.make.finger == k])
            scale = finger.unit.number("force share") * finger.unit.number("length")
            self.parts.require(f"finger equilibrium, {finger.make.name}", scale * missing, "N m", finger.make.name)
        self._balance_object()
        add_limits(self)
        self.objective = add_objective(self)

    # -- unknowns --------------------------------------------------------------------------------------------

    def _force(self, contact: ContactMake) -> ca.SX:
        force = self.parts.unknown(f"force, {contact.name}", 3 if self.make.gravity == "out_of_plane" else 2)
        return force if force.numel() == 3 else ca.vertcat(force, 0.0)

    def _finger(self, make: FingerMake) -> FingerState:
        unit, add = UnitFinger(make, self.numbers), self.parts.unknown
        q = add(f"{make.name}.q", unit.model.n)
        joints = [
            add(f"{make.name}.joint_{k}") if on else unit.number(f"joint_{k}") for k, on in enumerate(make.touching)
        ]
        pulls = add(f"{make.name}.pulls", 2)
        base = add(f"{make.name}.base", 3) if make.free else unit.number("base", 3)
        tip = next((self._forces[c.name] for c in self.make.contacts if self._on_tip(c, make)), ca.SX.zeros(3))
        couple = -unit.number("thickness") * tip[1] / unit.number("force share") if make.tip else ca.SX(0)
        u = unit.input(pulls, couple)
        p = unit.parameters(ca.SX(ca.vertcat(*unit.element_lengths(joints))), base[2])
        ends, angles = unit.model.joints(q, u, p)
        turned = unit.number("length") * rotation(base[2]) @ ends
        return FingerState(
            make, unit, q, joints, pulls, base, u, p, turned + ca.repmat(base[:2], 1, ends.shape[1]), angles + base[2]
        )

    def _on_tip(self, contact: ContactMake, finger: FingerMake) -> bool:
        return contact.joint == -1 and self.make.fingers[contact.finger] == finger

    def _touch(self, contact: ContactMake) -> TouchState:
        number = self.numbers
        if contact.finger < 0 and not self.make.free:  # where it sits is known
            local = SurfacePoint(number(f"{contact.name}.point", 2), number(f"{contact.name}.normal", 2), ca.SX(0, 1))
        else:
            place = self.parts.unknown(f"place, {contact.name}", 2)
            surface = contact.surface
            local = surface.point(place, number(f"{contact.name}.feature", surface.feature_count))
        self.parts.require(f"contact on the surface, {contact.name}", local.on_surface, "1", "object")
        turn = rotation(self.pose[2])
        point = self.pose[:2] + turn @ local.point
        return TouchState(contact, point, turn @ local.normal, local, self._forces[contact.name])

    # -- equations -------------------------------------------------------------------------------------------

    def _close(self, contact: TouchState) -> None:
        """The contact's gap is zero."""
        make, require, key = contact.make, self.parts.require, f"contacts.{contact.make.name}"
        if make.finger >= 0:
            finger = self.fingers[make.finger]
            end = finger.end_of(make)
            gap = finger.ends[:, end] - contact.point - self.thickness(finger) * contact.normal
            require(f"contact gap, {make.name}", gap, "m", key)
            if make.joint >= 0:
                along = ca.vertcat(-ca.sin(finger.angles[end]), ca.cos(finger.angles[end]))
                require(f"contact tangency, {make.name}", ca.dot(along, contact.normal), "rad", key)
        elif self.make.free:
            key = f"supports.{make.name}"
            if make.peg:
                centre, radius = self.numbers(f"{make.name}.position", 2), self.numbers(f"{make.name}.radius")
                require(f"contact gap, {make.name}", contact.point + radius * contact.normal - centre, "m", key)
                return
            normal, at = self.numbers(f"{make.name}.wall normal", 2), self.numbers(f"{make.name}.wall point", 2)
            along = ca.vertcat(-normal[1], normal[0])
            require(f"contact gap, {make.name}", ca.dot(normal, contact.point - at), "m", key)
            require(f"contact normal, {make.name}", ca.dot(along, contact.normal), "rad", key)
            if make.bounded:
                off, half = ca.dot(along, contact.point - at), self.numbers(f"{make.name}.half length")
                within = ca.vertcat(half - off, half + off)
                require(f"contact within its support, {make.name}", within, "m", key, upper=ca.inf)

    def thickness(self, finger: FingerState) -> ca.SX:
        """Half thickness of a finger."""
        return finger.unit.number("thickness") * finger.unit.number("length")

    @property
    def centre_of_mass(self) -> ca.SX:
        """World position of the object's centre of mass (2,)."""
        return self.pose[:2] + rotation(self.pose[2]) @ self.numbers("centre of mass", 2)

    def _balance_object(self) -> None:
        require, number = self.parts.require, self.numbers
        force, moment, lift, tilt = ca.SX.zeros(2), ca.SX(0), ca.SX(0), ca.SX.zeros(2)
        for contact in self.contacts:
            arm, load = contact.point - self.centre_of_mass, contact.world
            force -= load
            moment -= arm[0] * load[1] - arm[1] * load[0]
            lift += contact.force[2]
            tilt += contact.force[2] * arm
        if self.make.gravity == "planar":
            force += number("weight", 2) * (1.0 - self.give["mass"])
        require("object force balance", force, "N", "object.mass")
        require("object moment balance", moment / number("size"), "N", "object")
        if self.make.gravity == "out_of_plane":
            require("object lift balance", lift - number("weight") * (1.0 - self.give["mass"]), "N", "object.mass")
            if self.make.tilt:
                balance = (tilt - self.give["tilt balance"]) / number("size")
                require("object tilt balance", balance, "N", "gravity.tilt")


def finger_balance(finger: FingerState, contacts: list[TouchState]) -> ca.SX:
    """Generalised force that a finger lacks for rest, in E I / L of it."""
    unit = finger.unit
    share, h = unit.number("force share"), unit.number("thickness")
    back = rotation(-finger.base[2])
    zero = ca.SX.zeros(2)
    forces: dict[int, Any] = {c.make.joint: back @ c.world / share for c in contacts}
    couples = {c.make.joint: -h * c.force[1] / share for c in contacts}
    middles = range(len(finger.make.before))
    w = [*(forces.get(k, zero) for k in middles), forces.get(-1, zero), *(couples.get(k, 0.0) for k in middles)]
    rest = ca.SX.zeros(unit.model.n)
    missing = unit.model.inverse_dynamics(finger.q, rest, rest, finger.u, ca.vertcat(*w), finger.p)
    return missing - unit.hanging_masses(finger.q, finger.u, finger.p, finger.base[2])
