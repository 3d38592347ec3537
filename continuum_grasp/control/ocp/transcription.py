"""Functions of a stage from dynamics, outputs and constraint rows: multiple shooting with derivatives."""

from __future__ import annotations

import casadi as ca

from continuum_grasp.control.ocp.implicit import implicit_step

__all__ = ["cost_function", "step_function", "terminal_function"]


def step_function(dynamics: ca.Function, nx: int, method: str = "rk4") -> ca.Function:
    """Write one step of an integrator with its derivatives, by the variational equations.

    The Jacobian of the dynamics is written once per slope and propagated; CasADi's ``jacobian`` of the whole step takes
    2.4 times as many instructions.

    Parameters
    ----------
    dynamics : casadi.Function
        (x, u, p) -> xd of the first entries of x; the last ones, if any, become the input (the first nu of them).
    nx : int
        Number of states.
    method : {"rk4", "implicit"}
        The Runge-Kutta method of order 4, or an L-stable one of order 2 for stiff models.

    Returns
    -------
    casadi.Function
        (x, u, p, h) -> xn, A, B.
    """
    x, u, p = ca.SX.sym("x", nx), ca.SX.sym("u", dynamics.size1_in(1)), ca.SX.sym("p", dynamics.size1_in(2))
    h = ca.SX.sym("h")
    rate = dynamics(x, u, p)
    nd = rate.numel()
    slope = ca.Function("slope", [x, u, p], ca.cse([rate, ca.jacobian(rate, x)[:, :nd], ca.jacobian(rate, u)]))
    step = implicit_step if method == "implicit" else _explicit_step
    following, by_x, by_u = step(slope, x[:nd], (u, p), h, x[nd:])
    following = ca.vertcat(following, u[: nx - nd, :])
    a = ca.diagcat(by_x, ca.SX(nx - nd, nx - nd))
    b = ca.vertcat(by_u, ca.SX.eye(u.numel())[: nx - nd, :])
    expressions = [ca.densify(e) for e in ca.cse([following, a, b])]
    return ca.Function("stage_step", [x, u, p, h], expressions, ["x", "u", "p", "h"], ["xn", "A", "B"])


def _explicit_step(
    slope: ca.Function, x: ca.SX, others: tuple[ca.SX, ...], h: ca.SX, held: ca.SX
) -> tuple[ca.SX, ca.SX, ca.SX]:
    """The Runge-Kutta method of order 4; arguments and results as of ``implicit_step``."""
    n, m = x.numel(), slope.size2_out(2)
    state, by_x, by_u = x, ca.SX.eye(n), ca.SX(n, m)
    total, total_x, total_u = ca.SX(n, 1), ca.SX(n, n), ca.SX(n, m)
    for weight, ahead in ((1.0, 0.5), (2.0, 0.5), (2.0, 1.0), (1.0, 0.0)):
        k, f_x, f_u = slope(ca.vertcat(state, held), *others)
        k_x, k_u = ca.mtimes(f_x, by_x), ca.mtimes(f_x, by_u) + f_u
        total, total_x, total_u = total + weight * k, total_x + weight * k_x, total_u + weight * k_u
        state, by_x, by_u = x + ahead * h * k, ca.SX.eye(n) + ahead * h * k_x, ahead * h * k_u
    return x + h / 6 * total, ca.SX.eye(n) + h / 6 * total_x, h / 6 * total_u


def cost_function(outputs: ca.Function, rows: ca.Function, stage: float) -> ca.Function:
    """Write cost and rows of a stage; see ``Stages.cost``."""
    x, u, p = (ca.SX.sym(name, outputs.size1_in(k)) for k, name in enumerate("xup"))
    r, weights = ca.SX.sym("r", outputs.numel_out(0)), ca.SX.sym("W", outputs.numel_out(0))
    z = ca.vertcat(x, u)
    expressions = _expanded(outputs(x, u, p), rows(x, u, p), z, r, stage * weights)
    names = ["l", "g", "H", "c", "C"]
    return ca.Function("stage_cost", [x, u, p, r, weights], expressions, ["x", "u", "p", "r", "W"], names)


def terminal_function(outputs: ca.Function, rows: ca.Function, nt: int, ns: int) -> ca.Function:
    """Write cost and rows of the last node; see ``Stages.terminal``."""
    x, u, p = (ca.SX.sym(name, outputs.size1_in(k)) for k, name in enumerate("xup"))
    r, weights = ca.SX.sym("r", outputs.numel_out(0)), ca.SX.sym("T", outputs.numel_out(0))
    y, c = outputs(x, u, p)[:nt], rows(x, u, p)[:ns]
    expressions = _expanded(y, c, x, r[:nt], weights[:nt])
    names = ["l", "g", "H", "c", "C"]
    return ca.Function("terminal_cost", [x, p, r, weights], expressions, ["x", "p", "r", "T"], names)


def _expanded(y: ca.SX, c: ca.SX, z: ca.SX, r: ca.SX, weights: ca.SX) -> list[ca.SX]:
    """Half the weighted squares of the errors, gradient, Gauss-Newton Hessian; rows and their Jacobian.

    Gauss-Newton, since its Hessian is positive semidefinite, so that every QP is convex, and needs first derivatives
    only.
    """
    error, slope = y - r, ca.jacobian(y, z)
    weighted = weights * error
    gradient = ca.mtimes(slope.T, weighted)
    hessian = ca.mtimes(slope.T, ca.mtimes(ca.diag(weights), slope))
    expressions = [0.5 * ca.dot(error, weighted), gradient, hessian, c, ca.jacobian(c, z)]
    return [ca.densify(e) for e in ca.cse([ca.SX(e) for e in expressions])]
