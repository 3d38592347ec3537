"""``sdirk2`` with a third Newton iteration per stage, for contacts so stiff that they close within a step.

The onset of such a contact lies between the first iterate and the solution, so that the second iteration, which
corrects with the stiffness found there, still leaves a residual. The derivatives then differ from those of an L-stable
step (largest absolute eigenvalue 11 instead of 2 when a contact of 2 kN/m closes, and products of 1e4 over 20 steps).
"""

from __future__ import annotations

import casadi as ca

from continuum_grasp.core.integrators import sdirk2


def differentiated_step(
    name: str, slope: ca.Function, start: ca.MX, others: tuple[ca.MX, ...], h: ca.MX, instants: int
) -> list[ca.MX]:
    """Write the step with its derivatives; see the package."""
    return sdirk2.differentiated_step(name, slope, start, others, h, instants, between=1)
