"""Curves of DXF drawings: entities of the model space that are visible, blocks expanded."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from continuum_grasp.scene.objects.drawings.curves import DrawnCurve, distinct
from continuum_grasp.scene.objects.drawings.drawing import Drawing
from continuum_grasp.scene.value import WRITTEN

if TYPE_CHECKING:
    from continuum_grasp.scene.objects.outline import OutlineFile

_UNITS = {
    1: 0.0254, 2: 0.3048, 3: 1609.344, 4: 1e-3, 5: 1e-2, 6: 1.0, 7: 1e3, 8: 2.54e-8, 9: 2.54e-5, 10: 0.9144, 11: 1e-10,
    12: 1e-9, 13: 1e-6, 14: 0.1, 15: 10.0, 16: 100.0, 21: 1200 / 3937, 22: 100 / 3937, 23: 3600 / 3937,
    24: 6336000 / 3937,
}  # fmt: skip
"""Length of a unit by ``$INSUNITS`` [m]; ezdxf has no mils and no survey units. Those beyond a planet are left out."""
_CURVES = ("LINE", "ARC", "CIRCLE", "ELLIPSE", "SPLINE", "HELIX", "LWPOLYLINE", "POLYLINE")
_CHORD = 1e-5
"""Distance of chords from a curve as a part of its size [1]: a hundredth of a tolerance of 0.1 mm on 100 mm."""


def read_dxf(given: OutlineFile) -> Drawing:
    """Read visible entities of the model space; `ValueError` names layer and handle of an entity that cannot be
    read.
    """
    import ezdxf
    import ezdxf.recover

    try:
        try:
            document = ezdxf.readfile(given.file)  # type: ignore[attr-defined]
        except ezdxf.DXFStructureError:  # type: ignore[attr-defined]
            document, _ = ezdxf.recover.readfile(given.file)
    except ezdxf.DXFError as error:  # type: ignore[attr-defined]
        raise ValueError(str(error)) from None
    stated = b"$INSUNITS" in Path(given.file).read_bytes()  # ezdxf takes meters for a file without a header
    drawing = Drawing(
        _UNITS.get(document.units) if stated else None,
        advice="choose one by path (a layer, block or INSERT, or a handle)",
    )
    for entity, at in _visible(document, document.modelspace(), drawing.ignored, _Instance()):
        if (curve := _curve(entity, at, drawing.ignored)) is not None:
            drawing.curves += _clipped(curve, at)
    for layout in document.layouts:
        if not layout.is_modelspace and (count := sum(entity.dxftype() != "VIEWPORT" for entity in layout)):
            drawing.ignored[f"entity of the paper space {layout.name!r}"] += count
    return drawing


@dataclass(frozen=True)
class _Instance:
    """Place of an entity: in the model space, or in an instance of an inserted block.

    Attributes
    ----------
    layer : str
        Layer of the entities that are on layer 0 of the block.
    blocks : tuple of str
        Blocks around it, the outermost first.
    handles : tuple of str
        Handle of each reference to the blocks, with the number of the instance in an array: ``2F[3]``.
    clips : tuple of (str, ClippingPath)
        Clipping boundaries, in words and as paths.
    """

    layer: str = "0"
    blocks: tuple[str, ...] = ()
    handles: tuple[str, ...] = ()
    clips: tuple[tuple[str, Any], ...] = ()

    def names(self, kind: str, handle: str, layer: str) -> tuple[str, ...]:
        """Return the names of an entity and of all instances around it."""
        around: list[str] = []
        for depth in range(len(self.blocks), 0, -1):
            reference = self.handles[depth - 1].partition("[")[0]
            around += [f"INSERT {'/'.join(self.handles[:depth])}", self.blocks[depth - 1], reference]
        full = f"{kind} {'/'.join((*self.handles, handle))}"
        return tuple(dict.fromkeys((f"{kind} {handle}", *around, handle, layer, full)))


def _visible(
    document: Any, entities: Iterable[Any], ignored: Counter[str], at: _Instance
) -> Iterator[tuple[Any, _Instance]]:
    """Yield the visible entities, each with its layer and its instance of a block.

    An entity on layer 0 of a block has the layer of its reference. A reference on a layer that is off still shows the
    entities of other layers; on a frozen layer it shows nothing.
    """
    for entity in entities:
        own = str(entity.dxf.layer)
        own = at.layer if at.blocks and own == "0" else own
        hidden = _hidden(document, own)
        if entity.dxf.get("invisible", 0):
            ignored["invisible entity"] += 1
        elif hidden and (entity.dxftype() != "INSERT" or hidden == "frozen"):
            ignored[f"entity on layer {own!r}, which is {hidden}"] += 1
        elif entity.dxftype() == "INSERT":
            yield from _expanded(document, entity, ignored, replace(at, layer=own))
        else:
            yield entity, replace(at, layer=own)


def _expanded(document: Any, insert: Any, ignored: Counter[str], at: _Instance) -> Iterator[tuple[Any, _Instance]]:
    """Yield the entities of each instance of a block."""
    from ezdxf.xclip import XClip

    name = str(insert.dxf.name)
    block = insert.block()
    if block is None or block.block.is_xref:
        ignored[f"block {name!r}, which is in another file"] += 1
        return
    handle = _handle(insert)
    cut = XClip(insert)
    if cut.is_clipping_enabled:
        by = f"the boundary of block {name!r} on layer {at.layer!r} (INSERT {handle})"
        at = replace(at, clips=(*at.clips, (by, cut.get_wcs_clipping_path())))
    if insert.attribs:
        ignored["ATTRIB"] += len(insert.attribs)
    several = list(insert.multi_insert()) if insert.mcount > 1 else [insert]
    for k, single in enumerate(several, 1):
        reference = f"{handle}[{k}]" if len(several) > 1 else handle
        inside = replace(at, blocks=(*at.blocks, name), handles=(*at.handles, reference))
        yield from _visible(document, single.virtual_entities(), ignored, inside)


def _clipped(curve: DrawnCurve, at: _Instance) -> list[DrawnCurve]:
    """Return the curve within the boundaries of blocks: whole, None, or with a flaw."""
    import shapely

    for by, boundary in at.clips:
        region = shapely.make_valid(shapely.Polygon(boundary.vertices))
        outside = region.disjoint(curve.drawn)
        if not outside and (boundary.is_inverted_clip or not region.covers(curve.drawn)):
            return [replace(curve, flaw=f"is cut by {by}, which is not read: cut it, or remove the boundary")]
        if outside is not boundary.is_inverted_clip:
            return []
    return [curve]


def _hidden(document: Any, name: str) -> str:
    """Return the reason why a layer is not drawn; empty for a visible layer."""
    if not document.layers.has_entry(name):
        return ""
    layer = document.layers.get(name)
    if layer.is_frozen():
        return "frozen"
    if layer.is_off():
        return "off"
    return ""


def _curve(entity: Any, at: _Instance, ignored: Counter[str]) -> DrawnCurve | None:
    from ezdxf.path import make_path

    kind = entity.dxftype()
    handle = _handle(entity)
    if kind not in _CURVES or (kind == "POLYLINE" and not (entity.is_2d_polyline or entity.is_3d_polyline)):
        ignored[kind] += 1
        return None
    inside = f" of block {at.blocks[-1]!r}" if at.blocks else ""
    label = f"{kind} {handle} on layer {at.layer!r}{inside}"
    names = at.names(kind, handle, at.layer)
    if kind == "POLYLINE":  # a frame of control points is not part of the curve
        entity.vertices[:] = [vertex for vertex in entity.vertices if not vertex.dxf.flags & 16]
    try:
        # Eight Bézier curves per arc of a bulge, a quarter or a span of a spline: they are off by less than 1e-8.
        curve = make_path(entity, segments=8, level=8)
    except (TypeError, ValueError, ArithmeticError) as error:
        raise ValueError(f"{label} cannot be read: {error}") from None
    if not len(curve):
        return None
    corners = curve.control_vertices()
    spans = [max(axis) - min(axis) for axis in zip(*((p.x, p.y, p.z) for p in corners), strict=True)]
    size = max(spans)
    if size <= 0.0:
        return None
    flaw = "is not in a plane of constant z: draw it in the plane of x and y" if spans[2] > WRITTEN * size else ""
    points = distinct((p.x, p.y) for p in curve.flattening(_CHORD * size))
    if len(points) < 2:
        return None
    group = (at.layer, at.handles)
    return DrawnCurve(label, names, points, curve.is_closed, group, width=_width(entity), flaw=flaw)


def _width(entity: Any) -> float:
    """Return the greatest width of a polyline in the drawing; line weights only affect the paper."""
    if entity.dxftype() == "LWPOLYLINE":
        widths = [width for point in entity.get_points("se") for width in point]
        return float(max([*widths, entity.dxf.get("const_width", 0.0)]))
    if entity.dxftype() == "POLYLINE":
        keys = ("start_width", "end_width")
        own = [entity.dxf.get(f"default_{key}", 0.0) for key in keys]
        return float(max([*own, *(vertex.dxf.get(key, 0.0) for vertex in entity.vertices for key in keys)]))
    return 0.0


def _handle(entity: Any) -> str:
    """Return the handle of an entity, or of its original in a block."""
    origin = entity.origin_of_copy
    return str(entity.dxf.handle or (origin.dxf.handle if origin is not None else None) or "without handle")
