"""A pad that sticks: surfaces that touch also pull, up to the force at which they come apart."""

from __future__ import annotations

import casadi as ca

from continuum_grasp.model import TouchLaw


class AdhesiveLaw(TouchLaw):
    """The law of the package minus a pull that acts within the rounding of its onset.

    ``contact_law.law_numbers`` has one number: the greatest pull [N]. Friction acts on the pressing force alone.
    """

    def normal_force(self, gap: ca.SX, gap_rate: ca.SX) -> ca.SX:
        """Return pressure minus pull [N]; the pull ends smoothly at twice the rounding."""
        (pull,) = self.law.law_numbers
        near = ca.fmin(ca.fmax(1.0 - 0.5 * gap / self.rounding, 0.0), 1.0)
        return super().normal_force(gap, gap_rate) - pull * near * near * (3.0 - 2.0 * near)
