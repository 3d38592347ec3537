"""A finger along its length: stiffness, mass, rest curvature, thickness and moments as functions of position."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    from continuum_grasp.scene.graded import RodFactors

Array = NDArray[np.float64]

_SAME = 1e-9
"""Distance per length up to which two positions are the same [1]: above the rounding of sums of lengths."""
_JUMP = 1e-12
"""Jump per value from which on a curve jumps [1]: above the rounding of its pieces."""


_MEAN_NODES = 32
"""Gauss nodes per piece for a mean along the finger: rounding for a taper to a tenth."""


@dataclass(frozen=True)
class Curve:
    """A function of the position s along the finger [m]: a polynomial, or its exponential, on each of some pieces.

    At a jump it has the value of the base side, except where the tip side is asked for.
    """

    edges: tuple[float, ...]
    """Where pieces begin and end [m], from 0 to the length: one more than pieces."""
    coefficients: tuple[tuple[float, ...], ...]
    """Per piece, of the powers 0, 1, ... of the distance from its start [m]."""
    exponential: bool = False
    """Whether the value is the exponential of the polynomial."""

    @classmethod
    def uniform(cls, length: float, value: float) -> Curve:
        """The same value everywhere."""
        return cls((0.0, length), ((value,),))

    def __call__(self, s: ArrayLike, *, tip_side: bool = False) -> Array:
        """Value at positions [m], beyond the ends that of the outer pieces continued; shape of ``s``."""
        at = np.asarray(s, dtype=float)
        shift = _SAME * self.edges[-1] * (1.0 if tip_side else -1.0)
        piece = np.searchsorted(np.asarray(self.edges[1:-1]), at + shift)
        distance, coefficients = at - np.asarray(self.edges)[piece], self._table[piece]
        value = np.zeros(at.shape)
        for power in reversed(range(self._table.shape[1])):
            value = value * distance + coefficients[..., power]
        return np.exp(value) if self.exponential else value

    def on(self, piece: int, s: Any) -> Any:
        """The function of one piece at positions [m]: floats, arrays or CasADi expressions."""
        distance, coefficients = s - self.edges[piece], self.coefficients[piece]
        value = 0.0 * distance + coefficients[-1]
        for coefficient in reversed(coefficients[:-1]):
            value = value * distance + coefficient
        return np.exp(value) if self.exponential else value

    @cached_property
    def _table(self) -> Array:
        """Coefficients, one row per piece."""
        table = np.zeros((len(self.coefficients), max(map(len, self.coefficients))))
        for row, coefficients in zip(table, self.coefficients, strict=True):
            row[: len(coefficients)] = coefficients
        return table

    @cached_property
    def constant(self) -> float | None:
        """Its value where that is the same everywhere; else None."""
        first = self.coefficients[0][0]
        same = all(c[0] == first and not any(c[1:]) for c in self.coefficients)
        return float(np.exp(first) if self.exponential else first) if same else None

    @property
    def breaks(self) -> tuple[float, ...]:
        """Where it may jump or have a kink [m], without the ends."""
        return () if self.constant is not None else self.edges[1:-1]

    @cached_property
    def jumps(self) -> tuple[float, ...]:
        """Where its value jumps [m]."""
        before, after = self(self.edges[1:-1]), self(self.edges[1:-1], tip_side=True)
        large = np.abs(after - before) > _JUMP * np.maximum(np.abs(after), np.abs(before))
        return tuple(float(at) for at, jumps in zip(self.edges[1:-1], large, strict=True) if jumps)

    def integral(self) -> float:
        """Its integral over the whole length."""
        # 16 nodes per piece: exact for polynomials of degree 31, to rounding for samples 1:100 apart.
        nodes, weights = np.polynomial.legendre.leggauss(16)
        total = 0.0
        for k, (a, b) in enumerate(pairwise(self.edges)):
            total += 0.5 * (b - a) * float(weights @ self.on(k, a + 0.5 * (b - a) * (nodes + 1.0)))
        return total

    def most(self) -> float:
        """Greatest value, of a function that is monotone on each piece."""
        return float(max(*self(self.edges), *self(self.edges, tip_side=True)))

    def scaled(self, factor: float) -> Curve:
        """The same times a factor, positive for an exponential."""
        if factor == 1.0:
            return self
        if self.exponential:
            return Curve(self.edges, tuple((c[0] + float(np.log(factor)), *c[1:]) for c in self.coefficients), True)
        return Curve(self.edges, tuple(tuple(factor * one for one in c) for c in self.coefficients))


@dataclass(frozen=True)
class Profile:
    """A finger's rod along its length; all curves have the same length."""

    length: float  # [m]
    bending_stiffness: Curve  # E I [N m2]
    linear_density: Curve  # rho A [kg/m]
    rotary_inertia: Curve  # rho I [kg m]
    rest_curvature: Curve  # [1/m]
    half_thickness: Curve  # half the outer thickness [m], where contacts touch
    half_depth: Curve | None  # half the depth of the elastic section [m], which strains most there; None: not known
    graded: bool = False
    """Whether it is given by sections, samples or a spiral: stiffness and density as run-time arguments are then
    factors (nominal 1), and lengths of elements are none."""

    def scaled(self, factors: RodFactors) -> Profile:
        """The same with other stiffness and mass everywhere."""
        keys = ("bending_stiffness", "linear_density", "rotary_inertia")
        return replace(self, **{key: getattr(self, key).scaled(getattr(factors, key)) for key in keys})

    @cached_property
    def uniform(self) -> bool:
        """Whether stiffness, density and rotary inertia are the same everywhere."""
        return all(c.constant is not None for c in (self.bending_stiffness, self.linear_density, self.rotary_inertia))

    @cached_property
    def breaks(self) -> tuple[float, ...]:
        """Where stiffness, density, rotary inertia or rest curvature may jump or have kinks [m], increasing."""
        curves = (self.bending_stiffness, self.linear_density, self.rotary_inertia, self.rest_curvature)
        found: list[float] = []
        for at in sorted(at for curve in curves for at in curve.breaks):
            if not found or at - found[-1] > _SAME * self.length:
                found.append(at)
        return tuple(found)

    @cached_property
    def mean_stiffness(self) -> float:
        """E I of the uniform rod whose tip a couple turns as far [N m2]: the harmonic mean, a scale of moments."""
        curve = self.bending_stiffness
        if curve.constant is not None:
            return curve.constant
        nodes, weights = np.polynomial.legendre.leggauss(_MEAN_NODES)
        turns = [
            0.5 * (b - a) * float(weights @ (1.0 / curve(0.5 * (a + b) + 0.5 * (b - a) * nodes)))
            for a, b in self.panels()
        ]
        return self.length / sum(turns)

    def panels(self, *places: float) -> list[tuple[float, float]]:
        """Parts [m] between breaks and further places, from base to tip: smooth inside, for quadrature."""
        edges = [0.0]
        for at in sorted((*self.breaks, *places)):
            if at - edges[-1] > _SAME * self.length and self.length - at > _SAME * self.length:
                edges.append(at)
        return list(pairwise([*edges, self.length]))


@dataclass(frozen=True)
class Channel:
    """What bends the finger by a moment of a known shape: tendons that run alike, or couples at one place.

    The bending moment at s is ``amplitude * shape(s)``; the amplitude [N m] is the sum of tensions times ``arms`` and
    of the couples of the place.
    """

    shape: Curve  # [1], one at the base, zero beyond ``to``
    to: float  # where it ends [m]
    arms: tuple[float, ...] = ()  # per tendon of the finger, amplitude per tension [m]; zero: not in this channel
    time_constant: float | None = None  # of its tendons [s]
