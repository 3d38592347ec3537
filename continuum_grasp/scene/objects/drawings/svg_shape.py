"""Painted shapes of SVG: the filled area, and the part that clip paths, masks and viewports leave."""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from continuum_grasp.base import Array
from continuum_grasp.scene.objects.drawings.curves import DrawnCurve, distinct
from continuum_grasp.scene.objects.drawings.svg_paint import Paint
from continuum_grasp.scene.polygons import PlanePoint

Piece = tuple[tuple[PlanePoint, ...], bool]
"""Points of a subpath, and whether it is closed."""


_ROUNDING = 1e-6
"""Relative size of parts that only rounding leaves [1]: far above 16 digits, far below the 1e-4 of chords of curves."""


@dataclass(frozen=True)
class DrawnShape:
    """A shape of a drawing.

    Attributes
    ----------
    label, names, group, source
        As in `DrawnCurve`.
    pieces : tuple of Piece
        Visible subpaths, on the page, y down [px].
    whole : Array
        Points (n, 2) of all subpaths, including clipped ones, or the corners of the box around the shape's group [px].
    rule : str
        ``evenodd`` or ``nonzero``.
    fill, stroke : Paint or None
        None if nothing is painted.
    width : float
        Width of the stroke [px].
    dashed : bool
        Whether the stroke has gaps.
    flaw : str
        Reason why the pieces differ from the visible shape; empty if they do not.
    """

    label: str
    names: tuple[str, ...]
    group: Hashable
    source: Hashable
    pieces: tuple[Piece, ...]
    whole: Array
    rule: str = "nonzero"
    fill: Paint | None = None
    stroke: Paint | None = None
    width: float = 0.0
    dashed: bool = False
    flaw: str = ""

    @cached_property
    def area(self) -> Any:
        """Filled area; a shapely geometry."""
        return filled([points for points, _ in self.pieces if len(points) > 2], self.rule)

    @property
    def lines(self) -> list[Any]:
        """Subpaths as lines; shapely geometries."""
        import shapely

        return [shapely.LineString([*points, *points[:1]] if closed else points) for points, closed in self.pieces]

    @property
    def extent(self) -> float:
        """Longer side of the box around the shape [px]."""
        return float((self.whole.max(axis=0) - self.whole.min(axis=0)).max()) if len(self.whole) else 0.0

    def cut(self, region: Any) -> DrawnShape:
        """Return the part of the shape inside a region."""
        import shapely

        drawn = self.area if self.fill else shapely.union_all(self.lines)
        rounding = _ROUNDING * self.extent
        if region.buffer(rounding).covers(drawn):
            return self
        left = drawn.intersection(region)
        if self.fill:
            pieces = tuple((ring, True) for ring in _rings(left, rounding))
        else:
            pieces = tuple((distinct(line.coords), line.is_ring) for line in _lines(left, rounding))
        return replace(self, pieces=pieces, rule="evenodd", stroke=None if self.fill else self.stroke)

    def curves(self) -> Iterator[DrawnCurve]:
        """Yield each visible subpath, y up."""
        fill, stroke = (_shade(paint) for paint in (self.fill, self.stroke))
        if not (fill or stroke):
            return
        aside = "" if "dark" in (fill, stroke) else "white"
        aside = "dashed" if self.dashed and not fill else aside
        flaw = self.flaw or (self.fill.flaw if self.fill and not stroke else "")
        for k, (points, closed) in enumerate(self.pieces, 1):
            part = f"[{k}]" if len(self.pieces) > 1 else ""
            names = (*(name + part for name in self.names[:2]), *self.names) if part else self.names
            yield DrawnCurve(
                f"{self.label} {part}".strip(),
                tuple(dict.fromkeys(names)),
                tuple((x, -y) for x, y in points),
                closed=len(points) > 2 and (closed or bool(fill)),
                group=self.group,
                source=self.source,
                filled=fill == "dark",
                aside=aside,
                width=self.width if stroke else 0.0,
                flaw=flaw,
            )


def filled(rings: Sequence[Sequence[PlanePoint]], rule: str) -> Any:
    """The area that rings enclose by a rule of SVG; shapely's.

    The lines of all rings divide the plane into faces; a face is filled by the number of turns around a point of it.
    """
    import numpy as np
    import shapely

    if not rings:
        return shapely.Polygon()
    lone = shapely.Polygon(rings[0])
    if len(rings) == 1 and lone.is_valid:
        return lone
    corners = [np.asarray(ring) for ring in rings]
    lines = shapely.union_all([shapely.LineString([*ring, ring[0]]) for ring in rings])
    faces = list(shapely.polygonize([lines]).geoms)
    turns = [round(sum(_turns(ring, face.representative_point()) for ring in corners)) for face in faces]
    return shapely.union_all(
        [face for face, turn in zip(faces, turns, strict=True) if (turn % 2 if rule == "evenodd" else turn)]
    )


def _turns(ring: Array, point: Any) -> float:
    """Number of turns of a ring around a point that is not on it."""
    import numpy as np

    arms = ring - [point.x, point.y]
    after = np.roll(arms, -1, axis=0)
    sines = arms[:, 0] * after[:, 1] - arms[:, 1] * after[:, 0]
    return float(np.arctan2(sines, (arms * after).sum(axis=1)).sum() / (2.0 * np.pi))


def masked(shapes: Sequence[DrawnShape], by_alpha: bool) -> Any:
    """The region that a mask leaves visible, painted by its shapes in their order; shapely's."""
    import shapely

    region = shapely.Polygon()
    for shape in shapes:
        flaw = shape.flaw or (shape.fill.flaw if shape.fill else "")
        if not by_alpha and shape.fill and not (shape.fill.even and shape.fill.light in (0.0, 1.0)):
            flaw = "is neither black nor white"
        if shape.fill and (by_alpha or shape.fill.light > 0.0):
            region = region.union(shape.area)
        elif shape.fill and shape.fill.alpha == 1.0:
            region = region.difference(shape.area)
        if shape.stroke and (by_alpha or shape.stroke.light > 0.0 or _covers_a_part(shape, region)):
            flaw = flaw or "is a stroke"
        if flaw:
            raise ValueError(f"{shape.label}, which {flaw}")
    return region


def _covers_a_part(shape: DrawnShape, region: Any) -> bool:
    """Whether the stroke of a shape lies on a part of a region."""
    import shapely

    band = shapely.union_all(shape.lines).buffer(0.5 * shape.width)
    return not band.intersection(region).buffer(-_ROUNDING * shape.width).is_empty


def _rings(area: Any, rounding: float) -> Iterator[tuple[PlanePoint, ...]]:
    """Yield the boundaries of all parts of an area that are thicker than rounding errors."""
    for part in getattr(area, "geoms", [area]):
        if part.geom_type == "Polygon" and not part.buffer(-rounding).is_empty:
            for ring in (part.exterior, *part.interiors):
                yield distinct((float(x), float(y)) for x, y in ring.coords[:-1])


def _lines(drawn: Any, rounding: float) -> list[Any]:
    """Return the lines of a geometry that are longer than rounding errors; lines that meet at their ends are joined."""
    import shapely

    every = getattr(drawn, "geoms", [drawn])
    parts = [part for part in every if part.geom_type == "LineString" and part.length > rounding]
    merged = shapely.line_merge(shapely.MultiLineString(parts))
    return list(getattr(merged, "geoms", [merged])) if parts else []


def _shade(paint: Paint | None) -> str:
    """``dark``, ``white`` like the paper, or empty without paint."""
    if paint is None:
        return ""
    return "white" if paint.light == 1.0 else "dark"
