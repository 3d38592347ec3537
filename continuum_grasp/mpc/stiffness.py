"""How fast a controller's model can move."""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from continuum_grasp.errors import NumericalError
from continuum_grasp.mpc.prediction import Prediction

__all__ = ["fastest_rate"]

_SAMPLES = 16


def fastest_rate(model: Prediction, u_min: NDArray[np.float64], u_max: NDArray[np.float64]) -> float:
    """Largest absolute eigenvalue of the linearised motion over shapes of half the bending range at rest [1/s].

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
    slope = ca.Function(
        "slope", [model.x, model.u, model.p], [ca.jacobian(model.dynamics(model.x, model.u, model.p), model.x)]
    )
    rng = np.random.default_rng(0)
    spread = model.shapes(_SAMPLES)
    largest = 0.0
    for shape in spread:
        u = rng.uniform(u_min, u_max)
        a = np.array(slope(model.at_rest(shape, u), u, model.p_nominal))
        if not np.all(np.isfinite(a)):
            raise NumericalError("the linearised motion is not finite", state=shape)
        largest = max(largest, float(np.abs(np.linalg.eigvals(a)).max()))
    return largest
