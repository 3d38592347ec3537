"""Curvatures from which on a finger is stiffer, where its links touch, or softer, where its material yields.

Beyond a curvature c the bending stiffness changes by a share r of it; with the width e of the corner and y = kappa - c

    energy per length r E I s^2 / 2,    s = (y + sqrt(y^2 + e^2)) / 2,    moment r E I s^2 / sqrt(y^2 + e^2)
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import casadi as ca

from continuum_grasp.model.laws.section import Bend, Kind, Number, Numbers, PortRule, SectionLaw, own_stiffness
from continuum_grasp.model.planar import Scalar
from continuum_grasp.scene import Curve, Finger


@dataclass(frozen=True)
class Limit(SectionLaw):
    """A curvature from which on the stiffness changes, the one of ``own``."""

    kind: Kind = "elastic"
    signs: tuple[float, ...] = (1.0, -1.0)  # the sides on which it does
    rounding: Scalar = 0.0  # width of the corner per curvature [1]
    change: Scalar = 0.0  # of the stiffness [N m2]
    with_rest: bool = False  # whether the curvature at rest counts
    scale: Scalar = 1.0  # of the curvature
    units: ClassVar[Mapping[str, str | tuple[str, ...]]] = {"rounding": "1", "change": "N m2", "scale": "1"}

    @property
    def port_rule(self) -> PortRule:
        # 3: points per part of an element: as good as dense ones
        return PortRule("points", 3)

    def _beyond(self, bend: Bend) -> list[tuple[float, Scalar, Scalar]]:
        """Per side its sign, s and the root."""
        sides = list[tuple[float, Scalar, Scalar]]()
        touch = self.scale * bend.own[0]
        rounding = self.rounding * touch
        for sign in self.signs:
            beyond = sign * (bend.curvature + bend.rest if self.with_rest else bend.curvature) - touch
            root = ca.sqrt(beyond * beyond + rounding * rounding)
            sides.append((sign, 0.5 * (beyond + root), root))
        return sides

    def moment(self, bend: Bend) -> Scalar:
        return self.change * sum((sign * (s * s / root) for sign, s, root in self._beyond(bend)), 0.0)

    @property
    def slopes(self) -> tuple[Scalar, Scalar]:
        return ca.fmin(self.change, 0.0), ca.fmax(self.change, 0.0)

    def energy(self, bend: Bend) -> Scalar:
        return (0.5 * self.change) * sum((s * s for _, s, _ in self._beyond(bend)), 0.0)


def numbers_of(finger: Finger) -> dict[str, Number]:
    """Stiffness ratio and curvature of a material that softens; none without one."""
    soft = finger.softening
    if soft is None:
        return {}
    ratio = Number("1", soft.stiffness_ratio, "softening.stiffness_ratio", least=0.0)
    if isinstance(soft.curvature, tuple):
        return {"softening_ratio": ratio}
    return {"softening_ratio": ratio, "softening_curvature": Number("1/m", soft.curvature, "softening.curvature")}


def laws_of(finger: Finger, numbers: Numbers) -> list[SectionLaw]:
    """Links that touch, at a curvature of the finger itself; a material that softens, at one above that at rest."""
    laws: list[SectionLaw] = []
    stiffness = own_stiffness(finger, numbers)
    stops, soft = finger.stops, finger.softening
    if stops is not None and finger.stop_curvature is not None:
        touching = finger.stop_curvature
        change = (stops.stiffness_ratio - 1.0) * stiffness
        # 0.005: share of the curvature where links touch within which they do so smoothly; 0.02 costs 3e-3 of it
        laws.append(Limit(own=(touching,), signs=stops.signs, rounding=0.005, change=change, with_rest=True))
    if soft is not None:
        yields = Curve.along(finger.rod.length, soft.curvature)
        change = numbers["softening_ratio"] - 1.0
        at = "softening_curvature"
        scale = numbers[at] / numbers_of(finger)[at].value if numbers.is_runtime(at) else 1.0
        laws.append(Limit(own=(yields,), rounding=soft.rounding, change=change * stiffness, scale=scale))
    return laws
