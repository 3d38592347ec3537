"""The finger in high precision, independent of the package: quadrature of the definitions with 50 digits, no CasADi.

It shares no formula with the package under test. Conventions: tangent (-sin, cos) of the bending angle in
base axes, positive angles bend towards -X, world = base position + rotation by the base angle.
"""

from __future__ import annotations

import numpy as np

from tests.truth.finger import TruthFinger
from tests.truth.quadrature import ctx
from tests.truth.rod import Rod, christoffel_bias

__all__ = ["Rod", "TruthFinger", "christoffel_bias", "ctx", "matched_tip", "to_numpy"]


def matched_tip(finger: TruthFinger, tau=0, rate=0, acceleration=0) -> tuple:
    """Tip curvature above rest of a matched clothoid under a tip moment [N m], with its rate and acceleration."""
    stiffness = ctx.mpf(finger.bending_stiffness)
    return ctx.mpf(tau) / stiffness, ctx.mpf(rate) / stiffness, ctx.mpf(acceleration) / stiffness


def to_numpy(value) -> np.ndarray:
    """An mpmath matrix or list as doubles; column matrices become vectors."""
    if hasattr(value, "rows"):
        array = np.array([[float(value[i, j]) for j in range(value.cols)] for i in range(value.rows)])
        return array[:, 0] if value.cols == 1 else array
    return np.array([float(v) for v in value]) if hasattr(value, "__len__") else np.array(float(value))
