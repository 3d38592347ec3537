"""Sections of meshes with a plane."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from continuum_grasp.scene.objects.drawings.curves import DrawnCurve, distinct
from continuum_grasp.scene.objects.drawings.drawing import Drawing
from continuum_grasp.scene.problems import KeyedError

if TYPE_CHECKING:
    from continuum_grasp.scene.objects.outline import OutlineFile


def read_cut(given: OutlineFile) -> Drawing:
    """Cut a closed mesh with the plane of a scene; return the closed curves, the largest first, in units of the
    file.
    """
    import numpy as np

    from continuum_grasp.scene.objects.outline import PlaneCut
    from continuum_grasp.scene.solids.triangles import load_closed

    mesh, factor, _ = load_closed(Path(given.file), given.scale)
    cut = given.cut or PlaneCut()
    point = np.array(cut.point) / factor
    normal = np.array(cut.normal) / np.linalg.norm(cut.normal)
    section = mesh.section(plane_origin=point, plane_normal=normal)
    if section is None:
        heights = (mesh.vertices @ normal) * factor
        raise KeyedError(
            f"cut: the plane misses the mesh, from {heights.min():.4g} to {heights.max():.4g} m along the normal; "
            f"the plane is at {float(point @ normal) * factor:.4g} m"
        )
    first = np.eye(3)[0 if abs(normal[0]) < 1.0 - 1e-9 else 1]
    x = first - normal * float(normal @ first)
    x = x / np.linalg.norm(x)
    axes = np.column_stack([x, np.cross(normal, x)])
    rings = [distinct((float(a), float(b)) for a, b in (line - point) @ axes) for line in section.discrete]
    curves = [DrawnCurve("section", (), ring, group="cut") for ring in rings if len(ring) > 2]
    curves.sort(key=lambda curve: -curve.solid.area)
    named = [DrawnCurve(f"section {k + 1}", (f"section {k + 1}",), c.points, group="cut") for k, c in enumerate(curves)]
    return Drawing(factor, named)
