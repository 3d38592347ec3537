"""The curves along a finger in units of its own: their structure, their numbers, and their values as expressions.

Of a uniform finger it is its thickness alone; the model has all else that it is.

Between the places where a curve jumps or has a kink (the *panels*) every curve is a polynomial of the distance from
the panel's start, or the exponential of one. Their coefficients are run-time numbers: fingers of one structure share
one solver.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
from numpy.polynomial import Polynomial

from continuum_grasp.base import Array, InputError
from continuum_grasp.grasp.shape import skin, steepest
from continuum_grasp.model import family_class
from continuum_grasp.rod import with_places
from continuum_grasp.scene import Curve, FingerSetup

MOST_PANELS = 16
"""Most parts of a finger on which a curve is one polynomial: every element has Gauss nodes in each of them."""
MOST_STEEP = 0.7
"""Greatest slope of half the thickness [1]: the skin then leans by 45 degrees, and discs cover no steeper one."""


@dataclass(frozen=True)
class CurveSpec:
    """Structure of a curve: in each panel a polynomial, or its exponential."""

    name: str
    panels: int
    degree: int
    exponential: bool

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
        return {_group(curve.name): curve.panels - 1 for curve in self.curves}

    @staticmethod
    def of(setup: FingerSetup, weighs: bool) -> CurvesSpec:
        """The structure of a finger's curves."""
        if setup.graded and family_class(setup.family).degree != 1:
            raise InputError(
                f"elements of family {setup.family} do not follow a finger that changes along its length in a grasp: "
                "take matched_clothoid",
                key="fidelity.family",
            )
        made = _curves(setup, weighs)
        steep = steepest(skin(setup.finger.profile.half_thickness))
        if steep > MOST_STEEP:
            raise InputError(
                f"half the thickness of {setup.name} changes by {steep:.2g} per length where its corners are rounded, "
                f"more than {MOST_STEEP}: give smaller jumps, or half_thickness",
                key="rod",
            )
        panels = max(each.spec.panels for each in made)
        if panels > MOST_PANELS:
            raise InputError(
                f"{setup.name} consists of {panels} parts with curves of their own, a grasp takes {MOST_PANELS} at "
                "most: give fewer sections or samples",
                key="rod",
            )
        return CurvesSpec(tuple(each.spec for each in made))


@dataclass(frozen=True)
class _Made:
    """A curve on the panels: coefficients (panels, degree + 1) per powers of the distance, lengths per L."""

    spec: CurveSpec
    edges: Array  # per L
    coefficients: Array


def curve_numbers(setup: FingerSetup, weighs: bool) -> Array:
    """The run-time numbers of a finger's curves, as `Curves` takes them."""
    made = _curves(setup, weighs)
    edges = {_group(each.spec.name): each.edges[1:-1] for each in made}
    return np.concatenate([*edges.values(), *(each.coefficients.ravel() for each in made)])


def _group(name: str) -> str:
    """Whose panels a curve has: its own, or those of the statics."""
    return name if name in ("thickness", "depth") else "statics"


def _curves(setup: FingerSetup, weighs: bool) -> list[_Made]:
    """All curves of a finger: per E I (its mean), rho A at its base and L where they have units."""
    finger, profile, length = setup.finger, setup.finger.profile, setup.finger.profile.length
    thickness = _alone("thickness", skin(profile.half_thickness), 1.0 / length)
    if not setup.graded:
        return [thickness]
    (channel,) = finger.channels  # a grasp has a pair of tendons, which run alike
    breaks = [at for at in (*profile.breaks, *channel.shape.breaks) if at < length]
    edges = tuple(with_places((0.0, length), breaks).tolist())
    curves = [
        _made("stiffness", profile.bending_stiffness, edges, 1.0 / setup.stiffness),
        _made("rest", profile.rest_curvature, edges, length),
        thickness,
        _made("channel", channel.shape, edges, 1.0),
    ]
    if finger.strain_limit is not None and profile.half_depth is not None:
        curves.append(_alone("depth", profile.half_depth, 1.0 / length))
    if weighs:
        curves.append(_made("density", profile.linear_density, edges, 1.0 / finger.rod.mass_per_length))
    return curves


def _alone(name: str, curve: Curve, scale: float) -> _Made:
    return _made(name, curve, (0.0, *curve.breaks, curve.edges[-1]), scale)


@lru_cache(maxsize=64)
def _made(name: str, curve: Curve, edges: tuple[float, ...], scale: float) -> _Made:
    degree, rows = max(len(c) for c in curve.coefficients) - 1, []
    for a in edges[:-1]:
        piece = int(np.searchsorted(curve.edges[1:-1], a + 1e-9 * edges[-1]))
        shifted = curve.local(piece, a)(Polynomial([0.0, edges[-1]]))
        row = np.zeros(degree + 1)
        row[: len(shifted.coef)] = shifted.coef
        if curve.exponential:
            row[0] += np.log(scale)
        rows.append(row if curve.exponential else scale * row)
    return _Made(CurveSpec(name, len(rows), degree, curve.exponential), np.array(edges) / edges[-1], np.array(rows))


class Curves:
    """The curves along a finger as expressions of the position, per its length."""

    def __init__(self, spec: CurvesSpec, numbers: ca.SX) -> None:
        self.spec, start = spec, 0
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
        distance = s - (self._breaks[_group(name)][panel - 1] if panel else 0.0)
        value = coefficients[spec.degree, panel]
        for k in range(spec.degree - 1, -1, -1):
            value = value * distance + coefficients[k, panel]
        return ca.exp(value) if spec.exponential else value

    def _piece(self, name: str, value: Callable[[int, Any], ca.SX], s: Any, tip_side: bool) -> ca.SX:
        breaks = self._breaks[_group(name)]
        piece = value(0, ca.fmin(s, breaks[0]) if breaks else s)
        for panel, start in enumerate(breaks, 1):
            # Clipped to its panel, beyond which a polynomial may vanish, and its inverse be infinite.
            at = ca.fmax(s, start)
            if panel < len(breaks):
                at = ca.fmin(at, breaks[panel])
            beyond = s >= start if tip_side else s > start
            piece = ca.if_else(beyond, value(panel, at), piece)
        return piece
