"""Outlines of objects from files: paths of SVG, polylines of DXF, points of CSV, silhouettes of PNG."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from continuum_grasp.scene.objects.shapes import Drawing, ObjectBody
from continuum_grasp.scene.objects.simplify import FINER, MOST, SHARE, deviation, simplified
from continuum_grasp.scene.parts import OffsetPolygon, Part, Point, check_simple
from continuum_grasp.scene.units import Unit
from continuum_grasp.scene.value import SAME, Extent, Value

_SMALLEST, _GREATEST = 1e-4, 10.0
"""Sizes of an outline [m] beyond which its unit is likely another one."""
_CURVE = 48
"""Chords of a curve of an SVG path, before it is simplified: they keep a half circle to 0.05 % of its radius."""

Ring = tuple[str, list[Point]]
"""Name of a closed curve in its file, and its points there."""


class OutlineFile(Value):
    """File of an outline, and how it is read."""

    shape: Literal["outline"]
    """A closed curve in a file; it becomes a polygon whose frame has its origin at the centroid, y up."""
    file: Annotated[str, Field(examples=["bottle.png"])]
    """SVG (a path or shape), DXF (a closed polyline, spline, circle or ellipse), CSV (two columns, with or without a
    line of names) or PNG (a dark silhouette on a light or transparent ground)."""
    path: str | None = None
    """Curve to take of several: ``id`` of an SVG path, or the layer of a DXF entity."""
    scale: Annotated[Extent, Field(examples=["1 mm"])] | None = None
    """Length of a unit of the file, or of a pixel [m]; None: 1/96 inch of SVG, what a DXF states, 1 m of CSV."""
    tolerance: Annotated[Extent, Field(examples=["0.2 mm"])] | None = None
    """Greatest distance of the polygon from the curve [m]; a greater one takes fewer corners. None: a thousandth of the
    longer side of what the curve fills."""
    threshold: Annotated[float, Field(gt=0.0, lt=1.0), Unit("1")] = 0.5
    """Darkness of a pixel of a PNG from which on it belongs to the object [1]: 0 white or transparent, 1 black."""

    @cached_property
    def parts(self) -> tuple[Part, ...]:
        return (OffsetPolygon(self.vertices),)

    @cached_property
    def vertices(self) -> tuple[Point, ...]:
        """Corners counter-clockwise, from the centroid of the curve [m]."""
        return self.corners()

    @property
    def distance_allowed(self) -> float:
        """The tolerance [m], also where it is a share of the size."""
        return SHARE * _extent(self.curve) if self.tolerance is None else self.tolerance

    @cached_property
    def drawn(self) -> Drawing | None:
        """Curve that the corners stand for, where they are not exact."""
        return self.drawing(self.vertices)

    def corners(self, retained: Collection[int] = (), share: float = 1.0) -> tuple[Point, ...]:
        """Corners of the polygon that is within a share of the tolerance of the curve, with points of it that are
        ``retained``.
        """
        size, tolerance = _extent(self.curve), self.distance_allowed
        corners = simplified(self.curve, share * tolerance, retained)
        if len(corners) < 3 or tolerance > 0.2 * size:
            raise ValueError(f"tolerance: {tolerance:g} m leaves nothing of an outline {size:.4g} m long")
        return corners

    def drawing(self, corners: tuple[Point, ...], retained: Collection[int] = ()) -> Drawing | None:
        """Curve that some corners stand for, with the ``retained`` points too; None where they are exact."""
        off = deviation(self.curve, corners)
        if off <= SAME * _extent(self.curve):
            return None
        # Noise of a picture has corners without end.
        finer = (self.corners(retained, share) for share in (FINER, 2.0 * FINER))
        return Drawing(deviation=off, vertices=next((f for f in finer if len(f) <= MOST), corners))

    def polygon(self, retained: Collection[int] = ()) -> dict[str, Any]:
        """Keys of the polygon that stands for the curve, with points of it that are ``retained``."""
        corners = self.corners(retained)
        drawing = self.drawing(corners, retained)
        drawn = {} if drawing is None else {"drawn": drawing.model_dump(mode="json")}
        return {"shape": "polygon", "vertices": [list(corner) for corner in corners], **drawn}

    @cached_property
    def curve(self) -> tuple[Point, ...]:
        """Points of the curve as it was read, from its centroid [m]."""
        read = _READERS.get(Path(self.file).suffix.lower())
        if read is None:
            raise ValueError(f"file: expected {', '.join(_READERS)}, got {Path(self.file).name}")
        try:
            unit, rings = read(self)
        except (OSError, ValueError, SyntaxError) as error:
            raise ValueError(f"file: cannot be read: {error}") from None
        if self.path is not None:
            known = ", ".join(sorted({name for name, _ in rings})) or "none"
            rings = [ring for ring in rings if ring[0] == self.path]
            if not rings:
                raise ValueError(f"path: no closed curve {self.path!r} in the file, which has {known}")
        scale = unit if self.scale is None else self.scale
        if scale is None:
            raise ValueError("scale: missing; the file does not say how long a unit of it is")
        return _only([(name, [(x * scale, y * scale) for x, y in ring]) for name, ring in rings])

    def _check(self) -> None:
        check_simple(self.vertices, "tolerance: the outline")


class Outline(OutlineFile, ObjectBody):
    """Any closed curve that a file has: a drawing, or a silhouette."""


def _only(rings: list[Ring]) -> tuple[Point, ...]:
    """The one closed curve of several that is an outline, from its centroid [m]."""
    import shapely

    if not rings:
        raise ValueError("file: no closed curve in it: expected one that ends where it begins")
    for name, ring in rings:
        check_simple(ring, f"file: the curve {name!r}" if name else "file: the curve")
    solids = sorted((shapely.Polygon(ring) for _, ring in rings), key=lambda solid: -solid.area)
    inner = [other.representative_point() for other in solids[1:]]
    if holes := [at for at in inner if solids[0].contains(at)]:
        where = f"({holes[0].x:.4g}, {holes[0].y:.4g}) m"
        raise ValueError(f"file: the outline has a hole at {where} (as scaled): fill it, or choose one curve by path")
    if inner:
        names = ", ".join(repr(name) for name, _ in rings)
        raise ValueError(f"file: {len(rings)} closed curves ({names}): expected one; choose by path")
    ring = solids[0].exterior.coords[:-1]  # in the order of the file: a mirrored one is simplified alike
    size = _extent(ring)
    if not _SMALLEST < size < _GREATEST:
        raise ValueError(f"scale: the outline would be {size:.4g} m long; in which unit is the file?")
    center = solids[0].centroid
    # A billionth of the size: numbers as they are written have no digits of rounding.
    digits = 9 - math.ceil(math.log10(size))
    return tuple((round(x - center.x, digits), round(y - center.y, digits)) for x, y in ring)


def _extent(curve: Sequence[Point]) -> float:
    """Longer side of the box around a curve [m]."""
    return max(max(side) - min(side) for side in (tuple(p[k] for p in curve) for k in (0, 1)))


def _from_svg(shape: OutlineFile) -> tuple[float | None, list[Ring]]:
    import svgelements

    rings: list[Ring] = []
    for element in svgelements.SVG.parse(shape.file).elements():
        if not isinstance(element, svgelements.Shape):
            continue
        for piece in svgelements.Path(element).as_subpaths():
            path = svgelements.Path(piece)
            points = [path.first_point]
            for segment in path:
                straight = isinstance(segment, svgelements.Line | svgelements.Close | svgelements.Move)
                points += [segment.point((k + 1) / _CURVE) for k in range(_CURVE)] if not straight else [segment.end]
            if isinstance(path[-1], svgelements.Close) or abs(points[0] - points[-1]) < _JOINED * path.length():
                rings.append((element.id or "", _once([(p.x, -p.y) for p in points if p is not None])))
    # 0.0254 / 96.0: a user unit of SVG [m]: 96 per inch, by CSS
    return (0.0254 / 96.0), rings


def _from_dxf(shape: OutlineFile) -> tuple[float | None, list[Ring]]:
    import ezdxf
    from ezdxf import path
    from ezdxf.enums import InsertUnits
    from ezdxf.units import conversion_factor

    try:
        drawing = ezdxf.readfile(shape.file)  # type: ignore[attr-defined]
    except ezdxf.DXFError as error:  # type: ignore[attr-defined]
        raise ValueError(str(error)) from None
    unit = conversion_factor(InsertUnits(drawing.units), InsertUnits.Meters) if drawing.units else None
    rings = []
    for entity in drawing.modelspace().query("LWPOLYLINE POLYLINE SPLINE CIRCLE ELLIPSE"):
        curve = path.make_path(entity)
        if curve.is_closed:
            size = max(curve.control_vertices()[0].distance(p) for p in curve.control_vertices())
            chord = 0.1 * (shape.tolerance / (shape.scale or unit or 1.0) if shape.tolerance else SHARE * size)
            rings.append((str(entity.dxf.layer), _once([(p.x, p.y) for p in curve.flattening(chord)])))
    return unit, rings


def _from_csv(shape: OutlineFile) -> tuple[float | None, list[Ring]]:
    from continuum_grasp.scene.table import read_table

    table = read_table(shape.file, ("x", "y"))
    points = _once(list(zip(table.numbers("x").tolist(), table.numbers("y").tolist(), strict=True)))
    return 1.0, [("", points)] if len(points) > 2 else []


def _from_png(shape: OutlineFile) -> tuple[float | None, list[Ring]]:
    import contourpy
    import numpy as np
    from PIL import Image

    with Image.open(shape.file) as image:
        gray, alpha = np.moveaxis(np.asarray(image.convert("LA"), dtype=float) / 255.0, 2, 0)
    # A ground round the image closes what its edge cuts off.
    dark = np.pad((1.0 - gray) * alpha, 1)
    lines: Any = contourpy.contour_generator(z=dark[::-1]).lines(shape.threshold)
    return None, [("", _once([(float(x), float(y)) for x, y in line])) for line in lines]


_JOINED = 1e-6
"""Gap between the ends of a curve, as a part of its length, up to which it is closed."""
_READERS: dict[str, Callable[[OutlineFile], tuple[float | None, list[Ring]]]] = {
    ".svg": _from_svg,
    ".dxf": _from_dxf,
    ".csv": _from_csv,
    ".png": _from_png,
}


def _once(points: list[Point]) -> list[Point]:
    """Points without repeated ones, and without the last where it is the first."""
    size = max(math.dist(points[0], p) for p in points) if points else 0.0
    distinct: list[Point] = []
    for point in points:
        if not distinct or math.dist(point, distinct[-1]) > _JOINED * size:
            distinct.append(point)
    return distinct[:-1] if len(distinct) > 1 and math.dist(distinct[0], distinct[-1]) <= _JOINED * size else distinct
