"""Outlines that configurations name in files, replaced by polygons when these are read."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from continuum_grasp.base import InputError
from continuum_grasp.scene.document import Document, KeyPath, child, dotted
from continuum_grasp.scene.objects.outline import OutlineFile
from continuum_grasp.scene.objects.shapes import MemberPlace, ObjectBody
from continuum_grasp.scene.placement import Supported
from continuum_grasp.scene.polygons import PlanePoint
from continuum_grasp.scene.problems import validated
from continuum_grasp.scene.supports import Place, Wall
from continuum_grasp.scene.value import WRITTEN


def put_in_object(document: Document, at: KeyPath, main: Path) -> None:
    """Replace the outline file of a scene's object, at a path of a document, by a polygon."""
    if child(document.get(at), "object") is not None:
        put_in_outlines(document, (*at, "object"), main)


def put_in_outlines(document: Document, body: KeyPath, main: Path, *, touches: bool = True, share: float = 1.0) -> None:
    """Replace the outline file of an object, or of members of a union, by a polygon, unless its keys vary.

    Without ``tolerance`` the polygon is within a share of the default tolerance of the curve. If the object
    ``touches`` supports, the points of the curve nearest to them become corners.
    """
    part = document.part(body)
    if not isinstance(part.value, dict):
        return
    members = part.value.get("members")
    for k in range(len(members) if isinstance(members, list) else 0):
        put_in_outlines(document, (*body, "members", k), main, touches=touches)
    if part.value.get("shape") != "outline" or not isinstance(part.value.get("file"), str):
        return
    file = part.place(("file",)).named_file(part.get(("file",)), main, "file of an outline", (*body, "file"))
    if any("object" in key[:-1] and key[-1] in OutlineFile.model_fields for key in document.varied):
        part.value["file"] = str(file.resolve())
        return
    others = ObjectBody.model_fields
    rest = {key: value for key, value in part.value.items() if key in others}
    part.value = {key: value for key, value in part.value.items() if key not in others} | {"file": str(file)}
    try:
        outline = validated(part, OutlineFile)
    except InputError as error:
        key = f"{dotted(body)}.{error.key}" if error.key else dotted(body)
        raise InputError(error.message, file=error.file, line=error.line, column=error.column, key=key) from None
    document.notes.append(f"{dotted(body)}: {outline.note}")
    at = body.index("object")
    frames = [document.get(body[: at + 1]), *([rest] if body[at + 1 :] else [])]
    supports = document.get(body[:at]).get("supports") if touches else None
    places, frame = _placed(supports, frames)
    outline = outline.level(_facing(places, frame))
    polygon = outline.polygon(_touching(outline.curve, places, frame), share)
    # That of the curve, not of the polygon.
    mass = {} if body[at + 1 :] else {"center_of_mass": [0.0, 0.0]}
    document.put(body, Document(polygon | mass | rest, part.places))


def _placed(supports: Any, frames: Sequence[Any]) -> tuple[Sequence[Place], tuple[float, float, float]]:
    """Return the supports of a configuration, and the world pose of an outline.

    ``frames`` have ``position`` and ``angle`` of the object and, for a member of a union, of the member in it. The
    validation of the whole scene reports faults in them.
    """
    x, y, angle = 0.0, 0.0, 0.0
    try:
        around = Supported.model_validate({"supports": supports or {}})
        for frame in frames:
            at = MemberPlace.model_validate({key: frame[key] for key in ("position", "angle") if key in frame})
            c, s = math.cos(angle), math.sin(angle)
            x = x + c * at.position[0] - s * at.position[1]
            y = y + s * at.position[0] + c * at.position[1]
            angle += at.angle
    except ValidationError:
        return (), (0.0, 0.0, 0.0)
    return around.places, (x, y, angle)


def _facing(places: Sequence[Place], frame: tuple[float, float, float]) -> list[PlanePoint]:
    """Return the directions from a frame toward walls."""
    angles = [wall.normal_angle + math.pi - frame[2] for wall in places if isinstance(wall, Wall)]
    return [(math.cos(angle), math.sin(angle)) for angle in angles]


def _touching(curve: Sequence[PlanePoint], places: Sequence[Place], frame: tuple[float, float, float]) -> set[int]:
    """Indices of the points of a curve nearest to supports."""
    x, y, angle = frame
    c, s = math.cos(angle), math.sin(angle)
    points = [(x + c * px - s * py, y + s * px + c * py) for px, py in curve]
    touching = set[int]()
    for place in places:
        away = place.height if isinstance(place, Wall) else partial(math.dist, place.position)
        distances = [away(point) for point in points]
        near = min(distances) + WRITTEN * max(math.dist((x, y), point) for point in points)
        touching |= {k for k, distance in enumerate(distances) if distance <= near}
    return touching
