"""Solid objects from files of triangles."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from continuum_grasp.base import Array
from continuum_grasp.scene.solids.boundary import few
from continuum_grasp.scene.solids.solid_body import SolidBody
from continuum_grasp.scene.value import Extent

if TYPE_CHECKING:
    from continuum_grasp.scene.solids.triangles import TriangleMesh


class MeshPart(SolidBody):
    """A closed surface of triangles; the frame has the axes of the file, and its origin at the centroid of the volume.

    Distances refer to the triangles; normals vary smoothly across edges that are blunter than 30 degrees, as in
    pictures of meshes. A closed surface inside the outer one bounds a cavity, whichever way its normals point: volume,
    centroid and inertia belong to the hollow body, and fingers touch it outside.
    """

    shape: Literal["mesh"]
    """A closed surface of triangles; the frame has the axes of the file and its origin at the centroid."""
    file: Annotated[str, Field(examples=["part.stl"])]
    """STL, OBJ, PLY or 3MF; one closed body, which may have closed cavities."""
    scale: Annotated[Extent, Field(examples=["1 mm"])] | None = None
    """Length of a unit of the file [m]; None: what a 3MF states."""

    @property
    def surface(self) -> TriangleMesh:
        """Triangles [m]; read again only if the file changes."""
        from continuum_grasp.scene.solids.triangles import read_triangles

        return read_triangles(Path(self.file), self.scale)

    def outermost(self, direction: Array) -> Array:
        return few(self.surface.corners, direction, self.size)

    @property
    def deviation(self) -> float:
        return self.surface.deviation

    @property
    def volume(self) -> float:
        return self.surface.volume

    @property
    def size(self) -> float:
        return self.surface.size

    def _check(self) -> None:
        _ = self.surface
