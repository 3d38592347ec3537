"""The finger of two circular arcs that the baselines describe, and what they have in common."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca

from benchmarks import paper

Number = Any
"""A float, or a CasADi SX where it is a run-time parameter."""

PARAMETERS = (
    "mass_per_length",
    "rotary_inertia",
    "bending_stiffness",
    "tip_mass",
    "contact_mass",
    "arc_damping",
    "tendon_offset",
    "element_lengths",
    "gravity",
)


@dataclass(frozen=True)
class TwoArcs:
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


def arcs(finger: TwoArcs) -> paper.TwoArcs:
    """What the paper's equations need to know of the finger."""
    return paper.TwoArcs(
        lengths=finger.element_lengths,
        mass_per_length=finger.mass_per_length,
        rotary_inertia=finger.rotary_inertia,
        contact_mass=finger.contact_mass,
        tip_mass=finger.tip_mass,
        gravity=to_base(finger, finger.gravity),
    )


def to_base(finger: TwoArcs, vector: tuple[Number, Number]) -> tuple[Number, Number]:
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


def forward_dynamics(
    name: str,
    finger: TwoArcs,
    terms: Callable[[TwoArcs, ca.SX, ca.SX, ca.SX, ca.SX], tuple[ca.SX, ca.SX]],
    parameters: Iterable[str] = (),
) -> ca.Function:
    """(x, u, w, p) -> xd with x = [theta1, theta2, rates], w = world forces at contact, then tip.

    ``terms(finger, theta, rate, contact_force, tip_force)`` gives the mass matrix and the generalised force
    of inertia, gravity and contacts on the right-hand side; elasticity, damping and actuation are added here,
    equations (32), (39), (42). The numbers named in ``parameters`` (out of ``PARAMETERS``) become entries of
    p, in that order; pairs take two entries.
    """
    symbols: list[ca.SX] = []
    for key in parameters:
        if key not in PARAMETERS:
            raise ValueError(f"unknown parameter {key!r}, expected one of {PARAMETERS}")
        if isinstance(getattr(finger, key), tuple):
            pair = ca.SX.sym(key, 2)
            symbols.append(pair)
            finger = replace(finger, **{key: (pair[0], pair[1])})
        else:
            symbols.append(ca.SX.sym(key))
            finger = replace(finger, **{key: symbols[-1]})
    p = ca.vertcat(*symbols) if symbols else ca.SX(0, 1)
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
        extension = theta[i] - finger.rest_angles[i]
        damping = finger.arc_damping + finger.material_damping / length
        right.append(force[i] + tau - finger.bending_stiffness / length * extension - damping * rate[i])
    scale = 1 / (mass[0, 0] * mass[1, 1] - mass[0, 1] * mass[0, 1])
    xd = ca.vertcat(
        rate,
        (mass[1, 1] * right[0] - mass[0, 1] * right[1]) * scale,
        (mass[0, 0] * right[1] - mass[0, 1] * right[0]) * scale,
    )
    return ca.Function(name, [x, u, w, p], [ca.cse(xd)], ["x", "u", "w", "p"], ["xd"])
