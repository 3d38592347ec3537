"""Outlines of objects from files: a curve of a drawing, points of CSV, silhouettes of PNG."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

from pydantic import Field

from continuum_grasp.base import named_value
from continuum_grasp.scene.curved_parts import SHARE, curved
from continuum_grasp.scene.objects.shapes import MaybeDrawn, ObjectBody, OutlineCurve
from continuum_grasp.scene.objects.simplify import FINER, MOST, deviation, grown, simplified
from continuum_grasp.scene.parts import OffsetPolygon, Part
from continuum_grasp.scene.polygons import PlanePoint, check_simple
from continuum_grasp.scene.problems import KeyedError
from continuum_grasp.scene.units import Unit
from continuum_grasp.scene.value import SAME, Extent, SpatialPosition, Value, Vector3

if TYPE_CHECKING:
    from continuum_grasp.scene.objects.drawings.drawing import Drawing, DrawnOutline

_SMALLEST, _GREATEST = 1e-4, 10.0
"""Sizes of an outline [m] beyond which its unit is likely another one."""
_DRAWINGS = "continuum_grasp.scene.objects.drawings"
MESHES = (".stl", ".obj", ".ply", ".3mf")
_READERS = {
    ".svg": f"{_DRAWINGS}.svg:read_svg",
    ".dxf": f"{_DRAWINGS}.dxf:read_dxf",
    ".csv": f"{_DRAWINGS}.points:read_csv",
    ".png": f"{_DRAWINGS}.picture:read_png",
    **dict.fromkeys(MESHES, f"{_DRAWINGS}.mesh_cut:read_cut"),
}
"""From an `OutlineFile` to the `Drawing` in it, by the ending of its name; loaded, with the library that it takes, with
the first such file. A new form is a line here.
"""


class PlaneCut(Value):
    """Plane that cuts a mesh, in the axes of its file."""

    point: SpatialPosition = (0.0, 0.0, 0.0)
    """A point of the plane, from the origin of the file [m]."""
    normal: Annotated[Vector3, Unit("1")] = (0.0, 0.0, 1.0)
    """Normal of the plane, of any length [1]. The section is seen from the tip of the normal. The x axis of the outline
    is the file's x axis projected onto the plane, or its y axis if x is the normal."""

    def _check(self) -> None:
        if not math.hypot(*self.normal) > 0.0:
            raise ValueError("normal must not be zero")


class OutlineFile(MaybeDrawn):
    """File of an outline, and how it is read."""

    shape: Literal["outline"]
    """The outer closed curve in a file; it becomes a polygon whose frame has its origin at the centroid, y up."""
    file: Annotated[str, Field(examples=["bottle.png"])]
    """SVG (the visible shape), DXF (entities of the model space, joined at common ends), CSV (columns x
    and y, with units in their headings or without headings), PNG (a dark silhouette on a light ground, or an opaque one
    on a transparent ground), or the closed surface of an STL, OBJ, PLY or 3MF, cut to a section by ``cut``."""
    path: str | None = None
    """Curve to choose from several: ``id`` of an SVG element or of a group around it; layer, block or handle of DXF, or
    ``INSERT 33[2]``, the second instance of an array; ``silhouette 2`` of PNG, the second largest. An error that lists
    several curves has a name of each."""
    scale: Annotated[Extent, Field(examples=["1 mm"])] | None = None
    """Length of a unit of the file, or of a pixel [m]; None: 1/96 inch of SVG, what a DXF, a 3MF or the headings of a
    CSV state, 1 m of a CSV without units."""
    tolerance: Annotated[Extent, Field(examples=["0.2 mm"])] | None = None
    """Greatest distance of the polygon from the curve [m]; a greater one takes fewer corners. None: a thousandth of the
    longer side of the curve's bounding box."""
    threshold: Annotated[float, Field(gt=0.0, lt=1.0), Unit("1")] | None = None
    """Least darkness of the object's pixels in a PNG [1]: 0 is white or transparent, 1 is black. None: halfway between
    object and ground, measured next to the edge at 0.5."""
    cut: PlaneCut | None = None
    """Plane whose section of a mesh is the outline; ``path`` chooses one of several: ``section 2``, the second
    largest."""

    @cached_property
    def parts(self) -> tuple[Part, ...]:
        return (curved(OffsetPolygon(self.vertices)),)

    @cached_property
    def found(self) -> DrawnOutline:
        """The curve as the file has it [m], and what else the file has."""
        name = Path(self.file).name
        form = Path(self.file).suffix.lower()
        if form not in _READERS:
            raise ValueError(f"file: expected {', '.join(_READERS)}, got {name}")
        if (self.cut is None) is (form in MESHES):
            needs = "missing; a mesh needs the plane of the section: cut: {point: [0, 0, 0], normal: [0, 0, 1]}"
            raise ValueError(f"cut: {needs if self.cut is None else f'{name} is no mesh: leave it out'}")
        try:
            drawing: Drawing = named_value(_READERS[form])(self)
        except KeyedError:
            raise
        except (OSError, ValueError, SyntaxError) as error:
            raise ValueError(f"file: cannot be read: {name}: {error}") from None
        scale = drawing.unit if self.scale is None else self.scale
        if scale is None:
            raise ValueError(f"scale: missing; {name} does not say how long a unit of it is")
        return drawing.scaled(scale).outline(name, self.path)

    def level(self, normals: Iterable[PlanePoint]) -> Self:
        """Return the outline with sides that lie flat, within the error of a measured one, on supports along some
        normals.
        """
        copy = self.model_copy()
        of_curve = ("curve", "vertices", "drawn", "parts")
        for key in of_curve:
            copy.__dict__.pop(key, None)
        copy.__dict__["found"] = self.found.level(normals)
        return copy

    @property
    def note(self) -> str:
        """Curve that is the outline, its size, and the parts of the file that are left out."""
        rest = f"; left out: {', '.join(self.found.left_out)}" if self.found.left_out else ""
        return f"{self.found.curve.text} of {Path(self.file).name}{rest}"

    @cached_property
    def curve(self) -> tuple[PlanePoint, ...]:
        """Points of the curve as it was read, from its centroid [m]."""
        import shapely

        # In the order of the file: a mirrored one is simplified alike.
        ring = self.found.curve.points
        size = _extent(ring)
        if not _SMALLEST < size < _GREATEST:
            raise ValueError(f"scale: the outline would be {size:.4g} m long; in which unit is the file?")
        center = shapely.Polygon(ring).centroid
        # A billionth of the size, so that written numbers have no digits from rounding.
        digits = 9 - math.ceil(math.log10(size))
        return tuple((round(x - center.x, digits), round(y - center.y, digits)) for x, y in ring)

    @cached_property
    def vertices(self) -> tuple[PlanePoint, ...]:
        """Corners counter-clockwise, from the centroid of the curve [m]."""
        return self.corners()

    @property
    def distance_allowed(self) -> float:
        """Tolerance [m], whether it is stated or a share of the size."""
        return SHARE * _extent(self.curve) if self.tolerance is None else self.tolerance

    @cached_property
    def drawn(self) -> OutlineCurve | None:
        """Curve that the corners approximate; None if they are exact."""
        return self.drawing(self.vertices)

    @property
    def deviation(self) -> float:
        return 0.0 if self.drawn is None else self.drawn.off

    @property
    def outline_error(self) -> float:
        return self.found.error

    def redrawn(self) -> Self:
        return self if self.drawn is None else self.replaced(tolerance=FINER * self.distance_allowed)

    def corners(self, retained: Collection[int] = (), share: float = 1.0) -> tuple[PlanePoint, ...]:
        """Corners of the polygon that is within a share of the tolerance of the curve, with points of it that are
        ``retained``.
        """
        size = _extent(self.curve)
        tolerance = self.distance_allowed
        if self.tolerance is None and self.found.fit is not None:
            retained = {*retained, *self.found.fit.knots}
        corners = simplified(self.curve, share * tolerance, retained)
        if len(corners) < 3 or tolerance > 0.2 * size:
            raise ValueError(f"tolerance: {tolerance:g} m leaves nothing of an outline {size:.4g} m long")
        return corners

    def drawing(self, corners: tuple[PlanePoint, ...], retained: Collection[int] = ()) -> OutlineCurve | None:
        """Return the curve that corners approximate, with the ``retained`` points; None if the corners are exact."""
        error = self.found.error
        off = deviation(self.curve, corners)
        if max(off, error) <= SAME * _extent(self.curve):
            return None
        finer = (self.corners(retained, share) for share in (FINER, 2.0 * FINER))
        nearer = next((f for f in finer if len(f) <= MOST), corners)
        return OutlineCurve(deviation=off, error=error, vertices=grown(nearer, error))

    def polygon(self, retained: Collection[int] = (), share: float = 1.0) -> dict[str, Any]:
        """Return the keys of a polygon that approximates the curve and contains its ``retained`` points.

        The polygon is within the stated tolerance, or within a share of the default one.
        """
        corners = self.corners(retained, share if self.tolerance is None else 1.0)
        drawing = self.drawing(corners, retained)
        drawn = {} if drawing is None else {"drawn": drawing.model_dump(mode="json")}
        return {"shape": "polygon", "vertices": [list(corner) for corner in corners], **drawn}

    def _check(self) -> None:
        check_simple(self.vertices, "tolerance: the outline")


class Outline(OutlineFile, ObjectBody):
    """A closed curve from a file: a drawing, or a silhouette."""


def _extent(curve: Sequence[PlanePoint]) -> float:
    """Longer side of the box around a curve [m]."""
    return max(max(side) - min(side) for side in (tuple(p[k] for p in curve) for k in (0, 1)))
