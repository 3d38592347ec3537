"""How long a step the explicit method may take, over bends, inputs and parameters that the package takes."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.core import Core
from continuum_grasp.errors import NumericalError
from continuum_grasp.export.fields import Field
from continuum_grasp.model import FingerModel
from continuum_grasp.simulation.spectrum import sample_shapes, spectral_radius

__all__ = ["ACCURATE", "STABLE", "greatest_radius"]

STABLE = 2.5
"""Greatest product of step and spectral radius that is taken; the method is stable up to about 2.7."""
ACCURATE = 1.0
"""The same up to which the motion is followed as well as it is resolved."""
_CORNERS = 32


def greatest_radius(model: FingerModel, parameters: Sequence[Field]) -> float:
    """Greatest spectral radius of the linearised motion [1/s].

    Taken over shapes within the bending range and the corners of the ranges of the parameters (some of them where they
    are many).

    Raises
    ------
    NumericalError
        If it is not finite.
    """
    core = Core(model, compiled=False)
    shapes, u, w = _shapes(model), np.zeros(model.nu), np.zeros(model.nw)
    radius = max(spectral_radius(core, shapes, u, w, p) for p in _corners(model, parameters))
    if not np.isfinite(radius):
        raise NumericalError("the linearised motion is not finite at a corner of the parameters' ranges: narrow them")
    return radius


def _shapes(model: FingerModel) -> NDArray[np.float64]:
    """Shapes of moderate bends, and those of twice as much."""
    inside = sample_shapes(model, np.zeros(model.n))
    return np.vstack([inside, 2.0 * inside[2:]])


def _corners(model: FingerModel, parameters: Sequence[Field]) -> list[NDArray[np.float64]]:
    pairs = [(field.low, field.high) for field in parameters]
    if 2 ** len(pairs) <= _CORNERS:
        found = [np.array(corner) for corner in itertools.product(*pairs)]
    else:
        low, high = np.array(pairs).T
        picked = np.random.default_rng(0).integers(0, 2, (_CORNERS, len(pairs)))
        found = [low, high, *(low + (high - low) * row for row in picked)]
    return [np.array(model.p_nominal), *found]
