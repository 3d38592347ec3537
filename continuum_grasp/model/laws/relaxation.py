"""Creep and relaxation of the material: springs in series with dashpots beside the elastic rod, a Prony series.

A branch of a share g of the bending stiffness E I is stretched by a curvature e, which relaxes in a time T (J. D.
Ferry, Viscoelastic Properties of Polymers, 1980, chapter 1):

    moment g E I e,    e' = kappa' - e / T

The stiffness of the finger holds for slow loads, under which all branches have relaxed: a finger at rest knows nothing
of them. A sudden load meets (1 + sum g) E I. The energy g E I e^2 / 2 per length is lost at the rate g E I e^2 / T.
"""

from __future__ import annotations

from dataclasses import dataclass

from continuum_grasp.model.laws.section import (
    Bend,
    Kind,
    Number,
    Numbers,
    PortRule,
    SectionLaw,
    numbers_of_branches,
    own_stiffness,
)
from continuum_grasp.model.planar import Scalar
from continuum_grasp.scene import Finger


@dataclass(frozen=True)
class RelaxationLaw(SectionLaw):
    """Branches of a stiffness [N m2] and a time [s], with a state each."""

    kind: Kind = "relaxation"
    branches: tuple[tuple[Scalar, Scalar], ...] = ()

    @property
    def port_rule(self) -> PortRule:
        return PortRule("linear_points")

    def names(self, port: int) -> list[str]:
        return [f"relaxing_{j + 1}_{port} [1/m]" for j in range(len(self.branches))]

    def moment(self, bend: Bend) -> Scalar:
        return sum((stiffness * e for (stiffness, _), e in zip(self.branches, bend.states, strict=True)), 0.0)

    def rates(self, bend: Bend) -> list[Scalar]:
        parts = zip(self.branches, bend.states, strict=True)
        return [bend.memory.fading(e, bend.rate, 1.0 / time) for (_, time), e in parts]

    def energy(self, bend: Bend) -> Scalar:
        parts = zip(self.branches, bend.states, strict=True)
        return sum((0.5 * stiffness * (e * e) for (stiffness, _), e in parts), 0.0)

    @property
    def held(self) -> Scalar:
        return sum((stiffness for stiffness, _ in self.branches), 0.0)


def numbers_of(finger: Finger) -> dict[str, Number]:
    """Share and time of each branch."""
    return numbers_of_branches("relaxation", finger.damping.relaxation, {"share": "1", "time": "s"})


def laws_of(finger: Finger, numbers: Numbers) -> list[SectionLaw]:
    """All branches together; none without them."""
    names = [f"relaxation_{k + 1}" for k in range(len(finger.damping.relaxation))]
    if not names:
        return []
    stiffness = own_stiffness(finger, numbers)
    branches = tuple((numbers[f"{name}_share"] * stiffness, numbers[f"{name}_time"]) for name in names)
    return [RelaxationLaw(branches=branches)]
