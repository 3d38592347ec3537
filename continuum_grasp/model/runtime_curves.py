"""Curves along a finger as run-time numbers: their structure, and their values as expressions.

Between the places where a curve jumps or has a kink (the *panels*) every curve is a polynomial of the distance from
the panel's start, or the exponential of one. Their coefficients are run-time numbers: fingers of one structure share
one function.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca


@dataclass(frozen=True)
class CurveSpec:
    """Structure of a curve: in each panel a polynomial, or its exponential."""

    name: str
    panels: int
    degree: int
    exponential: bool

    @property
    def group(self) -> str:
        """Whose panels it has: its own, or the statics'."""
        return self.name if self.name in ("thickness", "depth") else "statics"

    @property
    def size(self) -> int:
        """Number of coefficients."""
        return self.panels * (self.degree + 1)


@dataclass(frozen=True)
class CurvesSpec:
    """Structure of the curves along a finger; thickness and depth have panels of their own."""

    curves: tuple[CurveSpec, ...]

    @property
    def size(self) -> int:
        """Number of entries: inner edges of the panels, and the coefficients of the curves."""
        return sum(self.edges.values()) + sum(curve.size for curve in self.curves)

    @property
    def graded(self) -> bool:
        """Whether the finger changes along its length."""
        return len(self.curves) > 1

    @property
    def edges(self) -> dict[str, int]:
        """Number of inner edges, of those curves that have their own and of all others together."""
        return {curve.group: curve.panels - 1 for curve in self.curves}

    def expressions(self, numbers: ca.SX) -> Curves:
        """The curves by their numbers (size,), which are symbols."""
        return Curves(self, numbers)


class Curves:
    """The curves along a finger as expressions of the position, per its length."""

    def __init__(self, spec: CurvesSpec, numbers: ca.SX) -> None:
        self.spec = spec
        start = 0
        self._breaks: dict[str, list[ca.SX]] = {}
        for group, count in spec.edges.items():
            self._breaks[group] = [numbers[start + k] for k in range(count)]
            start += count
        self.breaks = self._breaks.get("statics", [])
        self.names = frozenset(curve.name for curve in spec.curves)
        self._curves: dict[str, tuple[CurveSpec, ca.SX]] = {}
        for curve in spec.curves:
            coefficients = ca.reshape(numbers[start : start + curve.size], curve.degree + 1, curve.panels)
            self._curves[curve.name] = curve, coefficients
            start += curve.size

    def on(self, panel: int, s: Any) -> Callable[[str], ca.SX]:
        """Values of the curves of the statics in one of their panels."""
        return lambda name: self._on(name, panel, s)

    def at(self, s: Any, *, tip_side: bool = False) -> Callable[[str], ca.SX]:
        """Values of the curves anywhere; where one jumps, on the base side or the other."""
        return lambda name: self._piece(name, lambda panel, at: self._on(name, panel, at), s, tip_side)

    def slope(self, name: str, s: Any) -> ca.SX:
        """Derivative of a curve anywhere, per length; on the base side of a kink."""

        def derivative(panel: int, at: Any) -> ca.SX:
            place = ca.SX.sym("s")
            return ca.substitute(ca.jacobian(self._on(name, panel, place), place), place, at)

        return self._piece(name, derivative, s, False)

    def _on(self, name: str, panel: int, s: Any) -> ca.SX:
        spec, coefficients = self._curves[name]
        distance = s - (self._breaks[spec.group][panel - 1] if panel else 0.0)
        value = coefficients[spec.degree, panel]
        for k in range(spec.degree - 1, -1, -1):
            value = value * distance + coefficients[k, panel]
        return ca.exp(value) if spec.exponential else value

    def _piece(self, name: str, value: Callable[[int, Any], ca.SX], s: Any, tip_side: bool) -> ca.SX:
        breaks = self._breaks[self._curves[name][0].group]
        piece = value(0, ca.fmin(s, breaks[0]) if breaks else s)
        for panel, start in enumerate(breaks, 1):
            # Clipped to its panel, beyond which a polynomial may vanish, and its inverse be infinite.
            at = ca.fmax(s, start)
            if panel < len(breaks):
                at = ca.fmin(at, breaks[panel])
            beyond = s >= start if tip_side else s > start
            piece = ca.if_else(beyond, value(panel, at), piece)
        return piece
