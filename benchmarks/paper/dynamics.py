"""The paper's equations of motion as one would write them for speed: what the package is raced against."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from benchmarks.paper import appendix, closed_forms
from benchmarks.paper.closed_forms import GUARD
from benchmarks.paper.kinematics import Bent
from benchmarks.paper.two_arcs import Terms, TwoArcs

__all__ = ["RacedFinger", "assembled", "by_appendix", "by_closed_forms", "closed_form_terms"]

Number = Any
"""A float, or a CasADi SX."""


@dataclass(frozen=True)
class RacedFinger:
    """Two arcs, the first from the base to the contact, the second from the contact to the tip. SI units."""

    element_lengths: tuple[Number, Number] = (0.3, 0.3)
    mass_per_length: Number = 6450 * math.pi * 0.001**2
    rotary_inertia: Number = 0.0
    """Rotary inertia per length [kg m]; the appendix leaves it out where it is as printed."""
    bending_stiffness: Number = 60e9 * math.pi * 0.002**4 / 64
    rest_angles: tuple[Number, Number] = (0.0, 0.0)
    tip_mass: Number = 0.0
    contact_mass: Number = 0.0
    gravity: tuple[Number, Number] = (0.0, -9.81)
    """World axes [m/s2]."""
    base_angle: float = 0.0
    """World angle of the base axes [rad]."""
    arc_damping: Number = 0.0
    """c_frc of equation (39) [N m s]."""
    material_damping: float = 0.0
    """eta [N m2 s]; eta / L_i per arc."""
    tendon_offset: Number | None = 0.005
    """e of equation (42) [m], u = [F1, F2]; None: u = [tip moment]."""


def arcs(finger: RacedFinger) -> TwoArcs:
    """What the paper's equations need to know of the finger."""
    return TwoArcs(
        lengths=finger.element_lengths,
        mass_per_length=finger.mass_per_length,
        rotary_inertia=finger.rotary_inertia,
        contact_mass=finger.contact_mass,
        tip_mass=finger.tip_mass,
        gravity=to_base(finger, finger.gravity),
    )


def to_base(finger: RacedFinger, vector: tuple[Number, Number]) -> tuple[Number, Number]:
    """A world vector in base axes."""
    c, s = (_tidy(f(finger.base_angle)) for f in (math.cos, math.sin))
    return _rotated(c, s, *vector)


def _tidy(value: float) -> float:
    """cos(pi/2) is 0, not 6e-17: no instructions for round-off."""
    return float(round(value)) if abs(value - round(value)) < 1e-15 else value


def _rotated(c: float, s: float, x: Number, y: Number) -> tuple[Number, Number]:
    if s == 0.0:
        return (x, y) if c == 1.0 else (-x, -y)
    if c == 0.0:
        return (y, -x) if s == 1.0 else (-y, x)
    return c * x + s * y, c * y - s * x


def assembled(
    name: str,
    finger: RacedFinger,
    terms: Callable[[RacedFinger, ca.SX, ca.SX, ca.SX, ca.SX], tuple[ca.SX, ca.SX]],
) -> ca.Function:
    """(x, u, w, p) -> xd with x = [theta1, theta2, rates], w = world forces at contact, then tip.

    ``terms(finger, theta, rate, contact_force, tip_force)`` gives the mass matrix and the generalized force
    of inertia, gravity and contacts on the right-hand side; elasticity, damping and actuation are added here,
    equations (32), (39), (42). There are no run-time parameters: p is empty.
    """
    p = ca.SX(0, 1)
    x = ca.SX.sym("x", 4)
    u = ca.SX.sym("u", 1 if finger.tendon_offset is None else 2)
    w = ca.SX.sym("w", 4)
    theta, rate = x[:2], x[2:]
    tau = u[0] if finger.tendon_offset is None else (u[0] - u[1]) * finger.tendon_offset
    at_contact = ca.vertcat(*to_base(finger, (w[0], w[1])))
    at_tip = ca.vertcat(*to_base(finger, (w[2], w[3])))
    mass, force = terms(finger, theta, rate, at_contact, at_tip)
    right = []
    for i, length in enumerate(finger.element_lengths):
        bend = theta[i] - finger.rest_angles[i]
        damping = finger.arc_damping + finger.material_damping / length
        right.append(force[i] + tau - finger.bending_stiffness / length * bend - damping * rate[i])
    scale = 1 / (mass[0, 0] * mass[1, 1] - mass[0, 1] * mass[0, 1])
    xd = ca.vertcat(
        rate,
        (mass[1, 1] * right[0] - mass[0, 1] * right[1]) * scale,
        (mass[0, 0] * right[1] - mass[0, 1] * right[0]) * scale,
    )
    return ca.Function(name, [x, u, w, p], [ca.cse(xd)], ["x", "u", "w", "p"], ["xd"])


def kinetic_energy_by_quadrature(finger: RacedFinger, theta: ca.SX, rate: ca.SX, nodes: int = 5) -> ca.SX:
    """Kinetic energy of the rod, equation (34), without equation (36): Gauss points on each arc, velocities by
    differentiating (4)-(6); what is written without integrating by hand.
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


def closed_form_terms(
    finger: RacedFinger, theta: ca.SX, rate: ca.SX, *, guard: float = GUARD, bias: str = "christoffel"
) -> Terms:
    """Mass matrix, bias, gravity and Jacobians, point masses included.

    Parameters
    ----------
    guard : float
        Smallest angle [rad]; 0 leaves the divisions bare. Rounding grows like a high power of 1 / theta and
        the guard itself errs like its size, so no value is accurate near a straight finger.
    bias : {"christoffel", "lagrange", "quadrature"}
        The paper's formulas, with sums over the derivatives of the mass matrix (the fastest); or the Lagrangian of
        (4)-(12), (28) and (36) differentiated, d/dt(dT/dqd) - dT/dq by directional derivatives; or that with the
        kinetic energy by quadrature.
    """
    if bias == "christoffel":
        return closed_forms.terms(arcs(finger), theta, rate, guard=guard)
    if bias not in ("lagrange", "quadrature"):
        raise ValueError(f"bias must be 'christoffel', 'lagrange' or 'quadrature', got {bias!r}")
    t, td = ca.SX.sym("theta", 2), ca.SX.sym("rate", 2)
    made = arcs(finger)
    bent = Bent(made, t)
    jc, jt = ca.jacobian(bent.contact, t), ca.jacobian(bent.tip, t)
    if bias == "quadrature":
        rod = 2 * kinetic_energy_by_quadrature(finger, t, td)
    else:
        rod = td.T @ closed_forms.rod_mass_matrix(bent) @ td
    vc, vt = jc @ td, jt @ td
    kinetic = (rod + made.contact_mass * ca.dot(vc, vc) + made.tip_mass * ca.dot(vt, vt)) / 2
    (l1, l2), rho = made.lengths, made.mass_per_length
    weight = rho * l1 * bent.center1 + rho * l2 * bent.center2
    weight += made.contact_mass * bent.contact + made.tip_mass * bent.tip
    potential = -ca.dot(ca.vertcat(*made.gravity), weight)
    mass, momentum = ca.hessian(kinetic, td)
    inertial = ca.jtimes(momentum, t, td) - ca.gradient(kinetic, t)
    found = [mass, inertial, ca.gradient(potential, t), jc, jt]
    return Terms(*ca.substitute(closed_forms.guarded(found, t, theta, guard), [td], [rate]))


def by_closed_forms(finger: RacedFinger, *, guard: float = GUARD, bias: str = "christoffel") -> ca.Function:
    """(x, u, w, p) -> xd of ``assembled`` by the closed forms; ``guard`` and ``bias`` as of ``closed_form_terms``."""

    def right(
        described: RacedFinger, theta: ca.SX, rate: ca.SX, at_contact: ca.SX, at_tip: ca.SX
    ) -> tuple[ca.SX, ca.SX]:
        part = closed_form_terms(described, theta, rate, guard=guard, bias=bias)
        force = part.contact_jacobian.T @ at_contact + part.tip_jacobian.T @ at_tip - part.bias - part.gravity
        return part.mass, force

    return assembled("closed_forms", finger, right)


def by_appendix(finger: RacedFinger) -> ca.Function:
    """(x, u, w, p) -> xd of ``assembled`` by the corrected appendix."""

    def right(
        described: RacedFinger, theta: ca.SX, rate: ca.SX, at_contact: ca.SX, at_tip: ca.SX
    ) -> tuple[ca.SX, ca.SX]:
        return appendix.right_hand_side(arcs(described), theta, rate, at_contact, at_tip)

    return assembled("appendix", finger, right)
