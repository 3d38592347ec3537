"""A finger along its length: stiffness, mass, rest curvature, thickness and moments as functions of position."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import ArrayLike

from continuum_grasp.base import Array
from continuum_grasp.scene.graded import Along, RodSamples, RodSection, SpiRob, Varying, ends
from continuum_grasp.scene.value import SAME

if TYPE_CHECKING:
    from scipy.interpolate import PPoly


_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(32)
"""Nodes and weights of integrals between breaks: rounding for means of a taper to a tenth."""


class Panels(tuple[tuple[float, float], ...]):
    """Parts of a finger [m], from base to tip; some functions are smooth on each part."""

    __slots__ = ()

    @classmethod
    def of(cls, length: float, curves: Iterable[Curve], start: float = 0.0, end: float | None = None) -> Panels:
        """Return the parts of a finger of a length [m], or of a segment of it, with smooth curves."""
        least, end, edges = SAME * length, length if end is None else end, [start]
        for at in sorted(at for curve in curves for at in curve.breaks):
            if at - edges[-1] > least and end - at > least:
                edges.append(at)
        return cls(pairwise([*edges, end]))

    def cut(self, curve: Curve) -> Panels:
        """Divide these parts into parts with another smooth curve."""
        return Panels(panel for part in self for panel in Panels.of(curve.edges[-1], (curve,), *part))

    def nodes(self) -> Iterator[tuple[Array, Array]]:
        """Per part its nodes (32,) and weights, for integrals of functions that are smooth there."""
        for a, b in self:
            yield a + 0.5 * (b - a) * (_NODES + 1.0), 0.5 * (b - a) * _WEIGHTS

    def integral(self, values: Callable[[Array], Array]) -> Array:
        """Integral (...) of values (..., M) at places (M,)."""
        return np.asarray(np.sum([values(s) @ weights for s, weights in self.nodes()], axis=0))


@dataclass(frozen=True)
class Curve:
    """A function of the position s along the finger [m]: a polynomial, or its exponential, on each of some pieces.

    At a jump it has the value of the base side, except where the tip side is asked for.
    """

    edges: tuple[float, ...]
    """Ends of the pieces [m], from 0 to the length: one more than pieces."""
    coefficients: tuple[tuple[float, ...], ...]
    """Per piece, of the powers 0, 1, ... of the distance from its start [m]."""
    exponential: bool = False
    """Whether the value is the exponential of the polynomial."""

    @classmethod
    def along(cls, length: float, value: Along) -> Curve:
        """Curve from what a user gives along a finger: a number, its values at base and tip, or numbers between
        breaks.
        """
        if isinstance(value, float | tuple):
            return cls((0.0, length), (_coefficients(_line(value, length)),))
        return cls((0.0, *value.breaks, length), tuple((number,) for number in value.values))

    @classmethod
    def of_pieces(cls, length: float, starts: Sequence[float], coefficients: Sequence[tuple[float, ...]]) -> Curve:
        """Polynomials from places on [m], each up to the next place, without pieces of no length."""
        spans = zip(starts, (*starts[1:], length), coefficients, strict=True)
        pieces = [(start, polynomial) for start, end, polynomial in spans if end - start > SAME * length]
        return cls((*(start for start, _ in pieces), length), tuple(polynomial for _, polynomial in pieces))

    @classmethod
    def through(cls, spline: PPoly, *, exponential: bool = False) -> Curve:
        """A piecewise polynomial of scipy, or its exponential."""
        # scipy has the highest power first, one column per piece.
        pieces = spline.c[::-1].T.tolist()
        return cls(tuple(map(float, spline.x)), tuple(map(tuple, pieces)), exponential)

    def __call__(self, s: ArrayLike, *, tip_side: bool = False) -> Array:
        """Value at positions [m], beyond the ends the outer pieces continued; shape of ``s``."""
        at = np.asarray(s, dtype=float)
        if len(self.coefficients) == 1:
            return np.asarray(self.on(0, at))
        shift = SAME * self.edges[-1] * (1.0 if tip_side else -1.0)
        piece = np.searchsorted(np.asarray(self.edges[1:-1]), at + shift)
        return np.asarray(self._value(at - np.asarray(self.edges)[piece], np.moveaxis(self._table[piece], -1, 0)))

    def on(self, piece: int, s: Any) -> Any:
        """The function of one piece at positions [m]: floats, arrays or CasADi expressions."""
        return self._value(s - self.edges[piece], self.coefficients[piece])

    def _value(self, distance: Any, coefficients: Any) -> Any:
        """Value at a distance from the start of a piece of these coefficients."""
        value = 0.0 * distance + coefficients[-1]
        for coefficient in coefficients[-2::-1]:
            value = value * distance + coefficient
        return np.exp(value) if self.exponential else value

    def local(self, piece: int, at: float) -> Polynomial:
        """The polynomial of one piece, of the distance from a position [m]."""
        return Polynomial(self.coefficients[piece])(Polynomial([at - self.edges[piece], 1.0]))

    def slope(self, s: float) -> float:
        """Derivative at a position [m]; at a kink or a jump, the derivative on the base side."""
        piece = int(np.searchsorted(np.asarray(self.edges[1:-1]), s - SAME * self.edges[-1]))
        # A complex step subtracts nothing: exact to rounding.
        return float(np.imag(self.on(piece, s + 1e-30j)) / 1e-30)

    @cached_property
    def _table(self) -> Array:
        """Coefficients, one row per piece."""
        table = np.zeros((len(self.coefficients), max(map(len, self.coefficients))))
        for row, coefficients in zip(table, self.coefficients, strict=True):
            row[: len(coefficients)] = coefficients
        return table

    @cached_property
    def constant(self) -> float | None:
        """Value of a constant curve; else None."""
        first = self.coefficients[0][0]
        same = all(c[0] == first and not any(c[1:]) for c in self.coefficients)
        return float(np.exp(first) if self.exponential else first) if same else None

    @property
    def breaks(self) -> tuple[float, ...]:
        """Places where the curve may jump or have a kink [m], without the ends."""
        return () if self.constant is not None else self.edges[1:-1]

    @cached_property
    def jumps(self) -> tuple[float, ...]:
        """Places where the value jumps [m]."""
        before, after = self(self.edges[1:-1]), self(self.edges[1:-1], tip_side=True)
        # 1e-12: least jump per value, above the rounding of the curve's pieces
        large = np.abs(after - before) > 1e-12 * np.maximum(np.abs(after), np.abs(before))
        return tuple(float(at) for at, jumps in zip(self.edges[1:-1], large, strict=True) if jumps)

    def integral(self) -> float:
        """Integral over the whole length."""
        return float(Panels(pairwise(self.edges)).integral(self))

    @property
    def extremes(self) -> tuple[float, float]:
        """Return the least and greatest value of a function that is monotone on each piece."""
        sides = np.concatenate([self(self.edges), self(self.edges, tip_side=True)])
        return float(sides.min()), float(sides.max())

    def most(self) -> float:
        """Greatest value, of a function that is monotone on each piece."""
        return self.extremes[1]

    def scaled(self, factor: float) -> Curve:
        """The curve times a factor, positive for an exponential."""
        return self if factor == 1.0 else self.times(Curve.along(self.edges[-1], factor))

    def times(self, factors: Curve) -> Curve:
        """The product with a function that is constant between its edges, positive for an exponential."""
        starts = [start for start, _ in Panels.of(self.edges[-1], (self, factors))]
        pieces = []
        for at in starts:
            piece = bisect_right(self.edges, at * (1.0 + SAME)) - 1
            factor, (first, *rest) = float(factors(at, tip_side=True)), self.local(piece, at).coef.tolist()
            scaled = [factor * c for c in rest] if not self.exponential else rest
            pieces.append((first + math.log(factor) if self.exponential else factor * first, *scaled))
        return Curve((*starts, self.edges[-1]), tuple(pieces), self.exponential)


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
    added: Curve | None = None  # stiffness including the chambers, per stiffness of the rod itself [1]
    graded: bool = False
    """Whether it is given by sections, samples or a spiral: stiffness and density as run-time arguments are then
    factors (nominal 1), and lengths of elements are none."""

    @property
    def own_stiffness(self) -> float:
        """Bending stiffness of the rod itself at the base [N m2], the reference for numbers of the material."""
        added = 1.0 if self.added is None else float(self.added(0.0))
        return float(self.bending_stiffness(0.0)) / added

    @cached_property
    def uniform(self) -> bool:
        """Whether stiffness, density and rotary inertia are the same everywhere."""
        return all(curve.constant is not None for curve in self.curves[:3])

    @property
    def curves(self) -> tuple[Curve, ...]:
        """Stiffness, density, rotary inertia and rest curvature."""
        return self.bending_stiffness, self.linear_density, self.rotary_inertia, self.rest_curvature

    def panels(self, start: float = 0.0, end: float | None = None) -> Panels:
        """Return the parts of the finger, or of a segment of it [m], with smooth curves."""
        return Panels.of(self.length, self.curves, start, end)

    @cached_property
    def breaks(self) -> tuple[float, ...]:
        """Places where these curves may jump or have kinks [m], increasing."""
        return tuple(start for start, _ in self.panels())[1:]

    def moments(self, density: Callable[[Array], Array], bounds: ArrayLike, powers: int = 1) -> Array:
        """Integrals (powers, N) of a density times 1, s, s^2 ... between neighbors of bounds (N + 1,) [m].

        It is smooth where the curves are.
        """
        spans, exponents = pairwise(np.asarray(bounds).tolist()), np.arange(powers)[:, None]
        integrals = (self.panels(*span).integral(lambda s: density(s) * s**exponents) for span in spans)
        return np.stack([*integrals], axis=1)

    def waves(self, s: Array) -> Array:
        """Integral of (rho A / E I)^(1/4), the waves of bending, from the first of positions (N,) [m] to each."""
        middles = 0.5 * (s[1:] + s[:-1])
        density = (self.linear_density(middles) / self.bending_stiffness(middles)) ** 0.25
        return np.concatenate([[0.0], np.cumsum(density * np.diff(s))])


@dataclass(frozen=True)
class Channel:
    """Source of a bending moment of a known shape: tendons that run alike, or a chamber.

    The bending moment at s is ``gain * amplitude * shape(s)``; the amplitude [N m, or Pa] is the sum of inputs times
    ``arms``.
    """

    shape: Curve  # [1], of tendons one at the base, zero beyond ``to``
    to: float  # end along the finger [m]
    arms: tuple[float, ...] = ()  # per input of the finger, amplitude per tension [m]; zero: not in this channel
    time_constant: float | None = None  # of the lag of its tendons, or of its pressure [s]
    order: int = 2  # of that lag
    gain: float = 1.0  # moment per amplitude: [m3] of a chamber, whose amplitude is its pressure [Pa]


def summed(length: float, steps: Sequence[Curve]) -> Curve:
    """Sum of functions along a finger of a length [m] that are constant between their edges."""
    starts = [start for start, _ in Panels.of(length, steps)]
    return Curve((*starts, length), tuple((sum(float(step(at, tip_side=True)) for step in steps),) for at in starts))


def touching(length: float, spiral: SpiRob) -> Curve:
    """Return the curvature that closes the gaps of a spiral [1/m]: its own, ``-dh/ds / (b h)`` with the thickness h.

    Cubics with the values and slopes at the ends of units approximate its logarithm.
    """
    from scipy.interpolate import CubicHermiteSpline

    at, slope = np.asarray(spiral.edges(length)), (spiral.tip_thickness - spiral.base_thickness) / length
    thickness = spiral.base_thickness + slope * at
    values = np.log(-slope / (spiral.growth(length) * thickness))
    return Curve.through(CubicHermiteSpline(at, values, -slope / thickness), exponential=True)


def of_sections(length: float, sections: Sequence[RodSection]) -> Profile:
    """A rod of sections, which state all that they need."""
    edges = (0.0, *(section.to for section in sections[:-1]), length)
    spans = zip(sections, pairwise(edges), strict=True)
    columns = zip(*(_of_section(section, b - a) for section, (a, b) in spans), strict=True)
    stiffness, mass, inertia, rest, thickness = (Curve(edges, tuple(map(_coefficients, each))) for each in columns)
    half = thickness.scaled(0.5)
    return Profile(length, stiffness, mass, inertia, rest, half, None if sections[0].thick is None else half)


def _of_section(section: RodSection, span: float) -> tuple[float | Polynomial, ...]:
    """Stiffness, mass, rotary inertia, rest curvature and thickness of a section, of the distance from its start."""
    width, thickness, modulus, density = (
        _line(value or 0.0, span) for value in (section.width, section.thick, section.youngs_modulus, section.density)
    )
    inertia = _line(section.rotary_inertia or 0.0, span)
    if section.bending_stiffness is not None:
        stiffness, mass = _line(section.bending_stiffness, span), _line(section.linear_density or 0.0, span)
    else:
        if section.diameter is None:
            second, mass = width * thickness**3 / 12, density * width * thickness
        else:
            second, mass = math.pi * thickness**4 / 64, density * math.pi * thickness**2 / 4
        stiffness = modulus * second
        inertia = density * second if section.rotary_inertia is None else inertia
    return stiffness, mass, inertia, _line(section.rest_curvature or 0.0, span), thickness


def of_samples(length: float, samples: RodSamples) -> Profile:
    from scipy.interpolate import PchipInterpolator

    at = np.array([*samples.at[:-1], length])

    def smooth(values: Sequence[float] | None, *, exponential: bool = False) -> Curve:
        if values is None:
            return Curve.along(length, 0.0)
        numbers = np.log(values) if exponential else np.asarray(values)
        return Curve.through(PchipInterpolator(at, numbers), exponential=exponential)

    thickness = smooth(samples.thickness).scaled(0.5)
    return Profile(
        length,
        smooth(samples.bending_stiffness, exponential=True),
        smooth(samples.linear_density, exponential=True),
        smooth(samples.rotary_inertia),
        smooth(samples.rest_curvature),
        thickness,
        None if samples.thickness is None else thickness,
    )


def _line(value: Varying[float], span: float) -> float | Polynomial:
    """A number, or one that is linear between its two values over a span [m]."""
    first, last = ends(value)
    return first if first == last else Polynomial([first, (last - first) / span])


def _coefficients(value: float | Polynomial) -> tuple[float, ...]:
    return tuple(value.coef.tolist()) if isinstance(value, Polynomial) else (value,)
