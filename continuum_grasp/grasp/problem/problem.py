"""The grasp as a nonlinear problem (NLP): unknowns, named constraints, objective.

Units of the problem: length of the longest finger, greatest E I / L^2 of the fingers as force, radians. Each finger's
mechanics come from `continuum_grasp.model.FingerModel` in units of its own; element lengths are run-time parameters,
so that middle contacts, which are joints of two elements, can move along the finger. With surface point p, outward
normal n and half thickness h:

    middle    r(s) = p + h n,  n across the finger there (tangency)
    tip       r(L) = p + h n,  the finger not coming from within
    finger    inverse dynamics at rest = 0, contact forces N n + f t and couples -h f included
    object    weight - sum (N n + f t) + lift = 0, moments about the center of mass: six rows, less empty ones

All numbers of the scene are run-time arguments: two scenes of one structure share one solver.
"""

from __future__ import annotations

import casadi as ca

from continuum_grasp.grasp.certificate.check import EXACT
from continuum_grasp.grasp.problem.blocks import in_space
from continuum_grasp.grasp.problem.disturbance import add_disturbances
from continuum_grasp.grasp.problem.limits import add_limits
from continuum_grasp.grasp.problem.relaxations import RELAXATIONS
from continuum_grasp.grasp.problem.structure import ProblemSpec
from continuum_grasp.grasp.problem.unit_finger import UnitFinger
from continuum_grasp.grasp.problem.unknowns import Touch, Unknowns


class GraspProblem(Unknowns):
    """Unknowns, constraints and objective (a casadi.SX) of a grasp."""

    def __init__(self, spec: ProblemSpec) -> None:
        super().__init__(spec)
        for contact in self.contacts:
            if contact.spec.finger >= 0:
                self._close(contact, self.fingers[contact.spec.finger])
            elif self.spec.free:
                self._close_support(contact)
        for k, finger in enumerate(self.fingers):
            missing = finger.missing_force(finger.q, finger.u, self.loads(k))
            # In units of the whole problem, so that the residuals of different fingers compare.
            scale = finger.number("force share") * finger.number("length")
            self.rows.require(f"finger equilibrium, {finger.spec.name}", scale * missing, "N m", finger.spec.name)
            drive = finger.number("length") * finger.drive_rows()
            self.rows.require(f"drive, {finger.spec.name}", drive, "m", f"{finger.spec.name}.tendons.drive")
        self._balance_object()
        self._land()
        add_limits(self)
        self.objective = self._objective()
        if spec.steadied:
            # The least eigenvalue of the second-order test, to first order about a point, is not below a level.
            x = self.x.symbol
            value = ca.dot(self.numbers("stability slope", x.numel()), x) - self.numbers("stability level")
            self.rows.require("stability", value, "1", "stability", upper=ca.inf)

    def _close(self, contact: Touch, finger: UnitFinger) -> None:
        """A finger touches: no gap, and a middle contact is tangent.

        Stations that lie along the object would all be tangent by dependent equations; guards beside them
        keep them so within their tolerance.
        """
        spec = contact.spec
        require = self.rows.require
        key = f"contacts.{contact.spec.name}"
        end = finger.end_of(spec)
        gap = finger.ends[:, end] - contact.point - finger.half(spec) * contact.normal
        require(f"contact gap, {spec.name}", gap, "m", key)
        if spec.joint >= 0 and finger.spec.stations:
            return
        along = ca.vertcat(-ca.sin(finger.angles[end]), ca.cos(finger.angles[end]))
        # The finger is as thick as discs along it: where these grow, the skin leans by the slope of the radius.
        tilt = ca.dot(along, contact.normal) - finger.lean(spec)
        if spec.joint >= 0:
            require(f"contact tangency, {spec.name}", tilt, "rad", key)
        else:
            # Else it would come from within the object, if only by the tolerance: places before the tip, guarded where
            # they are deepest, would follow it by halves, as often the optimum touches with the side of the tip. An
            # angle e leaves a depth of e^2 / 2 per relative curvature; an arc that fits a disc needs one.
            # 1e3: angle of the tip that clearance relaxed by one unit of length allows [rad]: any, from a thousandth on
            spare = ca.sqrt(self.numbers("tolerance")) + 1e3 * self.slack["clearance at the object"] - tilt
            require(f"contact direction, {spec.name}", spare, "rad", key, upper=ca.inf)

    def _close_support(self, contact: Touch) -> None:
        """A support touches the object, whose pose is sought."""
        name = contact.spec.name
        require = self.rows.require
        number = self.numbers
        key = f"supports.{name}"
        if contact.spec.peg:
            center = number(f"{name}.position", 2)
            radius = number(f"{name}.radius")
            require(f"contact gap, {name}", contact.point + radius * contact.normal - center, "m", key)
            return
        normal, at = number(f"{name}.wall normal", 2), number(f"{name}.wall point", 2)
        along = ca.vertcat(-normal[1], normal[0])
        gap = ca.dot(normal, contact.point - at)
        # Within the tolerance, not zero: where the object cannot leave or enter the support, because its pose is free
        # along it alone or other supports hold it, equations would be dependent (egg: no start converged).
        spare = number("tolerance") + ca.vertcat(-gap, gap)
        require(f"contact gap, {name}", spare, "m", key, upper=ca.inf)
        # The wall's normal decides, but a face that lies flat does not lift off within the tolerance of its gaps.
        tilt = ca.dot(along, contact.normal)
        require(f"contact normal, {name}", tilt, "rad", key, lower=-EXACT, upper=EXACT)
        if contact.spec.bounded:
            off = ca.dot(along, contact.point - at)
            half = number(f"{name}.half length")
            within = ca.vertcat(half - off, half + off)
            require(f"contact within its support, {name}", within, "m", key, upper=ca.inf)

    def _land(self) -> None:
        """A tip stays where it touched: on the place of the surface next to where it met the object."""
        for contact in self.contacts:
            if self.spec.lands(contact.spec):
                normal = contact.local.normal
                at = self.x(f"landing, {contact.spec.name}", 2)
                off = ca.dot(ca.vertcat(-normal[1], normal[0]), contact.local.point - at)
                self.rows.require(f"landing, {contact.spec.name}", off, "m", "robust")

    def _balance_object(self) -> None:
        require = self.rows.require
        number = self.numbers
        balances = self.spec.balances
        force = in_space(number("weight", self.spec.dimensions)) * (1.0 - self.slack["mass"])
        moment = in_space(self.slack["tilt balance"])
        for contact in self.contacts:
            # What a contact does to the finger or support, it does to the object with the opposite sign.
            arm = in_space(contact.point - self.center_of_mass)
            load = contact.world
            force -= load
            moment -= ca.cross(arm, load)
        require("object force balance", force[[k for k in balances if k < 3]], "N", "object.mass")
        # Per size of the object, so that moments compare with forces.
        moment = moment[[k - 3 for k in balances if k >= 3]] / number("size")
        require("object moment balance", moment, "moment per size", "object")

    def _objective(self) -> ca.SX:
        """The objective; its own unknowns and constraints are added to the problem."""
        number = self.numbers
        aims = self.spec.aims
        total = ca.SX(0)
        # Tensions always count, if only by a little: they are unique then.
        total += sum(f.number("tension weight") * ca.sum1(f.pulls) for f in self.fingers)
        if "least_normal_force" in aims:
            # Least maximum as a smooth problem: a bound on all normal forces, which is minimized.
            greatest = self.x("greatest normal force")
            for contact in self.contacts:
                spare = greatest - contact.force[0]
                self.rows.require(f"greatest normal force, {contact.spec.name}", spare, "N", "objective", upper=ca.inf)
            total += number("normal weight") * greatest
        if "greatest_friction_margin" in aims:
            total -= number("margin weight") * self.x("friction margin")
        if self.reserve is not None:
            total -= self.reserve
            # Tensions that are chosen anew change as little as they can.
            changes = ((f.pulls - f.number("pull_held", 2)) / f.number("pull_max") for f in self.fingers)
            # 1e-2: weight of squared changes of tension, per greatest tension, beside the reserve of the cones: far
            # below the reserve, per weight, that they bring
            total += 1e-2 * sum(ca.sumsqr(change) for change in changes)
        if "greatest_disturbance" in aims:
            total -= number("disturbance weight") * add_disturbances(self)
        forces = ca.vertcat(*(c.force for c in self.contacts)) / number("force reference")
        # 1e-8: weight of the squared contact forces (scaled) beside what is sought, so that they are unique: with more
        # than three contacts equilibrium alone does not fix them. It changes the optimum by less than the certificate
        # resolves.
        effort = total + 1e-8 * ca.sumsqr(forces)
        slacks = (self.slack[r.name] for r in RELAXATIONS)
        # 1e-6: rounding of the norm of a relaxation with several components (scaled): keeps its derivative finite at
        # zero
        relaxed = ca.vertcat(*(z if z.numel() == 1 else ca.sqrt(ca.sumsqr(z) + 1e-6**2) for z in slacks))
        weights = number("relaxation weights", len(RELAXATIONS))
        return number("effort weight") * effort + ca.dot(weights, relaxed)
