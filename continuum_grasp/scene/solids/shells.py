"""Closed shells of a mesh: the outer one, and cavities inside."""

from __future__ import annotations

from typing import Any

from continuum_grasp.base import Array
from continuum_grasp.scene.problems import KeyedError

_PROBES = 100
"""Triangles of a shell whose middles say whether it lies inside of another; of shells that cross, some lie outside."""
_CLEAR = 0.25
"""A point may lie on the shell itself if its winding number is within this distance of one half [1]. The number is 0
outside, 1 inside, and one half on a face."""


def outer_shell(name: str, mesh: Any, factor: float) -> Array:
    """Find the triangles (T,) of a closed mesh that are its outer shell; all others bound cavities.

    The mesh of cavities is turned in place where needed, so that all normals point out of the material.

    Parameters
    ----------
    name : str
        Name of the file, for messages.
    mesh : trimesh.Trimesh
        Closed shells, each of a consistent winding.
    factor : float
        Length of a unit of the mesh [m].

    Raises
    ------
    KeyedError
        If there are several bodies, next to each other or one loose in a cavity of the other, shells that cross, or if
        the outer shell is inside-out.
    """
    import numpy as np
    import trimesh

    components: Any = trimesh.graph.connected_components(mesh.face_adjacency, nodes=np.arange(len(mesh.faces)))
    corners = np.asarray(mesh.triangles - mesh.bounds.mean(axis=0))
    shells = [_Shell(component, corners[component]) for component in components]
    around = [_shells_around(name, shells, shell, factor) for shell in shells]
    outer = [shell for shell, count in zip(shells, around, strict=True) if count == 0]
    loose = [shell for shell, count in zip(shells, around, strict=True) if count > 1]
    if len(outer) > 1:
        raise KeyedError(
            f"file: {name} has {len(outer)} bodies ({_sizes(outer, factor)}); a hand holds one: unite them, "
            "or export one"
        )
    if loose:
        raise KeyedError(
            f"file: {name} has a body that lies loose in a cavity ({_sizes(loose, factor)}); a hand holds one "
            "body: leave it out, or unite it with the wall"
        )
    if outer[0].volume <= 0.0:
        raise KeyedError(f"file: {name} is inside-out: its normals point inward; reverse all triangles")
    faces = np.array(mesh.faces)
    for shell, count in zip(shells, around, strict=True):
        if count and shell.volume > 0.0:
            faces[shell.numbers] = faces[shell.numbers, ::-1]
    mesh.faces = faces
    is_outer = np.zeros(len(faces), dtype=bool)
    is_outer[outer[0].numbers] = True
    return is_outer


class _Shell:
    """Triangles that edges connect: their numbers (T,), corners (T, 3, 3), bounds (3,), and the volume within."""

    def __init__(self, numbers: Array, corners: Array) -> None:
        import numpy as np

        self.numbers, self.corners = numbers, corners
        self.least, self.most = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
        self.volume = float(np.linalg.det(corners).sum() / 6.0)


def _shells_around(name: str, shells: list[_Shell], own: _Shell, factor: float) -> int:
    """Number of shells that a shell lies in."""
    import numpy as np

    points = own.corners[:: 1 + len(own.corners) // _PROBES].mean(axis=1)
    count = 0
    for other in shells:
        if other is own or (own.most < other.least).any() or (own.least > other.most).any():
            continue
        winding = np.abs([_winding_number(point, other.corners) for point in points])
        inside = winding > 0.5 + _CLEAR
        if inside.any() and (winding < 0.5 - _CLEAR).any():
            raise KeyedError(f"file: {name} has shells that cross ({_sizes([own, other], factor)}); unite them")
        count += bool(inside.any())
    return count


def _winding_number(point: Array, triangles: Array) -> float:
    """Winding number of triangles (T, 3, 3) about a point: the sum of their solid angles over 4 pi (A. van Oosterom, J.
    Strackee, "The Solid Angle of a Plane Triangle", IEEE Trans. Biomed. Eng. 30 (1983) 125).
    """
    import numpy as np

    away = triangles - point
    a, b, c = np.moveaxis(away, 1, 0)
    p, q, r = np.linalg.norm(away, axis=2).T
    products = ((a * b).sum(axis=1) * r, (b * c).sum(axis=1) * p, (c * a).sum(axis=1) * q)
    angles = 2.0 * np.arctan2(np.linalg.det(away), p * q * r + sum(products))
    return float(angles.sum() / (4.0 * np.pi))


def _sizes(shells: list[_Shell], factor: float) -> str:
    """Largest extents of some shells, in words."""
    extents = [float((shell.most - shell.least).max()) * factor for shell in shells]
    return ", ".join([*(f"{extent:.3g} m" for extent in extents[:4]), *(["..."] if len(extents) > 4 else [])])
