"""A solid object as geometries of MuJoCo, with its mass and inertia."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull

from continuum_grasp.addons.chains.convex_pieces import convex_pieces
from continuum_grasp.addons.chains.text import numbers
from continuum_grasp.base import Array

_PRIMITIVES = ("sphere", "ellipsoid", "box", "cylinder")
_FLAT = 1e-6
"""Thickness per extent of a part, below which it is flat [1]."""
_TOLERANCE = 1e-3
"""Depth of hollows that convex pieces may fill, per size of the solid [1]: mugs, rings and vases are then within 0.2
mm."""
_EXACT = 1e-6
"""Distance [m] below which MuJoCo is not exact: the default of its ``ccd_tolerance``."""
_PLACES = 400
"""Number of places on a solid at which the deviation of its pieces is measured."""
_SHARE = 0.95
"""Share of these places that satisfy the stated angle of normals [1]: at edges any displacement turns the normals."""


@dataclass(frozen=True)
class SolidGeometry:
    """Geometries of MuJoCo that represent a solid.

    Attributes
    ----------
    parts : list of dict
        Attributes of its geometries.
    meshes : list of (str, str)
        Names and vertices of meshes.
    edge : float
        Edge radius that the geometries lack [m]. MuJoCo's boxes and cylinders have sharp edges: they are smaller by the
        radius, and fingers touch them at a distance larger by the radius.
    difference : str
        Deviation of the pieces from the solid, in words; empty for an exact or convex solid.
    """

    parts: list[dict[str, str]]
    meshes: list[tuple[str, str]]
    edge: float
    difference: str = ""

    @staticmethod
    def of(result: Any) -> SolidGeometry:
        """Build the geometries of the object in a hand's grasp.

        Raises
        ------
        InputError
            If the object is not convex, and manifold3d is not installed.
        """
        solid = result.scene.object
        body = result.body
        if solid.shape in _PRIMITIVES:
            half, edge = body.half, body.edge
            size = {"sphere": half[:1], "ellipsoid": half, "box": half - edge, "cylinder": half[[0, 2]] - edge}
            # 1e-6: least half extent [m], of a box that is all edge
            least = np.maximum(size[solid.shape], 1e-6)
            return SolidGeometry([{"name": "object", "type": solid.shape, "size": numbers(*least)}], [], edge)
        corners, triangles = _surface(result)
        pieces = body.convex_parts or convex_pieces(corners, triangles, _TOLERANCE * solid.size)
        pieces = [part[ConvexHull(part).vertices] for part in pieces if _thick(part)]
        meshes = [(f"part_{k + 1}", numbers(*np.ravel(part))) for k, part in enumerate(pieces)]
        # A mesh is placed by its center of mass: MuJoCo shifts the vertices accordingly.
        parts = [{"name": name, "type": "mesh", "mesh": name} for name, _ in meshes]
        reach = min(float(setup.finger.profile.half_thickness(0.0)) for setup in result.scene.setups)
        return SolidGeometry(parts, meshes, 0.0, _difference(result, corners[triangles], pieces, reach))


def _surface(result: Any) -> tuple[Array, Array]:
    """Corners (V, 3) [m] and triangles (T, 3) of a closed surface of the object, in its own frame."""
    from trimesh import Trimesh

    solid = result.scene.object
    if solid.shape == "mesh":
        return solid.surface.corners, solid.surface.triangles
    points, triangles = result.body.triangles()
    mesh = Trimesh((points - np.array(solid.position)) @ solid.axes, triangles, process=False)
    mesh.merge_vertices()
    mesh.update_faces(mesh.nondegenerate_faces())
    return np.array(mesh.vertices), np.array(mesh.faces)


def _thick(part: Array) -> bool:
    """Whether a part has a volume, without which MuJoCo finds no hull."""
    spread = np.linalg.svd(part - part.mean(axis=0), compute_uv=False)
    return bool(spread[-1] > _FLAT * spread[0])


def _difference(result: Any, places: Array, pieces: list[Array], reach: float) -> str:
    """Describe the deviation of pieces in words; empty if they are exact."""
    off, angle = deviation(result, places, pieces, reach)
    if off < _EXACT and len(pieces) == 1:
        return ""
    what = "a convex mesh replaces its surface"
    if len(pieces) > 1:
        what = f"{len(pieces)} convex pieces replace its concave surface"
    return (
        f"object: {what}; where fingers may touch, it is within {1e3 * max(off, _EXACT):.2g} mm, and {_SHARE:.0%} of "
        f"its normals within {math.degrees(angle):.2g} degrees"
    )


def deviation(result: Any, places: Array, pieces: list[Array], reach: float) -> tuple[float, float]:
    """Measure object against pieces where fingers of a radius [m] may touch: greatest difference of their distances
    [m], and the angle between their normals [rad] that 95 % of the places do not exceed.

    ``places`` are triangles (T, 3, 3) of the object, ``pieces`` corners of convex bodies, in the object's frame.
    """
    import trimesh

    solid = result.scene.object
    # from trimesh: its random points, and closest points of many triangles
    around = trimesh.Trimesh(places.reshape(-1, 3), np.arange(3 * len(places)).reshape(-1, 3), process=False)
    sampled: Any = trimesh.sample.sample_surface(around, _PLACES, seed=0)
    points = np.asarray(sampled[0] + reach * around.face_normals[sampled[1]])
    near = result.body.near(np.array(solid.position) + points @ solid.axes.T)
    outside = near.distance > 0.5 * reach
    normal = (near.normal if near.slope is None else near.slope)[outside] @ solid.axes
    points, distance = points[outside], near.distance[outside]
    hulls = [trimesh.convex.convex_hull(piece) for piece in pieces]
    closest: Any = trimesh.proximity.closest_point
    place, apart, _ = closest(trimesh.util.concatenate(hulls), points)
    planes = [ConvexHull(piece).equations for piece in pieces]
    within = np.any([(points @ plane[:, :3].T + plane[:, 3] < 0.0).all(axis=1) for plane in planes], axis=0)
    apart = np.where(within, -apart, apart)
    cosine = ((points - place) * normal).sum(axis=1) / np.where(apart == 0.0, 1.0, apart)
    angles = np.arccos(np.clip(cosine, -1.0, 1.0))
    return float(np.abs(apart - distance).max(initial=0.0)), float(np.quantile(angles, _SHARE)) if len(angles) else 0.0


def solid_inertia(result: Any) -> Array:
    """Moments of inertia (3, 3) of the homogeneous shape with the object's mass, along its own axes [kg m2].

    Integrals over the tetrahedra between the center and the triangles of the surface; of a mesh, without its cavities.
    """
    solid = result.scene.object
    if solid.shape == "mesh":
        return np.asarray(solid.weighed * solid.surface.inertia)
    points, triangles = _surface(result)
    corners = points[triangles]
    volume = np.linalg.det(corners) / 6.0
    total = corners.sum(axis=1)
    second = np.einsum("k,kia,kib->ab", volume, corners, corners) + np.einsum("k,ka,kb->ab", volume, total, total)
    second = solid.weighed * second / (20.0 * volume.sum())
    center = (volume @ total) / (4.0 * volume.sum())
    second -= solid.weighed * np.outer(center, center)
    return np.asarray(np.trace(second) * np.eye(3) - second)
