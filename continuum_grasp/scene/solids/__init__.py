"""Solid objects in space, which a hand holds: shape, mass and pose."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from pydantic import Field

from continuum_grasp.scene.document import Document, KeyPath, child
from continuum_grasp.scene.objects.outline_files import put_in_outlines
from continuum_grasp.scene.solids.mesh_part import MeshPart
from continuum_grasp.scene.solids.primitives import Cylinder, Ellipsoid, RoundedBox, Sphere, Superquadric
from continuum_grasp.scene.solids.solid_body import SolidBody
from continuum_grasp.scene.solids.swept import Cone, Extruded, Revolved
from continuum_grasp.scene.value import SpatialPosition, Vector3

__all__ = ["Solid", "SolidBody", "SpatialPosition", "Vector3", "put_in_files"]

Solid = Annotated[
    Sphere | Ellipsoid | Superquadric | Cylinder | Cone | RoundedBox | Revolved | Extruded | MeshPart,
    Field(discriminator="shape"),
]
"""A solid object to be held by a hand."""


_FINER = 0.05
"""Share of the default tolerance of a drawing within which a profile is: corners of curves then turn by less than 0.1
rad down to radii of a fiftieth of the size, and are arcs, so that normals of hollows do not jump."""


def put_in_files(document: Document, scene: KeyPath, main: Path) -> None:
    """Replace outline files of the object of a scene, at a path, by polygons, and find the file of its mesh."""
    at = (*scene, "object")
    if child(document.get(scene), "object") is None:
        return
    part = document.part(at)
    if not isinstance(part.value, dict):
        return
    for key in ("profile", "outline"):
        if isinstance(part.value.get(key), dict):
            drawn = not str(part.value[key].get("file")).lower().endswith(".png")
            put_in_outlines(document, (*at, key), main, touches=False, share=_FINER if drawn else 1.0)
    if part.value.get("shape") == "mesh" and isinstance(part.value.get("file"), str):
        file = part.place(("file",)).named_file(part.value["file"], main, "file of a mesh", (*at, "file"))
        part.value["file"] = str(file.resolve())
