"""The paper's closed forms, corrected, on the benchmarks' finger.

Everything is divided by powers of the bending angles; the divisions are guarded the usual way: an angle smaller than
``GUARD`` is replaced by ``GUARD`` (in the finished expressions, so that the derivatives stay right).
"""

from __future__ import annotations

from collections.abc import Iterable

import casadi as ca
import numpy as np

from benchmarks.baselines.two_arcs import TwoArcs, arcs
from benchmarks.baselines.two_arcs import forward_dynamics as assemble
from benchmarks.paper import Terms, closed_forms
from benchmarks.paper.closed_forms import GUARD
from benchmarks.paper.kinematics import Bent


def kinetic_energy_by_quadrature(finger: TwoArcs, theta: ca.SX, rate: ca.SX, nodes: int = 5) -> ca.SX:
    """Kinetic energy of the rod, equation (34), without equation (36): Gauss points on each arc, velocities by
    differentiating (4)-(6); what is written when no integral is found by hand.
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
    weight = rho * l1 * bent.centre1 + rho * l2 * bent.centre2
    weight += made.contact_mass * bent.contact + made.tip_mass * bent.tip
    potential = -ca.dot(ca.vertcat(*made.gravity), weight)
    mass, momentum = ca.hessian(kinetic, td)
    inertial = ca.jtimes(momentum, t, td) - ca.gradient(kinetic, t)
    found = [mass, inertial, ca.gradient(potential, t), jc, jt]
    return Terms(*ca.substitute(closed_forms.guarded(found, t, theta, guard), [td], [rate]))


def forward_dynamics(
    finger: TwoArcs, parameters: Iterable[str] = (), *, guard: float = GUARD, bias: str = "christoffel"
) -> ca.Function:
    """(x, u, w, p) -> xd of ``two_arcs.forward_dynamics`` by the closed forms."""

    def right(described: TwoArcs, theta: ca.SX, rate: ca.SX, at_contact: ca.SX, at_tip: ca.SX) -> tuple[ca.SX, ca.SX]:
        part = terms(described, theta, rate, guard=guard, bias=bias)
        force = part.contact_jacobian.T @ at_contact + part.tip_jacobian.T @ at_tip - part.bias - part.gravity
        return part.mass, force

    return assemble("closed_forms", finger, right, parameters)
