"""Linearly implicit Euler steps, implicit in the finger's own elasticity and damping alone, extrapolated once.

For models of many elements, whose own stiffness and damping cause the fastest motions, at a cost that grows
with their number; all else, contacts too, must be resolved by the step. A step h and two of h/2 have errors of the same
power series in h whatever the Jacobian is taken to be (P. Deuflhard, doi:10.1137/1027140), so that twice the second
less the first is of order 2. It is L-stable.
"""

from __future__ import annotations

from typing import Any

import casadi as ca


def step(model: Any, x: ca.MX, u: list[ca.MX], w: list[ca.MX], p: ca.MX, h: ca.MX) -> ca.MX:
    """Next state; ``model.implicit()`` is (x, u, w, p, part) -> (1 - part A)^-1 xd. See ``step_function``."""
    rate = model.implicit()
    # Inputs have their values at the end of each step, as in an implicit method.
    middle = x + 0.5 * h * rate(x, u[1], w[1], p, 0.5 * h)
    end = middle + 0.5 * h * rate(middle, u[2], w[2], p, 0.5 * h)
    following: ca.MX = 2.0 * end - (x + h * rate(x, u[2], w[2], p, h))
    return following
