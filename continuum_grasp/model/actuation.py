"""From the input u to bending moments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

from continuum_grasp.model.planar import Scalar
from continuum_grasp.scene.profile import Curve


@dataclass(frozen=True)
class InputLayout:
    """What the input vector holds: values, then (for known moments that vary) their rates and accelerations."""

    drives: int  # of tendons; 0: the tip moment
    couples: tuple[str, ...]  # names of the couples of the scene that are inputs
    rates: bool
    quantity: tuple[str, str] = ("tension", "N")  # what drives take, and its unit

    @property
    def count(self) -> int:
        """Number of values."""
        return max(self.drives, 1) + len(self.couples)

    @property
    def labels(self) -> list[str]:
        """Name and unit of each entry of u."""
        name, unit = self.quantity
        entries = [(f"{name}_{k + 1}", unit) for k in range(self.drives)] or [("tip_moment", "N m")]
        entries += [(name, "N m") for name in self.couples]
        derivatives = (("", ""), ("_rate", "/s"), ("_acceleration", "/s2")) if self.rates else (("", ""),)
        return [f"{name}{word} [{unit}{per}]" for word, per in derivatives for name, unit in entries]


@dataclass(frozen=True)
class Source:
    """What gives a bending moment of one shape."""

    shape: Curve  # [1]
    arms: tuple[float, ...]  # per entry of the input, amplitude per value [m]; 1 for the tip moment itself
    couples: tuple[int, ...]  # of the input's couples
    time_constant: float | None  # of the lag of the first [s]
    tendon: int | None = None  # whose tension is its amplitude [N]: a tendon that has one of its own, see TendonForces
    wound: bool = False  # up by a winch or motor, so that its tension is no input

    def amplitudes(self, values: Sequence[Any], drives: int, scale: Scalar = 1.0) -> tuple[Any, Any]:
        """Those of the drive, times a scale, and of the couples [N m], of a block of the input; numbers or arrays."""
        driven: Any = 0.0
        couples = sum((values[drives + k] for k in self.couples), 0.0)
        if self.wound:
            return 0.0, couples
        if self.tendon is not None:
            return values[self.tendon], couples
        # Equation (42); equal arms are multiplied once.
        for arm in dict.fromkeys(abs(arm) for arm in self.arms if arm != 0.0):
            pulled: Any = 0.0
            for own, value in zip(self.arms, values[:drives], strict=True):
                pulled = pulled + value if own == arm else pulled - value if own == -arm else pulled
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

    @staticmethod
    def from_input(u: ca.SX, layout: InputLayout, source: Source, scale: Scalar) -> Drive:
        """Read the input vector; ``scale`` is that of the tendons' arms."""
        values, drives = ca.vertsplit(u), max(layout.drives, 1)

        def block(k: int) -> tuple[Scalar, Scalar]:
            return source.amplitudes(values[k * layout.count : (k + 1) * layout.count], drives, scale)

        moment, couple = block(0)
        if not layout.rates:
            return Drive(moment, couple, 0.0, 0.0)
        return Drive(moment, couple, sum(block(1)), sum(block(2)))
