"""Unknowns, constraints and run-time numbers of a grasp: their layout, which is known without expressions, and its
fingers and contacts as expressions.
"""

from __future__ import annotations

import json
from dataclasses import dataclass

import casadi as ca

from continuum_grasp.grasp.problem.blocks import Columns, ConstraintRows, Expressed, Places, in_space, rotation
from continuum_grasp.grasp.problem.relaxations import RELAXATIONS
from continuum_grasp.grasp.problem.structure import ContactSpec, FingerSpec, ProblemSpec
from continuum_grasp.grasp.problem.unit_finger import UnitFinger, shared_by
from continuum_grasp.model import Family, SurfacePoint


@dataclass(frozen=True)
class Touch:
    """A contact's unknowns and what follows from them, as expressions in the world."""

    spec: ContactSpec
    point: ca.SX  # (2,) of the object's surface
    normal: ca.SX  # (2,) outward, of the object
    local: SurfacePoint  # the same in the object's frame
    force: ca.SX  # (3,) N, f, lift; the lift acts on the object, and is structurally zero in the plane

    @property
    def across(self) -> ca.SX:
        """The normal turned by +90 degrees."""
        return ca.vertcat(-self.normal[1], self.normal[0])

    @property
    def world(self) -> ca.SX:
        """Force on what touches the object (3,)."""
        return ca.vertcat(self.force[0] * self.normal + self.force[1] * self.across, -self.force[2])


class Unknowns:
    """Unknowns and numbers in which constraints and objective of a grasp are written."""

    def __init__(self, spec: ProblemSpec) -> None:
        self.spec = spec
        self.x, self.numbers = Columns(), Columns()  # unknowns, run-time numbers
        self.rows = Expressed()  # constraints
        # By how much each limit that can be relaxed is relaxed.
        self.slack = {r.name: self.x(f"relaxed {r.name}", r.size) for r in RELAXATIONS}
        # By how much all cones could be narrower, per force reference; negative where contacts would slip or part.
        self.reserve = self.x("reserve") if "greatest_reserve" in spec.aims else None
        self.pose = self.x("object pose", 3) if spec.free else self.numbers("object pose", 3)
        if "greatest_friction_margin" in spec.aims:
            self.x("friction margin")
        forces = {c.name: in_space(self.x(f"force, {c.name}", spec.dimensions)) for c in spec.contacts}
        tips = {c.finger: forces[c.name] for c in spec.contacts if c.joint == -1}
        self.fingers = [
            UnitFinger(finger, self.x, self.numbers, tips.get(k, ca.SX(3, 1))) for k, finger in enumerate(spec.fingers)
        ]
        self.contacts = [self._touch(contact, forces[contact.name]) for contact in spec.contacts]

    @property
    def center_of_mass(self) -> ca.SX:
        """World position of the object's center of mass (2,)."""
        return self.pose[:2] + rotation(self.pose[2]) @ self.numbers("center of mass", 2)

    def loads(self, index: int) -> ca.SX:
        """The loads on a finger's model by its contacts."""
        finger = self.fingers[index]
        touching = [c for c in self.contacts if c.spec.finger == index]
        share = finger.number("force share")
        back = rotation(-finger.base[2])
        forces = {c.spec.joint: back @ c.world[:2] / share for c in touching}
        # Friction acts on the skin: it turns the backbone by its arm, half the thickness.
        couples = {c.spec.joint: -finger.half_at(finger.end_of(c.spec)) * c.force[1] / share for c in touching}
        return finger.loads(forces, couples)

    def _touch(self, contact: ContactSpec, force: ca.SX) -> Touch:
        name, number, surface = contact.name, self.numbers, contact.surface
        if contact.finger < 0 and not self.spec.free:  # a fixed object: numbers in place of unknowns
            local = SurfacePoint(number(f"{name}.point", 2), number(f"{name}.normal", 2), ca.SX(0, 1))
        else:
            local = surface.point(
                self.x(f"place, {name}", surface.place_count), number(f"{name}.feature", surface.feature_count)
            )
        self.rows.require(f"contact on the surface, {name}", local.on_surface, "1", "object")
        turn = rotation(self.pose[2])
        return Touch(contact, self.pose[:2] + turn @ local.point, turn @ local.normal, local, force)


@dataclass(frozen=True)
class FingerLayout:
    """Layout of a finger."""

    spec: FingerSpec
    size: int  # number of its bending coordinates
    elements: list[int]  # that guarded places but for the probes are in
    touches: list[bool]  # whether the finger touches the object there, of all guarded places

    @property
    def family(self) -> Family:
        """The family of the unit finger's elements."""
        return shared_by(self.spec).model.structure.family


@dataclass(frozen=True, eq=False)
class Layout:
    """Unknowns, run-time numbers, constraints and fingers of a grasp problem."""

    spec: ProblemSpec
    x: Places  # the unknowns
    numbers: Places  # the run-time numbers
    rows: ConstraintRows
    fingers: list[FingerLayout]

    @staticmethod
    def of(spec: ProblemSpec, text: str) -> Layout:
        """The layout of a structure from what `described` wrote of it."""
        x, numbers, blocks, guarded = json.loads(text)
        rows = ConstraintRows()
        for name, key, unit, count, lower, upper in blocks:
            rows.rows(name, key, unit, count, 1.0, lower, upper)
        pairs = zip(spec.fingers, guarded, strict=True)
        fingers = [FingerLayout(finger, x[f"{finger.name}.q"], *places) for finger, places in pairs]
        return Layout(spec, Places(x), Places(numbers), rows, fingers)
