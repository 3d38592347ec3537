"""A solid object as geometries of MuJoCo, with its mass and inertia."""

from __future__ import annotations

from typing import Any

import numpy as np

from continuum_grasp.addons.chains.text import numbers
from continuum_grasp.base import Array

_ROUND = ("sphere", "ellipsoid")
_PRIMITIVES = (*_ROUND, "box", "cylinder")
_FLAT = 1e-6
"""Thickness per extent of a part, below which it is flat [1]."""
_FINE = 65
"""Rows of the grid by which inertia is integrated: of a sphere it is then within 0.1 %."""


def solid_parts(result: Any) -> tuple[list[dict[str, str]], list[tuple[str, str]], float]:
    """Attributes of the object's geometries, meshes by name with their vertices, and the radius of edges that these
    lack [m].

    Boxes and cylinders of MuJoCo have sharp edges: theirs are as much smaller as their edges are round, and fingers
    touch them from as much farther.
    """
    solid = result.scene.object
    body = result.body
    if solid.shape in _PRIMITIVES:
        half, edge = body.half, body.edge
        size = {"sphere": half[:1], "ellipsoid": half, "box": half - edge, "cylinder": half[[0, 2]] - edge}[solid.shape]
        # 1e-6: least half extent [m], of a box that is all edge
        return [{"name": "object", "type": solid.shape, "size": numbers(*np.maximum(size, 1e-6))}], [], edge
    meshes = [(f"part_{k + 1}", numbers(*np.ravel(part))) for k, part in enumerate(filter(_thick, body.convex_parts()))]
    # Places of meshes are those of their centers of mass, from which MuJoCo counts back.
    return [{"name": name, "type": "mesh", "mesh": name} for name, _ in meshes], meshes, 0.0


def _thick(part: Array) -> bool:
    """Whether a part has a volume, without which MuJoCo finds no hull."""
    spread = np.linalg.svd(part - part.mean(axis=0), compute_uv=False)
    return bool(spread[-1] > _FLAT * spread[0])


def solid_inertia(result: Any) -> Array:
    """Moments of inertia (3, 3) of the homogeneous shape with the object's mass, along its own axes [kg m2].

    Integrals over the tetrahedra between the center and the triangles of the surface.
    """
    solid = result.scene.object
    points, triangles = result.body.triangles(_FINE)
    corners = ((points - np.array(solid.position)) @ solid.axes)[triangles]
    volume = np.linalg.det(corners) / 6.0
    total = corners.sum(axis=1)
    second = np.einsum("k,kia,kib->ab", volume, corners, corners) + np.einsum("k,ka,kb->ab", volume, total, total)
    second = solid.weighed * second / (20.0 * volume.sum())
    center = (volume @ total) / (4.0 * volume.sum())
    second -= solid.weighed * np.outer(center, center)
    return np.asarray(np.trace(second) * np.eye(3) - second)
