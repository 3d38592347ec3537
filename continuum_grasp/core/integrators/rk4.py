"""The classical Runge-Kutta method of order 4."""

from __future__ import annotations

from typing import Any

import casadi as ca


def step(model: Any, x: ca.MX, u: list[ca.MX], w: list[ca.MX], p: ca.MX, h: ca.MX) -> ca.MX:
    """Next state; see ``step_function``."""
    f: ca.Function = model.forward_dynamics
    k1 = f(x, u[0], w[0], p)
    k2 = f(x + 0.5 * h * k1, u[1], w[1], p)
    k3 = f(x + 0.5 * h * k2, u[1], w[1], p)
    k4 = f(x + h * k3, u[2], w[2], p)
    return x + h / 6 * (k1 + 2 * (k2 + k3) + k4)


def differentiated_step(
    slope: ca.Function, x: ca.SX, others: tuple[ca.SX, ...], h: ca.SX, held: ca.SX
) -> tuple[ca.SX, ca.SX, ca.SX]:
    """The step with its derivatives, by the variational equations; see ``differentiated_step`` of the package."""
    n, m = x.numel(), slope.size2_out(2)
    state, by_x, by_u = x, ca.SX.eye(n), ca.SX(n, m)
    total, total_x, total_u = ca.SX(n, 1), ca.SX(n, n), ca.SX(n, m)
    # The Jacobians of the four slopes by the chain rule: as exact as the step, at four Jacobians a step.
    for weight, ahead in ((1.0, 0.5), (2.0, 0.5), (2.0, 1.0), (1.0, 0.0)):
        k, f_x, f_u = slope(ca.vertcat(state, held), *others)
        k_x, k_u = ca.mtimes(f_x, by_x), ca.mtimes(f_x, by_u) + f_u
        total, total_x, total_u = total + weight * k, total_x + weight * k_x, total_u + weight * k_u
        state, by_x, by_u = x + ahead * h * k, ca.SX.eye(n) + ahead * h * k_x, ahead * h * k_u
    return x + h / 6 * total, ca.SX.eye(n) + h / 6 * total_x, h / 6 * total_u
