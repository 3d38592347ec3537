"""Read curves of SVG drawings: every visible shape, in the unit of the document.

The reader applies every effect that changes the visible shape, or names it: as left out, or as a flaw of nearby shapes.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from continuum_grasp.scene.objects.drawings.curves import DrawnCurve
from continuum_grasp.scene.objects.drawings.drawing import Drawing
from continuum_grasp.scene.objects.drawings.svg_effects import MOVING, Effects, ElementPlace
from continuum_grasp.scene.objects.drawings.svg_geometry import (
    SHAPES,
    box,
    check,
    fitted,
    length,
    named,
    names,
    pieces,
    rectangle,
)  # fmt: skip
from continuum_grasp.scene.objects.drawings.svg_paint import REFERENCES, Paint, Paints, fraction
from continuum_grasp.scene.objects.drawings.svg_shape import DrawnShape
from continuum_grasp.scene.objects.drawings.svg_style import Styles
from continuum_grasp.scene.polygons import PlanePoint

if TYPE_CHECKING:
    from continuum_grasp.scene.objects.outline import OutlineFile

_PIXEL = 0.0254 / 96.0
"""Length of a user unit of SVG [m]: 96 per inch, by CSS."""
_GROUPS = ("g", "a", "switch", "svg")
_VIEWPORTS = ("svg", "symbol")
_NOT_DRAWN = (
    "clipPath", "defs", "desc", "filter", "linearGradient", "marker", "mask", "metadata", "pattern", "radialGradient",
    "style", "symbol", "title", "view",
)  # fmt: skip
"""Elements that are not drawn in place."""
_SPACE = "{http://www.w3.org/2000/svg}"
_Edges = tuple[float, float, float, float]
_MOST = 100_000
"""Greatest number of shapes, with every use of each: uses of uses multiply beyond any bound."""


def read_svg(given: OutlineFile) -> Drawing:
    """Read the shapes that are visible; `ValueError` names an element that cannot be read."""
    from lxml import etree

    root = etree.parse(given.file, etree.XMLParser(no_network=True)).getroot()
    for element in root.iter(etree.Element):
        element.tag = element.tag.removeprefix(_SPACE)
    if root.tag != "svg":
        raise ValueError(f"expected an svg element, got {etree.QName(root).localname[:60]!r}")
    try:
        return _Document(root).drawing()
    except RecursionError:
        raise ValueError("elements inside elements are too many") from None


class _Document:
    def __init__(self, root: Any) -> None:
        self.root = root
        self.targets = {element.get("id"): element for element in root.iter() if element.get("id")}
        self.styles = Styles(root)
        self.paints = Paints(self.target, self.styles.in_place)
        self.ignored: Counter[str] = Counter()
        self._kinds: Counter[str] = Counter()
        self._count = 0
        self.effects = Effects(root, self.target, self.styles, self._alone)

    def drawing(self) -> Drawing:
        """Yield everything that the document shows."""
        style = self.styles.of(self.root, {})
        matrix, viewport, page = self._page(style)
        place = ElementPlace(matrix, viewport, style, (self.root,), fraction(style.get("opacity", "1")))
        if style.get("transform", "none") != "none":
            raise ValueError(f"{named(self.root)}: transform is not read: put it into a group")
        shapes = [shape for child in self.root for shape in self._drawn(child, place)]
        drawing = Drawing(_PIXEL, ignored=self.ignored)
        for shape in self.effects.seen(self.root, place, shapes):
            curves = list(shape.curves())
            drawing.curves += curves if page is None else [_on_page(curve, page) for curve in curves]
            if not curves:
                self.ignored["shape that is not visible"] += 1
        return replace(drawing, page=page)

    def target(self, reference: str) -> Any:
        """Return the element of a reference; None if the file lacks it."""
        return self.targets.get(reference.strip().removeprefix("#")) if reference.strip().startswith("#") else None

    def _page(self, style: dict[str, str]) -> tuple[Any, PlanePoint, _Edges | None]:
        """Return transform and lengths of the outermost viewport, and the page, y up; None without a page."""
        check({"viewBox": self.root.get("viewBox", "")}, named(self.root))
        view = self.root.get("viewBox", "").replace(",", " ").split()
        inner = (float(view[2]), float(view[3])) if len(view) == 4 else (0.0, 0.0)
        width, height = (self._side(style, key) for key in ("width", "height"))
        if all(inner):  # a side that the file does not state follows from the other
            width, height = width or height * inner[0] / inner[1], height or width * inner[1] / inner[0]
        width, height = width or inner[0], height or inner[1]
        page = (0.0, -height, width, 0.0) if width and height else None
        matrix, viewport = fitted(self.root, named(self.root), (0.0, 0.0, width or 100.0, height or 100.0))
        return matrix, viewport, page

    def _side(self, style: dict[str, str], key: str) -> float:
        """Return the width or height of the page [px]; 0 if the viewer decides."""
        for text in (style.get(key), self.root.get(key)):
            check({} if text is None else {key: text}, named(self.root))
            if text is not None and text != "auto" and not text.endswith("%"):
                return length(text, 0.0)
        return 0.0

    def _drawn(self, element: Any, place: ElementPlace) -> list[DrawnShape]:
        """Yield everything that an element shows."""
        if not isinstance(element.tag, str) or "}" in element.tag or not _wanted(element):
            return []
        inside = self._inside(element, place)
        draw = self._drawing_of(element.tag)
        if draw is None:
            if element.tag not in (*_NOT_DRAWN, *MOVING) and inside.style.get("display") != "none":
                self.ignored[element.tag] += 1
            return []
        inside = self._turned(element, inside)
        return self.effects.seen(element, inside, draw(element, inside))

    def _drawing_of(self, tag: str) -> Callable[[Any, ElementPlace], list[DrawnShape]] | None:
        """Return the method that draws elements of a kind; None without one."""
        if tag in SHAPES:
            return self._shape
        return self._used if tag == "use" else self._group if tag in _GROUPS else None

    def _inside(self, element: Any, place: ElementPlace) -> ElementPlace:
        """Return the place with an element's properties; an element in a hidden one is hidden, too."""
        style = self.styles.of(element, place.style)
        if place.style.get("display") == "none":
            style["display"] = "none"
        return replace(place, style=style, opacity=place.opacity * fraction(style.get("opacity", "1")))

    def _turned(self, element: Any, place: ElementPlace) -> ElementPlace:
        """Return the place with an element's transform, which includes x and y of a use."""
        place = place.turned(named(element))
        if element.tag != "use":
            return place
        x, y, _, _ = box(place.style, place.viewport, {})
        return replace(place, matrix=fitted({}, "", (x, y, 0.0, 0.0))[0] * place.matrix)

    def _group(self, element: Any, place: ElementPlace, sized: dict[str, str] | None = None) -> list[DrawnShape]:
        """Yield the children of a group; ``sized`` is the size of a viewport, which a use may state."""
        place = replace(place, within=(*place.within, element))
        edge = None
        if element.tag in _VIEWPORTS:
            sides = box(place.style, place.viewport, sized or {})
            if not (sides[2] > 0.0 and sides[3] > 0.0):
                return []
            if place.style.get("overflow", "hidden") not in ("visible", "auto"):
                edge = rectangle(place.matrix, *sides)
            fit, viewport = fitted(element, named(element), sides)
            place = replace(place, matrix=fit * place.matrix, viewport=viewport)
        children = list(element)
        if element.tag == "switch":
            children = [child for child in children if isinstance(child.tag, str) and "}" not in child.tag]
            children = [child for child in children if child.tag != "foreignObject" and _wanted(child)][:1]
        shapes = [shape for child in children for shape in self._drawn(child, place)]
        return shapes if edge is None else [shape.cut(edge) for shape in shapes]

    def _used(self, element: Any, place: ElementPlace) -> list[DrawnShape]:
        reference = next((element.get(key) for key in REFERENCES if element.get(key)), "")
        target = self.target(reference)
        if target is None or target in place.within:
            self.ignored[f"use of {reference!r}, which is not in the file"] += 1
            return []
        place = replace(place, within=(*place.within, element))
        if target.tag not in _VIEWPORTS:
            return self._drawn(target, place)
        inside = self._turned(target, self._inside(target, place))
        return self.effects.seen(target, inside, self._group(target, inside, self.styles.of(element, {})))

    def _shape(self, element: Any, place: ElementPlace) -> list[DrawnShape]:
        if self._count >= _MOST:
            raise ValueError(f"more than {_MOST} shapes")
        import numpy as np

        self._count += 1
        self._kinds[element.tag] += not place.clips
        ordinal = f"{element.tag} {self._kinds[element.tag]}"
        every = [*names(element), ordinal, *(name for outer in reversed(place.within[1:]) for name in names(outer))]
        label = named(element) if every[0] != ordinal else ordinal
        style = place.style
        parts = pieces(element.tag, style, label, place.viewport, place.matrix)
        shape = DrawnShape(
            label,
            tuple(dict.fromkeys(every)),
            group=tuple(map(id, place.within)),
            source=self._count,
            pieces=parts,
            whole=np.array([point for points, _ in parts for point in points]).reshape(-1, 2),
            rule=style.get("clip-rule" if place.clips else "fill-rule", "nonzero"),
        )
        if style.get("display") == "none":
            return [replace(shape, whole=shape.whole[:0])]
        if style.get("visibility", "visible") in ("hidden", "collapse"):
            return [shape]
        if place.clips:
            return [replace(shape, fill=Paint(0.0, 1.0))]
        fill = self.paints.of(style, "fill", place.opacity)
        stroke = self.paints.of(style, "stroke", place.opacity)
        width = self._width(style, place) if stroke else 0.0
        shape = replace(shape, fill=fill, stroke=stroke if width else None, width=width)
        return [self._marked(element, style, shape)]

    def _width(self, style: dict[str, str], place: ElementPlace) -> float:
        """Return the width of a stroke on the page [px]."""
        width = length(style.get("stroke-width", "1"), math.hypot(*place.viewport) / math.sqrt(2.0))
        fixed = style.get("vector-effect") == "non-scaling-stroke"
        return width * (1.0 if fixed else math.sqrt(abs(place.matrix.determinant)))

    def _marked(self, element: Any, style: dict[str, str], shape: DrawnShape) -> DrawnShape:
        """Return a shape with the gaps and markers of its stroke, which are left out or a flaw."""
        marks = {style.get(key, "none") for key in ("marker-start", "marker-mid", "marker-end")} - {"none"}
        if marks and element.tag in ("path", "line", "polyline", "polygon"):
            if any(closed or (shape.fill and len(points) > 2) for points, closed in shape.pieces):
                return replace(shape, flaw="has markers, which are not read: remove them, or convert them to paths")
            self.ignored[f"marker of {shape.label}"] += 1
        return replace(shape, dashed=bool(re.search("[1-9]", style.get("stroke-dasharray", "none"))))

    def _alone(self, children: list[Any], place: ElementPlace) -> list[DrawnShape]:
        """Draw the shapes of a clip path or a mask; `ValueError` for other contents.

        The shapes do not count in the names of other shapes.
        """
        before, kinds = self.ignored, self._kinds
        self.ignored, self._kinds = Counter(), Counter()
        try:
            shapes = [shape for child in children for shape in self._drawn(child, place)]
            if self.ignored:
                raise ValueError(f"it has {next(iter(self.ignored))}")
            return shapes
        finally:
            self.ignored, self._kinds = before, kinds


def _wanted(element: Any) -> bool:
    """Whether the conditions of an element hold, for a viewer in English without extensions."""
    languages = element.get("systemLanguage")
    english = languages is None or any(one.strip().lower().startswith("en") for one in languages.split(","))
    return english and element.get("requiredExtensions") is None


def _on_page(curve: DrawnCurve, edges: _Edges) -> DrawnCurve:
    """Return the curve; if it is a rectangle as large as the page, a curve inside may be the object."""
    import shapely

    page = shapely.box(*edges)
    if not page.intersects(curve.drawn):
        return replace(curve, aside="outside of the page")
    if not curve.filled or curve.solid.symmetric_difference(page).area > 1e-3 * page.area:
        return curve
    return replace(curve, filled=False, group="page")
