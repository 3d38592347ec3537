"""The paper's appendix: Taylor polynomials of total degree 5 in the bending angles, corrected or as printed.

Evaluated the way a careful C programmer would: powers shared by all polynomials, constants folded into the
coefficients, point masses, their weight and the forces on them gathered into one force per point.
"""

from __future__ import annotations

from collections.abc import Iterable

import casadi as ca

from benchmarks.baselines.appendix_coefficients import Table, tables
from benchmarks.baselines.two_arcs import Number, Terms, TwoArcs, to_base
from benchmarks.baselines.two_arcs import forward_dynamics as assemble


class Powers:
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

    def evaluate(self, table: Table, scale: Number = 1.0) -> ca.SX:
        """Scale times the polynomial; a known scale costs nothing."""
        known = not isinstance(scale, ca.SX)
        total = ca.SX(0)
        for (i, j), coefficient in sorted(table.items(), key=lambda item: sum(item[0])):
            value = coefficient * scale if known else coefficient
            total += value * self(i, j) if i or j else value
        return total if known else scale * total


def derivative(table: Table, variable: int) -> Table:
    """Derivative of a polynomial with respect to angle 0 or 1."""
    result = {}
    for powers, coefficient in table.items():
        if powers[variable]:
            lower = list(powers)
            lower[variable] -= 1
            result[lower[0], lower[1]] = powers[variable] * coefficient
    return result


def _is_zero(value: Number) -> bool:
    return not isinstance(value, ca.SX) and value == 0


def _rod(finger: TwoArcs, power: Powers, rate: ca.SX, printed: bool) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Mass matrix, bias and gravity of the rod alone, (A.1), (A.3), (A.4)."""
    t = tables(*finger.element_lengths, printed=printed)
    rho = finger.mass_per_length
    m11, m12, m22 = (power.evaluate(t[key], rho) for key in ("M11", "M12", "M22"))
    squares = {"1": rate[0] * rate[0], "2": rate[0] * rate[1], "3": rate[1] * rate[1]}
    bias = [
        sum((power.evaluate(t[key], rho) * squares[key[2]] for key in keys), ca.SX(0))
        for keys in (("V11", "V12", "V13"), ("V21", "V23"))
    ]
    gx, gy = to_base(finger, finger.gravity)
    gravity = [ca.SX(0), ca.SX(0)]
    for i in (0, 1):
        for key, g in (("GX", gx), ("GY", -gy)):
            if not _is_zero(g):
                gravity[i] += power.evaluate(t[f"{key}{i + 1}"], rho * g)
    mass = ca.vertcat(ca.horzcat(m11, m12), ca.horzcat(m12, m22))
    return mass, ca.vertcat(*bias), ca.vertcat(*gravity)


def _point(finger: TwoArcs, power: Powers, rate: ca.SX, which: str, mass: Number) -> tuple[ca.SX, ca.SX | None]:
    """Jacobian (A.2) of the contact ("c") or the tip ("t"); with a mass, its rate times the rates."""
    t = tables(*finger.element_lengths)
    names = [[f"J{which}{row}{column}" for column in (1, 2)] for row in (1, 2)]
    jacobian = ca.vertcat(*(ca.horzcat(*(power.evaluate(t[n]) for n in row)) for row in names))
    if _is_zero(mass):
        return jacobian, None
    acceleration = []
    for first, second in names:
        # The columns are derivatives of one polynomial, so the mixed derivative needs one of them only.
        acceleration.append(
            power.evaluate(derivative(t[first], 0)) * (rate[0] * rate[0])
            + power.evaluate(derivative(t[first], 1)) * (2 * rate[0] * rate[1])
            + power.evaluate(derivative(t[second], 1)) * (rate[1] * rate[1])
        )
    return jacobian, ca.vertcat(*acceleration)


def terms(finger: TwoArcs, theta: ca.SX, rate: ca.SX, *, printed: bool = False) -> Terms:
    """Mass matrix, bias, gravity and Jacobians; point masses enter through the Jacobians (A.2)."""
    power = Powers(theta)
    mass, bias, gravity = _rod(finger, power, rate, printed)
    g = ca.vertcat(*to_base(finger, finger.gravity))
    jacobians = []
    for which, point in (("c", finger.contact_mass), ("t", finger.tip_mass)):
        jacobian, acceleration = _point(finger, power, rate, which, point)
        jacobians.append(jacobian)
        if acceleration is not None:
            mass += point * (jacobian.T @ jacobian)
            bias += point * (jacobian.T @ acceleration)
            gravity -= point * (jacobian.T @ g)
    return Terms(mass, bias, gravity, jacobians[0], jacobians[1])


def forward_dynamics(finger: TwoArcs, parameters: Iterable[str] = (), *, printed: bool = False) -> ca.Function:
    """(x, u, w, p) -> xd of ``two_arcs.forward_dynamics`` by the appendix.

    Parameters
    ----------
    printed : bool
        True: the coefficients as printed in the paper; False: corrected.
    """

    def right(described: TwoArcs, theta: ca.SX, rate: ca.SX, at_contact: ca.SX, at_tip: ca.SX) -> tuple[ca.SX, ca.SX]:
        power = Powers(theta)
        mass, bias, gravity = _rod(described, power, rate, printed)
        force = -bias - gravity
        g = ca.vertcat(*to_base(described, described.gravity))
        for which, point, applied in (
            ("c", described.contact_mass, at_contact),
            ("t", described.tip_mass, at_tip),
        ):
            jacobian, acceleration = _point(described, power, rate, which, point)
            if acceleration is not None:
                applied = applied + point * (g - acceleration)
                outer = [ca.dot(jacobian[:, i], jacobian[:, j]) for i, j in ((0, 0), (0, 1), (1, 1))]
                mass += point * ca.vertcat(ca.horzcat(outer[0], outer[1]), ca.horzcat(outer[1], outer[2]))
            force += jacobian.T @ applied
        return mass, force

    return assemble("appendix_printed" if printed else "appendix", finger, right, parameters)
