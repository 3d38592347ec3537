"""The paper's closed forms, corrected, with the Lagrangian differentiated by CasADi.

Kinetic and potential energy are written as in equations (4)-(29) and (36): everything divided by powers of
the bending angles. The divisions are guarded the usual way: an angle smaller than ``GUARD`` is replaced by
``GUARD`` (in the finished expressions, so that the derivatives stay right).
"""

from __future__ import annotations

from collections.abc import Iterable

import casadi as ca
import numpy as np

from benchmarks.baselines.two_arcs import Terms, TwoArcs, to_base
from benchmarks.baselines.two_arcs import forward_dynamics as assemble

GUARD = 0.005
"""[rad]; about where the error of the guard meets the rounding of the divisions: no value does better."""


def positions(finger: TwoArcs, theta: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
    """Contact, tip and the arcs' mass centres in base axes, equations (4)-(12)."""
    l1, l2 = finger.element_lengths
    t1, t2 = theta[0], theta[1]
    c1, s1, c2, s2 = ca.cos(t1), ca.sin(t1), ca.cos(t2), ca.sin(t2)
    turn = ca.vertcat(ca.horzcat(c1, -s1), ca.horzcat(s1, c1))
    contact = l1 / t1 * ca.vertcat(c1 - 1, s1)
    tip = contact + turn @ (l2 / t2 * ca.vertcat(c2 - 1, s2))
    centre1 = l1 / t1**2 * ca.vertcat(s1 - t1, 1 - c1)
    centre2 = contact + turn @ (l2 / t2**2 * ca.vertcat(s2 - t2, 1 - c2))
    return contact, tip, centre1, centre2


def rod_mass_matrix(finger: TwoArcs, theta: ca.SX) -> ca.SX:
    """Mass matrix of the rod alone, equation (36) corrected."""
    l1, l2 = finger.element_lengths
    rho, rho_i = finger.mass_per_length, finger.rotary_inertia
    t1, t2 = theta[0], theta[1]
    c1, s1, c2, s2 = ca.cos(t1), ca.sin(t1), ca.cos(t2), ca.sin(t2)

    def alone(t: ca.SX, c: ca.SX, s: ca.SX) -> ca.SX:
        return 1 / (3 * t**2) + 2 * (1 + c) / t**4 - 4 * s / t**5

    px, py = l1 / t1**2 * (1 - c1 - t1 * s1), l1 / t1**2 * (t1 * c1 - s1)
    vx, vy = c1 * px + s1 * py, c1 * py - s1 * px
    m11 = (
        rho * l2 * (vx**2 + vy**2 + 2 * l2 * ((s2 - t2) * vy - (1 - c2) * vx) / t2**2 + 2 * l2**2 * (t2 - s2) / t2**3)
        + rho_i * l2
        + rho * l1**3 * alone(t1, c1, s1)
        + rho_i * l1 / 3
    )
    m12 = (
        rho * l2**2 * ((t2 * s2 + 2 * c2 - 2) * vy + (t2 * (c2 + 1) - 2 * s2) * vx) / t2**3
        + rho * l2**3 * ((1 - c2) / t2**4 - s2 / t2**3 + 1 / (2 * t2**2))
        + rho_i * l2 / 2
    )
    m22 = rho * l2**3 * alone(t2, c2, s2) + rho_i * l2 / 3
    return ca.vertcat(ca.horzcat(m11, m12), ca.horzcat(m12, m22))


def kinetic_energy_by_quadrature(finger: TwoArcs, theta: ca.SX, rate: ca.SX, nodes: int = 5) -> ca.SX:
    """Kinetic energy of the rod, equation (34), without equation (36): Gauss points on each arc, velocities by
    differentiating (4)-(6); what is written when nobody integrates by hand.
    """
    at, weights = np.polynomial.legendre.leggauss(nodes)
    l1, l2 = finger.element_lengths
    t1, t2 = theta[0], theta[1]
    turn = ca.vertcat(ca.horzcat(ca.cos(t1), -ca.sin(t1)), ca.horzcat(ca.sin(t1), ca.cos(t1)))
    total = ca.SX(0)
    for x, weight in zip(at, weights, strict=True):
        u = 0.5 * (float(x) + 1)
        first = l1 / t1 * ca.vertcat(ca.cos(u * t1) - 1, ca.sin(u * t1))
        contact = l1 / t1 * ca.vertcat(ca.cos(t1) - 1, ca.sin(t1))
        second = contact + turn @ (l2 / t2 * ca.vertcat(ca.cos(u * t2) - 1, ca.sin(u * t2)))
        for length, r, turning in ((l1, first, u * rate[0]), (l2, second, rate[0] + u * rate[1])):
            v = ca.jacobian(r, theta) @ rate
            share = finger.mass_per_length * ca.dot(v, v) + finger.rotary_inertia * turning**2
            total += 0.25 * float(weight) * length * share
    return total


def terms(finger: TwoArcs, theta: ca.SX, rate: ca.SX, *, guard: float = GUARD, bias: str = "christoffel") -> Terms:
    """Mass matrix, bias, gravity and Jacobians, point masses included, by differentiating the Lagrangian.

    Parameters
    ----------
    guard : float
        Smallest angle [rad]; 0 leaves the divisions bare. Rounding grows like a high power of 1 / theta and
        the guard itself errs like its size, so no value is accurate near a straight finger.
    bias : {"christoffel", "lagrange", "quadrature"}
        Equation (38), sums over the derivatives of the mass matrix (the fastest); or d/dt(dT/dqd) - dT/dq by
        directional derivatives, of the kinetic energy of (36) or of that by quadrature.
    """
    t, td = ca.SX.sym("theta", 2), ca.SX.sym("rate", 2)
    contact, tip, centre1, centre2 = positions(finger, t)
    jc, jt = ca.jacobian(contact, t), ca.jacobian(tip, t)
    if bias == "quadrature":
        rod = 2 * kinetic_energy_by_quadrature(finger, t, td)
    else:
        rod = td.T @ rod_mass_matrix(finger, t) @ td
    vc, vt = jc @ td, jt @ td
    kinetic = (rod + finger.contact_mass * ca.dot(vc, vc) + finger.tip_mass * ca.dot(vt, vt)) / 2
    g = ca.vertcat(*to_base(finger, finger.gravity))
    l1, l2 = finger.element_lengths
    rho = finger.mass_per_length
    weight = rho * l1 * centre1 + rho * l2 * centre2 + finger.contact_mass * contact + finger.tip_mass * tip
    potential = -ca.dot(g, weight)
    mass, momentum = ca.hessian(kinetic, td)
    if bias in ("lagrange", "quadrature"):
        inertial = ca.jtimes(momentum, t, td) - ca.gradient(kinetic, t)
    elif bias == "christoffel":
        slopes = [ca.reshape(ca.jacobian(ca.vec(mass), t)[:, k], 2, 2) for k in (0, 1)]
        inertial = ca.vertcat(
            *(
                sum((slopes[k][i, j] - slopes[i][j, k] / 2) * td[j] * td[k] for j in (0, 1) for k in (0, 1))
                for i in (0, 1)
            )
        )
    else:
        raise ValueError(f"bias must be 'christoffel', 'lagrange' or 'quadrature', got {bias!r}")
    found = [mass, inertial, ca.gradient(potential, t), jc, jt]
    guarded = [ca.if_else(ca.fabs(theta[i]) < guard, guard, theta[i]) for i in (0, 1)] if guard else [theta]
    replaced = ca.substitute(found, [t, td], [ca.vertcat(*guarded), rate])
    return Terms(*replaced)


def forward_dynamics(
    finger: TwoArcs, parameters: Iterable[str] = (), *, guard: float = GUARD, bias: str = "christoffel"
) -> ca.Function:
    """(x, u, w, p) -> xd of ``two_arcs.forward_dynamics`` by the closed forms."""

    def right(described: TwoArcs, theta: ca.SX, rate: ca.SX, at_contact: ca.SX, at_tip: ca.SX) -> tuple[ca.SX, ca.SX]:
        part = terms(described, theta, rate, guard=guard, bias=bias)
        force = part.contact_jacobian.T @ at_contact + part.tip_jacobian.T @ at_tip - part.bias - part.gravity
        return part.mass, force

    return assemble("closed_forms", finger, right, parameters)
