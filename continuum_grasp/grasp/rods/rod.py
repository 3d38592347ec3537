"""The inextensible elastic rod as an initial value problem, in units of its length L, E I / L^2 and E I / L.

A `Geometry` has the equations of its state. The force F [N] that the part beyond s exerts changes by F' = -w(s) G.
m [N m] is the moment of the tendons at the base, and t(s) its shape along the finger. k0(s) [1/m] is the curvature at
rest, B(s) [N m2] the bending stiffness, and w G [N/m] the weight per length. All are polynomials of s.
"""

from __future__ import annotations

from dataclasses import dataclass

from continuum_grasp.grasp.rods.geometry import Geometry, Value, Values


def polynomial(coefficients: Values, s: Value) -> Value:
    """Value of a polynomial at s; the constant comes first."""
    value = coefficients[-1]
    for coefficient in reversed(coefficients[:-1]):
        value = coefficient + s * value
    return value


def integral(coefficients: Values, a: Value, b: Value) -> Value:
    """Integral of a polynomial from a to b."""
    whole = [0.0, *(coefficient / (k + 1) for k, coefficient in enumerate(coefficients))]
    return polynomial(whole, b) - polynomial(whole, a)


def slope(coefficients: Values, s: Value) -> Value:
    """Derivative of a polynomial at s."""
    if len(coefficients) == 1:
        return 0.0
    return polynomial([k * coefficient for k, coefficient in enumerate(coefficients)][1:], s)


@dataclass(frozen=True)
class Course:
    """What varies along a finger, as coefficients of polynomials of s; in units of the finger."""

    stiffness: Values
    rest: Values
    tendon: Values
    weight: Values
    half: Values  # half thickness

    @property
    def numbers(self) -> Values:
        """All coefficients."""
        return [*self.stiffness, *self.rest, *self.tendon, *self.weight, *self.half]

    @staticmethod
    def of(numbers: Values) -> Course:
        """A course by all its coefficients, as many of each polynomial."""
        count = len(numbers) // 5
        return Course(*(numbers[k * count : (k + 1) * count] for k in range(5)))


def stage(
    geometry: Geometry,
    course: Course,
    sides: Values,
    gravity: Values,
    state: Values,
    force: Values,
    m: Value,
    s: Value,
    h: Value,
) -> Values:
    """State at the end of a stage of length h from s, where the force beyond is ``force``."""
    state = [*state]
    begin = s
    h = h / geometry.steps

    def rates(q: Values, at: Value) -> Values:
        weight = integral(course.weight, begin, at)
        beyond = [part - g * weight for part, g in zip(force, gravity, strict=True)]
        pulled = polynomial(course.tendon, at) * m
        return geometry.rates(q, beyond, polynomial(course.stiffness, at), polynomial(course.rest, at), pulled, sides)

    def moved(by: Values, share: Value) -> Values:
        return [q + share * rate for q, rate in zip(state, by, strict=True)]

    for k in range(geometry.steps):
        at = s + k * h
        first = rates(state, at)
        second = rates(moved(first, 0.5 * h), at + 0.5 * h)
        third = rates(moved(second, 0.5 * h), at + 0.5 * h)
        fourth = rates(moved(third, h), at + h)
        mean = [(a + 2.0 * b + 2.0 * c + d) / 6.0 for a, b, c, d in zip(first, second, third, fourth, strict=True)]
        state = moved(mean, h)
    return state


def between(geometry: Geometry, a: Values, b: Values, h: Value, share: Value) -> Values:
    """Place at a share of a stage of length h between two states, by the cubic through both and their directions."""
    w0, w1 = (1.0 + 2.0 * share) * (1.0 - share) ** 2, share * share * (3.0 - 2.0 * share)
    v0, v1 = share * (1.0 - share) ** 2, share * share * (share - 1.0)
    ends = zip(geometry.tangent(a), geometry.tangent(b), strict=True)
    return [w0 * a[k] + w1 * b[k] + h * (v0 * along + v1 * last) for k, (along, last) in enumerate(ends)]
