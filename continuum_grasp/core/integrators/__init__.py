"""One step of each method of ``scene.integrators`` as CasADi expressions, a file per method."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import casadi as ca

from continuum_grasp.scene.integrators import INTEGRATORS

__all__ = ["differentiated_step", "step_function"]

_EXPAND_UP_TO = 1500
"""Instructions of the dynamics up to which explicit steps become one straight-line function [1], which batches compute
in vector lanes: it has four copies of the dynamics to compile."""


def step_function(model: Any, method: str) -> ca.Function:
    """One step of a method from a state to the next.

    Parameters
    ----------
    model : FingerModel, System, PlantModel, or anything that has the functions which the method's file names
        At least ``forward_dynamics``, (x, u, w, p) -> xd.
    method : str
        Name in ``INTEGRATORS``.

    Returns
    -------
    casadi.Function
        ``METHOD_step``: (x, u0, um, u1, w0, wm, w1, p, h) -> xn, with inputs and forces at the start, the middle and
        the end of the step h [s].
    """
    f: ca.Function = model.forward_dynamics
    nx, nu, nw, n_p = (f.size1_in(k) for k in range(4))
    x, p, h = ca.MX.sym("x", nx), ca.MX.sym("p", n_p), ca.MX.sym("h")
    u = [ca.MX.sym(name, nu) for name in ("u0", "um", "u1")]
    w = [ca.MX.sym(name, nw) for name in ("w0", "wm", "w1")]
    following = import_module(f"{__name__}.{method}").step(model, x, u, w, p, h)
    names = ["x", "u0", "um", "u1", "w0", "wm", "w1", "p", "h"]
    step = ca.Function(f"{method}_step", [x, *u, *w, p, h], [following], names, ["xn"])
    if INTEGRATORS[method].stable is not None and f.n_instructions() <= _EXPAND_UP_TO:
        step = step.expand()
    return step


def differentiated_step(
    method: str, slope: ca.Function, x: ca.SX, others: tuple[ca.SX, ...], h: ca.SX, held: ca.SX
) -> tuple[ca.SX, ca.SX, ca.SX]:
    """One step and its derivatives, as expressions without loops, branches or pivoting.

    Parameters
    ----------
    method : str
        Name in ``CONTROL_METHODS``.
    slope : casadi.Function
        (x, *others) -> rate (n), its Jacobians with respect to the first n entries of x and to what is differentiated
        for beside them.
    x : casadi.SX
        State (n).
    others : tuple of casadi.SX
        Further arguments, constant over the step.
    h : casadi.SX
        Step [s].
    held : casadi.SX
        Constant entries of the first argument after the state.

    Returns
    -------
    xn, by_x, by_u : casadi.SX
        Next state (n), and its derivatives (n, n) and (n, m).
    """
    found: tuple[ca.SX, ca.SX, ca.SX]
    found = import_module(f"{__name__}.{method}").differentiated_step(slope, x, others, h, held)
    return found
