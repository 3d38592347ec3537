"""How fast a scene can move: the spectral radius that an explicit step must resolve."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.core import Core
from continuum_grasp.model import FingerModel

__all__ = ["TARGET_RADIUS", "damping_matrix", "sample_shapes", "spectral_radius", "stable_steps"]

Array = NDArray[np.float64]

TARGET_RADIUS = 1.0
"""Product of step and spectral radius that the explicit method is given; it is stable up to 2.7."""
_POSES = 12
"""Random shapes at which the spectral radius is taken, beside the start and the straight finger [1]."""


def spectral_radius(core: Core, q: Array, u: Array, w: Array, p: Array) -> float:
    """Largest absolute eigenvalue of the linearized motion over some shapes [1/s].

    Parameters
    ----------
    core : Core
        The compiled model.
    q : (count, n) ndarray
        Shapes.
    u, w, p : ndarray
        Input, forces and parameters.

    Returns
    -------
    float
        The largest over the shapes, with that of the tendons' lag; infinite where the model's numbers are not finite.
        Velocities are left out.
    """
    model = core.model
    largest = _drive_rate(model)
    for shape in np.atleast_2d(q):
        mass = core.mass_matrix(shape, u, p)
        stiffness = core.statics(shape, u, w, p)[1]
        damping = damping_matrix(core, shape, u, p)
        if not all(np.all(np.isfinite(part)) for part in (mass, stiffness, damping)):
            return math.inf
        lower = -np.linalg.solve(mass, np.hstack([stiffness, damping]))
        motion = np.vstack([np.hstack([np.zeros_like(mass), np.eye(model.n)]), lower])
        largest = max(largest, float(np.abs(np.linalg.eigvals(motion)).max()))
    return largest


def damping_matrix(core: Core, q: Array, u: Array, p: Array) -> Array:
    """Damping forces per rate of the coordinates (n, n); they are linear in the rates."""
    at_rest = core.damping(q, np.zeros_like(q), u, p)
    return np.array([core.damping(q, e, u, p) - at_rest for e in np.eye(len(q))]).T


def stable_steps(model: FingerModel, x0: Array, u: Array, w: Array) -> int:
    """Steps per second with which the explicit method follows the motion from a state (nx,) under constant u and w."""
    core = Core(model, compiled=False)
    shapes = sample_shapes(model, x0[: model.n])
    return math.ceil(spectral_radius(core, shapes, u, w, np.array(model.p_nominal)) / TARGET_RADIUS)


def sample_shapes(model: FingerModel, start: Array) -> Array:
    """Shapes to estimate the spectral radius at: the start, straight, and some over the bending range."""
    reach = np.array(model.structure.coordinate_limits())
    spread = np.random.default_rng(0).uniform(-0.5, 0.5, (_POSES, model.n)) * reach
    return np.vstack([start, np.zeros(model.n), spread])


def _drive_rate(model: FingerModel) -> float:
    tendons = model.finger.tendons
    return 1.0 / tendons.time_constant if tendons is not None and tendons.time_constant is not None else 0.0
