"""Derivatives by differences of what is differentiated."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np


def differences(function: Callable[[np.ndarray], Any], at: Any, steps: Any = 1e-6) -> np.ndarray:
    """Jacobian by central differences; ``steps`` is one number for all entries of ``at``, or a number for each."""
    at = np.asarray(at, dtype=float)
    sizes = np.broadcast_to(steps, at.shape)
    sides = [[np.array(function(at + way * step)).ravel() for way in (1.0, -1.0)] for step in np.diag(sizes)]
    return np.array([(ahead - behind) / (2.0 * size) for (ahead, behind), size in zip(sides, sizes, strict=True)]).T
