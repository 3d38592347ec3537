"""The paper's dynamics in closed form: mass matrix (36), (37), velocity products (38), gravity (29).

The divisions by the angles are guarded the usual way: in the finished expressions an angle smaller than ``GUARD`` is
replaced by ``GUARD``, so that the derivatives stay right.
"""

from __future__ import annotations

import casadi as ca

from benchmarks.paper.kinematics import Bent, Terms, TwoArcs, is_zero
from benchmarks.paper.slips import AsPrinted

GUARD = 0.005
"""[rad]; about where the error of the guard meets the rounding of the divisions: no value does better."""

_RIGHT = AsPrinted()


def rod_mass_matrix(bent: Bent) -> ca.SX:
    """Mass matrix of the rod alone, equation (36) [kg m2]."""
    arcs, slips = bent.arcs, bent.slips
    l1, l2 = arcs.lengths
    rho, rho_i = arcs.mass_per_length, arcs.rotary_inertia
    t1, c1, s1, t2, c2, s2 = bent.trigonometry

    def alone(t: ca.SX, c: ca.SX, s: ca.SX, sine: float) -> ca.SX:
        return 1 / (3 * t**2) + 2 * (c + 1) / t**4 + sine * s / t**5

    velocity = bent.along_arc_slope(0)
    if "(36) axes" not in slips:
        velocity = bent.rotation.T @ velocity
    vx, vy = velocity[0], velocity[1]
    cross = slips.factor("(36) twice") * l2 * ((s2 - t2) * vy + (c2 - 1) * vx) / t2**2
    m11 = rho * l2 * (vx**2 + vy**2 + cross + 2 * l2**2 * (t2 - s2) / t2**3)
    m11 += rho * l1**3 * alone(t1, c1, s1, slips.factor("(36) M11 sine"))
    coupling = (t2 * s2 + slips.factor("(36) M12 cosine") * c2 - 2) * vy + (t2 * (c2 + 1) - 2 * s2) * vx
    end = (1 - c2) / t2**4 - s2 / t2**3 + 1 / (2 * t2**2)
    if "(36) M12 end" in slips:
        end = t2**4 - (1 - c2) / t2**3 + 1 / (2 * t2**2)
    m12 = rho * l2**2 * coupling / t2**3 + rho * l2**3 * end
    m22 = rho * l2**3 * alone(t2, c2, s2, slips.factor("(36) M22 sine"))
    if not is_zero(rho_i):
        m11 += rho_i * l2 + rho_i * l1 / 3
        m12 += rho_i * l2 / 2
        m22 += rho_i * l2 / 3
    return ca.vertcat(ca.horzcat(m11, m12), ca.horzcat(m12, m22))


def christoffel(mass: ca.SX, theta: ca.SX, rate: ca.SX) -> ca.SX:
    """Velocity products of a mass matrix (2, 2), equation (38) [N m]."""
    slopes = [ca.reshape(ca.jacobian(ca.vec(mass), theta)[:, k], 2, 2) for k in (0, 1)]
    rows = []
    for i in (0, 1):
        row = ca.SX(0)
        for j in (0, 1):
            for k in (0, 1):
                row += (slopes[k][i, j] - slopes[i][j, k] / 2) * rate[j] * rate[k]
        rows.append(row)
    return ca.vertcat(*rows)


def guarded(expressions: list[ca.SX], symbol: ca.SX, theta: ca.SX, guard: float = GUARD) -> list[ca.SX]:
    """Expressions of the two angles ``symbol`` at ``theta``, but at ``guard`` where an angle is smaller than that."""
    away = [ca.if_else(ca.fabs(theta[i]) < guard, guard, theta[i]) for i in (0, 1)] if guard else [theta]
    replaced: list[ca.SX] = ca.substitute(expressions, [symbol], [ca.vertcat(*away)])
    return replaced


def terms(arcs: TwoArcs, theta: ca.SX, rate: ca.SX, slips: AsPrinted = _RIGHT, *, guard: float = GUARD) -> Terms:
    """Mass matrix, velocity products, gravity and Jacobians, point masses included.

    ``guard`` is the smallest angle [rad]; 0 leaves the divisions bare. Rounding grows like a high power of 1 / theta
    and the guard itself errs like its size, so no value is accurate near a straight finger.
    """
    symbol = ca.SX.sym("theta", 2)
    bent = Bent(arcs, symbol, slips)
    jc, jt = bent.contact_jacobian, bent.tip_jacobian
    mass = rod_mass_matrix(bent)
    weighed = [(arcs.mass_per_length * arcs.lengths[0], bent.center1_jacobian)]
    weighed.append((arcs.mass_per_length * arcs.lengths[1], bent.center2_jacobian))
    for point, jacobian in ((arcs.contact_mass, jc), (arcs.tip_mass, jt)):
        if not is_zero(point):
            mass += point * (jacobian.T @ jacobian)
            weighed.append((point, jacobian))
    gravity = ca.SX(2, 1)
    if not all(is_zero(g) for g in arcs.gravity):
        for point, jacobian in weighed:
            gravity -= point * (jacobian.T @ ca.vertcat(*arcs.gravity))
    found = [mass, christoffel(mass, symbol, rate), gravity, jc, jt]
    return Terms(*guarded(found, symbol, theta, guard))
