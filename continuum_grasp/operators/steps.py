"""A step with inputs that hold during it."""

from __future__ import annotations

from typing import Any

import casadi as ca

from continuum_grasp.arguments import choice
from continuum_grasp.core.calls import straight_function
from continuum_grasp.core.integrators import differentiated_step, step_function
from continuum_grasp.errors import InputError
from continuum_grasp.scene.integrators import CONTROL_METHODS, SIMULATION_METHODS

METHODS = tuple(dict.fromkeys((*SIMULATION_METHODS, *CONTROL_METHODS)))
"""Methods by which operators integrate."""


def held_step(model: Any, method: str) -> ca.Function:
    """``(x, u, w, p, h) -> xn``: one step h [s] of a method during which inputs and forces hold.

    Of methods that are written as calls of straight-line functions their derivatives are, too, so that the dynamics and
    its derivatives are compiled once instead of once per stage, in lanes.
    """
    choice("method", method, METHODS)
    dynamics = model.forward_dynamics
    sizes = {"x": model.nx, "u": model.nu, "w": model.nw, "p": model.np}
    symbols = {name: ca.MX.sym(name, size) for name, size in sizes.items()}
    (x, u, w, p), h = symbols.values(), ca.MX.sym("h")
    if method in CONTROL_METHODS and dynamics.is_a("SXFunction"):
        given = {name: ca.SX.sym(name, size) for name, size in sizes.items()}
        rate = dynamics(*given.values())
        # The explicit method needs no Jacobian.
        by = ca.SX(model.nx, model.nx) if method == "rk4" else ca.jacobian(rate, given["x"])
        slope = straight_function("slope", given, {"rate": rate, "jacobian": by})
        (end,) = differentiated_step(method, "held", slope, x, (u, w, p), h, instants=0)
    elif method in SIMULATION_METHODS:
        end = step_function(model, method)(x, u, u, u, w, w, w, p, h)
    else:
        raise InputError(
            f"{method} writes the elimination of its equations out, which takes too long for this many elements: take "
            "one of rk4, rodas, extrapolated_euler",
            key="method",
        )
    return ca.Function(f"{method}_held", [*symbols.values(), h], [end], [*sizes, "h"], ["xn"])
