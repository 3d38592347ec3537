"""Ports at which a law sees how the finger bends, what a law gives there, and the generalized forces of all laws.

A port is the curvature at a point of an element, or its mean over a part of it. Its measure has the stiffness of the
section per stiffness of the rod itself at the base: moments of a law are taken there, and go with the stiffness along
the finger. By virtual work, a moment m at a port of the mean shapes c and the measure l [m] exerts l m c on the
coordinates.

A law has states where it remembers. At rest its friction states follow from how the finger came there (``Memory``); all
others are zero.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, Protocol

from continuum_grasp.model.family import Family, gathered
from continuum_grasp.model.memory import Instant, Memory
from continuum_grasp.model.planar import Scalar, is_zero
from continuum_grasp.scene import Finger, Value

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


@dataclass(frozen=True)
class Port:
    """Port at which a law sees the curvature."""

    element: int
    measure: Scalar  # [m]
    shapes: Sequence[Scalar]  # mean of those of the element's coordinates
    rest: float  # curvature at rest [1/m]
    own: tuple[float, ...] = ()  # numbers of the law there


@dataclass(frozen=True)
class Bend:
    """Curvature, its rate and the states of a law at a port."""

    curvature: Scalar  # above that at rest [1/m]
    rest: Scalar  # that at rest [1/m]
    rate: Scalar  # of the curvature [1/(m s)]
    memory: Memory
    own: Sequence[Scalar] = ()  # numbers of the law there
    states: Sequence[Scalar] = ()


@dataclass(frozen=True)
class SectionLaw(ABC):
    """A moment by the curvature, its rate, and states, against the bending.

    ``kind`` says what it depends on: the curvature alone; its rate too; states of friction; or states that fade to
    zero.
    """

    ports: tuple[Port, ...]
    kind: Kind

    @abstractmethod
    def moment(self, bend: Bend) -> Scalar:
        """Against the bending [N m]."""

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


class SectionForces:
    """Generalized forces of laws, and the rates of their states: law by law, port by port.

    ``states`` belong to the laws, by kind, ``rest`` is the curvature at rest [1/m] where it is a run-time argument.
    """

    def __init__(
        self,
        laws: Sequence[SectionLaw],
        family: Family,
        at: Instant,
        states: Mapping[str, Sequence[Scalar]],
        rest: Scalar | None = None,
    ) -> None:
        self._family, self._rest, self._at = family, rest, at
        self._ports: list[tuple[SectionLaw, Port, Sequence[Scalar]]] = []
        left = {group: iter(entries) for group, entries in states.items()}
        for law in laws:
            for k, port in enumerate(law.ports, start=1):
                self._ports.append((law, port, [next(left[law.kind]) for _ in law.names(k)]))

    def _weights(self, port: Port) -> tuple[Scalar, list[Scalar]]:
        """Measure of a port, and that times its shapes; its element may have another length at run time."""
        length_factors = self._family.length_factors(port.element, self._at.lengths)
        weights = [port.measure * shape * factor for shape, factor in zip(port.shapes, length_factors, strict=True)]
        h, nominal = self._at.lengths[port.element], self._family.mesh.lengths[port.element]
        return port.measure if isinstance(h, float) else port.measure * (h / nominal), weights

    @cached_property
    def _acting(self) -> list[tuple[SectionLaw, Port, Bend]]:
        acting = []
        for law, port, states in self._ports:
            curvature, rate = (self._mean(port, values) for values in (self._at.full, self._at.rates))
            rest = port.rest if self._rest is None else self._rest
            acting.append((law, port, Bend(curvature, rest, rate, self._at.memory, port.own, states)))
        return acting

    def _mean(self, port: Port, values: Sequence[Scalar]) -> Scalar:
        measure, weights = self._weights(port)
        local = self._family.local(port.element)
        return sum(((w / measure) * values[a] for a, w in zip(local, weights, strict=True) if not is_zero(w)), 0.0)

    def on_elements(self, *kinds: Kind) -> list[list[Scalar]]:
        """Generalized forces of the laws of kinds on the local coordinates of every element, against the bending."""
        total: list[list[Scalar]] = [[0.0] * len(self._family.local(k)) for k in range(self._family.elements)]
        for law, port, bend in self._acting:
            if law.kind in kinds:
                moment = law.moment(bend)
                for i, weight in enumerate(self._weights(port)[1]):
                    if not is_zero(weight):
                        total[port.element][i] += weight * moment
        return total

    def force(self, *kinds: Kind) -> list[Scalar]:
        """Generalized forces of the laws of kinds on all coordinates, against the bending."""
        return gathered(self._family, self.on_elements(*kinds))

    def rates(self, kind: Kind) -> list[Scalar]:
        return [rate for law, _, bend in self._acting if law.kind == kind for rate in law.rates(bend)]

    @property
    def travel(self) -> list[Scalar]:
        """Travel of all friction states since the unloaded shape, per the sliding travel of each [1]."""
        return [way for law, _, bend in self._acting for way in law.travel(bend)]

    @property
    def stored_energy(self) -> Scalar:
        """Energy that the laws store [J]."""
        return sum((self._weights(port)[0] * law.energy(bend) for law, port, bend in self._acting), 0.0)
