"""A finger of a planar grasp problem with its contacts, and fingers that keep clear of each other."""

from __future__ import annotations

from functools import cached_property, lru_cache

import casadi as ca

from continuum_grasp.grasp.problem.blocks import rotation
from continuum_grasp.grasp.problem.disturbance import add_disturbances, add_push
from continuum_grasp.grasp.problem.limits import keep_apart, keep_clear, keep_limits
from continuum_grasp.grasp.problem.planar import PlanarPart, Touch
from continuum_grasp.grasp.problem.structure import ContactSpec, FingerSpec, ProblemSpec
from continuum_grasp.grasp.problem.unit_finger import UnitFinger


class PlanarFinger(PlanarPart):
    """A finger, and its contacts with the object; ``curled``: it must not pass through itself."""

    name = "{0}."

    def __init__(self, spec: ProblemSpec, finger: FingerSpec, contacts: tuple[ContactSpec, ...], curled: bool):
        super().__init__(spec)
        tip = next((self.force(contact) for contact in contacts if contact.joint == -1), ca.SX(3, 1))
        self.finger = UnitFinger(finger, self.x, self.numbers, tip)
        self.fingers.append(self.finger)
        for contact in contacts:
            self._close(self.touch(contact))
        self._rest()
        self.bear(ca.SX(3, 1), ca.SX(3, 1))
        self._land()
        points = keep_clear(self, self.finger)
        keep_limits(self, self.finger)
        if curled:
            keep_apart(self, (self.finger, self.finger), (points, points))
        self.aim(self._effort())
        if "greatest_disturbance" in spec.aims:
            add_disturbances(self, ca.SX(3, spec.wrenches))
        if spec.pushed:
            add_push(self, ca.SX(0))
        if spec.steadied:
            self.steady(ca.SX(0))

    def _close(self, contact: Touch) -> None:
        """The finger touches: no gap, and a middle contact is tangent.

        Stations that lie along the object would all be tangent by dependent equations; guards beside them
        keep them so within their tolerance.
        """
        finger, spec = self.finger, contact.spec
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

    def _rest(self) -> None:
        """Equilibrium under tensions and contact forces, and what the drives wind up."""
        finger, require = self.finger, self.rows.require
        share = finger.number("force share")
        back = rotation(-finger.base[2])
        forces = {c.spec.joint: back @ c.world[:2] / share for c in self.contacts}
        # Friction acts on the skin: it turns the backbone by its arm, half the thickness.
        couples = {c.spec.joint: -finger.half_at(finger.end_of(c.spec)) * c.force[1] / share for c in self.contacts}
        missing = finger.missing_force(finger.q, finger.u, finger.loads(forces, couples))
        # In units of the whole problem, so that the residuals of different fingers compare.
        scale = share * finger.number("length")
        require(f"finger equilibrium, {finger.spec.name}", scale * missing, "N m", finger.spec.name)
        drive = finger.number("length") * finger.drive_rows()
        require(f"drive, {finger.spec.name}", drive, "m", f"{finger.spec.name}.tendons.drive")

    def _land(self) -> None:
        """A tip stays where it touched: on the place of the surface next to where it met the object."""
        for contact in self.contacts if self.spec.yielding and self.finger.spec.lands else ():
            normal = contact.local.normal
            at = self.x(f"landing, {contact.spec.name}", 2)
            off = ca.dot(ca.vertcat(-normal[1], normal[0]), contact.local.point - at)
            self.rows.require(f"landing, {contact.spec.name}", off, "m", "robust")

    def _effort(self) -> ca.SX:
        """The aims that concern tensions."""
        finger = self.finger
        # Tensions always count, if only by a little: they are unique then.
        total = finger.number("tension weight") * ca.sum1(finger.pulls)
        if self.reserve is not None:
            # Tensions that are chosen anew change as little as they can.
            change = (finger.pulls - finger.number("pull_held", 2)) / finger.number("pull_max")
            # 1e-2: weight of squared changes of tension, per greatest tension, beside the reserve of the cones: far
            # below the reserve, per weight, that they bring
            total += 1e-2 * ca.sumsqr(change)
        return total

    @cached_property
    def along(self) -> list[int]:
        """Contacts in their order along the finger, by index."""
        return sorted(range(len(self.contacts)), key=lambda k: self.finger.end_of(self.contacts[k].spec))

    # -- functions that read a point -----------------------------------------------------------------------------

    @cached_property
    def places(self) -> ca.Function:
        """Guarded places but for the probes (2, K), half the finger's thickness there, curvatures, and `stored`."""
        finger = self.finger
        points, _, _, half = finger.guarded
        count = len(finger.unprobed)
        return self.read(points[:, :count], half[:count], finger.curvatures()[1], *finger.stored())

    @cached_property
    def stored(self) -> ca.Function:
        """Coordinates, lengths, curvature at the tip, pulls and base, as a result stores them, and middle contacts."""
        return self.read(*self.finger.stored(), ca.vertcat(*self.finger.joints))

    @cached_property
    def state(self) -> ca.Function:
        """Arguments of the functions that the finger shares with others."""
        return self.read(self.finger.q, self.finger.u, self.finger.p)


class PlanarPair(PlanarPart):
    """Two fingers that keep clear of each other; ``tips`` are the contacts at theirs, where they touch."""

    def __init__(self, spec: ProblemSpec, pair: tuple[FingerSpec, FingerSpec], tips: tuple[ContactSpec | None, ...]):
        super().__init__(spec)
        for finger, tip in zip(pair, tips, strict=True):
            force = ca.SX(3, 1) if tip is None else self.force(tip)
            self.fingers.append(UnitFinger(finger, self.x, self.numbers, force))
        first, other = self.fingers
        keep_apart(self, (first, other), (first.guarded[0], other.guarded[0]))


finger_part = lru_cache(maxsize=64)(PlanarFinger)
"""The part of a finger; built once in a process."""
pair_part = lru_cache(maxsize=64)(PlanarPair)
