"""The paper's appendix: Taylor polynomials of total degree 5 in the bending angles, in three readings.

Evaluated the way a careful C programmer would: powers shared by all polynomials, constants folded into the
coefficients, point masses, their weight and the forces on them gathered into one force per point.
"""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction

import casadi as ca

from benchmarks.paper.coefficients import BIAS, GRAVITY_ACROSS, GRAVITY_ALONG, JACOBIAN, MASS, Polynomial, Reading
from benchmarks.paper.kinematics import Terms, TwoArcs, is_zero
from continuum_grasp.model.planar import Scalar

__all__ = ["POSITION", "position", "right_hand_side", "terms"]

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

_Numbers = Mapping[tuple[int, int], Scalar]
"""Powers of the two angles -> coefficient."""


class _Powers:
    """Monomials of the two angles, each formed once."""

    def __init__(self, theta: ca.SX) -> None:
        self._known: dict[tuple[int, int], ca.SX] = {(1, 0): theta[0], (0, 1): theta[1]}

    def __call__(self, i: int, j: int) -> ca.SX:
        """theta1^i theta2^j."""
        if (i, j) not in self._known:
            if i and j:
                self._known[i, j] = self(i, 0) * self(0, j)
            else:
                half, rest = ((i // 2, 0), (i - i // 2, 0)) if i else ((0, j // 2), (0, j - j // 2))
                self._known[i, j] = self(*half) * self(*rest)
        return self._known[i, j]

    def evaluate(self, table: _Numbers, scale: Scalar = 1.0) -> ca.SX:
        """Scale times the polynomial; a known scale costs nothing."""
        known = not isinstance(scale, ca.SX)
        total = ca.SX(0)
        for (i, j), coefficient in sorted(table.items(), key=lambda item: sum(item[0])):
            value = coefficient * scale if known else coefficient
            total += value * self(i, j) if i or j else value
        return total if known else scale * total


def _derivative(table: _Numbers, variable: int) -> _Numbers:
    """Derivative of a polynomial with respect to angle 0 or 1."""
    result: dict[tuple[int, int], Scalar] = {}
    for (i, j), coefficient in table.items():
        if variable == 0 and i:
            result[i - 1, j] = i * coefficient
        if variable == 1 and j:
            result[i, j - 1] = j * coefficient
    return result


class _Appendix:
    """The polynomials of one finger in one state."""

    def __init__(self, arcs: TwoArcs, theta: ca.SX, rate: ca.SX, reading: Reading) -> None:
        self.arcs, self.rate, self.reading = arcs, rate, reading
        self.power = _Powers(theta)

    def numbers(self, polynomial: Polynomial) -> _Numbers:
        """Coefficients for the finger's lengths."""
        return {powers: getattr(m, self.reading)(*self.arcs.lengths) for powers, m in polynomial.items()}

    def rod(self) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Mass matrix, velocity products and gravity of the rod alone, (A.1), (A.3), (A.4)."""
        arcs, rate = self.arcs, self.rate
        rho = arcs.mass_per_length
        m11, m12, m22 = (self.power.evaluate(self.numbers(p), rho) for p in MASS.values())
        if self.reading != "printed" and not is_zero(arcs.rotary_inertia):
            (l1, l2), rho_i = arcs.lengths, arcs.rotary_inertia
            m11, m12, m22 = m11 + rho_i * (l1 / 3 + l2), m12 + rho_i * l2 / 2, m22 + rho_i * l2 / 3
        squares = {"1": rate[0] * rate[0], "2": rate[0] * rate[1], "3": rate[1] * rate[1]}
        bias = [ca.SX(0), ca.SX(0)]
        for key, polynomial in BIAS.items():
            bias[int(key[1]) - 1] += self.power.evaluate(self.numbers(polynomial), rho) * squares[key[2]]
        gravity = [ca.SX(0), ca.SX(0)]
        for table, g in ((GRAVITY_ACROSS, arcs.gravity[0]), (GRAVITY_ALONG, -arcs.gravity[1])):
            for i, polynomial in enumerate(table.values()):
                if not is_zero(g):
                    gravity[i] += self.power.evaluate(self.numbers(polynomial), rho * g)
        mass = ca.vertcat(ca.horzcat(m11, m12), ca.horzcat(m12, m22))
        return mass, ca.vertcat(*bias), ca.vertcat(*gravity)

    def jacobian(self, which: str) -> ca.SX:
        """Jacobian (A.2) of the contact ("c") or the tip ("t")."""
        rows = []
        for row in (1, 2):
            entries = [JACOBIAN.get(f"J{which}{row}{column}", {}) for column in (1, 2)]
            rows.append(ca.horzcat(*(self.power.evaluate(self.numbers(entry)) for entry in entries)))
        return ca.vertcat(*rows)

    def acceleration(self, which: str) -> ca.SX:
        """Velocity-product acceleration of the contact or the tip: the rate of the Jacobian times the rates."""
        rate, rows = self.rate, []
        for row in (1, 2):
            first, second = (self.numbers(JACOBIAN.get(f"J{which}{row}{column}", {})) for column in (1, 2))
            # The columns are derivatives of one polynomial, so the mixed derivative needs one of them only.
            rows.append(
                self.power.evaluate(_derivative(first, 0)) * (rate[0] * rate[0])
                + self.power.evaluate(_derivative(first, 1)) * (2 * rate[0] * rate[1])
                + self.power.evaluate(_derivative(second, 1)) * (rate[1] * rate[1])
            )
        return ca.vertcat(*rows)

    @property
    def points(self) -> tuple[tuple[str, Scalar], tuple[str, Scalar]]:
        """Names and point masses of contact and tip."""
        return ("c", self.arcs.contact_mass), ("t", self.arcs.tip_mass)


def terms(arcs: TwoArcs, theta: ca.SX, rate: ca.SX, reading: Reading = "corrected") -> Terms:
    """Mass matrix, velocity products, gravity and Jacobians; point masses enter by (37) through (A.2).

    The rotary inertia is left out as printed, as the paper does.
    """
    made = _Appendix(arcs, theta, rate, reading)
    mass, bias, gravity = made.rod()
    g = ca.vertcat(*arcs.gravity)
    jacobians = []
    for which, point in made.points:
        jacobian = made.jacobian(which)
        jacobians.append(jacobian)
        if not is_zero(point):
            mass += point * (jacobian.T @ jacobian)
            bias += point * (jacobian.T @ made.acceleration(which))
            gravity -= point * (jacobian.T @ g)
    return Terms(mass, bias, gravity, jacobians[0], jacobians[1])


def right_hand_side(
    arcs: TwoArcs, theta: ca.SX, rate: ca.SX, at_contact: ca.SX, at_tip: ca.SX, reading: Reading = "corrected"
) -> tuple[ca.SX, ca.SX]:
    """Mass matrix, and the generalized force of inertia, gravity and the forces on contact and tip [N, base axes]."""
    made = _Appendix(arcs, theta, rate, reading)
    mass, bias, gravity = made.rod()
    force = -bias - gravity
    g = ca.vertcat(*arcs.gravity)
    for (which, point), applied in zip(made.points, (at_contact, at_tip), strict=True):
        jacobian = made.jacobian(which)
        if not is_zero(point):
            applied = applied + point * (g - made.acceleration(which))
            outer = [ca.dot(jacobian[:, i], jacobian[:, j]) for i, j in ((0, 0), (0, 1), (1, 1))]
            mass += point * ca.vertcat(ca.horzcat(outer[0], outer[1]), ca.horzcat(outer[1], outer[2]))
        force += jacobian.T @ applied
    return mass, force


def position(length: Scalar, theta: ca.SX, s: Scalar, *, printed: bool = False) -> ca.SX:
    """Position at s [m] along an arc from its start, equation (45) [m]."""
    u = s / length
    rows = []
    for powers in POSITION.values():
        row = ca.SX(0)
        for n, both in powers.items():
            row += float(both[1 if printed else 0]) * (u * theta) ** n
        rows.append(s * row)
    return ca.vertcat(*rows)
