"""The grasp as a nonlinear problem (NLP): unknowns, named constraints, objective.

Units of the problem: length of the longest finger, greatest E I / L^2 of the fingers as force, radians. Each finger's
mechanics are those of `continuum_grasp.model.FingerModel` in units of its own; element lengths are run-time parameters,
so that middle contacts, which are joints of two elements, can move along the finger. With surface point p, outward
normal n and half thickness h:

    middle    r(s) = p + h n,  n across the finger there (tangency)
    tip       r(L) = p + h n
    finger    inverse dynamics at rest = 0, contact forces N n + f t and couples -h f included
    object    weight - sum (N n + f t) = 0, moments about the center of mass, lift out of the plane

All numbers of the scene are run-time arguments: two scenes of one structure share one solver.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from continuum_grasp.grasp.problem.disturbance import add_disturbances
from continuum_grasp.grasp.problem.limits import add_limits
from continuum_grasp.grasp.problem.relaxations import RELAXATIONS
from continuum_grasp.grasp.problem.structure import ProblemSpec
from continuum_grasp.grasp.problem.unit_finger import rotation
from continuum_grasp.grasp.problem.unknowns import FingerState, TouchState, Unknowns

_REGULARIZATION = 1e-8
"""Weight of the squared contact forces (scaled) beside what is sought, so that they are unique: with more than three
contacts equilibrium alone does not fix them. It changes the optimum by less than the certificate resolves."""
_TINY = 1e-6
"""Rounding of the norm of a relaxation with several components (scaled): keeps its derivative finite at zero."""


class GraspProblem(Unknowns):
    """Unknowns, constraint blocks and objective of a grasp.

    Parameters
    ----------
    spec : ProblemSpec

    Attributes
    ----------
    objective : casadi.SX
    """

    def __init__(self, spec: ProblemSpec) -> None:
        super().__init__(spec)
        for contact in self.contacts:
            self._close(contact)
        for k, finger in enumerate(self.fingers):
            # In units of the whole problem, so that the residuals of different fingers compare.
            missing = finger_balance(finger, [c for c in self.contacts if c.spec.finger == k])
            scale = finger.unit.number("force share") * finger.unit.number("length")
            self.parts.require(f"finger equilibrium, {finger.spec.name}", scale * missing, "N m", finger.spec.name)
        self._balance_object()
        add_limits(self)
        self.objective = _add_objective(self)

    def _close(self, contact: TouchState) -> None:
        """The contact's gap is zero."""
        spec, require, key = contact.spec, self.parts.require, f"contacts.{contact.spec.name}"
        if spec.finger >= 0:
            finger = self.fingers[spec.finger]
            end = finger.end_of(spec)
            gap = finger.ends[:, end] - contact.point - self.thickness(finger) * contact.normal
            require(f"contact gap, {spec.name}", gap, "m", key)
            if spec.joint >= 0:
                along = ca.vertcat(-ca.sin(finger.angles[end]), ca.cos(finger.angles[end]))
                require(f"contact tangency, {spec.name}", ca.dot(along, contact.normal), "rad", key)
        elif self.spec.free:
            key = f"supports.{spec.name}"
            if spec.peg:
                center, radius = self.numbers(f"{spec.name}.position", 2), self.numbers(f"{spec.name}.radius")
                require(f"contact gap, {spec.name}", contact.point + radius * contact.normal - center, "m", key)
                return
            normal, at = self.numbers(f"{spec.name}.wall normal", 2), self.numbers(f"{spec.name}.wall point", 2)
            along = ca.vertcat(-normal[1], normal[0])
            require(f"contact gap, {spec.name}", ca.dot(normal, contact.point - at), "m", key)
            require(f"contact normal, {spec.name}", ca.dot(along, contact.normal), "rad", key)
            if spec.bounded:
                off, half = ca.dot(along, contact.point - at), self.numbers(f"{spec.name}.half length")
                within = ca.vertcat(half - off, half + off)
                require(f"contact within its support, {spec.name}", within, "m", key, upper=ca.inf)

    def _balance_object(self) -> None:
        require, number = self.parts.require, self.numbers
        force, moment, lift, tilt = ca.SX.zeros(2), ca.SX(0), ca.SX(0), ca.SX.zeros(2)
        for contact in self.contacts:
            arm, load = contact.point - self.center_of_mass, contact.world
            force -= load
            moment -= arm[0] * load[1] - arm[1] * load[0]
            lift += contact.force[2]
            tilt += contact.force[2] * arm
        if self.spec.gravity == "planar":
            force += number("weight", 2) * (1.0 - self.slack["mass"])
        require("object force balance", force, "N", "object.mass")
        # Per size of the object, so that moments compare with forces.
        require("object moment balance", moment / number("size"), "N", "object")
        if self.spec.gravity == "out_of_plane":
            require("object lift balance", lift - number("weight") * (1.0 - self.slack["mass"]), "N", "object.mass")
            if self.spec.tilt:
                balance = (tilt - self.slack["tilt balance"]) / number("size")
                require("object tilt balance", balance, "N", "gravity.tilt")


def finger_balance(finger: FingerState, contacts: list[TouchState]) -> ca.SX:
    """Generalized force that a finger lacks for rest, in E I / L of it."""
    unit = finger.unit
    share, h = unit.number("force share"), unit.number("thickness")
    back = rotation(-finger.base[2])
    zero = ca.SX.zeros(2)
    forces: dict[int, Any] = {c.spec.joint: back @ c.world / share for c in contacts}
    couples = {c.spec.joint: -h * c.force[1] / share for c in contacts}
    middles = range(len(finger.spec.before))
    w = [*(forces.get(k, zero) for k in middles), forces.get(-1, zero), *(couples.get(k, 0.0) for k in middles)]
    rest = ca.SX.zeros(unit.model.n)
    missing = unit.model.inverse_dynamics(finger.q, rest, rest, finger.u, ca.vertcat(*w), finger.p)
    return missing - unit.hanging_masses(finger.q, finger.u, finger.p, finger.base[2])


def _add_objective(problem: Unknowns) -> ca.SX:
    """The objective; its unknowns and constraints are added to the problem."""
    parts, number, aims = problem.parts, problem.numbers, problem.spec.aims
    total = ca.SX(0)
    total += sum(f.unit.number("tension weight") * ca.sum1(f.pulls) for f in problem.fingers)
    if "least_normal_force" in aims:
        greatest = parts.unknown("greatest normal force")
        for contact in problem.contacts:
            spare = greatest - contact.force[0]
            parts.require(f"greatest normal force, {contact.spec.name}", spare, "N", "objective", upper=ca.inf)
        total += number("normal weight") * greatest
    if "greatest_friction_margin" in aims:
        total -= number("margin weight") * parts.variables["friction margin"].symbol
    if "greatest_disturbance" in aims:
        total -= number("disturbance weight") * add_disturbances(problem)
    forces = ca.vertcat(*(c.force for c in problem.contacts)) / number("force reference")
    effort = total + _REGULARIZATION * ca.sumsqr(forces)
    given = (problem.slack[r.name] for r in RELAXATIONS)
    relaxed = ca.vertcat(*(z if z.numel() == 1 else ca.sqrt(ca.sumsqr(z) + _TINY**2) for z in given))
    weights = number("relaxation weights", len(RELAXATIONS))
    return number("effort weight") * effort + ca.dot(weights, relaxed)
