"""Closed surfaces of triangles, read from files by trimesh."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

from continuum_grasp.base import Array
from continuum_grasp.scene.objects.outline import MESHES
from continuum_grasp.scene.problems import KeyedError
from continuum_grasp.scene.solids.shells import outer_shell

CREASE = 0.52
"""Least angle between the normals of neighboring triangles at a true edge of the object [rad], 30 degrees; the
triangles of a curved surface have blunter edges."""
_SMALLEST, _GREATEST = 1e-4, 3.0
"""Sizes of an object [m] beyond which the unit of its file is likely another one."""
_MOST = 2_000_000
"""Triangles of a file at most: the search holds all of them."""
_UNITS = {"millimeter": 1e-3, "centimeter": 1e-2, "meter": 1.0, "inch": 0.0254, "foot": 0.3048, "micron": 1e-6}
"""Units that a 3MF may state [m]."""


@dataclass(frozen=True, eq=False)
class TriangleMesh:
    """Outer surface of a solid of triangles; the origin of its frame is the centroid of the volume without cavities."""

    corners: Array  # (V, 3) [m]
    triangles: Array  # (T, 3) indices, counter-clockwise from outside
    normals: Array = field(repr=False)  # (T, 3, 3) outward unit normals at the three corners of each triangle
    volume: float  # of the material [m3]
    inertia: Array = field(repr=False)  # (3, 3) of the homogeneous body about its centroid, per mass [m2]
    size: float  # greatest distance of a corner from the centroid [m]
    deviation: float  # greatest distance of an edge from the arc that the normals at its ends make it [m]


def read_triangles(file: Path, scale: float | None) -> TriangleMesh:
    """The surface in a file, read again only where the file has changed.

    Raises
    ------
    ValueError
        The text begins with the key that is wrong: the file cannot be read, is open, inside-out, or several bodies, or
        its unit makes no sense.
    """
    try:
        state = file.stat()
    except OSError as error:
        raise KeyedError(f"file: cannot be read: {file.name}: {error.strerror}") from None
    return _read(file, scale, state.st_mtime_ns, state.st_size)


@lru_cache(maxsize=8)
def _read(file: Path, scale: float | None, changed: int, count: int) -> TriangleMesh:
    import numpy as np

    mesh, factor, is_outer = load_closed(file, scale)
    # The tensor of trimesh is of second order in what rounding far from the origin leaves: near the origin first.
    center = 0.5 * mesh.bounds.sum(axis=0)
    mesh.apply_translation(-center)
    mesh.apply_scale(factor)
    mesh.apply_translation(-mesh.center_mass)
    volume = float(mesh.volume)
    inertia = np.array(mesh.moment_inertia) / volume
    mesh.update_faces(is_outer)
    mesh.remove_unreferenced_vertices()
    corners = np.array(mesh.vertices, dtype=float)
    triangles = np.array(mesh.faces)
    normals = corner_normals(mesh)
    # An arc whose tangent turns by an angle is an eighth of that angle times its chord away from the chord.
    ends = corners[triangles], normals
    chords, turns = (np.linalg.norm(np.roll(part, -1, axis=1) - part, axis=2) for part in ends)
    size = float(np.linalg.norm(corners, axis=1).max())
    off = float((chords * turns).max()) / 8.0
    surface = TriangleMesh(corners, triangles, normals, volume, inertia, size, off)
    for array in (corners, triangles, normals, inertia):
        array.setflags(write=False)
    return surface


def load_closed(file: Path, scale: float | None) -> tuple[Any, float, Array]:
    """Return the closed mesh of a file, the length of a unit of it [m], and whether each triangle (T,) is outside.

    Raises
    ------
    KeyedError
        As `read_triangles`.
    """
    import trimesh

    name = file.name
    form = file.suffix.lower()
    if form not in MESHES:
        raise KeyedError(f"file: expected {', '.join(MESHES)}, got {name}")
    try:
        mesh = trimesh.load(file, force="mesh", process=False)
    except Exception as error:  # a dozen libraries and parsers raise any kind
        raise KeyedError(f"file: cannot be read: {name}: {_first_line(error)}") from None
    if not isinstance(mesh, trimesh.Trimesh) or not len(mesh.faces):
        raise KeyedError(f"file: {name} has no triangles")
    if len(mesh.faces) > _MOST:
        raise KeyedError(f"file: {name} has {len(mesh.faces)} triangles; reduce them to {_MOST} or fewer (decimate)")
    if not _finite(mesh.vertices):
        raise KeyedError(f"file: {name} has coordinates that are not finite numbers")
    factor = _factor(name, mesh, scale)
    _check_size(name, mesh, factor)
    _merge(mesh)
    _check_closed(name, mesh)
    return mesh, factor, outer_shell(name, mesh, factor)


def _first_line(error: Exception) -> str:
    text = str(error).strip().partition("\n")[0]
    return text[:120] or type(error).__name__


def _finite(values: Any) -> bool:
    import numpy as np

    return bool(np.isfinite(values).all())


def _factor(name: str, mesh: Any, scale: float | None) -> float:
    stated = _UNITS.get(str(mesh.units)) if mesh.units else None
    if scale is None and stated is None:
        raise KeyedError(f"scale: missing; {name} does not say how long a unit of it is: scale: 1 mm, or 1 m")
    if scale is not None and stated is not None and abs(scale - stated) > 1e-9 * stated:
        raise KeyedError(f"scale: {scale:g} m, but {name} says that its unit is a {mesh.units}; leave scale out")
    if scale is not None:
        return scale
    if stated is not None:
        return stated
    return 1.0


def _check_size(name: str, mesh: Any, factor: float) -> None:
    size = float(max(mesh.extents)) * factor
    if not _SMALLEST < size < _GREATEST:
        other = "1 mm" if size >= _GREATEST else "1 m"
        raise KeyedError(
            f"scale: {name} would be {size:.4g} m large; in which unit is the file? Expected {_SMALLEST:g} to "
            f"{_GREATEST:g} m: try scale: {other}"
        )


def _merge(mesh: Any) -> None:
    """Make corners of triangles that are one place one corner, and leave out triangles without area."""
    import numpy as np

    mesh.merge_vertices(merge_tex=True, merge_norm=True)
    if not mesh.is_watertight:  # corners that are written with few digits
        digits = 5 - int(np.ceil(np.log10(max(mesh.extents))))
        mesh.merge_vertices(merge_tex=True, merge_norm=True, digits_vertex=digits)
    sides = np.sort(mesh.faces, axis=1)
    mesh.update_faces((sides[:, 0] != sides[:, 1]) & (sides[:, 1] != sides[:, 2]))
    mesh.remove_unreferenced_vertices()


def _check_closed(name: str, mesh: Any) -> None:
    import numpy as np

    if not mesh.is_watertight:
        edges = np.sort(mesh.edges, axis=1)
        unique, counts = np.unique(edges, axis=0, return_counts=True)
        lone = unique[counts == 1]
        if len(lone):
            where = ", ".join(f"{v:.4g}" for v in mesh.vertices[lone[0]].mean(axis=0))
            raise KeyedError(
                f"file: {name} is open: {len(lone)} edges have a triangle on one side only, the first near ({where}) "
                "in units of the file; close its holes (a repair tool, or export it as a solid)"
            )
        raise KeyedError(
            f"file: {name} is no surface of a solid: {int((counts > 2).sum())} edges have more than two triangles, as "
            "where bodies or cavities touch; unite bodies, and part cavities, before export"
        )
    if not mesh.is_winding_consistent:
        raise KeyedError(
            f"file: {name} has triangles whose corners go round the other way; make its normals consistent"
        )


def corner_normals(mesh: Any) -> Array:
    """Normals (T, 3, 3) at the corners of triangles: means over the triangles around that no crease parts from them,
    weighted by area times angle, so that flat faces stay flat.
    """
    import numpy as np
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    faces = mesh.faces
    count = 3 * len(mesh.faces)
    smooth = mesh.face_adjacency_angles < CREASE
    pairs, edges = mesh.face_adjacency[smooth], mesh.face_adjacency_edges[smooth]
    # Number of the corner of each of both triangles at each end of their edge.
    at = [[3 * pairs[:, k] + (faces[pairs[:, k]] == edges[:, [end]]).argmax(axis=1) for k in (0, 1)] for end in (0, 1)]
    first, second = (np.concatenate([at[end][k] for end in (0, 1)]) for k in (0, 1))
    links = coo_matrix((np.ones(len(first)), (first, second)), shape=(count, count))
    _, group = connected_components(links, directed=False)
    weights = (mesh.area_faces[:, None] * mesh.face_angles).reshape(-1)
    sums = np.zeros((int(group.max()) + 1, 3))
    np.add.at(sums, group, weights[:, None] * np.repeat(mesh.face_normals, 3, axis=0))
    normals = sums / np.maximum(np.linalg.norm(sums, axis=1), 1e-300)[:, None]
    return np.asarray(normals[group].reshape(-1, 3, 3))
