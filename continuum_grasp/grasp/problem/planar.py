"""Parts of a planar grasp problem: they share the object's pose, and have contacts with it as expressions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca

from continuum_grasp.grasp.problem.blocks import in_space, rotation
from continuum_grasp.grasp.problem.parts import ProblemPart
from continuum_grasp.grasp.problem.relaxations import RELAXATIONS
from continuum_grasp.grasp.problem.structure import ContactSpec, ProblemSpec
from continuum_grasp.grasp.problem.unit_finger import UnitFinger
from continuum_grasp.model import SurfacePoint


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


class PlanarPart(ProblemPart):
    """A part of a planar problem; ``spec`` has what all of its parts share.

    Attributes
    ----------
    fingers : list of UnitFinger
    contacts : list of Touch
        Contacts of the part, whose specifications count these fingers.
    """

    def __init__(self, spec: ProblemSpec) -> None:
        super().__init__([relaxation.name for relaxation in RELAXATIONS])
        self.spec, self.balances = spec, spec.balances
        self.fingers, self.contacts = list[UnitFinger](), list[Touch]()
        self.pose = self.x("object pose", 3) if spec.free else self.numbers("object pose", 3)
        if "greatest_reserve" in spec.aims:
            self.reserve = self.x("reserve")

    @property
    def center_of_mass(self) -> ca.SX:
        """World position of the object's center of mass (2,)."""
        return self.pose[:2] + rotation(self.pose[2]) @ self.numbers("center of mass", 2)

    def force(self, contact: ContactSpec) -> ca.SX:
        """Force at a contact (3,): N, f, lift."""
        return in_space(self.x(f"force, {contact.name}", self.spec.dimensions))

    def touch(self, contact: ContactSpec) -> Touch:
        """Append a contact of the part."""
        name, number, surface = contact.name, self.numbers, contact.surface
        if contact.finger < 0 and not self.spec.free:  # a fixed object: numbers in place of unknowns
            local = SurfacePoint(number(f"{name}.point", 2), number(f"{name}.normal", 2), ca.SX(0, 1))
        else:
            local = surface.point(
                self.x(f"place, {name}", surface.place_count), number(f"{name}.feature", surface.feature_count)
            )
        self.rows.require(f"contact on the surface, {name}", local.on_surface, "1", "object")
        turn = rotation(self.pose[2])
        touch = Touch(contact, self.pose[:2] + turn @ local.point, turn @ local.normal, local, self.force(contact))
        self.contacts.append(touch)
        return touch

    def bear(self, force: ca.SX, moment: ca.SX) -> None:
        """Cones and limits of the contacts, and what they, a force and a moment do to the object."""
        for contact in self.contacts:
            name = contact.spec.name
            friction = self.numbers(f"{name}.friction") + self.slack["friction"]
            if "greatest_friction_margin" in self.spec.aims:
                friction *= 1.0 - self.x("friction margin")
            self.bound(name, contact.force[: self.spec.dimensions], friction)
        # What a contact does to the finger or support, it does to the object with the opposite sign.
        arms = (in_space(contact.point - self.center_of_mass) for contact in self.contacts)
        loads = [(arm, contact.world, ca.SX(3, 1)) for arm, contact in zip(arms, self.contacts, strict=True)]
        self.balance(force, moment, loads)

    def aim(self, effort: ca.SX) -> None:
        """Add to an effort what makes contact forces unique, and this to the objective."""
        number = self.numbers
        if "least_normal_force" in self.spec.aims:
            # Least maximum as a smooth problem: a bound on all normal forces, which is minimized.
            greatest = self.x("greatest normal force")
            for contact in self.contacts:
                spare = greatest - contact.force[0]
                self.rows.require(f"greatest normal force, {contact.spec.name}", spare, "N", "objective", upper=ca.inf)
        forces = ca.vertcat(*(contact.force for contact in self.contacts)) / number("force reference")
        # 1e-8: weight of the squared contact forces (scaled) beside what is sought, so that they are unique: with more
        # than three contacts equilibrium alone does not fix them. It changes the optimum by less than the certificate
        # resolves.
        self.objective += number("effort weight") * (effort + 1e-8 * ca.sumsqr(forces))

    @cached_property
    def touched(self) -> ca.Function:
        """Per contact a column: world point (2, C), normal (2, C), force (3, C), point of the object's frame (2, C)."""
        each = self.contacts
        return self.read(
            _columns(2, [contact.point for contact in each]),
            _columns(2, [contact.normal for contact in each]),
            _columns(3, [contact.force for contact in each]),
            _columns(2, [contact.local.point for contact in each]),
        )


def _columns(size: int, vectors: Sequence[ca.SX]) -> ca.SX:
    return ca.horzcat(ca.SX(size, 0), *vectors)
