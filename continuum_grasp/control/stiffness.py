"""How fast a controller's model can move."""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from continuum_grasp.control.prediction import Prediction
from continuum_grasp.errors import NumericalError

__all__ = ["fastest_rate"]

_SAMPLES = 16
_PRESSED = 10.0
"""Normal force at which contacts are taken to be [N]; their damping grows with it."""

Array = NDArray[np.float64]


def fastest_rate(model: Prediction, u_min: Array, u_max: Array) -> float:
    """Largest absolute eigenvalue of the linearised motion [1/s].

    Taken over shapes of half the bending range at rest, with all contacts closed where there is an object.

    Parameters
    ----------
    model : Prediction
        The model.
    u_min, u_max : (nu,) ndarray
        Limits of the input.

    Returns
    -------
    float

    Raises
    ------
    NumericalError
        If the model's numbers are not finite.
    """
    slope = _pressed(model) if model.system.surroundings is not None else _free(model)
    rng = np.random.default_rng(0)
    largest = 0.0 if model.scene.lag is None else 1.0 / model.scene.lag
    for shape in model.shapes(_SAMPLES):
        u = rng.uniform(u_min, u_max)
        a = np.array(slope(model.at_rest(shape, u), u, model.p_nominal))
        if not np.all(np.isfinite(a)):
            raise NumericalError("the linearised motion is not finite", state=shape)
        largest = max(largest, float(np.abs(np.linalg.eigvals(a)).max()))
    return largest


def _free(model: Prediction) -> ca.Function:
    """Jacobian of the motion as it is."""
    given = [model.x, model.u, model.p]
    return ca.Function("slope", given, [ca.jacobian(model.dynamics(*given), model.x)])


def _pressed(model: Prediction) -> ca.Function:
    """Jacobian of the system's motion as if every contact were pressed."""
    system, around = model.system, model.system.surroundings
    law = None if around is None else around.contact_law
    depth = 0.0 if law is None else law.rounding + _PRESSED / law.stiffness
    x, u, w, p = model.arguments
    gap = system.touch(x, u, w, p)[0]
    slope = system.pressed_linearization(x, u, w, p, gap + depth)
    return ca.Function("slope", [model.x, model.u, model.p], [slope])
