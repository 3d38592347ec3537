"""A smooth field on a grid that stands for the distance from facets."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array, diags_array, eye_array, kron
from scipy.sparse.linalg import cg

from continuum_grasp.base import Numbers as Array

_EXACT, _STEPS = 1e-8, 500
"""Relative residual of the normal equations, and limit of the steps of conjugate gradients; 60 to 120 are enough."""


def evened(distance: Array, normals: Array, step: float, reach: float) -> Array:
    """Return the field u that minimizes the sum over the grid of |grad u - n|^2 + (u - d)^2 / reach^2.

    It is smooth: facets shorter than ``reach`` leave no trace in it.

    Parameters
    ----------
    distance
        Distances d at the places of a grid (a, b, c), ``step`` apart [m].
    normals
        Directions n (a, b, c, 3) that its gradient should have [1].
    step
        Distance between places along each axis [m].
    reach
        Length [m] over which the field may leave the distance to follow the normals.
    """
    flat = distance.ravel()
    matrix = csr_array(eye_array(flat.size) / reach**2)
    right = flat / reach**2
    for axis in range(3):
        slope, mean = csr_array(np.ones((1, 1))), csr_array(np.ones((1, 1)))
        for k, count in enumerate(distance.shape):
            along = eye_array(count), eye_array(count)
            if k == axis:
                ends = np.ones(count - 1)
                shape = (count - 1, count)
                along = tuple(diags_array([s * ends, ends], offsets=[0, 1], shape=shape) for s in (-1.0, 1.0))
            slope, mean = kron(slope, along[0], "csr"), kron(mean, along[1], "csr")
        slope, mean = slope / step, 0.5 * mean
        matrix = matrix + slope.T @ slope
        right = right + slope.T @ (mean @ normals[..., axis].ravel())
    field, _ = cg(matrix, right, x0=flat, rtol=_EXACT, maxiter=_STEPS)
    return np.asarray(field.reshape(distance.shape))
