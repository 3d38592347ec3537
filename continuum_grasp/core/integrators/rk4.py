"""The classical Runge-Kutta method of order 4."""

from __future__ import annotations

from typing import Any

import casadi as ca

from continuum_grasp.core.calls import call, straight_function
from continuum_grasp.core.integrators.derivatives import derivative_pattern, identity, parts

# With the continuous extension of Hairer, Norsett and Wanner, Solving Ordinary Differential Equations I, II.6.
_SLOPES = (
    (1.0 / 6.0, 5.0 / 24.0, 0.5),
    (2.0 / 6.0, 4.0 / 24.0, 0.5),
    (2.0 / 6.0, 4.0 / 24.0, 1.0),
    (1.0 / 6.0, -1.0 / 24.0, 0.0),
)
"""Coefficients [1]: weight of a slope at the end of the step, its weight half-way (continuous extension of order 3),
and the position of the next slope."""


def step(model: Any, x: ca.MX, u: list[ca.MX], w: list[ca.MX], p: ca.MX, h: ca.MX) -> ca.MX:
    """Next state; see ``step_function``."""
    f: ca.Function = model.forward_dynamics
    k1 = f(x, u[0], w[0], p)
    k2 = f(x + 0.5 * h * k1, u[1], w[1], p)
    k3 = f(x + 0.5 * h * k2, u[1], w[1], p)
    k4 = f(x + h * k3, u[2], w[2], p)
    return x + h / 6 * (k1 + 2 * (k2 + k3) + k4)


def differentiated_step(
    name: str, slope: ca.Function, start: ca.MX, others: tuple[ca.MX, ...], h: ca.MX, instants: int
) -> list[ca.MX]:
    """The step with its derivatives, by the variational equations; see ``differentiated_step`` of the package.

    As exact as the step, at one Jacobian per slope. Half-way by the continuous extension, from the same four slopes.
    """
    first, again = (_round(f"{name}_{which}", slope, instants, which == "first") for which in ("first", "again"))
    state = start
    reached = list[ca.MX]()
    for k, coefficients in enumerate(_SLOPES):
        arguments = [h, ca.MX(ca.DM(coefficients)), start, *call(slope, state, *others)[: 2 if instants else 1]]
        state, *reached = call(again, *arguments, *reached) if k else call(first, *arguments)
    return reached[: 1 + instants]


def _round(name: str, slope: ca.Function, instants: int, is_first: bool) -> ca.Function:
    """From one slope to the next: the state there, the end of the step so far, its derivatives, the state's."""
    n = slope.size1_in(0)
    nd = slope.size1_out(0)
    pattern = derivative_pattern(slope)
    sizes = {"h": 1, "coefficients": 3, "start": n, "rate": nd, "end": nd}
    patterns = {"jacobian": slope.sparsity_out(1), "end_by": pattern, "half_by": pattern, "by": pattern}
    s = {key: ca.SX.sym(key, size) for key, size in sizes.items()}
    s |= {key: ca.SX.sym(key, sparsity) for key, sparsity in patterns.items()}
    asked = ["end", "end_by", "half_by"][: 1 + instants] + ["by"] * (instants > 0)
    names = ["h", "coefficients", "start", "rate", *["jacobian"] * (instants > 0), *([] if is_first else asked)]
    if is_first:
        s |= dict.fromkeys(asked, identity(pattern)) | {"end": s["start"][:nd]}
    by_state, by_input = parts(s["jacobian"])
    changed = ca.mtimes(by_state, s["by"]) + by_input
    share, half_share, ahead = (s["coefficients"][k] * s["h"] for k in range(3))
    expressions = {
        "state": ca.vertcat(s["start"][:nd] + ahead * s["rate"], s["start"][nd:, :]),
        "end": s["end"] + share * s["rate"],
        "end_by": s["end_by"] + share * changed,
        "half_by": s["half_by"] + half_share * changed,
        "by": identity(pattern) + ahead * changed,
    }
    results = {"state": expressions["state"]} | {
        f"next_{key}": expressions[key] if key == "end" else ca.project(expressions[key], pattern) for key in asked
    }
    return straight_function(name, {key: s[key] for key in names}, results)
