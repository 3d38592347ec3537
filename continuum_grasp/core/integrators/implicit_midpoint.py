"""The implicit midpoint rule in coordinates and momenta: symplectic, symmetric, order 2.

E. Hairer, C. Lubich, G. Wanner, Geometric Numerical Integration, doi:10.1007/3-540-30666-8. The rule is symplectic in
canonical variables only. Finger states have rates, not momenta, and the mass matrix varies with the shape: the same
rule in coordinates and rates misses the symplectic condition by 1.6e-2 (two arcs let go, steps of 5 ms), this one by
the tolerance of the iterations.
"""

from __future__ import annotations

import math
from typing import Any

import casadi as ca

_TOLERANCE = 1e-9
"""Last correction of the iterations, per 1 + |x| [1]. The next would be a hundredth of it; over 2e4 steps of 5 ms (two
arcs let go) the mean energy moved by 2e-8 of the swing."""


def step(model: Any, x: ca.MX, u: list[ca.MX], w: list[ca.MX], p: ca.MX, h: ca.MX) -> ca.MX:
    """Compute the next state from ``model.linearization``, ``model.energy`` and ``model.n``, with inputs at the middle.

    With m the state at the middle, f the rates of the state and P the momenta of the finger's coordinates,

        m = x + h/2 f(m), but P(m) = P(x) + h/2 dP/dt(m) instead of the rows of the coordinates' rates,

    and the next state has twice the middle's coordinates and momenta minus x's. All other moving parts have constant
    inertia, so that their rates serve as momenta.
    """
    n = model.n
    nx = x.numel()
    momenta, solved = _momenta(model), _middle(model)
    still = ca.MX.zeros(nx)
    start = momenta(x, u[1], p, still)[0]
    middle = x
    correction = ca.MX(1.0)
    # 20: iterations of Newton's method in a step: 5 are usual at steps of 1 ms, 7 at 10 ms (two arcs of 0.6 m with 20 g
    # let go)
    for _ in range(20):
        middle, correction = solved(correction > _TOLERANCE, middle, correction, x, u[1], w[1], p, h, start)
    following = 2.0 * middle - x
    # Momenta are affine in the rates, P = P(rates zero) + M qd, so that one solution gives the rates of the next P.
    following[n : 2 * n] = 0.0
    none, _, mass = momenta(following, u[1], p, still)
    momentum = 2.0 * momenta(middle, u[1], p, still)[0] - start
    following[n : 2 * n] = ca.solve(mass, momentum - none, "qr")
    return ca.if_else(correction <= _TOLERANCE, following, math.nan)


def _middle(model: Any) -> ca.Function:
    """(go on, m, its last correction, x, um, wm, p, h, P(x)) -> m and its correction by Newton, or as given."""
    n = model.n
    f: ca.Function = model.forward_dynamics
    names = ["m", "correction", "x", "u", "w", "p", "h", "P"]
    sizes = [f.size1_in(0), 1, *(f.size1_in(k) for k in range(4)), 1, n]
    symbols = [ca.MX.sym(name, size) for name, size in zip(names, sizes, strict=True)]
    m, correction, x, u, w, p, h, start = symbols
    rate = f(m, u, w, p)
    momentum, change, mass = _momenta(model)(m, u, p, rate)
    missing = m - x - 0.5 * h * rate
    missing[n : 2 * n] = ca.solve(mass, momentum - start - 0.5 * h * change, "qr")
    # The Jacobian without the change of the mass matrix over half a step: the exact one has three times the C (of two
    # arcs 201 instead of 70 kB) and took 17 instead of 12 us a step.
    slope = ca.MX.eye(x.numel()) - 0.5 * h * model.linearization(m, u, w, p)[0]
    # Unknowns in units of their own size: coordinates [rad] and rates [rad/s] differ by orders of magnitude.
    unit = 1.0 + ca.fabs(x)
    scaled = ca.densify(ca.repmat(1.0 / unit, 1, x.numel()) * slope * ca.repmat(unit.T, x.numel(), 1))
    move = ca.solve(scaled, missing / unit, "qr")
    once = ca.Function("newton_iteration", symbols, [m - unit * move, ca.norm_inf(move)])
    middle: ca.Function = ca.Function.if_else("newton", once, ca.Function("converged", symbols, [m, correction]))
    return middle


def _momenta(model: Any) -> ca.Function:
    """(x, u, p, xd) -> momenta P (n) of the finger's coordinates, their rate along xd, and the mass matrix (n, n)."""
    x, u, p = (ca.SX.sym(name, model.energy.size1_in(k)) for k, name in enumerate("xup"))
    xd = ca.SX.sym("xd", x.numel())
    rates = slice(model.n, 2 * model.n)
    momenta = ca.gradient(model.energy(x, u, p)[0], x)[rates]
    values = momenta, ca.jtimes(momenta, x, xd), ca.jacobian(momenta, x[rates])
    return ca.Function("momenta", [x, u, p, xd], ca.cse([ca.densify(value) for value in values]))
