"""From the input u to bending moments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from continuum_grasp.base import split_unit
from continuum_grasp.model.planar import Scalar
from continuum_grasp.scene import Channel, Finger


@dataclass(frozen=True)
class InputLayout:
    """Layout of the input vector: values, then (for known moments that vary) their rates and accelerations."""

    finger: Finger  # whose inputs come first: tip moment, tensions, ...
    couples: tuple[str, ...]  # names of the couples of the scene that are inputs
    rates: bool

    @property
    def count(self) -> int:
        """Number of values."""
        return len(self.finger.inputs) + len(self.couples)

    @property
    def labels(self) -> list[str]:
        """Name and unit of each entry of u."""
        entries = [
            *((drive.name, drive.unit) for drive in self.finger.inputs),
            *((name, "N m") for name in self.couples),
        ]
        derivatives = (("", ""), ("_rate", "/s"), ("_acceleration", "/s2")) if self.rates else (("", ""),)
        return [f"{name}{word} [{unit}{per}]" for word, per in derivatives for name, unit in entries]


class Lag(NamedTuple):
    """A lag behind commands, of first order, or a critically damped one of second order."""

    order: int

    def names(self, label: str) -> list[str]:
        """Return the names of its states, ``"name [unit]"``, with the label of the driven tendons."""
        name, unit = split_unit(label)
        return [f"{name} [{unit}]", f"{name}_rate [{unit}/s]"][: self.order]

    @staticmethod
    def rates(states: Sequence[Any], commanded: Any, time_constant: Any) -> list[Any]:
        """Rates of its states; none without it."""
        if time_constant is None or not states:
            return []
        pole, (value, *rates) = 1.0 / time_constant, states
        if not rates:
            return [pole * (commanded - value)]
        return [*rates, pole**2 * (commanded - value) - 2.0 * pole * rates[0]]


@dataclass(frozen=True)
class MomentSource(Channel):
    """Source of a bending moment of one shape, by a channel of the finger whose amplitude may lag behind its command.

    ``arms`` are per entry of the finger's own input, 1 for the tip moment itself; the lag is of first order, or a
    critically damped one of second order, whose rate and acceleration a matched tip needs.
    """

    couples: tuple[int, ...] = ()  # of the input's couples
    tendon: int | None = None  # whose tension is its amplitude [N]: a tendon that has one of its own, see TendonForces
    wound: bool = False  # up by a winch or motor, so that its tension is no input
    chamber: bool = False

    @property
    def lags(self) -> int:
        """Number of states of its lag; 0 without one."""
        return 0 if self.time_constant is None else self.order

    def amplitudes(self, values: Sequence[Any], drives: int, scale: Scalar = 1.0) -> tuple[Any, Any]:
        """Amplitudes by the drive, times a scale, and by the couples [N m], of a block of the input; numbers or
        arrays.
        """
        driven: Any = 0.0
        couples = sum((values[drives + k] for k in self.couples), 0.0)
        if self.wound:
            return 0.0, couples
        if self.tendon is not None:
            return values[self.tendon], couples
        # Equation (42); equal arms are multiplied once.
        for arm in dict.fromkeys(abs(arm) for arm in self.arms if arm != 0.0):
            pulled: Any = 0.0
            for tendon_arm, value in zip(self.arms, values[:drives], strict=True):
                pulled = pulled + value if tendon_arm == arm else pulled - value if tendon_arm == -arm else pulled
            driven += scale * arm * pulled
        return driven, couples


@dataclass(frozen=True)
class Drive:
    """Amplitudes of the moments of one source [N m]: of tendons (or given), of couples, and the rates of their sum."""

    moment: Scalar
    couple: Scalar
    rate: Scalar
    acceleration: Scalar

    @property
    def total(self) -> Scalar:
        """Amplitude of both [N m]."""
        return self.moment + self.couple
