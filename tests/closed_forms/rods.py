"""Closed forms of the statics of a straight rod that is clamped at one end and free at the other."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.special import ellipe, ellipeinc, ellipkinc, ellipkm1

from continuum_grasp.errors import InputError

__all__ = [
    "TipPose",
    "beam_pulsations",
    "bent_by_moment",
    "bent_by_tip_force",
    "buckled_column",
    "euler_load",
    "greenhill_length",
    "roots",
    "small_bend_by_force",
    "small_bend_by_moment",
    "small_bend_by_weight",
]


@dataclass(frozen=True)
class TipPose:
    """Pose of the tip.

    Attributes
    ----------
    across : float
        Deflection from the undeformed axis, towards the load, per length of the rod [1].
    along : float
        Position along the undeformed axis, per length of the rod [1].
    angle : float
        Turn of the tip [rad].
    """

    across: float
    along: float
    angle: float


def bent_by_tip_force(load: float) -> TipPose:
    """Tip of a rod under a dead force across its undeformed axis, by elliptic integrals.

    K. E. Bisshopp, D. C. Drucker, Large deflection of cantilever beams, 1945, doi:10.1090/qam/13360.

    Parameters
    ----------
    load : float
        P L^2 / EI, from 1e-3 to 1e4 [1]; below, the formula loses digits.

    Returns
    -------
    TipPose

    Raises
    ------
    InputError
        If the load is outside that range.
    """
    if not 1e-3 <= load <= 1e4:
        raise InputError(f"load: expected a number from 1e-3 to 1e4, got {load}")
    root = math.sqrt(load)

    def integrals(gap: float) -> tuple[float, float]:
        """Of first and second kind, from the clamp to the tip, whose tangent is that far from the force's direction."""
        complement = math.sin(0.5 * gap) ** 2
        m = 1.0 - complement
        start = math.atan2(math.sqrt(0.5 / m), math.sqrt(math.cos(gap) / (1.0 + math.cos(gap))))
        return ellipkm1(complement) - ellipkinc(start, m), ellipe(m) - ellipeinc(start, m)

    gap = math.exp(_root(lambda g: integrals(math.exp(g))[0] - root, -200.0, math.log(0.5 * math.pi)))
    along = math.sqrt(2.0 * math.cos(gap) / load)
    return TipPose(1.0 - 2.0 * integrals(gap)[1] / root, along, 0.5 * math.pi - gap)


def bent_by_moment(moment: float) -> TipPose:
    """Tip of a rod that an end moment bends to a circle: curvature M / EI; J. Bernoulli, 1694; L. Euler, 1744.

    Parameters
    ----------
    moment : float
        M L / EI [1], the turn of the tip.
    """
    if moment == 0.0:
        return TipPose(0.0, 1.0, 0.0)
    return TipPose(2.0 * math.sin(0.5 * moment) ** 2 / moment, math.sin(moment) / moment, moment)


def buckled_column(angle: float) -> tuple[float, TipPose]:
    """The load of a column whose tip has turned by an angle, and its tip.

    J. L. Lagrange, Sur la figure des colonnes, 1773; S. P. Timoshenko, J. M. Gere, Theory of Elastic Stability, 1961,
    section 2.7.

    Parameters
    ----------
    angle : float
        Turn of the tip, between 0 and pi [rad].

    Returns
    -------
    load : float
        P L^2 / EI [1] of the dead force along the undeformed axis, towards the clamp.
    tip : TipPose

    Raises
    ------
    InputError
        If the angle is not between 0 and pi.
    """
    if not 0.0 < angle < math.pi:
        raise InputError(f"angle: expected a number between 0 and pi, got {angle}")
    first, second = ellipkm1(math.cos(0.5 * angle) ** 2), ellipe(math.sin(0.5 * angle) ** 2)
    return first**2, TipPose(2.0 * math.sin(0.5 * angle) / first, 2.0 * second / first - 1.0, angle)


def euler_load(bending_stiffness: float, length: float) -> float:
    """Axial force at the tip [N] under which a column buckles: pi^2 EI / (4 L^2).

    L. Euler, De curvis elasticis, 1744; translated by W. A. Oldfather, C. A. Ellis, D. M. Brown, Isis 20, 1933.

    Parameters
    ----------
    bending_stiffness : float
        EI [N m2].
    length : float
        L [m].
    """
    return math.pi**2 * bending_stiffness / (4.0 * length**2)


def greenhill_length(
    bending_stiffness: float, linear_density: float, gravity: float = 9.81, *, tip_mass: float = 0.0
) -> float:
    """Length at which an upright rod buckles under its own weight and that of a mass on its tip.

    A. G. Greenhill, Determination of the greatest height consistent with stability that a vertical pole or mast can be
    made, and of the greatest height to which a tree of given proportions can grow, 1881: L^3 = 7.8373 EI / (rho A g).
    With a tip mass: the first length at which y'' + (m g L^2 + rho A g L^3 u) y / EI = 0, y'(0) = 0 has y(1) = 0, by
    the power series of y, the slope of the column at u L below its tip.

    Parameters
    ----------
    bending_stiffness : float
        EI [N m2].
    linear_density : float
        rho A [kg/m].
    gravity : float
        [m/s2]
    tip_mass : float
        [kg]

    Returns
    -------
    float
        Critical length [m].

    Raises
    ------
    InputError
        If stiffness and gravity are not positive, or there is no mass.
    """
    if (
        min(bending_stiffness, gravity) <= 0.0
        or min(linear_density, tip_mass) < 0.0
        or linear_density + tip_mass == 0.0
    ):
        raise InputError(
            "expected positive bending_stiffness and gravity, and linear_density and tip_mass that are not negative "
            "nor both zero"
        )
    force, weight = tip_mass * gravity / bending_stiffness, linear_density * gravity / bending_stiffness
    alone = [0.5 * math.pi / math.sqrt(force)] if force > 0.0 else []
    alone += [(8.0 / weight) ** (1.0 / 3.0)] if weight > 0.0 else []
    # Either load alone allows more than both together.
    return _root(lambda x: _slope_at_clamp(force * x**2, weight * x**3), 0.0, 1.0001 * min(alone))


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
    """Tip under a small force across the rod; C. Navier, 1826; S. P. Timoshenko, Strength of Materials, 1930.

    Parameters
    ----------
    load : float
        P L^2 / EI [1].
    at : float
        Place of the force, per length [1].
    """
    return TipPose(load * at**2 * (3.0 - at) / 6.0, 1.0, 0.5 * load * at**2)


def small_bend_by_moment(moment: float, at: float = 1.0) -> TipPose:
    """Tip under a small couple; S. P. Timoshenko, Strength of Materials, 1930.

    Parameters
    ----------
    moment : float
        M L / EI [1].
    at : float
        Place of the couple, per length [1].
    """
    return TipPose(moment * at * (1.0 - 0.5 * at), 1.0, moment * at)


def small_bend_by_weight(weight: float) -> TipPose:
    """Tip of a rod that its weight bends a little; S. P. Timoshenko, Strength of Materials, 1930.

    Parameters
    ----------
    weight : float
        rho A g L^3 / EI [1] across the undeformed axis.
    """
    return TipPose(weight / 8.0, 1.0, weight / 6.0)


def _root(function: Callable[[float], float], low: float, high: float) -> float:
    """Where a function that is positive at ``low`` and not at ``high`` changes sign, by bisection to the last digit."""
    while True:
        middle = 0.5 * (low + high)
        if middle in (low, high):
            return middle
        if function(middle) > 0.0:
            low = middle
        else:
            high = middle
