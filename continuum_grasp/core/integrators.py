"""One step of each fixed-step method as a CasADi function of state and inputs.

Every step function has the inputs ``x, u0, um, u1, w0, wm, w1, p, h`` (inputs and forces at the start, the middle and
the end of the step) and the output ``xn``.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import casadi as ca

from continuum_grasp.errors import InputError
from continuum_grasp.model.ldl import solve_ldl

__all__ = ["METHODS", "RK4_STABLE", "partly_implicit_step", "step_function"]

RK4_STABLE = 2.7
"""Largest product of step and spectral radius with which the Runge-Kutta method is stable."""

_EXPAND_UP_TO = 1500
"""Instructions of the dynamics up to which a step is written out as one straight-line function."""


def step_function(dynamics: ca.Function, method: str, linearization: ca.Function | None = None) -> ca.Function:
    """The step of a method.

    Parameters
    ----------
    dynamics : casadi.Function
        (x, u, w, p) -> xd.
    method : {"rk4", "implicit"}
        Name in ``METHODS``.
    linearization : casadi.Function, optional
        (x, u, w, p) -> (A, B); needed by ``implicit``.

    Returns
    -------
    casadi.Function
    """
    nx, nu, nw, n_p = (dynamics.size1_in(k) for k in range(4))
    x, p, h = ca.MX.sym("x", nx), ca.MX.sym("p", n_p), ca.MX.sym("h")
    u = [ca.MX.sym(name, nu) for name in ("u0", "um", "u1")]
    w = [ca.MX.sym(name, nw) for name in ("w0", "wm", "w1")]
    following = METHODS[method](dynamics, linearization, x, u, w, p, h)
    names = ["x", "u0", "um", "u1", "w0", "wm", "w1", "p", "h"]
    step = ca.Function(f"{method}_step", [x, *u, *w, p, h], [following], names, ["xn"])
    if method == "rk4" and dynamics.n_instructions() <= _EXPAND_UP_TO:
        step = step.expand()
    return step


def _rk4(
    f: ca.Function,
    linearization: ca.Function | None,
    x: ca.MX,
    u: list[ca.MX],
    w: list[ca.MX],
    p: ca.MX,
    h: ca.MX,
) -> ca.MX:
    """The classical Runge-Kutta method of order 4."""
    k1 = f(x, u[0], w[0], p)
    k2 = f(x + 0.5 * h * k1, u[1], w[1], p)
    k3 = f(x + 0.5 * h * k2, u[1], w[1], p)
    k4 = f(x + h * k3, u[2], w[2], p)
    return x + h / 6 * (k1 + 2 * (k2 + k3) + k4)


# RODAS: E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, section IV.7; order 4, L-stable,
# stiffly accurate, in the form without matrix products.
_GAMMA = 0.25
_ALPHA = (0.0, 0.386, 0.21, 0.63, 1.0, 1.0)
_GAMMAS = (0.25, -0.1043, 0.1035, -0.0362, 0.0, 0.0)
_A = (
    (),
    (1.544,),
    (0.9466785280815826, 0.2557011698983284),
    (3.314825187068521, 2.896124015972201, 0.9986419139977817),
    (1.221224509226641, 6.019134481288629, 12.53708332932087, -0.687886036105895),
    (1.221224509226641, 6.019134481288629, 12.53708332932087, -0.687886036105895, 1.0),
)
_C = (
    (),
    (-5.6688,),
    (-2.430093356833875, -0.2063599157091915),
    (-0.1073529058151375, -9.594562251023355, -20.47028614809616),
    (7.496443313967647, -10.24680431464352, -33.99990352819905, 11.7089089320616),
    (8.083246795921522, -7.981132988064893, -31.52159432874371, 16.31930543123136, -6.058818238834054),
)


def _rodas(
    f: ca.Function,
    linearization: ca.Function | None,
    x: ca.MX,
    u: list[ca.MX],
    w: list[ca.MX],
    p: ca.MX,
    h: ca.MX,
) -> ca.MX:
    """The linearly implicit method RODAS; inputs are taken as quadratic over the step."""
    if linearization is None:
        raise InputError("the implicit method needs the linearization")
    jacobian = linearization(x, u[0], w[0], p)[0]
    matrix = ca.MX.eye(x.numel()) / (_GAMMA * h) - jacobian
    # Rows of one size: those of accelerations can be 1e8 times those of rates, whose digits they would take.
    balance = 1.0 / ca.sqrt(ca.sum2(matrix * matrix))
    matrix = ca.repmat(balance, 1, x.numel()) * matrix
    solver = ca.Linsol("solver", "qr", matrix.sparsity())
    # Change of the right-hand side over the step through the inputs alone, per step.
    drift = -3 * f(x, u[0], w[0], p) + 4 * f(x, u[1], w[1], p) - f(x, u[2], w[2], p)
    varying = ca.vertcat(*u, *w).numel() > 0
    stages: list[ca.MX] = []
    for alpha, gamma, a, c in zip(_ALPHA, _GAMMAS, _A, _C, strict=True):
        at = x
        right = ca.MX.zeros(x.numel())
        for k, stage in enumerate(stages):
            at = at + a[k] * stage
            right = right + (c[k] / h) * stage
        right = right + f(at, _quadratic(u, alpha), _quadratic(w, alpha), p)
        if varying and gamma != 0.0:
            right = right + gamma * drift
        stages.append(solver.solve(matrix, balance * right))
    following = x + stages[-1]
    for weight, stage in zip(_A[-1], stages, strict=False):
        following = following + weight * stage
    return following


def _quadratic(samples: list[ca.MX], at: float) -> ca.MX:
    weights = ((1 - at) * (1 - 2 * at), 4 * at * (1 - at), at * (2 * at - 1))
    return sum((w * s for w, s in zip(weights, samples, strict=True) if w != 0.0), ca.MX.zeros(samples[0].shape))


_PART = 1.0 - math.sqrt(0.5)


def partly_implicit_step(dynamics: ca.Function, internal: ca.Function) -> ca.Function:
    """A step that is implicit in the finger's own elasticity and damping alone, so that it needs no Jacobian.

    For fine models, whose fastest motions are those of their own stiffness and damping; all else, contacts too,
    must be resolved by the step. It is of order 2 whatever it takes the Jacobian to be: the method ROS2 of
    J. G. Verwer, E. J. Spee, J. G. Blom, W. Hundsdorfer (1999), doi:10.1137/S1064827597326651.

    Parameters
    ----------
    dynamics : casadi.Function
        (x, u, w, p) -> xd, x beginning with the coordinates (n) and their rates (n).
    internal : casadi.Function
        (x, u, p) -> M, K, D (n, n).

    Returns
    -------
    casadi.Function
        As those of ``step_function``.
    """
    nx, nu, nw, n_p = (dynamics.size1_in(k) for k in range(4))
    n = internal.size1_out(0)
    x, p, h = ca.MX.sym("x", nx), ca.MX.sym("p", n_p), ca.MX.sym("h")
    u = [ca.MX.sym(name, nu) for name in ("u0", "um", "u1")]
    w = [ca.MX.sym(name, nw) for name in ("w0", "wm", "w1")]
    mass, stiffness, damping = internal(x, u[0], p)
    part, solve = _PART * h, _ldl_solver(n)
    matrix = mass + part * damping + part**2 * stiffness

    def stage(right: ca.MX) -> ca.MX:
        """(I - part A)^-1 right, where A is the Jacobian of elasticity and damping."""
        rate = solve(matrix, ca.mtimes(mass, right[n : 2 * n]) - part * ca.mtimes(stiffness, right[:n]))
        return ca.vertcat(right[:n] + part * rate, rate, right[2 * n :])

    first = stage(dynamics(x, u[0], w[0], p))
    second = stage(dynamics(x + h * first, u[2], w[2], p) - 2.0 * first)
    following = x + 1.5 * h * first + 0.5 * h * second
    names = ["x", "u0", "um", "u1", "w0", "wm", "w1", "p", "h"]
    return ca.Function("partly_implicit_step", [x, *u, *w, p, h], [following], names, ["xn"])


def _ldl_solver(n: int) -> ca.Function:
    """(matrix, right) -> solution of a symmetric positive definite system."""
    a, b = ca.SX.sym("a", n, n), ca.SX.sym("b", n)
    rows = [[a[i, j] for j in range(n)] for i in range(n)]
    return ca.Function("ldl", [a, b], [ca.vertcat(*solve_ldl(rows, [b[i] for i in range(n)]))])


METHODS: dict[str, Callable[..., ca.MX]] = {"rk4": _rk4, "implicit": _rodas}
"""Fixed-step methods by name."""
