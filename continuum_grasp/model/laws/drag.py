"""Damping by the square of the rate of the curvature, as air drag has it in a vibration of one shape."""

from __future__ import annotations

import casadi as ca

from continuum_grasp.model.family import Family
from continuum_grasp.model.laws.section import Bend, Number, Numbers, SectionLaw, cells
from continuum_grasp.model.planar import Scalar
from continuum_grasp.scene.finger import Finger


class Drag(SectionLaw):
    """m = c kappa' abs(kappa')."""

    kind = "damping"

    def __init__(self, finger: Finger, family: Family, numbers: Numbers) -> None:
        self.ports = cells(family, finger.damping.friction_cells)
        self._coefficient = numbers["quadratic_damping"]

    @classmethod
    def applies(cls, finger: Finger, numbers: Numbers) -> bool:
        return finger.damping.quadratic > 0.0 or numbers.is_runtime("quadratic_damping")

    @classmethod
    def numbers(cls, finger: Finger) -> dict[str, Number]:
        return {"quadratic_damping": Number("N m2 s2", finger.damping.quadratic, "damping.quadratic", positive=False)}

    def moment(self, bend: Bend) -> Scalar:
        return self._coefficient * (bend.rate * ca.fabs(bend.rate))

    def damping(self, bend: Bend) -> Scalar:
        return 2.0 * self._coefficient * ca.fabs(bend.rate)
