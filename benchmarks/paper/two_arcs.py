"""What the paper's equations (10)-(38) need to know of a finger."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca

from continuum_grasp.model.planar import Scalar

__all__ = ["Terms", "TwoArcs", "is_zero"]


@dataclass(frozen=True)
class TwoArcs:
    """Two arcs, the first from the base to the contact, the second from there to the tip; SI units, base axes.

    Each value is a number, or a CasADi symbol where it is a run-time argument.

    Attributes
    ----------
    lengths : pair
        L1, L2 [m].
    mass_per_length : scalar
        rho A [kg/m].
    rotary_inertia : scalar
        rho I_ca, rotary inertia per length [kg m].
    contact_mass, tip_mass : scalar
        Point masses at the ends of the arcs [kg].
    gravity : pair
        Gravity in the axes of the base, Y along the undeformed finger [m/s2].
    """

    lengths: tuple[Scalar, Scalar]
    mass_per_length: Scalar
    rotary_inertia: Scalar = 0.0
    contact_mass: Scalar = 0.0
    tip_mass: Scalar = 0.0
    gravity: tuple[Scalar, Scalar] = (0.0, 0.0)


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
