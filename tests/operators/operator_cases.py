"""The finger of the tests of operators."""

from __future__ import annotations

import numpy as np

import continuum_grasp as cg

FINGER = cg.Finger(
    rod=cg.Rod(length=0.18, linear_density=0.02, bending_stiffness=0.01), damping=cg.Damping(material=1e-5)
)
MODEL = cg.FingerModel(FINGER, family="arc", elements=2, parameters=["bending_stiffness", "material_damping"])
SCALE = np.array([1.0, 1.0, 1e-3, 1e-3])
"""Rates are a thousand times the angles."""


def start() -> list[np.ndarray]:
    """Three states, an input in each of four steps, the parameters."""
    rng = np.random.default_rng(0)
    return [0.1 * rng.normal(size=(3, 4)), 0.01 * rng.normal(size=(4, 1)), np.array(MODEL.p_nominal)]
