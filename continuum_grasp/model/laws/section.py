"""A law of the cross-sections: the moment that a section adds to linear elasticity and damping.

A law knows neither elements nor stages. Its moment is the one at the base, in units of the rod itself there: along the
finger, the moment goes with the stiffness of the section. ``laws.ports`` makes generalized forces of elements from it,
and ``model.section`` the curvature of an exact rod.

A law has states where it remembers. At rest its friction states follow from how the finger came there (``Memory``); all
others are zero.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, Protocol

from continuum_grasp.model.memory import Memory
from continuum_grasp.model.planar import Scalar
from continuum_grasp.scene import Curve, Finger, Profile, Value

Kind = Literal["elastic", "damping", "friction", "relaxation"]

STATEFUL: tuple[Kind, ...] = ("friction", "relaxation")


class Numbers(Protocol):
    """Numbers of a finger, some of them run-time arguments."""

    def __getitem__(self, name: str) -> Scalar:
        """A number, or its symbol."""

    def is_runtime(self, name: str) -> bool:
        """Whether it is a run-time argument."""


POSITIVE = 1e-9
"""Least value, per typical size [1], of a number that the model divides by, or that means nothing at zero."""


def places_of(finger: Finger, keys: str) -> list[str]:
    """Paths in a finger of the keys of a `Number`."""
    paths = list[str]()
    for key in keys.split():
        owner, every, rest = key.partition("*")
        paths += [f"{place}{rest}" for place in finger.places_of(owner)] if every else [key]
    return paths


@dataclass(frozen=True)
class Number:
    """A number of a finger that may be a run-time argument."""

    unit: str
    value: Any  # or numbers; None where the finger has none
    key: str  # where the finger has it, or the keys; ``*`` stands for all entries of a list, or for the only one
    least: float = POSITIVE  # per typical size [1]

    def places(self, finger: Finger) -> list[str]:
        """Paths of it in a finger."""
        return places_of(finger, self.key)


def numbers_of_branches(name: str, branches: Sequence[Value], units: Mapping[str, str]) -> dict[str, Number]:
    """Numbers with these units of branches in a list of ``damping``."""
    return {
        f"{name}_{k}_{field}": Number(unit, getattr(branch, field), f"damping.{name}[{k - 1}].{field}")
        for k, branch in enumerate(branches, start=1)
        for field, unit in units.items()
    }


def own_factor(profile: Profile) -> float:
    """Stiffness of the rod itself at the base, per the number ``bending_stiffness`` [1, or N m2 of a graded rod]."""
    return profile.own_stiffness / (1.0 if profile.graded else float(profile.bending_stiffness(0.0)))


def own_stiffness(finger: Finger, numbers: Numbers) -> Scalar:
    """Bending stiffness of the rod itself at the base [N m2], without what chambers add."""
    return numbers["bending_stiffness"] * own_factor(finger.profile)


@dataclass(frozen=True)
class Bend:
    """Curvature, its rate and the states of a law at a place."""

    curvature: Scalar  # above that at rest [1/m]
    rest: Scalar  # that at rest [1/m]
    rate: Scalar  # of the curvature [1/(m s)]
    memory: Memory
    own: Sequence[Scalar] = ()  # values of ``SectionLaw.own`` there [1/m]
    states: Sequence[Scalar] = ()


@dataclass(frozen=True)
class PortRule:
    """Rule by which the elements of a finger see its curvature for a law; see ``laws.ports``."""

    name: Literal["cells", "points", "linear_points"]
    count: int = 0  # of ports on each element, or on each part of it


@dataclass(frozen=True)
class SectionLaw(ABC):
    """A moment by the curvature, its rate, and states, against the bending.

    ``kind`` says what the moment depends on: the curvature alone; its rate too; states of friction; or states that
    fade to zero.
    """

    kind: Kind
    own: tuple[Curve, ...] = ()  # curvatures of the law along the finger [1/m]
    units: ClassVar[Mapping[str, str | tuple[str, ...]]] = {}
    """Unit of each field that is a number; of a tuple of numbers for a field that has several such tuples."""

    @property
    @abstractmethod
    def port_rule(self) -> PortRule:
        """Ports at which the elements see the curvature for the law."""

    @abstractmethod
    def moment(self, bend: Bend) -> Scalar:
        """Compute the moment against the bending [N m]."""

    def names(self, port: int) -> list[str]:
        """Name and unit of each state at a port, which counts from one."""
        return []

    def rates(self, bend: Bend) -> list[Scalar]:
        """Rates of the states [1/s]."""
        return []

    def travel(self, bend: Bend) -> list[Scalar]:
        """Travel of each friction state since the unloaded shape, per its sliding travel [1]."""
        return []

    def energy(self, bend: Bend) -> Scalar:
        """Stored, per length [J/m]."""
        return 0.0

    def damping(self, bend: Bend) -> Scalar:
        """Derivative of the moment by the rate of the curvature [N m2 s]."""
        return 0.0

    @property
    def held(self) -> Scalar:
        """Stiffness that it adds where its states do not slide [N m2]."""
        return 0.0

    @property
    def slopes(self) -> tuple[Scalar, Scalar]:
        """Bounds of the derivative of the moment by the curvature at rest [N m2]."""
        return 0.0, self.held
