"""The paper's appendix: Taylor polynomials of total degree 5 in the bending angles, in three readings."""

from __future__ import annotations

from fractions import Fraction

import casadi as ca

from benchmarks.paper.coefficients import BIAS, GRAVITY_ACROSS, GRAVITY_ALONG, JACOBIAN, MASS, Polynomial, Reading
from benchmarks.paper.kinematics import Terms, TwoArcs

POSITION: dict[str, dict[int, tuple[Fraction, Fraction]]] = {
    "x": {
        1: (Fraction(-1, 2), Fraction(-1, 2)),
        3: (Fraction(1, 24), Fraction(1, 24)),
        5: (Fraction(-1, 720), Fraction(1, 720)),
    },
    "y": {
        0: (Fraction(1), Fraction(1)),
        2: (Fraction(-1, 6), Fraction(-1, 6)),
        4: (Fraction(1, 120), Fraction(1, 120)),
    },
}
"""(45): power n of the angle -> coefficient of s (s/L)^n, corrected and printed."""


def _value(polynomial: Polynomial, arcs: TwoArcs, theta: ca.SX, reading: Reading) -> ca.SX:
    """Value of a polynomial at two angles, for the finger's lengths."""
    total = ca.SX(0)
    for (i, j), monomial in polynomial.items():
        total += getattr(monomial, reading)(*arcs.lengths) * theta[0] ** i * theta[1] ** j
    return total


def terms(arcs: TwoArcs, theta: ca.SX, rate: ca.SX, reading: Reading = "corrected") -> Terms:
    """Mass matrix, velocity products, gravity and Jacobians; point masses enter by (37) through (A.2).

    The rotary inertia is left out as printed, as the paper does.
    """
    angles = ca.SX.sym("theta", 2)

    def value(polynomial: Polynomial) -> ca.SX:
        return _value(polynomial, arcs, angles, reading)

    rho, (across, along) = arcs.mass_per_length, arcs.gravity
    m11, m12, m22 = (rho * value(polynomial) for polynomial in MASS.values())
    if reading != "printed":
        (l1, l2), rho_i = arcs.lengths, arcs.rotary_inertia
        m11, m12, m22 = m11 + rho_i * (l1 / 3 + l2), m12 + rho_i * l2 / 2, m22 + rho_i * l2 / 3
    mass = ca.vertcat(ca.horzcat(m11, m12), ca.horzcat(m12, m22))
    squares = {"1": rate[0] * rate[0], "2": rate[0] * rate[1], "3": rate[1] * rate[1]}
    bias, gravity = ca.SX(2, 1), ca.SX(2, 1)
    for key, polynomial in BIAS.items():
        bias[int(key[1]) - 1] += rho * value(polynomial) * squares[key[2]]
    for table, g in ((GRAVITY_ACROSS, across), (GRAVITY_ALONG, -along)):
        for i, polynomial in enumerate(table.values()):
            gravity[i] += rho * g * value(polynomial)
    jacobians = []
    for which, point in (("c", arcs.contact_mass), ("t", arcs.tip_mass)):
        rows = [[value(JACOBIAN.get(f"J{which}{row}{column}", {})) for column in (1, 2)] for row in (1, 2)]
        jacobian = ca.vertcat(*(ca.horzcat(*row) for row in rows))
        jacobians.append(jacobian)
        mass += point * (jacobian.T @ jacobian)
        bias += point * (jacobian.T @ (ca.jtimes(jacobian, angles, rate) @ rate))
        gravity -= point * (jacobian.T @ ca.vertcat(across, along))
    return Terms(*ca.substitute([mass, bias, gravity, *jacobians], [angles], [theta]))
