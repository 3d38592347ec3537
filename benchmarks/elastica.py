"""The exact bend of a cantilever by elliptic integrals, as a truth that no solver here uses."""

from __future__ import annotations

import math

from scipy.optimize import brentq
from scipy.special import ellipe, ellipeinc, ellipk, ellipkinc


def elastica_deflection(load: float) -> float:
    """Deflection per length of a clamped elastica whose tip bears a force across the clamp that keeps its direction.

    ``load`` is force times length squared over bending stiffness [1]. The rod neither extends nor shears (Bisshopp and
    Drucker 1945, doi:10.1090/qam/13360).
    """

    def integrals(tip_angle: float) -> tuple[float, float]:
        m = 0.5 * (1.0 + math.sin(tip_angle))
        start = math.asin(math.sqrt(0.5 / m))
        return ellipk(m) - ellipkinc(start, m), ellipe(m) - ellipeinc(start, m)

    angle = brentq(lambda tip: integrals(tip)[0] - math.sqrt(load), 1e-9, 0.5 * math.pi - 1e-9, xtol=1e-15)
    first, second = integrals(angle)
    return float(1.0 - 2.0 * second / first)
