"""Surfaces of objects: one file for each kind of part, and the table of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import casadi as ca

from continuum_grasp.model.planar import Vec
from continuum_grasp.model.surfaces.offset_polygon import PolygonSurface
from continuum_grasp.model.surfaces.superellipse import SuperellipseSurface
from continuum_grasp.model.surfaces.surface import Nearest, Surface, chosen
from continuum_grasp.scene import OffsetPolygon, Part, SuperellipsePart

__all__ = ["nearest", "surface_of"]

_SURFACES: dict[type[Part], Callable[[Any], Surface[Any]]] = {
    OffsetPolygon: PolygonSurface.of,
    SuperellipsePart: lambda part: SuperellipseSurface(),
}


def surface_of(part: Part) -> Surface[Any]:
    """The surface of a part."""
    return _SURFACES[type(part)](part)


def nearest(parts: Sequence[Part], at: Vec) -> Nearest:
    """Distance of a point from the surface of a union of parts, from the nearest part.

    Offset polygons are exact. On superellipses the nearest point is found by two or three Newton steps along the
    outline from the point in the same direction: exact to 1e-7 of the shorter half axis for points nearer than 0.4 of
    it, and never negative outside.
    """
    candidates = [surface_of(part).nearest(part, at) for part in parts]
    best = candidates[0]
    for other in candidates[1:]:
        nearer = ca.SX(best.distance) <= ca.SX(other.distance)
        best = Nearest(ca.fmin(best.distance, other.distance), chosen(nearer, best.normal, other.normal))
    return best
