"""Round bodies that roll on the surface of an object."""

from __future__ import annotations

import numpy as np

from continuum_grasp.grasp.certificate.check import EXACT
from continuum_grasp.grasp.certificate.recomputed import RecomputedContact, RecomputedGrasp, across


def surface_radius(grasp: RecomputedGrasp, contact: RecomputedContact) -> float:
    """Radius of curvature where the object is touched; within the tolerance of places a face ends in its corner [m]."""
    if np.isfinite(contact.surface_radius):
        return contact.surface_radius
    beside = EXACT * contact.length * across(contact.normal)
    seen = contact.point + contact.length * contact.normal + np.stack([-beside, beside])
    return float(np.min(grasp.object.nearest(seen, grasp.object.parts[contact.part]).radius))


def rolling_radius(h: float, rho: float) -> float:
    """The law h rho / (h + rho) of two radii, which tends to the other radius where one is flat [m]."""
    return rho if np.isinf(h) else h if np.isinf(rho) else 0.0 if h + rho == 0.0 else h * rho / (h + rho)
