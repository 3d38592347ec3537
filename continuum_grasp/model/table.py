"""What an object stands on where gravity acts out of the plane."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import casadi as ca

from continuum_grasp.model.body import Body
from continuum_grasp.model.contact_law import friction_rate, friction_share, normal_force, stored_energy
from continuum_grasp.model.planar import Scalar, Vec
from continuum_grasp.scene.surroundings import ContactLaw

__all__ = ["TablePair", "table_pair"]


@dataclass(frozen=True)
class TablePair:
    """The object's base on a table parallel to the plane; the attributes are those of a ``Pair``.

    The normal force lifts the object; friction acts in the plane at the center of mass, along world x and y.
    """

    name: str
    gap: Scalar
    point: Vec
    velocity: Vec
    climb: Scalar
    friction: float
    grip: Scalar
    law: ContactLaw
    z: ca.SX
    press: ca.SX

    def pressed(self) -> TablePair:
        """The same with a gap that is smaller by a run-time number ``press``."""
        press = ca.SX.sym("press")
        return replace(self, gap=self.gap - press, press=press)

    @property
    def z_names(self) -> list[str]:
        """Name and unit of each friction state."""
        return [f"{self.name}.slide_{axis} [1]" for axis in "xy"[: self.z.numel()]]

    @property
    def normal(self) -> Vec:
        """None in the plane."""
        return Vec(0.0, 0.0)

    @cached_property
    def normal_force(self) -> Scalar:
        """[N]"""
        return normal_force(self.law, self.gap, self.climb)

    @property
    def tangential(self) -> Scalar:
        """Friction on the table along world x [N]; see ``force`` for both components."""
        return self.force.x

    @property
    def lift(self) -> Scalar:
        """Force out of the plane, on the object [N]."""
        return self.normal_force

    @cached_property
    def force(self) -> Vec:
        """Force on the table in the plane, world [N]; the object bears the opposite."""
        if self.friction == 0.0:
            return Vec(0.0, 0.0)
        limit = self.grip * self.friction * self.normal_force
        x, y = friction_share(self.law, self._states, self._slip)
        return Vec(limit * x, limit * y)

    @property
    def z_rate(self) -> list[Scalar]:
        """Rates of the friction states [1/s]."""
        return friction_rate(self.law, self.gap, self._states, self._slip) if self.z.numel() else []

    @property
    def stored_energy(self) -> Scalar:
        """Of the normal spring [J]."""
        return stored_energy(self.law, self.gap)

    @property
    def _slip(self) -> list[Scalar]:
        return [self.velocity.x, self.velocity.y]

    @property
    def _states(self) -> list[Scalar]:
        return [self.z[k] for k in range(self.z.numel())]


def table_pair(body: Body, law: ContactLaw, friction: float) -> TablePair:
    """The table under an object that can slide out of the plane; its height is a run-time number."""
    center = body.position + body.arm
    has_state = friction > 0.0 and law.displacement is not None
    return TablePair(
        "table",
        body.pose[3] - body.wrench[3],
        center,
        body.velocity_at(center),
        body.climb,
        friction,
        body.grip,
        law,
        ca.SX.sym("table", 2 if has_state else 0),
        ca.SX(0, 1),
    )
