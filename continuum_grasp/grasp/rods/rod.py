"""The planar inextensible elastic rod as an initial value problem, in units of its length L, E I / L^2 and E I / L.

    x' = -sin(a),  y' = cos(a),  a' = k0(s) + (M + t(s) m) / B(s),  M' = sin(a) Fy + cos(a) Fx,  F' = -w(s) G

(x, y) [m] is the place and a [rad] the angle at s. M [N m] and F [N] are the moment and the force that the part beyond
s exerts. m [N m] is the moment of the tendons at the base, and t(s) its shape along the finger. k0 [1/m] is the
curvature at rest, B [N m2] the bending stiffness, and w G [N/m] the weight per length. All are polynomials of s.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from continuum_grasp.base import Array

Value = Any
"""A number, an array of numbers, or a symbol of CasADi."""
Values = Any
"""A sequence of these."""
SUBSTEPS = 4
"""Steps of the fourth-order rule of Runge and Kutta in a stage."""


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
    course: Course,
    gravity: Values,
    state: Values,
    force: Values,
    m: Value,
    s: Value,
    h: Value,
) -> Values:
    """State (x, y, a, M) at the end of a stage of length h from s, where the force beyond is ``force``."""
    lib = ca if any(isinstance(part, ca.SX) for part in (*state, s, h)) else np
    state = [*state]
    begin = s
    h = h / SUBSTEPS

    def rates(q: Values, at: Value) -> Values:
        angle, moment = q[2], q[3]
        weight = integral(course.weight, begin, at)
        bend = (moment + polynomial(course.tendon, at) * m) / polynomial(course.stiffness, at)
        sine, cosine = lib.sin(angle), lib.cos(angle)
        couple = sine * (force[1] - gravity[1] * weight) + cosine * (force[0] - gravity[0] * weight)
        return [-sine, cosine, polynomial(course.rest, at) + bend, couple]

    def moved(by: Values, share: Value) -> Values:
        return [q + share * rate for q, rate in zip(state, by, strict=True)]

    for k in range(SUBSTEPS):
        at = s + k * h
        first = rates(state, at)
        second = rates(moved(first, 0.5 * h), at + 0.5 * h)
        third = rates(moved(second, 0.5 * h), at + 0.5 * h)
        fourth = rates(moved(third, h), at + h)
        mean = [(a + 2.0 * b + 2.0 * c + d) / 6.0 for a, b, c, d in zip(first, second, third, fourth, strict=True)]
        state = moved(mean, h)
    return state


def between(a: Values, b: Values, h: Value, share: Value) -> tuple[Value, Value]:
    """Place at a share of a stage of length h between two states, by the cubic through both and their directions."""
    lib = ca if any(isinstance(part, ca.SX) for part in (*a, *b)) else np
    w0, w1 = (1.0 + 2.0 * share) * (1.0 - share) ** 2, share * share * (3.0 - 2.0 * share)
    v0, v1 = share * (1.0 - share) ** 2, share * share * (share - 1.0)
    x = w0 * a[0] + w1 * b[0] - h * (v0 * lib.sin(a[2]) + v1 * lib.sin(b[2]))
    y = w0 * a[1] + w1 * b[1] + h * (v0 * lib.cos(a[2]) + v1 * lib.cos(b[2]))
    return x, y


def crossed(a: Array, b: Array) -> Array:
    """Cross products (...,) of vectors of the plane (..., 2)."""
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])
