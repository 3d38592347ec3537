"""A solid object as geometries of MuJoCo, with its mass and inertia."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from continuum_grasp.addons.chains.text import numbers
from continuum_grasp.base import Array

_ROUND = ("sphere", "ellipsoid")
_PRIMITIVES = (*_ROUND, "box", "cylinder")
_FINE = 65
"""Rows of the grid by which inertia is integrated: of a sphere it is then within 0.1 %."""
_COARSE = 25
"""Rows of the grid in place of a surface that is none of MuJoCo's: a chord of 60 mm is 0.26 mm off."""


def solid_parts(result: Any) -> tuple[list[dict[str, str]], list[tuple[str, str]], float]:
    """Attributes of the object's geometries, meshes by name with their vertices, and the radius of edges that these
    lack [m].

    Boxes and cylinders of MuJoCo have sharp edges: theirs are as much smaller as their edges are round, and fingers
    touch them from as much farther.
    """
    solid, body = result.scene.object, result.body
    if solid.shape in _PRIMITIVES:
        half, edge = body.half, body.edge
        size = {"sphere": half[:1], "ellipsoid": half, "box": half - edge, "cylinder": half[[0, 2]] - edge}[solid.shape]
        # 1e-6: least half extent [m], of a box that is all edge
        return [{"name": "object", "type": solid.shape, "size": numbers(*np.maximum(size, 1e-6))}], [], edge
    grid = (body.mesh(_COARSE) - np.array(solid.position)) @ solid.axes
    bands = [grid] if _convex(grid) else [np.stack(pair) for pair in pairwise(grid)]
    meshes = [(f"part_{k + 1}", numbers(*np.ravel(band))) for k, band in enumerate(bands)]
    # Places of meshes are those of their centers of mass, from which MuJoCo counts back.
    return [{"name": name, "type": "mesh", "mesh": name} for name, _ in meshes], meshes, 0.0


def _convex(grid: Array) -> bool:
    """Whether all points of a surface are on its convex hull, to what a coarse grid shows."""
    from scipy.spatial import ConvexHull

    points = grid.reshape(-1, 3)
    hull = ConvexHull(points)
    depth = (points @ hull.equations[:, :3].T + hull.equations[:, 3]).max(axis=1)
    # 2e-3: dent per size that no contact shows
    return bool(depth.min() > -2e-3 * np.ptp(points))


def solid_inertia(result: Any) -> Array:
    """Moments of inertia (3, 3) of the homogeneous shape with the object's mass, along its own axes [kg m2].

    Integrals over the tetrahedra between the center and the triangles of the surface.
    """
    solid = result.scene.object
    grid = (result.body.mesh(_FINE) - np.array(solid.position)) @ solid.axes
    a, b, c, d = grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]
    corners = np.concatenate([np.stack(triangle, axis=-2).reshape(-1, 3, 3) for triangle in ((a, b, c), (a, c, d))])
    volume = np.linalg.det(corners) / 6.0
    total = corners.sum(axis=1)
    second = np.einsum("k,kia,kib->ab", volume, corners, corners) + np.einsum("k,ka,kb->ab", volume, total, total)
    second = solid.weighed * second / (20.0 * volume.sum())
    center = (volume @ total) / (4.0 * volume.sum())
    second -= solid.weighed * np.outer(center, center)
    return np.asarray(np.trace(second) * np.eye(3) - second)
