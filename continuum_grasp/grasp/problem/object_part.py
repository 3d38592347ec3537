"""The object of a planar grasp problem and its supports: balance, clearance between them, and what is sought of all."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import casadi as ca

from continuum_grasp.grasp.certificate.check import EXACT
from continuum_grasp.grasp.problem.blocks import in_space, rotation
from continuum_grasp.grasp.problem.disturbance import add_disturbances, add_push
from continuum_grasp.grasp.problem.planar import PlanarPart, Touch
from continuum_grasp.grasp.problem.relaxations import RELAXATIONS
from continuum_grasp.grasp.problem.structure import ContactSpec, ProblemSpec
from continuum_grasp.model import Surface, TouchingCircle


class PlanarObject(PlanarPart):
    """The object, whose parts have ``surfaces``, and its contacts with supports."""

    def __init__(self, spec: ProblemSpec, surfaces: tuple[Surface[Any], ...], supports: tuple[ContactSpec, ...]):
        super().__init__(spec)
        for support in supports:
            contact = self.touch(support)
            if spec.free:
                self._close(contact)
        weight = in_space(self.numbers("weight", spec.dimensions)) * (1.0 - self.slack["mass"])
        self.bear(weight, in_space(self.slack["tilt balance"]))
        if spec.free:
            self._keep_clear(surfaces)
        self.aim(self._effort())
        slacks = (self.slack[r.name] for r in RELAXATIONS)
        # 1e-6: rounding of the norm of a relaxation with several components (scaled): keeps its derivative finite at
        # zero
        relaxed = ca.vertcat(*(z if z.numel() == 1 else ca.sqrt(ca.sumsqr(z) + 1e-6**2) for z in slacks))
        self.objective += ca.dot(self.numbers("relaxation weights", len(RELAXATIONS)), relaxed)
        if spec.steadied:
            self.steady(self.numbers("stability level"))

    def _close(self, contact: Touch) -> None:
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

    def _keep_clear(self, surfaces: tuple[Surface[Any], ...]) -> None:
        number, spec = self.numbers, self.spec
        back = rotation(-self.pose[2])
        spare = []
        for k in range(spec.planes):
            normal, at = number(f"plane {k}.normal", 2), number(f"plane {k}.point", 2)
            for part, surface in enumerate(surfaces):
                angle = number(f"plane {k}.angle")
                shape = number(f"part {part}", surface.number_count)
                spare += surface.wall_clearance(normal, at, angle, self.pose, shape)
        for k in range(spec.pegs):
            local = back @ (number(f"peg {k}.position", 2) - self.pose[:2])
            for part in range(spec.obstacles):
                near = number(f"peg {k}.near_{part}", TouchingCircle.SIZE)
                spare.append(TouchingCircle(near).distance(local) - number(f"peg {k}.radius"))
        if spare:
            clear = ca.vertcat(*spare) + number("tolerance")
            self.rows.require("object in a support", clear, "m", "supports", upper=ca.inf)

    def _effort(self) -> ca.SX:
        """The aims that concern the whole."""
        number, aims = self.numbers, self.spec.aims
        total = ca.SX(0)
        if "least_normal_force" in aims:
            total += number("normal weight") * self.x("greatest normal force")
        if "greatest_friction_margin" in aims:
            total -= number("margin weight") * self.x("friction margin")
        if self.reserve is not None:
            total -= self.reserve
        if "greatest_disturbance" in aims:
            factor = self.x("resisted disturbance")
            count = self.spec.wrenches
            add_disturbances(self, factor * ca.reshape(self.numbers("wrenches", 3 * count), 3, count))
            total -= number("disturbance weight") * factor
        if self.spec.pushed:
            sought = "greatest_push" in aims
            push = self.x("borne push") if sought else number("push")
            add_push(self, push)
            if sought:
                total -= number("push weight") * push
        return total


object_part = lru_cache(maxsize=64)(PlanarObject)
"""The part of an object; built once in a process."""
