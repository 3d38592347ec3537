"""Functions of a stage from dynamics, outputs and constraint rows: multiple shooting with derivatives."""

from __future__ import annotations

import casadi as ca

from continuum_grasp.core.integrators import differentiated_step

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
    method : str
        Name in ``CONTROL_METHODS``.

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
    following, by_x, by_u = differentiated_step(method, slope, x[:nd], (u, p), h, x[nd:])
    following = ca.vertcat(following, u[: nx - nd, :])
    a = ca.diagcat(by_x, ca.SX(nx - nd, nx - nd))
    b = ca.vertcat(by_u, ca.SX.eye(u.numel())[: nx - nd, :])
    expressions = [ca.densify(e) for e in ca.cse([following, a, b])]
    return ca.Function("stage_step", [x, u, p, h], expressions, ["x", "u", "p", "h"], ["xn", "A", "B"])


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
