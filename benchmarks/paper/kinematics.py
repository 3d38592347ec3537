"""The paper's kinematics in closed form, equations (1)-(26): positions, velocities, Jacobians; base axes.

Everything is divided by powers of the bending angles, as in the paper.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca

from benchmarks.paper.slips import AsPrinted
from continuum_grasp.model import Scalar

_RIGHT = AsPrinted()


@dataclass(frozen=True)
class TwoArcs:
    """Two arcs, the first from the base to the contact, the second from there to the tip; SI units, base axes.

    Each value is a number, or a CasADi symbol where it is a run-time argument.
    """

    lengths: tuple[Scalar, Scalar]
    """L1, L2 [m]."""
    mass_per_length: Scalar
    """rho A [kg/m]."""
    rotary_inertia: Scalar = 0.0
    """rho I_ca, rotary inertia per length [kg m]."""
    contact_mass: Scalar = 0.0
    tip_mass: Scalar = 0.0
    """Point masses at the ends of the arcs [kg]."""
    gravity: tuple[Scalar, Scalar] = (0.0, 0.0)
    """Gravity in the axes of the base, Y along the undeformed finger [m/s2]."""


class Terms(NamedTuple):
    """M qdd + bias + gravity = J_c' F_c + J_t' F_t + other forces; base axes, point masses included."""

    mass: ca.SX
    """Mass matrix (2, 2), equation (37) [kg m2]."""
    bias: ca.SX
    """Velocity products (2,), equation (38) [N m]."""
    gravity: ca.SX
    """Gradient of the weight's potential (2,), equation (29) [N m]."""
    contact_jacobian: ca.SX
    """J_c (2, 2), equation (23) [m]."""
    tip_jacobian: ca.SX
    """J_t (2, 2), equation (24) [m]."""


def is_zero(value: Scalar) -> bool:
    """Whether a scalar is a number, and zero."""
    return isinstance(value, int | float) and value == 0


@dataclass(frozen=True)
class Bent:
    """Two arcs with bending angles (2,) [rad], and what is taken as printed: nothing by default."""

    arcs: TwoArcs
    theta: ca.SX
    slips: AsPrinted = _RIGHT

    @property
    def trigonometry(self) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX, ca.SX, ca.SX]:
        """theta1, C1, S1, theta2, C2, S2."""
        t1, t2 = self.theta[0], self.theta[1]
        return t1, ca.cos(t1), ca.sin(t1), t2, ca.cos(t2), ca.sin(t2)

    @property
    def rotation(self) -> ca.SX:
        """R_c, equation (8)."""
        _, c1, s1, _, _, _ = self.trigonometry
        return ca.vertcat(ca.horzcat(c1, -s1), ca.horzcat(s1, c1))

    @property
    def rotation_slope(self) -> ca.SX:
        """Derivative of R_c with respect to theta1, equation (15)."""
        _, c1, s1, _, _, _ = self.trigonometry
        return ca.vertcat(ca.horzcat(-s1, -c1), ca.horzcat(c1, -s1))

    def along_arc(self, which: int, fraction: Scalar = 1.0) -> ca.SX:
        """Position on arc 0 or 1 from its start in the axes there, equations (4), (5); fraction of its length."""
        t, length = self.theta[which], self.arcs.lengths[which]
        return length / t * ca.vertcat(ca.cos(fraction * t) - 1, ca.sin(fraction * t))

    def along_arc_slope(self, which: int, fraction: Scalar = 1.0) -> ca.SX:
        """Derivative of that position with respect to the arc's angle, equations (13), (16)."""
        t, length = self.theta[which], self.arcs.lengths[which]
        c, s = ca.cos(fraction * t), ca.sin(fraction * t)
        return length / t**2 * ca.vertcat(1 - c - t * fraction * s, t * fraction * c - s)

    @property
    def relative_center2(self) -> ca.SX:
        """Mass center of the second arc from the contact in the axes there, right-hand side of equation (11)."""
        _, _, _, t2, c2, s2 = self.trigonometry
        return self.arcs.lengths[1] / t2**2 * ca.vertcat(s2 - t2, 1 - c2)

    def second_velocity(self, s: Scalar, rate: ca.SX) -> ca.SX:
        """Velocity at s [m] from the base on the second arc, equations (14)-(17)."""
        l1, l2 = self.arcs.lengths
        fraction = (s - l1) / l2
        slope = self.along_arc_slope(1, s / l2 if "(16) s" in self.slips else fraction)
        turning = self.rotation_slope @ self.along_arc(1, fraction) * rate[0]
        return turning + self.rotation @ slope * rate[1] + self.along_arc_slope(0) * rate[0]

    def _center_slope(self, which: int, cosine: float) -> ca.SX:
        """Derivative of an arc's mass center with respect to its angle; ``cosine``: the factor of cos in y."""
        t, length = self.theta[which], self.arcs.lengths[which]
        c, s = ca.cos(t), ca.sin(t)
        return length / t**3 * ca.vertcat(t * c + t - 2 * s, t * s + cosine * c - 2)

    def center1_velocity(self, rate: ca.SX) -> ca.SX:
        """Velocity of the first mass center, equation (19)."""
        slope = self._center_slope(0, self.slips.factor("(19) cosine"))
        return slope if "(19) rate" in self.slips else slope * rate[0]

    def center2_velocity(self, rate: ca.SX) -> ca.SX:
        """Velocity of the second mass center, equation (20)."""
        turning = self.rotation_slope @ self.relative_center2 + self.along_arc_slope(0)
        return turning * rate[0] + self.rotation @ self._center_slope(1, self.slips.factor("(20) cosine")) * rate[1]

    @property
    def contact_jacobian(self) -> ca.SX:
        """J_c, equation (23)."""
        return ca.horzcat(self.along_arc_slope(0), ca.SX(2, 1))

    @property
    def tip_jacobian(self) -> ca.SX:
        """J_t, equation (24)."""
        t1, c1, s1, t2, c2, s2 = self.trigonometry
        l1, l2 = self.arcs.lengths
        scale = l2 / t2**2
        j11 = l2 / t2 * ((1 - c2) * s1 - s2 * c1) + l1 / t1**2 * (1 - c1 - t1 * s1)
        first, second = l2 / t2 * ((c2 - 1) * c1 - s2 * s1), l1 / t1**2 * (t1 * c1 - s1)
        j21 = first * second if "(24) plus" in self.slips else first + second
        along, across = 1 - c2 - t2 * s2, t2 * c2 - s2
        j12 = scale * along * c1 - (1 if "(24) J12 bracket" in self.slips else scale) * across * s1
        j22 = scale * along * s1 + (1 if "(24) J22 bracket" in self.slips else scale) * across * c1
        if "(24) names" in self.slips:
            j12, j21 = j21, j12
        return ca.vertcat(ca.horzcat(j11, j12), ca.horzcat(j21, j22))

    @property
    def center1_jacobian(self) -> ca.SX:
        """J_G1, equation (25)."""
        column = self._center_slope(0, self.slips.factor("(25) cosine"))
        if "(25) column" in self.slips:
            return ca.vertcat(column.T, ca.SX(1, 2))
        return ca.horzcat(column, ca.SX(2, 1))

    @property
    def center2_jacobian(self) -> ca.SX:
        """J_G2, equation (26)."""
        t1, c1, s1, t2, c2, s2 = self.trigonometry
        l1, l2 = self.arcs.lengths
        j11 = l2 / t2**2 * (-(s2 - t2) * s1 - (1 - c2) * c1) + l1 / t1**2 * (1 - c1 - t1 * s1)
        first, second = l2 / t2**2 * ((s2 - t2) * c1 - (1 - c2) * s1), l1 / t1**2 * (t1 * c1 - s1)
        j21 = first * second if "(26) plus" in self.slips else first + second
        along, cosine = t2 * c2 + t2 - 2 * s2, self.slips.factor("(26) cosine")
        j12 = l2 / t2**3 * (along * c1 - (t2 * s2 + cosine * c2 - 2) * s1)
        end = 0 if "(26) J22 end" in self.slips else (t2 * s2 + 2 * c2 - 2) * c1
        j22 = l2 / t2**3 * (along * s1 + end)
        if "(26) names" in self.slips:
            j12, j21 = j21, j12
        return ca.vertcat(ca.horzcat(j11, j12), ca.horzcat(j21, j22))
