"""Places of a rod between its nodes, and its half thickness."""

from __future__ import annotations

from continuum_grasp.grasp.rods.geometry import Geometry, Value, Values

THICKNESS = 6
"""Numbers of the half thickness on a piece: where the piece starts, then coefficients of a polynomial from there."""


def half_thickness(numbers: Values, s: Value) -> Value:
    """Half thickness at a place."""
    start, *coefficients = (numbers[k] for k in range(THICKNESS))
    value = coefficients[-1]
    for coefficient in reversed(coefficients[:-1]):
        value = coefficient + (s - start) * value
    return value


def taper(numbers: Values, s: Value) -> Value:
    """Derivative of the half thickness at a place."""
    start, _, *coefficients = (numbers[k] for k in range(THICKNESS))
    value = 0.0
    for power in reversed(range(1, len(coefficients) + 1)):
        value = power * coefficients[power - 1] + (s - start) * value
    return value


def between(geometry: Geometry, a: Values, b: Values, h: Value, share: Value) -> Values:
    """Place at a share of a stage of length h between two states, by the cubic through both and their directions."""
    w0, w1 = (1.0 + 2.0 * share) * (1.0 - share) ** 2, share * share * (3.0 - 2.0 * share)
    v0, v1 = share * (1.0 - share) ** 2, share * share * (share - 1.0)
    ends = zip(geometry.tangent(a), geometry.tangent(b), strict=True)
    return [w0 * a[k] + w1 * b[k] + h * (v0 * along + v1 * last) for k, (along, last) in enumerate(ends)]
