"""How long a step the explicit method may take, over bends and parameters that the package takes."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.errors import InputError, NumericalError
from continuum_grasp.export.fields import Field
from continuum_grasp.model import FingerModel

__all__ = ["ACCURATE", "MOST_SUBSTEPS", "STABLE", "check_step", "greatest_radius"]

STABLE = 2.5
"""Greatest product of step and spectral radius that is taken; the method is stable up to about 2.7."""
ACCURATE = 1.0
"""The same up to which the motion is followed as well as it is resolved."""
MOST_SUBSTEPS = 1000
"""Within one step."""
_CORNERS = 32
"""Corners of the box of parameters, all of them for up to five parameters."""
_BETWEEN = 32
"""Shapes within the bending range, as many again: the radius is not monotonic in the shape."""

Array = NDArray[np.float64]


def greatest_radius(model: FingerModel, states: Sequence[Field], parameters: Sequence[Field]) -> float:
    """Greatest spectral radius of the linearized motion [1/s].

    Taken at rest, without input and forces, over shapes within the bending range and the corners of the ranges of the
    parameters (some of them where they are many).

    Raises
    ------
    NumericalError
        If it is not finite.
    """
    rng = np.random.default_rng(0)
    u, w = np.zeros(model.nu), np.zeros(model.nw)
    reach = np.array([field.high for field in states[: model.n]])
    radius = 0.0
    for p in _corners(model, parameters, rng):
        for shape in _shapes(reach, rng):
            x = np.zeros(model.nx)
            x[: model.n] = shape
            jacobian = np.array(model.linearization(x, u, w, p)[0])
            if not np.isfinite(jacobian).all():
                raise NumericalError(
                    "the linearized motion is not finite at a corner of the parameters' ranges", state=x
                )
            radius = max(radius, float(np.abs(np.linalg.eigvals(jacobian)).max()))
    return radius


def check_step(step: float, substeps: int, radius: float) -> None:
    """Whether a step of so many sub-steps is stable.

    Raises
    ------
    InputError
        If it is not.
    """
    if step * radius <= STABLE * substeps:
        return
    needed = math.ceil(step * radius / STABLE)
    if needed <= MOST_SUBSTEPS:
        advice = f"needs {needed} sub-steps (substeps), or a model with fewer or longer elements"
    else:
        advice = (
            f"would need {needed:.3g} sub-steps: with {MOST_SUBSTEPS} (substeps) steps up to "
            f"{STABLE * MOST_SUBSTEPS / radius:.2g} s would do; take those, or a model with fewer or longer elements"
        )
    raise InputError(
        f"steps of {step:g} s are too long: the fastest motion of this model changes at {radius:.4g} 1/s, so the "
        f"Runge-Kutta method {advice}",
        key="step",
    )


def _shapes(reach: Array, rng: np.random.Generator) -> Array:
    """Straight, every bend at a limit (half of them, since the others mirror them), and in between."""
    between = rng.uniform(-1.0, 1.0, (_BETWEEN, len(reach)))
    return np.vstack([np.zeros(len(reach)), _signs(len(reach), rng), between]) * reach


def _signs(count: int, rng: np.random.Generator) -> Array:
    if 2 ** (count - 1) <= _CORNERS:
        return np.array([(1.0, *rest) for rest in itertools.product((-1.0, 1.0), repeat=count - 1)])
    return np.where(rng.integers(0, 2, (_CORNERS, count)) == 1, 1.0, -1.0)


def _corners(model: FingerModel, parameters: Sequence[Field], rng: np.random.Generator) -> list[Array]:
    """Nominal values and those at the ends of the ranges."""
    pairs = np.array([(field.low, field.high) for field in parameters]).reshape(-1, 2)
    if 2 ** len(pairs) <= _CORNERS:
        found = [np.array(corner) for corner in itertools.product(*pairs)]
    else:
        picked = rng.integers(0, 2, (_CORNERS, len(pairs)))
        found = [pairs[:, 0], pairs[:, 1], *(np.where(row == 1, pairs[:, 1], pairs[:, 0]) for row in picked)]
    return [np.array(model.p_nominal), *found]
