"""Creep and relaxation of the material: springs in series with dashpots beside the elastic rod, a Prony series.

A branch of a share g of the bending stiffness E I is stretched by a curvature e, which relaxes in a time T (J. D.
Ferry, Viscoelastic Properties of Polymers, 1980, chapter 1):

    moment g E I e,    e' = kappa' - e / T

The stiffness of the finger is that of slow loads, under which all branches have relaxed: what is at rest knows nothing
of them. A sudden load meets (1 + sum g) E I. The energy g E I e^2 / 2 per length is lost at the rate g E I e^2 / T.
"""

from __future__ import annotations

from continuum_grasp.model.family import Family
from continuum_grasp.model.laws.section import Bend, Number, Numbers, SectionLaw, points
from continuum_grasp.model.planar import Scalar
from continuum_grasp.scene.finger import Finger


class Relaxation(SectionLaw):
    """Of each branch g E I e, with a state per port."""

    kind = "relaxation"

    def __init__(self, finger: Finger, family: Family, numbers: Numbers) -> None:
        # As many as integrate products of the shapes exactly along a uniform rod.
        self.ports = points(family, family.degree + 1)
        stiffness = numbers["bending_stiffness"] * float(family.mesh.stiffness(0.0))
        self._branches = [
            (numbers[f"relaxation_{k + 1}_share"] * stiffness, numbers[f"relaxation_{k + 1}_time"])
            for k in range(len(finger.damping.relaxation))
        ]

    @classmethod
    def applies(cls, finger: Finger, numbers: Numbers) -> bool:
        return bool(finger.damping.relaxation)

    @classmethod
    def numbers(cls, finger: Finger) -> dict[str, Number]:
        found = {}
        for k, branch in enumerate(finger.damping.relaxation, start=1):
            key = f"damping.relaxation[{k - 1}]"
            found[f"relaxation_{k}_share"] = Number("1", branch.share, f"{key}.share")
            found[f"relaxation_{k}_time"] = Number("s", branch.time, f"{key}.time")
        return found

    def names(self, port: int) -> list[str]:
        return [f"relaxing_{j + 1}_{port} [1/m]" for j in range(len(self._branches))]

    def moment(self, bend: Bend) -> Scalar:
        parts = zip(self._branches, bend.states, strict=True)
        return sum((stiffness * stretched for (stiffness, _), stretched in parts), 0.0)

    def rates(self, bend: Bend) -> list[Scalar]:
        parts = zip(self._branches, bend.states, strict=True)
        return [bend.memory.fading(stretched, bend.rate, 1.0 / time) for (_, time), stretched in parts]

    def energy(self, bend: Bend) -> Scalar:
        parts = zip(self._branches, bend.states, strict=True)
        return sum((0.5 * stiffness * (stretched * stretched) for (stiffness, _), stretched in parts), 0.0)

    @property
    def held(self) -> Scalar:
        return sum((stiffness for stiffness, _ in self._branches), 0.0)
