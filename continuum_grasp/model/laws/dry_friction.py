"""Dry friction in bending, with a memory: branches of springs that slide at a moment.

A branch of stiffness k resists the curvature by the moment k (kappa - slid), and slides where that would exceed its
moment M: a stop operator (``memory``), and several of them the law of W. D. Iwan (1966, doi:10.1115/1.3625199):

    z' = kappa' k / M - (z - clip(z)) / time,    moment M clip(z),

The energy that it stores per length, M^2/k (z clip(z) - clip(z)^2 / 2), falls short of the work done by
M^2/k (abs(z) - 1) / time where it slides, which is never negative: no time step aside, friction creates no energy.

Branches go with the stiffness of the section, as the damping of the material does: the curvature at which they slide is
the same everywhere.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar

from continuum_grasp.model.laws.section import (
    Bend,
    Kind,
    Number,
    Numbers,
    PortRule,
    SectionLaw,
    numbers_of_branches,
)
from continuum_grasp.model.memory import Memory
from continuum_grasp.model.planar import Scalar
from continuum_grasp.scene import Finger


@dataclass(frozen=True)
class DryFrictionLaw(SectionLaw):
    """Branches of a stiffness [N m2] and a moment [N m], with a state each."""

    kind: Kind = "friction"
    branches: tuple[tuple[Scalar, Scalar], ...] = ()
    # Per element: no part of the law, so that sections are alike whatever elements there may be.
    cells: int = field(default=1, compare=False, repr=False)
    units: ClassVar[Mapping[str, str | tuple[str, ...]]] = {"branches": ("N m2", "N m")}

    @property
    def port_rule(self) -> PortRule:
        return PortRule("cells", self.cells)

    def names(self, port: int) -> list[str]:
        return [f"dry_friction_{j + 1}_{port} [1]" for j in range(len(self.branches))]

    def moment(self, bend: Bend) -> Scalar:
        ways = bend.memory.ways(bend.states, lambda: self.travel(bend))
        return sum((limit * way for (_, limit), way in zip(self.branches, ways, strict=True)), 0.0)

    def travel(self, bend: Bend) -> list[Scalar]:
        return [stiffness / limit * bend.curvature for stiffness, limit in self.branches]

    def rates(self, bend: Bend) -> list[Scalar]:
        sliding = [stiffness / limit * bend.rate for stiffness, limit in self.branches]
        return [bend.memory.rate(z, rate) for z, rate in zip(bend.states, sliding, strict=True)]

    def energy(self, bend: Bend) -> Scalar:
        total: Scalar = 0.0
        for z, (stiffness, limit) in zip(bend.states, self.branches, strict=True):
            y = Memory.clipped(z)
            total += limit * limit / stiffness * (z * y - 0.5 * (y * y))
        return total

    @property
    def held(self) -> Scalar:
        return sum((stiffness for stiffness, _ in self.branches), 0.0)


def numbers_of(finger: Finger) -> dict[str, Number]:
    """Stiffness and moment of each branch."""
    return numbers_of_branches("dry_friction", finger.damping.dry_friction, {"stiffness": "N m2", "moment": "N m"})


def laws_of(finger: Finger, numbers: Numbers) -> list[SectionLaw]:
    """All branches together; none without dry friction."""
    names = [f"dry_friction_{k + 1}" for k in range(len(finger.damping.dry_friction))]
    if not names:
        return []
    branches = tuple((numbers[f"{name}_stiffness"], numbers[f"{name}_moment"]) for name in names)
    return [DryFrictionLaw(branches=branches, cells=finger.damping.friction_cells)]
