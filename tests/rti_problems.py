"""Problems that are no finger, for tests: a cart-pole, and a linear oscillator."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca

import continuum_grasp as cg

CART, POLE, LENGTH, GRAVITY = 1.0, 0.2, 0.5, 9.81  # kg, kg, m, m/s2


def cart_pole_rates(x, force, gravity=GRAVITY):
    """Time derivative of position, angle from upright, and their rates: Lagrange's equations of a point mass."""
    _, angle, speed, rate = x
    sine, cosine = ca.sin(angle), ca.cos(angle)
    mass = CART + POLE * sine**2
    pushed = force + POLE * sine * (LENGTH * rate**2 - gravity * cosine)
    turned = (gravity * sine * (CART + POLE) - cosine * (force + POLE * LENGTH * rate**2 * sine)) / LENGTH
    return [speed, rate, pushed / mass, turned / mass]


@lru_cache
def cart_pole(**changes) -> cg.ControlProblem:
    """The cart at a bounded position with a bounded force; the pole's gravity is a parameter."""
    x = [ca.SX.sym(name) for name in ("position [m]", "angle [rad]", "speed [m/s]", "rate [rad/s]")]
    force, gravity = ca.SX.sym("force [N]"), ca.SX.sym("gravity [m/s2]")
    position, angle, speed, rate = x
    given = {
        "states": x,
        "inputs": force,
        "parameters": gravity,
        "nominal": {"gravity": GRAVITY},
        "dynamics": cart_pole_rates(x, force, gravity),
        "cost": {
            "force": (force, 0.01),
            "position": (position, 2.0, 1.0),
            "pole": (ca.vertcat(ca.sin(angle / 2), rate), [40.0, 0.1], [40.0, 1.0]),
            "speed": (speed, 0.1),
        },
        "bounds": {"force": (-12.0, 12.0), "position": (-0.6, 0.6)},
        "rows": {"power": (force * speed, -8.0, 8.0, (0.01, 0.5))},
        "stages": 25,
        "stage": 0.04,
        "substeps": 2,
    }
    return cg.ControlProblem(**{**given, **changes})
