"""The body of every object that a scene describes."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from continuum_grasp.grasp.body.body import Body
from continuum_grasp.grasp.body.mesh_surface import MeshSurface
from continuum_grasp.grasp.body.outline_body import OutlineBody
from continuum_grasp.grasp.body.plane_boundary import PlaneBoundary, RoundedRectangle
from continuum_grasp.grasp.body.superquadric_surface import SuperquadricSurface
from continuum_grasp.grasp.body.surface import SolidSurface
from continuum_grasp.grasp.body.swept_surface import ExtrudedSurface, TurnedSurface


def body_of(described: Any) -> Body:
    """Make the body of an object of a planar scene, or of a solid of a hand's scene, in its own frame.

    Examples
    --------
    >>> from continuum_grasp.scene import Circle
    >>> disc = body_of(Circle(shape="circle", diameter=0.06, mass=0.1, position=(0.2, 0.1)))
    >>> disc.distance([[0.05, 0.0]])
    array([0.02])
    """
    # Objects in the plane consist of parts, solids do not.
    return OutlineBody(described) if hasattr(described, "parts") else surface_of(described)


def surface_of(solid: Any) -> SolidSurface:
    """Make the surface of a solid in its own frame; a cache holds the last four shapes."""
    nowhere = {"position": (0.0, 0.0, 0.0), "rotation": (0.0, 0.0, 0.0), "against": None}
    return _surface(solid.replaced(mass=1.0, density=None, center_of_mass=None, **nowhere))


@lru_cache(maxsize=4)
def _surface(solid: Any) -> SolidSurface:
    size = solid.size
    match solid.shape:
        case "sphere":
            return TurnedSurface(RoundedRectangle((0.0, 0.0), size), size)
        case "cylinder":
            r = solid.edge_radius
            return TurnedSurface(RoundedRectangle((0.5 * solid.diameter - r, 0.5 * solid.height - r), r), size)
        case "box":
            *half, height = 0.5 * np.array(solid.extents) - solid.edge_radius
            return ExtrudedSurface(RoundedRectangle(half, 0.0), float(height), solid.edge_radius, size)
        case "ellipsoid":
            return SuperquadricSurface(solid.extents, (2.0, 2.0), size)
        case "superquadric":
            return SuperquadricSurface(solid.extents, solid.exponents, size)
        case "extrude":
            core = PlaneBoundary(solid.core)
            return ExtrudedSurface(core, solid.half_height, solid.edge_radius, size, solid.core_pieces)
        case "mesh":
            return MeshSurface(solid.surface)
        case _:
            return TurnedSurface(PlaneBoundary(solid.section), size)
