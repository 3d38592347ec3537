"""A step of each method of ``scene.integrators`` as CasADi expressions, a file per method."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import casadi as ca

from continuum_grasp.scene import INTEGRATORS

__all__ = ["differentiated_step", "step_function"]


def step_function(model: Any, method: str) -> ca.Function:
    """``METHOD_step``: (x, u0, um, u1, w0, wm, w1, p, h) -> xn, one step of a method in ``INTEGRATORS``.

    Inputs u and forces w are those at the start, the middle and the end of the step h [s]. The model has the functions
    that the method's file names, at least ``forward_dynamics``, (x, u, w, p) -> xd.
    """
    f: ca.Function = model.forward_dynamics
    nx, nu, nw, n_p = (f.size1_in(k) for k in range(4))
    x, p, h = ca.MX.sym("x", nx), ca.MX.sym("p", n_p), ca.MX.sym("h")
    u = [ca.MX.sym(name, nu) for name in ("u0", "um", "u1")]
    w = [ca.MX.sym(name, nw) for name in ("w0", "wm", "w1")]
    following = import_module(f"{__name__}.{method}").step(model, x, u, w, p, h)
    names = ["x", "u0", "um", "u1", "w0", "wm", "w1", "p", "h"]
    step = ca.Function(f"{method}_step", [x, *u, *w, p, h], [following], names, ["xn"])
    # 1500: instructions of the dynamics up to which explicit steps become one straight-line function, which batches
    # compute in vector lanes: it has four copies of the dynamics to compile
    straight = f.is_a("SXFunction") and f.n_instructions() <= 1500
    if INTEGRATORS[method].stable is not None and straight:
        step = step.expand()
    return step


def differentiated_step(
    method: str, name: str, slope: ca.Function, start: ca.MX, others: tuple[ca.MX, ...], h: ca.MX, instants: int = 1
) -> list[ca.MX]:
    """A step of a method of controllers with its derivatives, as calls of straight-line functions.

    ``slope`` is (state, *others) -> rate (n), its Jacobian (n, n + m) by the first n entries of the state and by m
    inputs; the further entries of the state are constant over the step h [s], as are ``others``. No function has loops,
    branches or pivoting; their names begin with ``name``. The results are the next state (n), and its derivatives (n,
    n + m) at as many ``instants``: none, the end of the step, or also those half-way.
    """
    results: list[ca.MX]
    results = import_module(f"{__name__}.{method}").differentiated_step(name, slope, start, others, h, instants)
    return results
