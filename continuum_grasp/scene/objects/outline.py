"""Outlines of objects from files: shapes of SVG, curves of DXF, points of CSV, silhouettes of PNG."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from continuum_grasp.scene.objects.shapes import ObjectBody
from continuum_grasp.scene.parts import OffsetPolygon, Part, Point, check_simple, corners_of, polygon_centroid
from continuum_grasp.scene.units import Unit
from continuum_grasp.scene.value import Extent, Value

if TYPE_CHECKING:
    from continuum_grasp.scene.objects.drawings.curves import Drawing, DrawnOutline

_SMALLEST, _GREATEST = 1e-4, 10.0
"""Sizes of an outline [m] beyond which its unit is likely another one."""
_FORMS = (".svg", ".dxf", ".csv", ".png")


class OutlineFile(Value):
    """File of an outline, and how it is read."""

    shape: Literal["outline"]
    """The outer closed curve in a file; it becomes a polygon whose frame has its origin at the centroid, y up."""
    file: Annotated[str, Field(examples=["bottle.png"])]
    """SVG (shapes that are visible), DXF (entities of the model space; those that meet are joined), CSV (columns x and
    y, with units in their headings or without headings) or PNG (a dark silhouette on a light ground, or an opaque one
    on a transparent ground)."""
    path: str | None = None
    """Curve to take of several: ``id`` of an SVG element or of a group around it; layer, block or handle of DXF;
    ``silhouette 2`` of PNG, the second largest. An error that lists several curves has a name of each."""
    scale: Annotated[Extent, Field(examples=["1 mm"])] | None = None
    """Length of a unit of the file, or of a pixel [m]; None: 1/96 inch of SVG, what a DXF or the headings of a CSV
    state, 1 m of a CSV without units."""
    tolerance: Annotated[Extent, Field(examples=["0.2 mm"])] = 1e-4
    """Greatest distance of the polygon from the curve [m]; a greater one takes fewer corners."""
    threshold: Annotated[float, Field(gt=0.0, lt=1.0), Unit("1")] = 0.5
    """Darkness of a pixel of a PNG from which on it belongs to the object [1]: 0 white or transparent, 1 black."""

    @cached_property
    def parts(self) -> tuple[Part, ...]:
        return (OffsetPolygon(self.vertices),)

    @cached_property
    def drawn(self) -> DrawnOutline:
        """The curve as the file has it [m], and what else the file has."""
        from continuum_grasp.scene.objects.drawings.curves import outline_in

        name = Path(self.file).name
        if Path(self.file).suffix.lower() not in _FORMS:
            raise ValueError(f"file: expected {', '.join(_FORMS)}, got {name}")
        try:
            drawing = self._read()
        except (OSError, ValueError, SyntaxError) as error:
            raise ValueError(f"file: cannot be read: {name}: {error}") from None
        scale = drawing.unit if self.scale is None else self.scale
        if scale is None:
            raise ValueError(f"scale: missing; {name} does not say how long a unit of it is")
        drawing.curves = [curve.scaled(scale) for curve in drawing.curves]
        return outline_in(drawing, name, self.path)

    @property
    def note(self) -> str:
        """What was read as the outline, its size, and what of the file is not part of it."""
        rest = f"; left out: {', '.join(self.drawn.left_out)}" if self.drawn.left_out else ""
        return f"{self.drawn.curve.text} of {Path(self.file).name}{rest}"

    @cached_property
    def vertices(self) -> tuple[Point, ...]:
        """Corners counter-clockwise, from the centroid [m]."""
        import shapely

        curve = self.drawn.curve
        size = max(curve.size)
        if not _SMALLEST < size < _GREATEST:
            raise ValueError(f"scale: the outline would be {size:.4g} m long; in which unit is the file?")
        simple = corners_of(shapely.Polygon(curve.points).simplify(self.tolerance).exterior.coords[:-1])
        if len(simple) < 3 or self.tolerance > 0.2 * size:
            raise ValueError(f"tolerance: {self.tolerance:g} m leaves nothing of an outline {size:.4g} m long")
        x, y = polygon_centroid(simple)
        return tuple((round(a - x, 9), round(b - y, 9)) for a, b in simple)

    def _read(self) -> Drawing:
        """Curves of the file; a library is loaded with the first file of its form."""
        form = Path(self.file).suffix.lower()
        if form == ".svg":
            from continuum_grasp.scene.objects.drawings.svg import read_svg

            return read_svg(self.file)
        if form == ".dxf":
            from continuum_grasp.scene.objects.drawings.dxf import read_dxf

            return read_dxf(self.file)
        if form == ".png":
            from continuum_grasp.scene.objects.drawings.picture import read_png

            return read_png(self.file, self.threshold)
        from continuum_grasp.scene.objects.drawings.points import read_csv

        return read_csv(self.file, self.scale)

    def _check(self) -> None:
        check_simple(self.vertices, "tolerance: the outline")


class Outline(OutlineFile, ObjectBody):
    """Any closed curve that a file has: a drawing, or a silhouette."""
