"""ROS2, implicit in the finger's own elasticity and damping alone, so that it needs no Jacobian.

For fine models, whose own stiffness and damping cause the fastest motions; all else, contacts too, must be
resolved by the step. It is of order 2 whatever it takes the Jacobian to be: J. G. Verwer, E. J. Spee, J. G. Blom,
W. Hundsdorfer (1999), doi:10.1137/S1064827597326651.
"""

from __future__ import annotations

import math
from typing import Any

import casadi as ca

from continuum_grasp.model import solve_ldl

_GAMMA = 1.0 - math.sqrt(0.5)
"""Makes the method L-stable [1]."""


def step(model: Any, x: ca.MX, u: list[ca.MX], w: list[ca.MX], p: ca.MX, h: ca.MX) -> ca.MX:
    """Next state; x begins with the coordinates (n) and their rates (n), model.internal is (x, u, p) -> M, K, D."""
    f = model.forward_dynamics
    n = model.internal.size1_out(0)
    mass, stiffness, damping = model.internal(x, u[0], p)
    part = _GAMMA * h
    solve = _ldl_solver(n)
    matrix = mass + part * damping + part**2 * stiffness

    def stage(right: ca.MX) -> ca.MX:
        """(I - part A)^-1 right, where A is the Jacobian of elasticity and damping."""
        rate = solve(matrix, ca.mtimes(mass, right[n : 2 * n]) - part * ca.mtimes(stiffness, right[:n]))
        return ca.vertcat(right[:n] + part * rate, rate, right[2 * n :])

    first = stage(f(x, u[0], w[0], p))
    second = stage(f(x + h * first, u[2], w[2], p) - 2.0 * first)
    return x + 1.5 * h * first + 0.5 * h * second


def _ldl_solver(n: int) -> ca.Function:
    """(matrix, right) -> solution of a symmetric positive definite system."""
    a = ca.SX.sym("a", n, n)
    b = ca.SX.sym("b", n)
    rows = [[a[i, j] for j in range(n)] for i in range(n)]
    return ca.Function("ldl", [a, b], [ca.vertcat(*solve_ldl(rows, [b[i] for i in range(n)]))])
