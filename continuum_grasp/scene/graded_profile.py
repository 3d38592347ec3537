"""The curves of a rod along its length, from what the user gives it by."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from continuum_grasp.scene.graded import RodSamples, RodSection, SpiRob, ends
from continuum_grasp.scene.profile import Curve, Profile

Varying = float | tuple[float, float]
Coefficients = tuple[float, ...]


def line(length: float, value: Varying) -> Curve:
    """A value, or one that is linear between its two values, from 0 to a length [m]."""
    return Curve((0.0, length), (_line(value, length),))


def touching(length: float, spiral: SpiRob) -> Curve:
    """Curvature that closes the gaps of a spiral [1/m]: that which it has, ``-dh/ds / (b h)`` of its thickness h.

    In the logarithm by cubics that have its values and slopes at the ends of units.
    """
    from scipy.interpolate import CubicHermiteSpline

    at, slope = np.asarray(spiral.edges(length)), (spiral.tip_thickness - spiral.base_thickness) / length
    thickness = spiral.base_thickness + slope * at
    values = np.log(-slope / (spiral.growth(length) * thickness))
    return _of_spline(CubicHermiteSpline(at, values, -slope / thickness), exponential=True)


def of_sections(length: float, sections: Sequence[RodSection]) -> Profile:
    """A rod of sections, which state all that they need."""
    edges = (0.0, *(one.to for one in sections[:-1]), length)
    spans = [(one, b - a) for one, (a, b) in zip(sections, pairwise(edges), strict=True)]

    def curve(of: Callable[[RodSection, float], Coefficients]) -> Curve:
        return Curve(edges, tuple(of(section, span) for section, span in spans))

    def product(factor: float, span: float, values: Iterable[Varying | None]) -> Coefficients:
        found = np.array([factor])
        for value in values:
            found = np.convolve(found, _line(value or 0.0, span))
        return tuple(map(float, found))

    def area(one: RodSection, moment: int) -> tuple[float, list[Varying | None]]:
        """Area of a section, or its second moment where ``moment`` is 2, as a product."""
        if one.diameter is not None:
            return math.pi / (64.0 if moment else 4.0), [one.diameter] * (2 + moment)
        return 1.0 / (12.0 if moment else 1.0), [one.width, *[one.thickness] * (1 + moment)]

    def stiffness(one: RodSection, span: float) -> Coefficients:
        if one.bending_stiffness is not None:
            return _line(one.bending_stiffness, span)
        factor, sides = area(one, 2)
        return product(factor, span, [one.youngs_modulus, *sides])

    def mass(one: RodSection, span: float) -> Coefficients:
        if one.linear_density is not None:
            return _line(one.linear_density, span)
        factor, sides = area(one, 0)
        return product(factor, span, [one.density, *sides])

    def inertia(one: RodSection, span: float) -> Coefficients:
        if one.rotary_inertia is not None or not one.shaped:
            return _line(one.rotary_inertia or 0.0, span)
        factor, sides = area(one, 2)
        return product(factor, span, [one.density, *sides])

    thickness = curve(lambda one, span: _line(one.thick or 0.0, span)).scaled(0.5)
    return Profile(
        length,
        curve(stiffness),
        curve(mass),
        curve(inertia),
        curve(lambda one, span: _line(one.rest_curvature or 0.0, span)),
        thickness,
        None if sections[0].thick is None else thickness,
        graded=True,
    )


def of_samples(length: float, samples: RodSamples) -> Profile:
    """A rod of samples."""
    from scipy.interpolate import PchipInterpolator

    at = np.array([*samples.at[:-1], length])

    def smooth(values: Sequence[float] | None, *, exponential: bool = False) -> Curve:
        if values is None:
            return Curve.uniform(length, 0.0)
        given = np.log(values) if exponential else np.asarray(values)
        return _of_spline(PchipInterpolator(at, given), exponential=exponential)

    thickness = smooth(samples.thickness).scaled(0.5)
    return Profile(
        length,
        smooth(samples.bending_stiffness, exponential=True),
        smooth(samples.linear_density, exponential=True),
        smooth(samples.rotary_inertia),
        smooth(samples.rest_curvature),
        thickness,
        None if samples.thickness is None else thickness,
        graded=True,
    )


def of_spiral(length: float, spiral: SpiRob, **material: float | None) -> Profile:
    """A straightened spiral; ``material`` is that of a section."""
    thickness = (spiral.base_thickness, spiral.tip_thickness)
    width = thickness if spiral.width is None else spiral.width
    whole = of_sections(length, [RodSection(to=length, thickness=thickness, width=width, **material)])
    return replace(
        whole,
        bending_stiffness=whole.bending_stiffness.scaled(spiral.core**3),
        half_depth=whole.half_thickness.scaled(spiral.core),
    )


def _of_spline(spline: object, *, exponential: bool) -> Curve:
    # scipy has the highest power first, one column per piece.
    powers = np.asarray(spline.c)[::-1].T  # type: ignore[attr-defined]
    edges = tuple(map(float, spline.x))  # type: ignore[attr-defined]
    return Curve(edges, tuple(tuple(map(float, piece)) for piece in powers), exponential)


def _line(value: Varying, span: float) -> Coefficients:
    first, last = ends(value)
    return (first,) if first == last else (first, (last - first) / span)
