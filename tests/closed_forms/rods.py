"""Closed forms of the statics of a straight rod that is clamped at one end and free at the other.

Loads are per EI / L^2 (forces), EI / L (moments) and EI / L^3 (weight per length), angles in rad.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.special import ellipe, ellipeinc, ellipkinc, ellipkm1

_EXACT = {"xtol": 1e-300, "rtol": 4.0 * np.finfo(float).eps}
"""Roots to the last digits."""


@dataclass(frozen=True)
class TipPose:
    """Pose of the tip: deflection towards the load and position along the undeformed axis, per length; turn [rad]."""

    across: float
    along: float
    angle: float


def bent_by_tip_force(load: float) -> TipPose:
    """Tip under a dead force across the undeformed axis, by elliptic integrals; for loads from 1e-3 to 1e4.

    K. E. Bisshopp, D. C. Drucker, Large deflection of cantilever beams, 1945, doi:10.1090/qam/13360.
    """
    root = math.sqrt(load)

    def integrals(gap: float) -> tuple[float, float]:
        """Of first and second kind, from the clamp to the tip, whose tangent is that far from the force's direction."""
        complement = math.sin(0.5 * gap) ** 2
        m = 1.0 - complement
        start = math.atan2(math.sqrt(0.5 / m), math.sqrt(math.cos(gap) / (1.0 + math.cos(gap))))
        return ellipkm1(complement) - ellipkinc(start, m), ellipe(m) - ellipeinc(start, m)

    gap = math.exp(brentq(lambda g: integrals(math.exp(g))[0] - root, -200.0, math.log(0.5 * math.pi), **_EXACT))
    along = math.sqrt(2.0 * math.cos(gap) / load)
    return TipPose(1.0 - 2.0 * integrals(gap)[1] / root, along, 0.5 * math.pi - gap)


def bent_by_moment(moment: float) -> TipPose:
    """Tip of a rod that an end moment bends to a circle: curvature M / EI; J. Bernoulli, 1694; L. Euler, 1744."""
    if moment == 0.0:
        return TipPose(0.0, 1.0, 0.0)
    return TipPose(2.0 * math.sin(0.5 * moment) ** 2 / moment, math.sin(moment) / moment, moment)


def buckled_column(angle: float) -> tuple[float, TipPose]:
    """The dead force towards the clamp on a column whose tip has turned by an angle between 0 and pi, and its tip.

    J. L. Lagrange, Sur la figure des colonnes, 1773; S. P. Timoshenko, J. M. Gere, Theory of Elastic Stability, 1961,
    section 2.7.
    """
    first, second = ellipkm1(math.cos(0.5 * angle) ** 2), ellipe(math.sin(0.5 * angle) ** 2)
    return first**2, TipPose(2.0 * math.sin(0.5 * angle) / first, 2.0 * second / first - 1.0, angle)


def euler_load(bending_stiffness: float, length: float) -> float:
    """Axial force at the tip [N] under which a column buckles: pi^2 EI / (4 L^2).

    L. Euler, De curvis elasticis, 1744; translated by W. A. Oldfather, C. A. Ellis, D. M. Brown, Isis 20, 1933.
    """
    return math.pi**2 * bending_stiffness / (4.0 * length**2)


def greenhill_length(
    bending_stiffness: float, linear_density: float, gravity: float = 9.81, *, tip_mass: float = 0.0
) -> float:
    """Length [m] at which an upright rod buckles under its own weight and that of a mass on its tip.

    A. G. Greenhill, Determination of the greatest height consistent with stability that a vertical pole or mast can be
    made, and of the greatest height to which a tree of given proportions can grow, 1881: L^3 = 7.8373 EI / (rho A g).
    With a tip mass: the first length at which y'' + (m g L^2 + rho A g L^3 u) y / EI = 0, y'(0) = 0 has y(1) = 0, by
    the power series of y, the slope of the column at u L below its tip.
    """
    force, weight = tip_mass * gravity / bending_stiffness, linear_density * gravity / bending_stiffness
    alone = [0.5 * math.pi / math.sqrt(force)] if force > 0.0 else []
    alone += [(8.0 / weight) ** (1.0 / 3.0)] if weight > 0.0 else []
    # Either load alone allows more than both together.
    return brentq(lambda x: _slope_at_clamp(force * x**2, weight * x**3), 0.0, 1.0001 * min(alone), **_EXACT)


def _slope_at_clamp(force: float, weight: float) -> float:
    """y(1) of y'' + (force + weight u) y = 0, y(0) = 1, y'(0) = 0, by its power series."""
    terms = [1.0, 0.0, -0.5 * force]
    for n in range(3, 80):
        terms.append(-(force * terms[n - 2] + weight * terms[n - 3]) / (n * (n - 1)))
    return math.fsum(terms)


def beam_pulsations(count: int, mass: float = 0.0) -> np.ndarray:
    """Angular frequencies (count,) [rad/s] of a unit rod, clamped and free, with a point mass at its tip.

    L. Euler, D. Bernoulli: 1 + cos b cosh b + mass b (cos b sinh b - sin b cosh b) = 0 of the roots b.
    """

    def characteristic(b: float) -> float:
        return math.cos(b) + 1.0 / math.cosh(b) + mass * b * (math.cos(b) * math.tanh(b) - math.sin(b))

    return roots(characteristic, 1e-3, (count + 1) * math.pi)[:count] ** 2


def roots(function: Callable[[float], float], low: float, high: float) -> np.ndarray:
    """All places between two at which a function changes its sign, if no two are nearer than a 4000th."""
    places = np.linspace(low, high, 4000)
    values = [function(at) for at in places]
    pairs = zip(places, places[1:], values, values[1:], strict=False)
    return np.array([brentq(function, a, b, xtol=1e-14) for a, b, x, y in pairs if x * y < 0.0])


def small_bend_by_force(load: float, at: float = 1.0) -> TipPose:
    """Tip under a small force across the rod, at a part of its length; C. Navier, 1826."""
    return TipPose(load * at**2 * (3.0 - at) / 6.0, 1.0, 0.5 * load * at**2)


def small_bend_by_moment(moment: float, at: float = 1.0) -> TipPose:
    """Tip under a small couple at a part of its length; S. P. Timoshenko, Strength of Materials, 1930."""
    return TipPose(moment * at * (1.0 - 0.5 * at), 1.0, moment * at)


def small_bend_by_weight(weight: float) -> TipPose:
    """Tip of a rod that its weight, across it, bends a little; S. P. Timoshenko, Strength of Materials, 1930."""
    return TipPose(weight / 8.0, 1.0, weight / 6.0)
