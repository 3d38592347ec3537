"""Variable-step integration with error control."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from continuum_grasp import interrupt
from continuum_grasp.errors import Interrupted, NumericalError
from continuum_grasp.model import FingerModel, System

Array = NDArray[np.float64]

_RELATIVE, _ABSOLUTE = 1e-11, 1e-12
"""Tolerances of CVODES [1; units of the states]: motions of 0.2 s have errors below 1e-9 (test_simulation.py)."""


def integrate_reference(
    model: FingerModel | System, x0: Array, step: float, u: Array, w: Array, *, looser: float = 1.0
) -> Array:
    """Integrate with CVODES (backward differentiation) to states (steps + 1, nx), a ``step`` [s] apart.

    Inputs and forces (2 * steps + 1, size) are those at half steps, quadratic in between; ``looser`` is a factor on the
    tolerances. NumericalError and Interrupted have the states so far as ``result``.
    """
    x, t = ca.MX.sym("x", model.nx), ca.MX.sym("t")
    samples = ca.MX.sym("samples", 3 * (model.nu + model.nw))
    blocks = ca.vertsplit(samples, [0, *np.cumsum([model.nu] * 3 + [model.nw] * 3).tolist()])
    at = t / step
    # Lagrange polynomials of start, middle and end of the step.
    weights = ((1 - at) * (1 - 2 * at), 4 * at * (1 - at), at * (2 * at - 1))
    now_u = sum((k * b for k, b in zip(weights, blocks[:3], strict=True)), ca.MX.zeros(model.nu))
    now_w = sum((k * b for k, b in zip(weights, blocks[3:], strict=True)), ca.MX.zeros(model.nw))
    rate = model.forward_dynamics(x, now_u, now_w, ca.DM(model.p_nominal))
    problem: Any = {"x": x, "t": t, "p": samples, "ode": rate}
    options: Any = {"max_num_steps": 200_000, "newton_scheme": "direct"}
    options |= {"abstol": looser * _ABSOLUTE, "reltol": looser * _RELATIVE}
    # One output step per call: CVODES starts anew there, where the piecewise quadratic inputs may have kinks.
    one = ca.integrator("reference", "cvodes", problem, 0.0, step, options)
    steps = (len(u) - 1) // 2
    states = np.empty((steps + 1, model.nx))
    states[0] = x0
    with interrupt.held(quietly=True) as pressed:
        for k in range(steps):
            rows = np.concatenate([u[2 * k : 2 * k + 3].ravel(), w[2 * k : 2 * k + 3].ravel()])
            reason = "the state is not finite"
            try:
                states[k + 1] = np.array(one(x0=states[k], p=rows)["xf"]).ravel()
            except RuntimeError as error:
                states[k + 1], reason = np.nan, f"the reference integrator failed: {str(error).splitlines()[-1]}"
            if pressed():  # CasADi's integrators would report it as a failure of the motion
                raise Interrupted("interrupted", result=states[: k + 1])
            if not np.all(np.isfinite(states[k + 1])):
                message = f"{reason} (after t = {k * step:g} s)"
                raise NumericalError(message, time=k * step, state=states[k], result=states[: k + 1])
    return states
