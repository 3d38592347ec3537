"""The motion M qdd + D qd + K q = 0 about a shape."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.base import Array
from continuum_grasp.core import Core


def poles(mass: Array, stiffness: Array, damping: Array) -> NDArray[np.inexact]:
    """Eigenvalues (2 n,) [1/s] of the linearized motion M qdd + D qd + K q = 0."""
    return np.linalg.eigvals(slope_matrix(mass, stiffness, damping))


def slope_matrix(mass: Array, stiffness: Array, damping: Array) -> Array:
    """Matrix A of the motion d(q, qd)/dt = A (q, qd)."""
    lower = -np.linalg.solve(mass, np.hstack([stiffness, damping]))
    return np.vstack([np.hstack([np.zeros_like(mass), np.eye(len(mass))]), lower])


def in_mass_metric(mass: Array, stiffness: Array) -> tuple[Array, Array, bool]:
    """Root R with R M R' = 1, the stiffness R K R', and whether that is symmetric."""
    root = np.linalg.inv(np.linalg.cholesky(mass))
    scaled = root @ stiffness @ root.T
    # Following loads and tendon friction make it unsymmetric, by far more than rounding.
    return root, scaled, bool(np.abs(scaled - scaled.T).max() <= 1e-9 * np.abs(scaled).max())


def damping_matrix(core: Core, q: Array, u: Array, p: Array, qd: Array | None = None) -> Array:
    """Damping forces per rate of the coordinates (n, n) at rates qd (n,), zero where not given."""
    x = np.zeros(core.model.nx)
    x[: 2 * len(q)] = np.concatenate([q, np.zeros_like(q) if qd is None else qd])
    return np.asarray(core.internal(x, u, p)[2])
