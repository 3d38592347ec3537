"""Damping by the square of the rate of the curvature, m = c kappa' abs(kappa'), as air drag has it in a vibration."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from continuum_grasp.model.laws.section import Bend, Kind, Number, Numbers, PortRule, SectionLaw
from continuum_grasp.model.planar import Scalar
from continuum_grasp.scene import Finger


@dataclass(frozen=True)
class Drag(SectionLaw):
    """Quadratic damping of a coefficient [N m3 s2]."""

    kind: Kind = "damping"
    coefficient: Scalar = 0.0

    @property
    def port_rule(self) -> PortRule:
        # 3: points per part of an element: as good as dense ones. Mean rates of two cells lose an eighth of the moment
        # of a rate that is linear from zero on.
        return PortRule("points", 3)

    def moment(self, bend: Bend) -> Scalar:
        return self.coefficient * (bend.rate * ca.fabs(bend.rate))

    def damping(self, bend: Bend) -> Scalar:
        return 2.0 * self.coefficient * ca.fabs(bend.rate)


def numbers_of(finger: Finger) -> dict[str, Number]:
    """The coefficient."""
    return {"quadratic_damping": Number("N m3 s2", finger.damping.quadratic, "damping.quadratic", least=0.0)}


def laws_of(finger: Finger, numbers: Numbers) -> list[SectionLaw]:
    """None without quadratic damping."""
    if not (finger.damping.quadratic > 0.0 or numbers.is_runtime("quadratic_damping")):
        return []
    return [Drag(coefficient=numbers["quadratic_damping"])]
